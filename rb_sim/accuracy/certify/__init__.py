"""The error of one run, certified by runs of another method and on another grid of steps."""
