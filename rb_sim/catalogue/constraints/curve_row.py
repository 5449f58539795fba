"""The rows that keep a point of a body on a curve."""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.constraints.rows import COUNT, anchor, fill, material_point, put
from rb_sim.catalogue.curves import curve_nearest, curve_point
from rb_sim.catalogue.types import Vec3
from rb_sim.maths.vectors import add, cross, dot, perpendicular, rotate, scale, sub, unrotate


class CurveRow(NamedTuple):
    """r_B of the body stays on a curve fixed in the world: 2 lines."""

    r_B: Vec3
    curve: tuple


COUNT[CurveRow] = 2


@fill.register(CurveRow)
def fill_curve(row, t, B, A, G, k):
    p, v, c = material_point(B, row.r_B)
    on, slope, bend = curve_point(row.curve, curve_nearest(row.curve, p))
    inverse = 1.0 / dot(slope, slope)
    s_dot = dot(v, slope) * inverse
    e1, e2 = perpendicular(scale(inverse**0.5, slope))
    gap, normal = sub(p, on), sub(c, scale(s_dot * s_dot, bend))
    r_B, none = row.r_B, (0.0, 0.0, 0.0)
    put(G, k, e1, cross(r_B, unrotate(B.q_WB, e1)), none, dot(e1, normal), dot(e1, gap), 0.0, 1.0)
    put(
        G,
        k + 1,
        e2,
        cross(r_B, unrotate(B.q_WB, e2)),
        none,
        dot(e2, normal),
        dot(e2, gap),
        0.0,
        1.0,
    )


@anchor.register(CurveRow)
def curve_anchor(row, B, A):
    return add(B.p_WC, rotate(B.q_WB, row.r_B))
