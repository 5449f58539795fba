"""Vectors, linear systems, cones and complementarity, and how functions are marked for
compiling."""
