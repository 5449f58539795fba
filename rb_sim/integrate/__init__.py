"""Stepping loops and methods, compiled once for all scenes; they call laws by address."""
