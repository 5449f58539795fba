"""Measurements of rb_sim: steps, start, memory, and beside other programs. See README.md."""
