"""Where samples go and come from: messages, bags, plots, Rerun recordings."""
