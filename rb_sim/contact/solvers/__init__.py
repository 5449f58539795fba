"""Solvers of the friction problem, one to a file."""
