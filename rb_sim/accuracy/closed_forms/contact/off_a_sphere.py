"""Ball that rolls (or slides without friction) down a fixed sphere and leaves it.

theta'' = k^2 sin theta with theta from the vertical and k^2 = g m a^2 / ((R + a) (I + m a^2)), or
g / (R + a) on a smooth sphere: a pendulum's equation.  It leaves where the normal force vanishes,
g cos theta = (R + a) theta'^2, on a parabola and with the spin it has.
"""

from __future__ import annotations

from typing import Any

from rb_sim.accuracy.closed_forms.contact.single import Ball, ball_of, coordinates_of, small
from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.extended import (
    EPS,
    Array,
    Long,
    about,
    long,
    np,
    product,
    unit,
)
from rb_sim.accuracy.closed_forms.pendulum import PI, about_hanging
from rb_sim.contact.friction import Rough, Smooth
from rb_sim.contact.geometry.pairs import BallOnSphere
from rb_sim.scene.compiled import Compiled


def off_a_sphere(compiled: Compiled) -> Exact | None:
    """The exact motion of a ball on top of a fixed sphere, in a vertical plane, or None."""
    ball = ball_of(compiled, BallOnSphere)
    if ball is None or ball.pair.side < 0 or ball.body.law.bilateral:
        return None
    if not isinstance(ball.friction, Rough | Smooth):
        return None
    body, reach = ball.body, Long(ball.pair.curved) + ball.radius
    fall = np.sqrt(body.g @ body.g)
    arm = body.p - long(ball.pair.r_A)
    if not fall > 0 or abs(np.sqrt(arm @ arm) - reach) > 1e-12 * body.length:
        return None
    up = -body.g / fall
    across = np.cross(up, arm)
    size = np.sqrt(across @ across)
    if size <= 1e-9 * reach:
        return None
    axis = across / size
    theta, rate = np.arctan2(size, arm @ up), Long(np.cross(arm, body.v) @ axis / reach**2)
    rolls = isinstance(ball.friction, Rough)
    # of the ball, where it rolls: v = theta' axis x arm = a w x n
    turning = rate * reach / ball.radius if rolls else Long(0)
    if not small(body.w - turning * axis, 1e4 * body.speed / ball.radius):
        return None
    if not small(body.v - rate * np.cross(axis, arm), 1e4 * body.speed):
        return None
    k2 = (1 - ball.share if rolls else Long(1)) * fall / reach
    if fall * np.cos(theta) <= reach * rate**2:
        return None
    motion = about_hanging(theta - PI, rate, k2)
    if motion is None:
        return None
    leaves = lift_off(motion, fall / reach)
    if leaves is None:
        return None
    return Exact(
        "ball that leaves a fixed sphere", path(ball, motion, leaves, axis, up, reach, rolls)
    )


def lift_off(motion: Any, ratio: Long) -> Long | None:
    """The instant at which ratio cos theta = theta'^2, by halving; None if it is far off."""

    def push(t: Long) -> Long:
        angle, speed = motion(long([t]))
        return (-ratio * np.cos(angle) - speed**2)[0]  # angle: from hanging

    late = Long(1) / np.sqrt(ratio)
    for _ in range(10):
        if push(late) < 0:
            break
        late *= 2
    else:
        return None
    # the first zero: the force falls monotonically from the top to where the ball leaves, and the
    # ball may go over the top once before
    grid = np.linspace(Long(0), late, 400)
    angle, speed = motion(grid)
    first = int(np.argmax(-ratio * np.cos(angle) - speed**2 < 0))
    early, late = grid[first - 1], grid[first]
    while late - early > 2 * EPS * late:
        middle = (early + late) / 2
        if not early < middle < late:
            break
        early, late = (early, middle) if push(middle) < 0 else (middle, late)
    return late


def path(
    ball: Ball, motion: Any, leaves: Long, axis: Array, up: Array, reach: Long, rolls: bool
) -> Any:
    """Coordinates over time."""
    body, centre = ball.body, long(ball.pair.r_A)
    forward = np.cross(axis, up)
    ratio = reach / ball.radius if rolls else Long(0)
    first = motion(long([0]))[0][0]

    def coordinates(times: Array) -> Array:
        t = long(times)
        s = np.minimum(t, leaves)
        angle, rate = motion(s)
        sin, cos = -np.sin(angle)[:, None], -np.cos(angle)[:, None]
        flown, speed = (t - s)[:, None], (reach * rate)[:, None]
        v = speed * (forward * cos - up * sin)
        p = centre + reach * (forward * sin + up * cos) + v * flown + body.g * flown**2 / 2
        turn = ratio * (angle - first + rate * (t - s))
        q = unit(product(about(axis, turn), body.q))
        return coordinates_of(body, p, q, v + body.g * flown, (ratio * rate)[:, None] * axis)

    return coordinates
