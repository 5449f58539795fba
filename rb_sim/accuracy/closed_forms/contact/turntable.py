"""Ball that rolls on a level turntable: its centre goes round a circle (Milne 1948; LL 38).

With v = W n x r + a w x n and the equations of motion dv/dt = k n x v, k = W I / (I + m a^2): 2/7
of the table's rate for a solid ball, whatever the start.
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
from rb_sim.accuracy.closed_forms.turning import Spin, attitudes
from rb_sim.contact.friction import Rough
from rb_sim.contact.geometry.carriers import Turntable
from rb_sim.contact.geometry.pairs import SurfaceOnPlane
from rb_sim.scene.compiled import Compiled


def turntable(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball on a perfectly rough turntable, or None."""
    ball = ball_of(compiled, SurfaceOnPlane, resting=False)
    if ball is None or not isinstance(ball.friction, Rough):
        return None
    body, n, a = ball.body, normal_of(ball.pair), ball.radius
    carrier, fall = body.rows[0].carrier, -(body.g @ n)
    if not isinstance(carrier, Turntable) or not fall > 0 or not small(np.cross(n, body.g), fall):
        return None
    table = long(carrier.spin) @ n
    if table == 0 or not small(np.cross(n, long(carrier.spin)), abs(table)):
        return None
    arm = body.p - long(carrier.point)
    arm = arm - (arm @ n) * n
    # the slip that is left at the start is rounding, which the run projects out as well
    v0 = body.v - (body.v @ n) * n
    w0 = (body.w @ n) * n + (np.cross(n, v0) + table * arm) / a
    if not small(w0 - body.w, 1e4 * body.speed / a) or not small(body.v - v0, body.speed):
        return None
    rate = table * ball.share
    reach = -np.cross(n, v0) / rate
    """from the middle of the circle to the ball's centre."""
    middle = arm - reach
    factor = (table - rate) / a
    spin = Spin(
        (body.w @ n) * n + table * middle / a,
        np.zeros(3, dtype=Long),
        factor * reach,
        factor * np.cross(n, reach),
        rate,
    )

    def coordinates(times: Array) -> Array:
        t = long(times)
        cos, sin = np.cos(rate * t)[:, None], np.sin(rate * t)[:, None]
        round_ = reach * cos + np.cross(n, reach) * sin
        p = body.p + round_ - reach
        return coordinates_of(
            body, p, attitudes(body.q, spin, t), rate * np.cross(n, round_), spin.at(t)
        )

    return Exact("ball on a turntable", coordinates)
