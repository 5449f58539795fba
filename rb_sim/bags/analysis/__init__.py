"""Analysis of recorded bags: ours, and those of anybody with poses in them."""
