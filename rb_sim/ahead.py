"""How a motion goes on from where it is, or from its start once more, by another one beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.contact.motion import motion_of
from rb_sim.engine.system import CONFIGURATION
from rb_sim.engine.systems.many_bodies import WIDTH
from rb_sim.errors import SimulationError

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array
    from rb_sim.motion import Motion

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
