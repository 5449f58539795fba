"""Rod of weight P, its end B on a horizontal plane and A on a vertical one, held by two strings.

    R_B = P,    T_B = (P/2) cot alpha,    R_A = T_B sin beta,    T_A = T_B cos beta

alpha: of the rod to the floor; beta: of its vertical plane to the wall. The string at B lies on the
floor below the rod, that at A along the wall. Landau & Lifshitz, section 38, problem 3.
"""

from __future__ import annotations

import numpy as np

from rb_sim.accuracy.closed_forms.statics.standing import (
    ExactReactions,
    Standing,
    line,
    of_kind,
    pointing,
    same,
    weight_of,
)


def rod_on_two_planes(standing: Standing) -> ExactReactions | None:
    """Forces of both planes and both strings, or None."""
    weight = weight_of(standing)
    contacts, strings = of_kind(standing, "contact", smooth=True), of_kind(standing, "string")
    if weight is None or (len(contacts), len(strings), len(standing.elements)) != (2, 2, 4):
        return None
    up = weight.up
    floor = pointing(contacts, up)
    if floor is None:
        return None
    wall = contacts[1 - contacts.index(floor)]
    rod = wall.anchor_W - floor.anchor_W
    if not same(floor.anchor_W + 0.5 * rod, weight.centre) or not same(line(wall) @ up, 0.0):
        return None
    height = float(rod @ up)
    below = rod - height * up
    width = float(np.linalg.norm(below))
    if width == 0.0 or height <= 0.0:
        return None
    sine = -float(below @ line(wall)) / width
    along = -below / width - sine * line(wall)
    cosine = float(np.linalg.norm(along))
    at_foot = pointing(strings, below / width)
    at_wall = pointing(strings, along / cosine) if cosine > 0.0 else None
    if at_foot is None or at_wall is None or sine < 0.0:
        return None
    if not same(at_foot.anchor_W, floor.anchor_W) or not same(at_wall.anchor_W, wall.anchor_W):
        return None
    pull = 0.5 * weight.size * width / height
    forces = {
        floor.name: weight.size * up,
        at_foot.name: pull * line(at_foot),
        wall.name: pull * sine * line(wall),
        at_wall.name: pull * cosine * line(at_wall),
    }
    return ExactReactions("rod on two planes; LL section 38, problem 3", forces)
