"""Symmetric top in steady precession about the vertical (LL 35, problem 1; Goldstein 5.7).

R(t) = turn(k p t) R(0) turn(e s t), k up, e the axis of symmetry, where the precession p and the
spin w3 = s + p cos(theta) satisfy p (I3 w3 - I1 p cos(theta)) = m g l (moments about the point).
"""

from __future__ import annotations

from typing import Any

from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import (
    Array,
    Long,
    about,
    long,
    np,
    product,
    tensor,
    unit,
    unturned,
)
from rb_sim.accuracy.closed_forms.parabola import gravity_of, only_gravity
from rb_sim.engine.systems.fixed_point import FixedPointBody

STEADY = 1e-14
"""Relative misfit of the condition up to which initial values count as steady (rounded ones)."""


def steady_top(system: Any, y: Any) -> Exact | None:
    """The exact motion of a top whose initial state precesses steadily, or None."""
    if not isinstance(system, FixedPointBody) or not only_gravity(system.effects):
        return None
    rho, g, mass = long(system.rho), gravity_of(system.effects), Long(system.body.mass)
    length, strength = np.sqrt(rho @ rho), np.sqrt(g @ g)
    if length == 0 or strength == 0:
        return None
    e, up, q0 = rho / length, -g / strength, unit(long(y[0:4]))
    own = tensor(system.body.inertia)
    about_O = own + mass * ((rho @ rho) * np.eye(3) - np.outer(rho, rho))
    w = long(y[4:7])
    axial, k = e @ about_O @ e, unturned(q0, up)
    across = (np.trace(about_O) - axial) / 2
    uniaxial = across * np.eye(3) + (axial - across) * np.outer(e, e)
    if np.abs(about_O - uniaxial).max() > STEADY * across:
        return None
    side = k - (k @ e) * e
    if side @ side < 1e-12:
        return None
    p, cosine, w3 = (w @ side) / (side @ side), k @ e, w @ e
    beside = w - p * side - w3 * e
    weight = mass * strength * length
    misfit = p * (axial * w3 - across * p * cosine) - weight
    if abs(misfit) > STEADY * weight or np.sqrt(beside @ beside) > STEADY * np.sqrt(w @ w):
        return None

    def coordinates(times: Array) -> Array:
        t = long(times)
        q = product(product(about(up, p * t), q0), about(e, (w3 - p * cosine) * t))
        w_t = p * unturned(q, up) + (w3 - p * cosine) * e
        return np.concatenate([unit(q), w_t], axis=1).astype(float)

    return Exact("top in steady precession; LL 35", coordinates)
