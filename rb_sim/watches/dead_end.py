"""Whether a motion that cannot go on has come to a dead point, which no step mends.

There s of `dead_point` falls to zero: as |x| where the motion passes a change point, as the root of
x where a drive comes to the end of its way.  The last states tell which of the two, and where.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.ahead import rows_ahead
from rb_sim.watches.dead_point import Conditioning

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array
    from rb_sim.watches.dead_point import DeadPoint

LAST, BETWEEN = 4, 8
"""Samples, and states between the last of them and the end of the last step, that are looked at."""

STEPS = 2.0
"""Steps after the last state in which s has to come to zero, fixed ones, or of those states."""


def dead_end(simulation: Any, t: Array, rows: Array) -> DeadPoint | None:
    """The dead point at which the run of a Simulation has failed, if it is one.

    t, rows: its last samples.
    """
    watch = Conditioning(simulation.scene, simulation.layout, simulation.compiled)
    if not watch.watching or not len(t):
        return None
    run = simulation._motion
    t, rows = t[-LAST:], rows[-LAST:]
    end, step = run.frontier
    if end > t[-1]:
        between = np.linspace(t[-1], end, BETWEEN + 1)[1:]
        found = rows_ahead(run, between)
        if found is not None:
            t, rows = np.append(t, between), np.append(rows, found, 0)
    width = 13 * len(simulation.layout.bodies)
    with np.errstate(all="ignore"):
        s, line = watch.shares(t, rows[:, :width])
    at = zero_of(t, s, end + STEPS * (getattr(run.method, "step", None) or step))
    return None if at is None else watch.told(at, float(s[-1]), int(line[-1]))


def zero_of(t: Array, s: Array, until: float) -> float | None:
    """Where s (n,), falling over three of the times in turn, comes to zero not after `until`."""
    for k in range(len(t) - 3, -1, -1):
        (a, b, c), times = s[k : k + 3], t[k : k + 3]
        if not (a > b > c and np.isfinite(a)):
            continue
        by = [_line(times, np.array([a, b, c]) ** power) for power in (1, 2)]
        _, at = min(by)
        if times[2] <= at <= max(until, times[2] + STEPS * (times[2] - times[1])):
            return at
    return None


def _line(t: Array, x: Array) -> tuple[float, float]:
    """By how much the third place is off the line through the other two, over what it falls; where
    the line through the last two is zero."""
    slope, last = np.diff(x) / np.diff(t)
    off = abs(last - slope) / abs(last)
    return float(off), float(t[2] - x[2] / last)
