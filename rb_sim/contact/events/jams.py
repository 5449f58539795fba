"""What stops a slip that jams (Painleve's paradox): the impulses of all lines."""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.dense import velocities
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.routh import impulse_process
from rb_sim.engine.samples import Array


def impulses_of_jam(at: Instant, c: int) -> Array | None:
    """Impulses of all lines for the impulse process of contact c, joints taking part; None if the
    process has no end."""
    k, joints = at.first[c], at.first[0]
    J = at.room.J
    own = J[k : k + 3]
    A = at.pivot_of(own, own)
    v = own @ velocities(at.system, at.y)
    v = v - at.room.line_rate[k : k + 3]
    law = at.laws[c]
    x = impulse_process(A, v, law.kinetic, law.restitution)
    if x is None:
        return None
    out = np.zeros(len(J))
    out[k : k + 3], out[:joints] = x, -at.taken_by_joints(own) @ x
    return out


def least_lifted(at: Instant) -> int | None:
    """The touching contact that its own push and the friction that follows it lift least; None if
    there is none."""
    lines = [at.first[c] for c in at.touching()]
    if not lines:
        return None
    J, W = at.room.J[lines], at.room.W[lines]
    lifted, alone = (np.einsum("ij,jk,ik->i", J, at.inverse_mass, P) for P in (W, J))
    return at.touching()[int(np.argmin(lifted / alone))]
