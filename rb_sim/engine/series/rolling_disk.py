"""Series of a disk that rolls on its edge on a level plane under gravity (Routh; LL 38).

With e the level direction in the disk's plane, u up its slope from the contact to the centre and k
its axis (e x u = k), tilt theta between k and the normal n, c and s its cosine and sine, and
w = w1 e + w2 u + w3 k:
    (A + m a^2) w1' = w2 (A own - (C + m a^2) w3) - m g a c,   A w2' = w1 (C w3 - A own),
    (C + m a^2) w3' = m a^2 w1 w2,   c' = -s w1,   s' = c w1,
where (e, u, k) itself turns by w1 e + w2 u + own k, that is by turn = w2/s about n; own = c turn.
The disk spins in it by w3 - own about k, and its centre goes by a (w1 k - w3 e).
"""

from __future__ import annotations

import math

from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.types import BodyState
from rb_sim.contact.geometry.shapes import RimSurface
from rb_sim.engine.one_body import total_wrench
from rb_sim.engine.series.expansion import quadratic_order
from rb_sim.engine.series.rolling import (
    rolling_evaluate,
    rolling_expand,
    rolling_plan,
    rolling_suits,
)
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import (
    ZERO,
    add,
    cross,
    dot,
    norm,
    quaternion_product,
    rotate,
    scale,
    sub,
    symmetric_times,
    unrotate,
)

W1, W2, W3, COSINE, SINE, TURN, OWN, SIDE, AHEAD, ACROSS, ALONG_E, ALONG_B = range(12)
"""Rows: the symbols above; SIDE = s w1; cosine and sine of the turn about n since the start; and
the level velocity over the radius, along e and b = n x e as they were at the start."""
SAME = 4e-16
"""Relative difference of moments that are equal but for rounding."""


def suits_disk(system):
    """A body of revolution about the disk's axis, its centre at C, under gravity along n."""
    axis, inertia = system.surface.axis_B, system.body.inertia
    axial = symmetric_times(inertia, axis)
    moment = dot(axis, axial)
    across = 0.5 * (inertia[0] + inertia[1] + inertia[2] - moment)
    # of revolution: I = across 1 + (moment - across) k k^T
    lacking = [
        value - (across * same + (moment - across) * axis[i] * axis[j])
        for value, (i, j, same) in zip(
            inertia,
            ((0, 0, 1), (1, 1, 1), (2, 2, 1), (0, 1, 0), (0, 2, 0), (1, 2, 0)),
            strict=True,
        )
    ]
    level = all(
        isinstance(row, GravityRow) and norm(cross(row.acceleration_W, system.normal)) == 0.0
        for row in system.effects
    )
    even = max(map(abs, lacking)) <= SAME * max(moment, across)
    return tuple(system.surface.centre_C) == ZERO and even and level


rolling_suits[RimSurface] = suits_disk


@inline
def slope_frame(system, q):
    """(e, u in body axes, c, s)."""
    k, gamma = system.surface.axis_B, unrotate(q, system.normal)
    c = dot(gamma, k)
    up = sub(gamma, scale(c, k))
    s = norm(up)
    u = scale(1.0 / s, up)
    return cross(u, k), u, c, s


@rolling_plan.register(RimSurface)
def disk_plan(surface, tolerance):
    return 12, quadratic_order(tolerance)


@rolling_expand.register(RimSurface)
def disk_expand(surface, system, t, y, order, room):
    q, spin = (y[3], y[4], y[5], y[6]), (y[7], y[8], y[9])
    B = BodyState((y[0], y[1], y[2]), q, ZERO, spin)
    e, u, c0, s0 = slope_frame(system, q)
    k_B, a = surface.axis_B, surface.radius
    force, _ = total_wrench(system.effects, t, system.body, B)
    rolled = system.body.mass * a * a
    axial = dot(k_B, symmetric_times(system.body.inertia, k_B))
    across = dot(u, symmetric_times(system.body.inertia, u))
    fall = a * dot(force, system.normal) / (across + rolled)
    keep, push = across / (across + rolled), (axial + rolled) / (across + rolled)
    swing, gain = axial / across, rolled / (axial + rolled)

    w1, w2, w3 = room[W1], room[W2], room[W3]
    c, s, turn, own = room[COSINE], room[SINE], room[TURN], room[OWN]
    side, ahead, askew = room[SIDE], room[AHEAD], room[ACROSS]
    along_e, along_b = room[ALONG_E], room[ALONG_B]
    w1[0], w2[0], w3[0] = dot(spin, e), dot(spin, u), dot(spin, k_B)
    c[0], s[0], ahead[0], askew[0] = c0, s0, 1.0, 0.0
    for n in range(order):
        back, rising, sideways, mixed = 0.0, c[0] * w1[n], s[0] * w1[n], w1[0] * w2[n]
        for i in range(n):
            back += turn[i] * s[n - i]
            rising += c[i + 1] * w1[n - 1 - i]
            sideways += s[i + 1] * w1[n - 1 - i]
            mixed += w1[i + 1] * w2[n - 1 - i]
        turn[n] = (w2[n] - back) / s0
        side[n] = sideways
        carried = 0.0
        for i in range(n + 1):
            carried += turn[i] * c[n - i]
        own[n] = carried
        x1, x2, ahead_rate, askew_rate, v_e, v_b = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(n + 1):
            j = n - i
            x1 += w2[i] * (keep * own[j] - push * w3[j])
            x2 += w1[i] * (swing * w3[j] - own[j])
            ahead_rate -= turn[i] * askew[j]
            askew_rate += turn[i] * ahead[j]
            v_e += side[i] * askew[j] - w3[i] * ahead[j]
            v_b -= side[i] * ahead[j] + w3[i] * askew[j]
        share = 1.0 / (n + 1)
        along_e[n], along_b[n] = v_e, v_b
        w1[n + 1], w2[n + 1] = share * (x1 + fall * c[n]), share * x2
        w3[n + 1] = share * gain * mixed
        c[n + 1], s[n + 1] = -share * sideways, share * rising
        ahead[n + 1], askew[n + 1] = share * ahead_rate, share * askew_rate
    largest = max(1.0, norm(spin))
    return disk_size(room, order - 1, largest, a), disk_size(room, order, largest, a)


@inline
def disk_size(room, n, spin, radius):
    """Largest coefficient n of the spin over `spin`, of the half angles and of the position."""
    size = max(abs(room[W1, n]), abs(room[W2, n]), abs(room[W3, n])) / spin
    half = 0.5 / n
    size = max(size, half * abs(room[W1, n - 1]), half * abs(room[TURN, n - 1]))
    size = max(size, half * (abs(room[W3, n - 1]) + abs(room[OWN, n - 1])))
    return max(size, radius / n * max(abs(room[ALONG_E, n - 1]), abs(room[ALONG_B, n - 1])))


@inline
def summed(room, order, h):
    """What w1, w2, w3 and s gain over h; and the integrals of w1, TURN, w3 - OWN, ALONG_E, ALONG_B.

    All sums in one loop, for each would wait for its own last term.
    """
    share, n = 1.0 / order, order - 1
    w1, w2, w3, s = room[W1, order], room[W2, order], room[W3, order], room[SINE, order]
    tilted, headed = share * room[W1, n], share * room[TURN, n]
    spun = share * (room[W3, n] - room[OWN, n])
    ahead, across = share * room[ALONG_E, n], share * room[ALONG_B, n]
    for k in range(order - 1, 0, -1):
        share, n = 1.0 / k, k - 1
        w1, w2 = room[W1, k] + h * w1, room[W2, k] + h * w2
        w3, s = room[W3, k] + h * w3, room[SINE, k] + h * s
        tilted, headed = share * room[W1, n] + h * tilted, share * room[TURN, n] + h * headed
        spun = share * (room[W3, n] - room[OWN, n]) + h * spun
        ahead = share * room[ALONG_E, n] + h * ahead
        across = share * room[ALONG_B, n] + h * across
    return (h * w1, h * w2, h * w3, h * s), (
        h * tilted,
        h * headed,
        h * spun,
        h * ahead,
        h * across,
    )


@inline
def turn_about(axis, angle):
    s = math.sin(0.5 * angle)
    return scale(s, axis) + (math.cos(0.5 * angle),)


@rolling_evaluate.register(RimSurface)
def disk_evaluate(surface, system, t, y, order, room, h):
    q, w, n = (y[3], y[4], y[5], y[6]), (y[7], y[8], y[9]), system.normal
    e, u, _, _ = slope_frame(system, q)
    e_W, k_B, a = rotate(q, e), surface.axis_B, surface.radius
    (dw1, dw2, dw3, rise), (tilted, headed, spun, ahead, across) = summed(room, order, h)
    world = quaternion_product(turn_about(n, headed), turn_about(e_W, tilted))
    turned = quaternion_product(world, quaternion_product(q, turn_about(k_B, spun)))
    dq = (turned[0] - q[0], turned[1] - q[1], turned[2] - q[2], turned[3] - q[3])
    ce, se = math.cos(spun), math.sin(spun)
    w1, w2, w3 = room[W1, 0] + dw1, room[W2, 0] + dw2, room[W3, 0] + dw3
    flat = add(scale(ce * w1 + se * w2, e), scale(ce * w2 - se * w1, u))
    dw = sub(add(flat, scale(w3, k_B)), w)
    level = add(scale(a * ahead, e_W), scale(a * across, cross(n, e_W)))
    return add(level, scale(a * rise, n)) + dq + dw
