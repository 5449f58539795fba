"""Continuations of a motion, computed beside the run: where it goes, and whether it can."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.checks.singular_configuration import Conditioning
from rb_sim.contact.choose_motion import motion_of

if TYPE_CHECKING:
    from rb_sim.checks.singular_configuration import DeadPoint
    from rb_sim.mechanics.samples import Array
    from rb_sim.motion.motion import Motion


# How a motion goes on from where it is, by another one beside it.


MOST_LOOKS = 100
"""Times that the motion beside is asked whether to go on, every some thousand steps, before it is
given up."""


def rows_ahead(run: Motion, times: Array) -> Array | None:
    """Rows of samples at the times, as `run` would have them, which stays as it is.

    None where the motion does not come so far, or takes too long, and with contacts, whose modes
    the motion beside would have to choose anew.
    """
    if run.layout.contacts:
        return None
    beside, looks = motion_of(run.compiled, run.method), 0

    def look() -> None:
        nonlocal looks
        looks += 1
        if looks > MOST_LOOKS:
            raise SimulationError("the comparison motion takes too long")

    out = np.zeros((len(times), beside.width))
    try:
        beside.reset_beside(run, run.coordinates, run.time)
        if run.layout.commanded:
            beside.change_law(run.system)
        beside.watch = look
        beside.run_to(times, out)
    except SimulationError:
        return None
    return out


# Whether a motion that cannot go on has come to a dead point, which no step mends.
#
# There s of `singular_configuration` falls to zero: as |x| where the motion passes a change point,
# as the root of x where a drive comes to the end of its way.  The last states tell
# which of the two, and where.


LAST, BETWEEN = 4, 8
"""Samples, and states between the last of them and the end of the last step, that are looked at."""

STEPS = 2.0
"""Steps after the last state in which s has to come to zero, fixed ones, or of those states."""


def dead_end(simulation: Any, t: Array, rows: Array) -> DeadPoint | None:
    """The singular configuration at which the run of a Simulation has failed, if it is one.

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
