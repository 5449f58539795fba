"""What is left of a slip or a rolling that has ended, and whether it may be taken away.

Where a contact comes to rest beside others, its lines and theirs may nearly depend on each other:
two corners of a box on compliant points are at rest along the line through both only if that line
does not tilt.  To take away a slip that has but turned then stops the tilt: by the slip over the
sine of the lean, which is another motion.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.dense import velocities
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.tasks import SETTLE
from rb_sim.contact.system.terms import STUCK
from rb_sim.contact.system.touch import SLIDE, SLIP, TURN
from rb_sim.engine.samples import Array

MOVED = 10.0
"""Times what is left of a slip by which velocities of bodies may change for its end: where they
would by more, and by more than errors do, it has not ended, but turned."""


def stop(at: Instant, c: int, mode: int, arms: Array) -> bool:
    """Take away what is left of the slip or the rolling of contact c, whose energy is of second
    order. False, and nothing changed, where bodies would move otherwise for it.

    mode: SLIDE or ROLL; arms: A of each body (see engine.velocities), (N, 3, 3) [m].
    """
    touch, y, table = at.system.touch, at.y.copy(), at.system.touch.copy()
    before = velocities(at.system, at.y)
    left = float(np.linalg.norm(touch[c, SLIP : SLIP + 3]))
    if mode != SLIDE:
        left = float(np.linalg.norm(touch[c, TURN : TURN + 3])) * at.system.length
    touch[c, mode] = STUCK
    at.call(SETTLE, at.t, at.y)
    change = (velocities(at.system, at.y) - before).reshape(-1, 6)
    turned = np.linalg.norm(np.einsum("bij,bj->bi", arms, change[:, 3:]), axis=1)
    most = float(max(np.linalg.norm(change[:, :3], axis=1).max(), turned.max()))
    stops = most <= max(MOVED * left, at.system.still)
    if not stops:
        at.y[:] = y
        touch[:] = table
    at.refresh()
    return stops
