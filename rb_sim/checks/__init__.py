"""Accuracy checks of every run: a second run, balances, constraints, steps."""
