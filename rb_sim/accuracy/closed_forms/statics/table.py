"""Table on four smooth legs at (+-a, +-b), a load P over (x, y).

    N = (P/4) (1 +- x/a +- y/b) + s (+1, -1, +1, -1)

s = 0 is the least norm, and what equally stiff legs give; |s| ends where a leg lifts.
"""

from __future__ import annotations

import numpy as np

from rb_sim.accuracy.closed_forms.statics.standing import (
    ExactReactions,
    Standing,
    line,
    of_kind,
    same,
)


def table(standing: Standing) -> ExactReactions | None:
    """Forces of the floor on the legs, of least norm, and their ranges; or None."""
    legs = of_kind(standing, "contact", smooth=True)
    if len(standing.bodies) != 1 or len(legs) != 4 or len(standing.elements) != 4:
        return None
    up, feet = line(legs[0]), np.array([leg.anchor_W for leg in legs])
    force, torque = standing.loads[0, :3], standing.loads[0, 3:]
    size = float(-force @ up)
    flat = all(same(line(leg), up) for leg in legs) and same(force, -size * up, size)
    centre = feet.mean(axis=0)
    arms = feet - centre
    reach = float(np.linalg.norm(arms, axis=1).max())
    if not flat or size <= 0.0 or not same(arms @ up, 0.0, reach):
        return None
    opposite = [i for i in (1, 2, 3) if same(arms[i], -arms[0], reach)]
    if len(opposite) != 1:
        return None
    first, second = (i for i in (1, 2, 3) if i != opposite[0])
    a, b = 0.5 * (arms[0] - arms[first]), 0.5 * (arms[0] - arms[second])
    if not same(a @ b, 0.0, reach * reach):
        return None
    moment = torque + np.cross(standing.centres[0] - centre, force)
    at = np.cross(moment, up) / size  # where the load meets the floor
    if not same(moment @ up, 0.0, size * reach):
        return None
    normals = 0.25 * size * (1.0 + (arms @ a) * (at @ a) / (a @ a) ** 2)
    normals = normals + 0.25 * size * (arms @ b) * (at @ b) / (b @ b) ** 2
    if normals.min() < 0.0:
        return None  # a leg lifts
    signs = np.array([1.0 if i in (0, opposite[0]) else -1.0 for i in range(4)])
    down, rise = float(normals[signs > 0].min()), float(normals[signs < 0].min())
    spans = {
        leg.name: (N - (down if sign > 0 else rise), N + (rise if sign > 0 else down))
        for leg, N, sign in zip(legs, normals.tolist(), signs, strict=True)
    }
    forces = {leg.name: N * up for leg, N in zip(legs, normals, strict=True)}
    return ExactReactions("table on four legs", forces, spans)
