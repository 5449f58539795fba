"""Rows of the work array, n numbers each, that every step finds."""

from __future__ import annotations

VELOCITY = 0
"""1 where the coordinate is a velocity, 0 where it is configuration."""
AT = 1
"""the argument of a stage; free between two calls."""
DY = 2
"""the increment."""
SLOPES = 3
"""first of SLOPE_ROWS rows for the slopes of the stages."""
SLOPE_ROWS = 16
WORK_ROWS = SLOPES + SLOPE_ROWS
