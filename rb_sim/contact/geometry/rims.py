"""A rim on a plane: the edge of a disk, or of an end of a cylinder, which may come to lie flat.

Tilted, it touches with its lowest point alone.  Flat, all of it touches at once, and which of its
points are there for all depends on how it came to lie: they keep their places in the body until it
tilts again.  The lowest point and the highest, opposite, are one line that goes on through flat:
what was the lowest on one side is the highest on the other.  Only a rim that falls straight comes
to lie, though: one that misses flat by whatever angle has its low point run round it, the faster
the less it misses, and rises again on another side (Srinivasan and Ruina, "Rocking and rolling: A
can that appears to rock might actually roll", Phys. Rev. E 78, 2008).  A rim that is held at a
point and falls straight therefore keeps that point in the step in which it comes to lie; of all
others what is low follows from the state alone, however far they turn in a step.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.types import Vec3
from rb_sim.contact.geometry.pairs import Touch, carried_direction, carried_point, touching
from rb_sim.contact.geometry.solids import direction_rate
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import (
    ZERO,
    add,
    cross,
    dot,
    norm,
    perpendicular,
    rotate,
    scale,
    sub,
    unrotate,
)

FLAT = 1e-10
"""Tilt [rad] that is none."""
LOST = 1e-14
"""Tilt [rad] of which rounding has taken the direction."""


class RimOnPlane(NamedTuple):
    """One point of a rim and the parent's plane."""

    centre_C: Vec3
    """of the rim, from C, body axes [m]."""
    radius: float
    axis_B: Vec3
    along: float
    """cosine of the angle, about the axis, from the point that is low to this one."""
    across: float
    """its sine."""
    alone: float
    """1: the lowest point only; it cannot lie flat."""
    r_A: Vec3
    n_A: Vec3


class Lean(NamedTuple):
    """How a rim leans."""

    low: Vec3
    """unit vector from its centre to its low point, body axes; zero where nothing is known."""
    axis: Vec3
    """its axis, upwards, across the plane's normal, world axes: as long as the sine of the tilt, it
    points to where the rim is low."""
    sense: float
    """1: `low` is low; -1: it is high, after the rim has gone through flat; SLAMS times either: it
    stays in the body; 0: it is alone, and has gone through flat; IN_FLIGHT: `low` is low, whatever
    was before."""


IN_FLIGHT = 2.0
"""Sense of a rim that nothing holds."""
SLAMS = 3.0
"""Size of the sense of a rim that falls straight on its flat side, and is nearly there."""
UPRIGHT = Lean(ZERO, ZERO, 1.0)
"""Where nothing is known of before."""


@inline
def keeps_low(tilt, before):
    """True if the low point is that of before: of a rim that lay flat, or will."""
    lost = FLAT if norm(before.axis) < FLAT else LOST
    return abs(before.sense) == SLAMS or tilt < lost


@inline
def lean_of(pair, gamma, axis, before):
    """The Lean with plane normal gamma (body axes), given that at the start of the step."""
    k = pair.axis_B
    up = sub(gamma, scale(dot(gamma, k), k))
    tilt = norm(up)
    if abs(before.sense) == SLAMS:
        sense = SLAMS if dot(up, before.low) <= 0.0 else pair.alone * SLAMS - SLAMS
        return Lean(before.low, axis, sense)
    if keeps_low(tilt, before):
        low, _ = perpendicular(k)
        if dot(before.low, before.low) > 0.0:
            low = before.low
        return Lean(low, axis, before.sense)
    low, sense = scale(-1.0 / tilt, up), before.sense
    if sense == IN_FLIGHT:
        return Lean(low, axis, sense)
    if norm(before.axis) < FLAT:
        sense = 1.0 if dot(low, before.low) >= 0.0 else -1.0
    return Lean(scale(sense, low), axis, sense * (1.0 - pair.alone) if sense < 0.0 else 1.0)


@inline
def rim_touching(pair, B, A, before):
    """(Touch, Lean) of a point of the rim, given the Lean at the start of the step."""
    n, n_dot = carried_direction(A, pair.n_A)
    spin_B, spin_A = rotate(B.q_WB, B.w_WB_B), rotate(A.q_WB, A.w_WB_B)
    k, gamma = pair.axis_B, unrotate(B.q_WB, n)
    gamma_dot = cross(gamma, sub(B.w_WB_B, unrotate(B.q_WB, spin_A)))
    axis = rotate(B.q_WB, k)
    axis = sub(axis, scale(dot(axis, n), n))
    if dot(gamma, k) < 0.0:
        axis = scale(-1.0, axis)
    lean = lean_of(pair, gamma, axis, before)
    up = sub(gamma, scale(dot(gamma, k), k))
    low_dot = ZERO
    if not keeps_low(norm(up), before):
        up_dot = sub(gamma_dot, scale(dot(gamma_dot, k), k))
        sign = -1.0 if dot(up, lean.low) < 0.0 else 1.0
        low_dot = direction_rate(lean.low, scale(sign, up_dot), norm(up))
    r = add(scale(pair.along, lean.low), scale(pair.across, cross(k, lean.low)))
    r_dot = add(scale(pair.along, low_dot), scale(pair.across, cross(k, low_dot)))
    r = rotate(B.q_WB, add(pair.centre_C, scale(pair.radius, r)))
    r_dot = rotate(B.q_WB, scale(pair.radius, r_dot))
    on, _ = carried_point(A, pair.r_A)
    p = add(B.p_WC, r)
    p_dot = add(B.v_WC, add(r_dot, cross(spin_B, r)))
    return Touch(dot(n, sub(p, on)), n, n_dot, p, p_dot), lean


@touching.register(RimOnPlane)
def rim_on_plane(pair, B, A):
    touch, _ = rim_touching(pair, B, A, UPRIGHT)
    return touch
