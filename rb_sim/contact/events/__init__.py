"""Motion cut into pieces at events: impacts, and which contacts open, slip, stick or roll."""
