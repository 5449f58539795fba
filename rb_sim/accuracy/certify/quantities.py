"""Six quantities whose errors a certificate states, and how two runs differ in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rb_sim.accuracy.choice import QUANTITIES as NAMES
from rb_sim.accuracy.errors import BALANCE, JUMPS, turn_between
from rb_sim.engine.samples import Array, SampleLayout

Indices = NDArray[np.intp]

POSITION, ROTATION, VELOCITY, SPIN, FORCE, TORQUE = range(6)


def differences(rows: Array, others: Array, layout: SampleLayout) -> Array:
    """How far two runs are apart at each instant, shape (n, 6), the worst of bodies and reactions.

    rows, others: as the kernel writes them. What is not finite is infinitely far apart. Where the
    two are on different sides of an event, which is no error but one of its time, the quantities
    that jump count as 0; unless there are many such instants, for then they do not move alike.
    """
    a, b = parts(rows, layout), parts(others, layout)
    apart = np.zeros((len(rows), len(NAMES)))
    for k in range(len(NAMES)):
        if k == ROTATION:
            size = turn_between(a[k], b[k])
        else:
            size = np.linalg.norm(a[k] - b[k], axis=2)
        apart[:, k] = np.nan_to_num(size, nan=np.inf, posinf=np.inf).max(axis=1, initial=0.0)
    for i in across_an_event(rows, others, layout):
        apart[i, VELOCITY:] = 0.0
    return apart


def parts(rows: Array, layout: SampleLayout) -> list[Array]:
    """The six quantities, each (n, bodies or reactions, components)."""
    bodies, reactions = len(layout.bodies), len(layout.reactions)
    body = rows[:, : 13 * bodies].reshape(len(rows), bodies, 13)
    reaction = rows[:, 13 * bodies : 13 * bodies + 9 * reactions]
    reaction = reaction.reshape(len(rows), reactions, 9)
    columns = [slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)]
    held = [reaction[:, :, 0:3], reaction[:, :, 3:6]]
    return [body[:, :, part] for part in columns] + held


def across_an_event(rows: Array, others: Array, layout: SampleLayout) -> Indices:
    """Indices of the instants that lie between the times that two runs give one event."""
    if not layout.contacts:
        return np.zeros(0, dtype=np.intp)
    states = 13 * len(layout.bodies) + 9 * len(layout.reactions) + BALANCE + 1
    finite = np.isfinite(rows).all(axis=1) & np.isfinite(others).all(axis=1)
    apart = np.flatnonzero((rows[:, states:] != others[:, states:]).any(axis=1) & finite)
    return apart if len(apart) <= JUMPS * len(rows) else apart[:0]


def sizes(rows: Array, layout: SampleLayout) -> Array:
    """How much of each quantity there is in a run, (6,): the way of the bodies, 1 rad, the largest
    velocities, forces and torques."""
    of = parts(rows, layout)
    found = np.ones(len(NAMES))
    of[POSITION] = of[POSITION] - of[POSITION][:1]
    for k, values in enumerate(of):
        if k != ROTATION:
            found[k] = np.linalg.norm(values, axis=2).max(initial=0.0)
    return found
