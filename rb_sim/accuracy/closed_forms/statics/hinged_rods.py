"""Two weightless rods AC and CB, hinged at the top C, their feet on a floor and tied by a string.

    R_A = 3 F/4,    R_B = F/4,    T = (F/4) cot alpha;    the hinge: -(R_B + T) on CB

The force F acts on the middle of AC; alpha: of both rods to the floor. Landau & Lifshitz, section
38, problem 4.
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


def hinged_rods(standing: Standing) -> ExactReactions | None:
    """Forces of the floor on both feet, of the string and of the hinge, or None."""
    feet, strings = of_kind(standing, "contact", smooth=True), of_kind(standing, "string")
    hinges = [e for e in standing.elements if e.kind == "hinge" and e.size == 3]
    if (len(standing.bodies), len(standing.elements)) != (2, 4):
        return None
    if (len(feet), len(strings), len(hinges)) != (2, 1, 1):
        return None
    loaded = [i for i, load in enumerate(standing.loads) if load.any()]
    if len(loaded) != 1:
        return None
    load, centre = standing.loads[loaded[0]], standing.centres[loaded[0]]
    name = standing.bodies[loaded[0]]
    a, b = sorted(feet, key=lambda foot: foot.body != name)
    (string,), (hinge,) = strings, hinges
    pair = {a.body, b.body}
    if len(pair) != 2 or {string.body, string.parent} != pair or {hinge.body, hinge.parent} != pair:
        return None
    size = float(np.linalg.norm(load[:3]))
    A, B, C = a.anchor_W, b.anchor_W, hinge.anchor_W
    ends = {a.body: A, b.body: B}
    tied = same(string.anchor_W, ends[string.body])
    tied = tied and same(string.parent_anchor_W, ends[string.parent or ""])
    middle = same(np.cross(0.5 * (A + C) - centre, load[:3]), load[3:], size)
    if size == 0.0 or a.parent is not None or b.parent is not None or not (tied and middle):
        return None
    up, across = -load[:3] / size, 0.5 * (B - A)
    height, half = float((C - A) @ up), float(np.linalg.norm(across))
    upright = same(C - 0.5 * (A + B), height * up) and same(across @ up, 0.0)
    if height <= 0.0 or half == 0.0 or not (upright and same(line(a), up) and same(line(b), up)):
        return None
    tension = 0.25 * size * half / height
    pull = -tension * across / half  # on CB, towards A
    on_b = -(0.25 * size * up + pull)
    forces = {
        a.name: 0.75 * size * up,
        b.name: 0.25 * size * up,
        string.name: pull if string.body == b.body else -pull,
        hinge.name: on_b if hinge.body == b.body else -on_b,
    }
    return ExactReactions("two hinged rods; LL section 38, problem 4", forces)
