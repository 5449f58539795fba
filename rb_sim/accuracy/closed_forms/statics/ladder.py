"""Ladder of weight P on a rough floor against a wall; D, H: its foot to its top, d to its centre.

    N_wall = (P d - f D)/H,    N_floor = P - f,    friction at the foot N_wall

f is the friction upwards at the wall: none on a smooth one; on a rough one anything that both
coefficients allow, |f| <= mu_w N_wall and N_wall <= mu_f N_floor. In the plane of the ladder.
"""

from __future__ import annotations

import math

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


def ladder(standing: Standing) -> ExactReactions | None:
    """Forces of floor and wall, of least norm, with the ranges where they are many; or None."""
    weight, contacts = weight_of(standing), of_kind(standing, "contact")
    if weight is None or (len(contacts), len(standing.elements)) != (2, 2):
        return None
    P, up = weight.size, weight.up
    floor = pointing(contacts, up)
    if floor is None or floor.size == 1:
        return None
    wall = contacts[1 - contacts.index(floor)]
    into, rise = line(wall), wall.anchor_W - floor.anchor_W
    D, H = -float(rise @ into), float(rise @ up)
    arm = weight.centre - floor.anchor_W
    d, level = -float(arm @ into), float(arm @ up)
    length = math.hypot(D, H)
    plane = same(rise, H * up - D * into, length) and same(arm, level * up - d * into, length)
    if not plane or not same(into @ up, 0.0) or H <= 0.0 or not 0.0 < d <= D:
        return None
    low, high = frictions(P, d, D, H, floor.friction, wall.friction)
    if not low <= high:
        return None  # slips

    def pressed(f: float) -> float:
        return (P * d - f * D) / H

    ratio = D / H
    least = (2.0 * ratio * P * d / H + P) / (2.0 * (ratio * ratio + 1.0))
    f = min(max(least, low), high)
    forces = {
        floor.name: (P - f) * up - pressed(f) * into,
        wall.name: pressed(f) * into + f * up,
    }
    if wall.size == 1:
        return ExactReactions("ladder against a smooth wall", forces)
    spans = {floor.name: (P - high, P - low), wall.name: (pressed(high), pressed(low))}
    return ExactReactions("ladder on a rough floor against a rough wall", forces, spans)


def frictions(
    P: float, d: float, D: float, H: float, floor: float, wall: float
) -> tuple[float, float]:
    """Smallest and largest friction upwards at the wall [N]; the first is larger where it slips.

    floor, wall: coefficients. Where these are so large that the ladder jams: nan.
    """
    high = wall * P * d / (H + wall * D)
    if wall == 0.0:
        return (0.0, 0.0) if d <= floor * H else (0.0, -np.inf)
    if floor * H >= D or wall * D >= H:
        return np.nan, np.nan
    slips = P * (d - floor * H) / (D - floor * H)
    return max(slips, -wall * P * d / (H - wall * D)), high
