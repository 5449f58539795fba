"""Ball that rolls inside a vertical cylinder: the golfer's dilemma (Gualtieri et al. 2006).

Along e_r (outward), e_phi and up, with b = R - a: the rate W about the axis is constant,
w_z = -b W/a, w_phi = z'/a, dw_r/dt = W z'/a, and z'' = -k W (a w_r) - (1 - k) g with
k = I / (I + m a^2): the height oscillates at the rate sqrt(k) W.
"""

from __future__ import annotations

from rb_sim.accuracy.closed_forms.contact.single import ball_of, coordinates_of, small
from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import Array, Long, about, long, np, product, turned
from rb_sim.accuracy.closed_forms.turning import Spin, attitudes
from rb_sim.contact.friction import Rough
from rb_sim.contact.geometry.pairs import BallOnCylinder
from rb_sim.scene.compiled import Compiled


def rolling_in_cylinder(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball inside a vertical, perfectly rough cylinder at rest, or None."""
    ball = ball_of(compiled, BallOnCylinder)
    if ball is None or not isinstance(ball.friction, Rough) or ball.pair.side > 0:
        return None
    body, a = ball.body, ball.radius
    up = long(ball.pair.axis_A)
    up = up / np.sqrt(up @ up)
    up = -up if body.g @ up > 0 else up
    fall = -(body.g @ up)
    arm = body.p - long(ball.pair.r_A)
    arm = arm - (arm @ up) * up
    b = np.sqrt(arm @ arm)
    out = arm / b
    ahead = np.cross(up, out)
    rate, z0 = (body.v @ ahead) / b, body.v @ up
    w_r = body.w @ out
    w0 = w_r * out + z0 / a * ahead - b * rate / a * up
    if not small(np.cross(up, body.g), max(fall, Long(1))) or rate == 0:
        return None
    if not small(body.v @ out, 1e4 * body.speed) or not small(w0 - body.w, 1e4 * body.speed / a):
        return None
    if abs(b + a - Long(ball.pair.curved)) > 1e-12 * body.length:
        return None
    k = ball.share
    swing = np.sqrt(k) * rate
    # z = z_m + (-z_m) cos + (z0 / swing) sin, from the start; z_m: where gravity is balanced
    z_m = -(k * rate * a * w_r + (1 - k) * fall) / (swing * swing)
    high = z0 / swing
    # in axes that turn with the ball about the cylinder's, whose own turning is taken off
    spin = Spin(
        (w_r + rate / a * z_m) * out - (b * rate / a + rate) * up,
        np.zeros(3, dtype=Long),
        -rate / a * z_m * out + swing / a * high * ahead,
        rate / a * high * out + swing / a * z_m * ahead,
        swing,
    )

    def coordinates(times: Array) -> Array:
        t = long(times)
        turn = about(up, rate * t)
        cos, sin = np.cos(swing * t), np.sin(swing * t)
        z, rise = z_m * (1 - cos) + high * sin, swing * (z_m * sin + high * cos)
        p = body.p + b * (turned(turn, out) - out) + z[:, None] * up
        v = b * rate * turned(turn, ahead) + rise[:, None] * up
        q = product(turn, attitudes(body.q, spin, t))
        w = turned(turn, spin.at(t)) + rate * up
        return coordinates_of(body, p, q, v, w)

    return Exact("ball inside a vertical cylinder", coordinates)
