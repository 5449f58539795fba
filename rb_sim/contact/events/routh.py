"""The impulse process of one contact that jams: Painleve's paradox resolved by an impact.

While the contact slips, its velocities change with the normal impulse p as
dv/dp = A (n - mu s/|s|); they go on until the slip has stopped and the normal velocity, which that
drives downward, has come back to zero: compression.  Restitution adds e times its impulse
(Darboux 1880, Keller 1986; "impact without collision", Genot and Brogliato 1999).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rb_sim.contact.events.decompositions import pseudo_inverse
from rb_sim.engine.samples import Array

DRIVEN, LIFTED = -1e-5, 1e-2
"""Normal velocities, relative to the slip, at which the contact is driven in and leaves: where the
effective pivot just vanishes, it does neither until the slip has stopped."""
TIGHT = {"rtol": 1e-12, "atol": 1e-14, "method": "DOP853"}


def impulse_process(A: Array, v: Array, friction: float, restitution: float) -> Array | None:
    """Impulse (n, t1, t2) of a contact with velocities v = (v_n, s) and A = J M^-1 J^T, (3, 3).

    None if the process does not end: the slip never stops while the contact holds.
    """
    size, stiffness = float(np.linalg.norm(v)) + 1e-300, A[0, 0]
    found = natural_process(A / stiffness, v / size, friction, restitution)
    return None if found is None else (size / stiffness) * found


def slopes_and_events(A: Array, v: Array, friction: float) -> tuple[Any, ...]:
    """(dx/dp, events of the end of the slip, of being driven in, of leaving, of coming back)."""

    def push(s: Array, last: Array) -> Array:
        speed = float(np.linalg.norm(s))
        d = s / speed if speed > 0.0 else last
        return np.array([1.0, -friction * d[0], -friction * d[1]])

    ahead = v[1:] / max(float(np.linalg.norm(v[1:])), 1e-300)

    def slope(p: float, x: Array) -> Array:
        f = push(v[1:] + (A @ x)[1:], ahead)
        if float((v[1:] + (A @ x)[1:]) @ ahead) < 0.0:
            f[1:] = -f[1:]
        return f

    def slip(p: float, x: Array) -> float:
        return float((v[1:] + (A @ x)[1:]) @ ahead)

    def normal(p: float, x: Array, level: float) -> float:
        return float(v[0] + (A @ x)[0]) - level

    def driven_in(p: float, x: Array) -> float:
        return normal(p, x, DRIVEN)

    def lifted(p: float, x: Array) -> float:
        return normal(p, x, LIFTED)

    def back(p: float, x: Array) -> float:
        return normal(p, x, 0.0)

    for event, direction in ((slip, -1.0), (driven_in, -1.0), (lifted, 1.0), (back, 1.0)):
        event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
    return slope, slip, driven_in, lifted, back


def natural_process(A: Array, v: Array, friction: float, restitution: float) -> Array | None:
    """As `impulse_process`, of |v| = 1 and A[0, 0] = 1, in which TIGHT means something: the impulse
    of a rod of a micrometre is 1e-21 N s."""
    from scipy.integrate import solve_ivp  # half a second to import, and hardly ever needed

    slope, slip, driven_in, lifted, back = slopes_and_events(A, v, friction)
    most = 1e6
    sliding = solve_ivp(slope, (0.0, most), np.zeros(3), events=(slip, driven_in, lifted), **TIGHT)
    if len(sliding.t_events[1]):
        start = (sliding.t[-1], most)
        sliding = solve_ivp(slope, start, sliding.y[:, -1], events=(slip, back), **TIGHT)
    elif not len(sliding.t_events[0]):
        return None
    if not any(len(instants) for instants in sliding.t_events):
        return None
    x = sliding.y[:, -1]
    if len(sliding.t_events[0]):
        x = x + _after_slip(A, v + A @ x, friction)
    compressed = x[0]
    if restitution > 0.0 and compressed > 0.0:
        x = x + restitution * compressed * _stuck_or_sliding(A, friction)
    return x


def _stuck_or_sliding(A: Array, friction: float) -> Array:
    """Direction of the impulse per unit of normal impulse at a contact without slip."""
    along = pseudo_inverse(A[1:, 1:], "the impulses of a contact that jams") @ A[1:, 0]
    stuck = np.concatenate([[1.0], -along])
    if np.linalg.norm(stuck[1:]) <= friction:
        return stuck
    return np.concatenate([[1.0], friction * stuck[1:] / np.linalg.norm(stuck[1:])])


def _after_slip(A: Array, v: Array, friction: float) -> Array:
    """What is still needed for the normal velocity to come back to zero once slip has stopped."""
    direction = _stuck_or_sliding(A, friction)
    rise = float((A @ direction)[0])
    return direction * max(0.0, -v[0] / rise) if rise > 0.0 else np.zeros(3)
