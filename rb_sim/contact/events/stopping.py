"""What is left of a slip or a rolling that has ended, and whether it may be taken away.

Where a contact comes to rest beside others, its lines and theirs may nearly depend on each other:
two corners of a box on compliant points are at rest along the line through both only if that line
does not tilt.  To take away a slip that has but turned then stops the tilt: by the slip over the
sine of the lean, which is another motion.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.decompositions import singular_values
from rb_sim.contact.events.dense import velocities
from rb_sim.contact.events.held import find_held
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.tasks import SETTLE
from rb_sim.contact.system.creep import SLOWER
from rb_sim.contact.system.terms import STUCK
from rb_sim.contact.system.touch import CREEPS, SLIDE, SLIP, TURN
from rb_sim.engine.samples import Array
from rb_sim.maths.rank import JUDGED_BY_CONTACT, scaled_lines

MOVED = 10.0
"""Times what is left of a slip by which velocities of bodies may change for its end: where they
would by more, and by more than errors do, it has not ended, but turned."""

DEPENDENT = 1e-5
"""Singular value of the lines at rest, relative to the largest, from which on their pivots, which
are its squares, tell that they do not depend on each other."""


def stop(at: Instant, cs: list[int], mode: int, arms: Array) -> bool:
    """Take away what is left of the slip or the rolling of contacts cs, whose energy is of second
    order. False, and nothing changed, where bodies would move otherwise for it: what creeps is
    tried again when it has become slower.

    mode: SLIDE or ROLL; arms: A of each body (see engine.velocities), (N, 3, 3) [m].
    """
    touch, y, table = at.system.touch, at.y.copy(), at.system.touch.copy()
    before = velocities(at.system, at.y)
    left = float(np.linalg.norm(touch[cs, SLIP : SLIP + 3], axis=1).max())
    if mode != SLIDE:
        left = float(np.linalg.norm(touch[cs, TURN : TURN + 3], axis=1).max()) * at.system.length
    creep = touch[cs, CREEPS].copy()
    touch[cs, mode], touch[cs, CREEPS] = STUCK, 0.0
    at.call(SETTLE, at.t, at.y)
    change = (velocities(at.system, at.y) - before).reshape(-1, 6)
    turned = np.linalg.norm(np.einsum("bij,bj->bi", arms, change[:, 3:]), axis=1)
    most = float(max(np.linalg.norm(change[:, :3], axis=1).max(), turned.max()))
    at.refresh()
    stops = most <= max(MOVED * left, at.system.still)
    if not stops or (creep.any() and nearly_depend(at)):
        at.y[:] = y
        touch[:] = table
        touch[cs, CREEPS] = np.where(creep > 0.0, SLOWER * left, 0.0)
        at.refresh()
        return False
    return True


def nearly_depend(at: Instant) -> bool:
    """True where lines that hold are taken to depend on each other, but do not to the last: forces
    that keep all of them at rest are none, or without bound."""
    held = at.room.used[: find_held(at.system, at.room)]
    rows = scaled_lines(at.room.J[held] @ np.linalg.cholesky(at.inverse_mass))
    _, s, _ = singular_values(rows, "the lines of contacts that come to rest")
    return bool(((s > JUDGED_BY_CONTACT * s[0]) & (s < DEPENDENT * s[0])).any())
