"""Rows of the work array, n numbers each, that every step finds."""

from __future__ import annotations

from rb_sim.loops.compiled import helper

VELOCITY = 0
"""1 where the coordinate is a velocity, 0 where it is configuration."""
FLOOR = 1
"""size of a coordinate below which its error is no longer relative to it but to this."""
START = 2
"""what a coordinate is counted from."""
SHARE = 3
"""share of its way from there to which its error is relative."""
AT = 4
"""the argument of a stage; free between two calls."""
DY = 5
"""the increment."""
SLOPES = 6
"""first of SLOPE_ROWS rows for the slopes of the stages."""
SLOPE_ROWS = 16
WORK_ROWS = SLOPES + SLOPE_ROWS


@helper
def size_of(n, y, work, m):
    """The size to which the error of coordinate m is relative."""
    way = work[SHARE * n + m] * abs(y[m] - work[START * n + m])
    return max(work[FLOOR * n + m], way)
