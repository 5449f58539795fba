"""Vectors, linear systems, cones, complementarity, and the marks of compiled functions."""
