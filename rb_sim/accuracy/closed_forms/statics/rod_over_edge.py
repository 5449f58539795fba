"""Rod of weight P and length l over the edge C of a wall of height h, its foot B on a string.

    R_C = P l sin(2 alpha)/(4 h),    R_B = P - R_C sin alpha,    T = R_C cos alpha

alpha: from the vertical. Landau & Lifshitz, section 38, problem 2.
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


def rod_over_edge(standing: Standing) -> ExactReactions | None:
    """Forces of the edge, the floor and the string, or None."""
    weight = weight_of(standing)
    contacts, strings = of_kind(standing, "contact", smooth=True), of_kind(standing, "string")
    if weight is None or (len(contacts), len(strings), len(standing.elements)) != (2, 1, 3):
        return None
    up, (string,) = weight.up, strings
    floor = pointing(contacts, up)
    if floor is None or not same(floor.anchor_W, string.anchor_W):
        return None
    edge = contacts[1 - contacts.index(floor)]
    half = weight.centre - floor.anchor_W
    length, to_edge = 2.0 * float(np.linalg.norm(half)), edge.anchor_W - floor.anchor_W
    rod, height = half / (0.5 * length), float(to_edge @ up)
    lean = rod - (rod @ up) * up
    sine, cosine = float(np.linalg.norm(lean)), float(rod @ up)
    if min(sine, cosine, height) <= 0.0 or not same(to_edge, (to_edge @ rod) * rod, length):
        return None
    ahead = lean / sine
    if not same(line(string), ahead) or not same(line(edge), sine * up - cosine * ahead):
        return None
    at_edge = weight.size * length * 2.0 * sine * cosine / (4.0 * height)
    if weight.size < at_edge * sine:
        return None  # tips over the edge
    forces = {
        edge.name: at_edge * line(edge),
        floor.name: (weight.size - at_edge * sine) * up,
        string.name: at_edge * cosine * ahead,
    }
    return ExactReactions("rod over an edge; LL section 38, problem 2", forces)
