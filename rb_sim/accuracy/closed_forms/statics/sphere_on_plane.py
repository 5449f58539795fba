"""Sphere at rest on a rough plane under a force F at its centre and a torque K, radius a.

    R_n = -F_n,    R_t = 5 (K x n)/(7 a) - 2 F_t/7        (Landau & Lifshitz, section 38, problem 1)

This is the reaction of the rolling sphere; it rests where K = a F x n, and then R = -F.
"""

from __future__ import annotations

import numpy as np

from rb_sim.accuracy.closed_forms.statics.standing import ExactReactions, Standing, line, same


def sphere_on_plane(standing: Standing) -> ExactReactions | None:
    """The reaction of the plane, or None."""
    if len(standing.bodies) != 1 or len(standing.elements) != 1:
        return None
    (floor,) = standing.elements
    if floor.kind != "contact" or not np.isinf(floor.friction):
        return None
    n, arm = line(floor), standing.centres[0] - floor.anchor_W
    radius, force, torque = float(arm @ n), standing.loads[0, :3], standing.loads[0, 3:]
    if not same(arm, radius * n, radius) or not force @ n < 0.0:
        return None
    if not same(torque, radius * np.cross(force, n), radius * float(np.linalg.norm(force))):
        return None  # it rolls or spins
    across = force - (force @ n) * n
    reaction = -(force @ n) * n + 5.0 / (7.0 * radius) * np.cross(torque, n) - 2.0 / 7.0 * across
    name = "sphere on a rough plane; LL section 38, problem 1"
    return ExactReactions(name, {floor.name: reaction})
