"""Continuations of a motion, computed beside the run: where it goes, and whether it can."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.checks.singular_configuration import Conditioning
from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.system import CONFIGURATION
from rb_sim.mechanics.systems.many_bodies import WIDTH

if TYPE_CHECKING:
    from rb_sim.checks.singular_configuration import DeadPoint
    from rb_sim.mechanics.samples import Array
    from rb_sim.motion.motion import Motion


# How a motion goes on from where it is, or from its start once more, by another one beside it.


VELOCITIES = 7
"""Of a body's coordinates, the first that is a velocity."""

MOST_LOOKS = 100
"""Times that the motion beside is asked whether to go on, every some thousand steps, before it is
given up."""


def rows_ahead(run: Motion, times: Array, faster: float = 0.0) -> Array | None:
    """Rows of samples at the times, as `run` would have them, which stays as it is.

    faster: share by which all velocities are larger from now on.
    None where the motion does not come so far, and with contacts, whose modes the motion beside
    would have to choose anew.
    """
    if run.layout.contacts:
        return None
    beside = motion_of(run.compiled, run.method)
    try:
        y = _hastened(run, faster) if faster else run.coordinates
        beside.reset_beside(run, y, run.time)
        if run.layout.commanded:
            beside.change_law(run.system)
    except SimulationError:
        return None
    return _rows_of(beside, times)


def rows_again(run: Motion, count: int) -> tuple[Array, Array] | None:
    """Times and rows of samples, as `run` would have them, at its start and after each of its first
    `count` steps, or so many parts of the same time; `run` stays as it is.

    None where the motion does not come so far, where somebody interfered with it, and where events
    of contacts stop it, which are told by its own samples.
    """
    if not run.as_compiled or run.event_driven or not run.time > 0.0:
        return None
    beside = motion_of(run.compiled, run.method)
    length = getattr(run.method, "step", run.time / max(1, run.steps))
    times: Array = np.minimum(length * np.arange(count + 1.0), run.time)
    times = times[: 1 + int(np.searchsorted(times, run.time))]
    rows = _rows_of(beside, times)
    return None if rows is None else (times, rows)


def _rows_of(beside: Motion, times: Array) -> Array | None:
    """Samples of a motion at the times; None where it does not come so far, or takes too long."""
    looks = 0

    def look() -> None:
        nonlocal looks
        looks += 1
        if looks > MOST_LOOKS:
            raise SimulationError("a motion beside takes too long")

    beside.watch = look
    out = np.zeros((len(times), beside.width))
    try:
        beside.run_to(times, out)
    except SimulationError:
        return None
    return out


def _hastened(run: Motion, faster: float) -> Any:
    """The run's coordinates with velocities that are larger by the share."""
    places = CONFIGURATION.get(type(run.system))  # None: those of each body in turn
    y = np.array(run.coordinates, dtype=float)
    if places is not None:
        y[places:] *= 1.0 + faster
    else:
        y.reshape(-1, WIDTH)[:, VELOCITIES:] *= 1.0 + faster
    return y if isinstance(run.coordinates, np.ndarray) else tuple(y.tolist())


# Whether a motion that cannot go on has come to a singular configuration, which no step mends.
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
