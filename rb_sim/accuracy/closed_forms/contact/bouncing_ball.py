"""Ball that bounces on a smooth plane: parabolas whose speeds fall by e (any text on mechanics).

After impacts at T_1, T_k+1 = T_k + 2 e^k s / g with s the speed of the first, at the limit
T_1 + 2 s e / (g (1 - e)) it rests on the plane, and slides on as on a smooth one.
"""

from __future__ import annotations

from rb_sim.accuracy.closed_forms.contact.single import ball_of, coordinates_of, normal_of
from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import Array, Long, long, np
from rb_sim.accuracy.closed_forms.turning import attitudes, steady_spin
from rb_sim.contact.friction import Smooth
from rb_sim.contact.geometry.pairs import SurfaceOnPlane
from rb_sim.scene.compiled import Compiled

MOST_IMPACTS = 100_000


def bouncing_ball(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball on a smooth plane at rest, or None."""
    ball = ball_of(compiled, SurfaceOnPlane)
    if ball is None or not isinstance(ball.friction, Smooth) or ball.body.law.bilateral:
        return None
    body, n = ball.body, normal_of(ball.pair)
    fall = -(body.g @ n)
    height = max(n @ (body.p - long(ball.pair.r_A)) - ball.radius, Long(0))
    if not fall > 0:
        return None
    along = body.g + fall * n
    rise = body.v @ n
    slide = body.v - rise * n
    e = Long(body.law.restitution)

    def coordinates(times: Array) -> Array:
        t = long(times)
        starts, heights, speeds, rest = flights(height, rise, fall, e, t[-1])
        i = np.searchsorted(starts, t, side="right") - 1
        s = t - starts[i]
        high, up = heights[i] + speeds[i] * s - fall * s * s / 2, speeds[i] - fall * s
        high, up = np.where(t >= rest, 0, high), np.where(t >= rest, 0, up)
        t = t[:, None]
        p = body.p + (high - height)[:, None] * n + slide * t + along * t * t / 2
        v = slide + along * t + up[:, None] * n
        w = np.tile(body.w, (len(times), 1))
        return coordinates_of(body, p, attitudes(body.q, steady_spin(body.w), t[:, 0]), v, w)

    return Exact("ball that bounces on a smooth plane", coordinates)


def flights(
    height: Long, rise: Long, fall: Long, e: Long, end: Long
) -> tuple[Array, Array, Array, Long]:
    """Start, height and speed of each flight up to `end`, and the time of rest."""
    speed = np.sqrt(rise * rise + 2 * fall * height)
    t = (rise + speed) / fall
    starts, heights, speeds = [Long(0)], [height], [rise]
    rest = t + 2 * e * speed / (fall * (1 - e)) if e < 1 else Long(np.inf)
    while t <= min(end, rest) and len(starts) < MOST_IMPACTS:
        speed *= e
        if 2 * speed <= np.finfo(Long).eps * fall * max(t, Long(1)):
            break
        starts.append(t)
        heights.append(Long(0))
        speeds.append(speed)
        t += 2 * speed / fall
    return long(starts), long(heights), long(speeds), rest
