"""Ball thrown on a level plane: it slips, then rolls (Landau & Lifshitz 38; Coriolis 1835).

While it slips, Coulomb's friction has the fixed direction -e of the slip s = v - a w x n, so
dv/dt = -mu g e, dw/dt = (mu m g a / I) n x e, and |s| falls at the rate mu g (1 + m a^2 / I).  Then
v and w are constant.
"""

from __future__ import annotations

from rb_sim.accuracy.closed_forms.contact.single import (
    ball_of,
    coordinates_of,
    normal_of,
    small,
)
from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import Array, Long, long, np
from rb_sim.accuracy.closed_forms.turning import Spin, attitudes, steady_spin
from rb_sim.contact.friction import Coulomb
from rb_sim.contact.geometry.pairs import SurfaceOnPlane
from rb_sim.scene.compiled import Compiled

TOUCHING = 1e-12
"""Gap relative to the scene's length, and speed relative to its, that count as none."""


def slipping_ball(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball that touches a level plane with Coulomb friction, or None."""
    ball = ball_of(compiled, SurfaceOnPlane)
    if ball is None or not isinstance(ball.friction, Coulomb) or not ball.friction.kinetic > 0:
        return None
    body, n, a = ball.body, normal_of(ball.pair), ball.radius
    fall = -(body.g @ n)
    gap = n @ (body.p - long(ball.pair.r_A)) - a
    if not fall > 0 or not small(np.cross(n, body.g), fall):
        return None
    if abs(gap) > TOUCHING * body.length or abs(body.v @ n) > TOUCHING * body.speed:
        return None
    slip = body.v - a * np.cross(body.w, n)
    slip = slip - (slip @ n) * n
    size = np.sqrt(slip @ slip)
    rolls = size <= TOUCHING * body.speed
    e = np.zeros(3, dtype=Long) if rolls else slip / size
    brake = Long(ball.friction.kinetic) * fall
    turn = brake * body.mass * a / ball.moment * np.cross(n, e)
    end = size * ball.share / brake
    none = np.zeros(3, dtype=Long)
    spin = Spin(body.w, turn, none, none, Long(0))

    def coordinates(times: Array) -> Array:
        t = long(times)
        s = np.minimum(t, end)[:, None]
        v = body.v - brake * e * s
        p = body.p + body.v * s - brake * e * s * s / 2 + v * (t[:, None] - s)
        early = int(np.searchsorted(t, end))
        q = attitudes(body.q, spin, np.append(t[:early], end))
        later = np.concatenate([[end], t[early:]])
        q = np.concatenate([q[:-1], attitudes(q[-1], steady_spin(body.w + turn * end), later)[1:]])
        return coordinates_of(body, p, q, v, body.w + turn * s)

    return Exact("ball that slips and then rolls; LL 38", coordinates)
