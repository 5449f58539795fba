"""One contact alone, exactly: the reaction that Signorini's and Coulomb's laws leave it.

With the contact's own block W of the Delassus matrix (components normal, first and second tangent)
and the velocity q that it would have without its reaction, u = W r + q, one of three holds
(Bonnefon and Daviet 2011):

    it opens    r = 0,  u_n >= 0
    it sticks   u = 0,  |r_T| <= mu r_n
    it slips    u_n = 0,  r_T = -u_T / lambda with lambda > 0,  |r_T| = mu r_n

The slip leaves one equation for lambda, which is solved by Newton's method inside a bracket.
"""

from __future__ import annotations

import math

from rb_sim.numerics.kernels import inline

ROUNDS = 100
"""Of Newton's method or bisection for lambda; bisection alone would end within them."""
EXACT = 1e-15
"""Of the reaction: distance to the bound at which it is on it."""
ROUGH = 1e8
"""Coefficient of friction beyond which none slips."""


@inline
def held_back(a, b, c, p, q, stiff):
    """-(S + stiff)^-1 (p, q) of the symmetric S = (a b; b c)."""
    a, c = a + stiff, c + stiff
    area = a * c - b * b
    return (b * q - c * p) / area, (b * p - a * q) / area


@inline
def on_bound(a, b, c, p, q, m0, m1, m2):
    """(x, y) = -(S + lambda)^-1 (p, q) with lambda >= 0 and |(x, y)| = m0 + m1 x + m2 y.

    To be called where lambda = 0 gives a longer vector than its bound, and m0 > 0.
    """
    size = math.sqrt(p * p + q * q)
    if m1 == 0.0 and m2 == 0.0 and b == 0.0 and a == c:
        return -m0 * p / size, -m0 * q / size
    low, high = 0.0, size / m0
    for _ in range(ROUNDS):
        x, y = held_back(a, b, c, p, q, high)
        if math.sqrt(x * x + y * y) <= m0 + m1 * x + m2 * y:
            break
        low, high = high, 4.0 * high
    stiff = 0.5 * (low + high)
    x, y = held_back(a, b, c, p, q, stiff)
    for _ in range(ROUNDS):
        length = math.sqrt(x * x + y * y)
        over = length - (m0 + m1 * x + m2 * y)
        if abs(over) <= EXACT * length:
            break
        if over > 0.0:
            low = stiff
        else:
            high = stiff
        dx, dy = held_back(a, b, c, x, y, stiff)
        slope = (x * dx + y * dy) / length - (m1 * dx + m2 * dy) if length > 0.0 else 0.0
        stiff = stiff - over / slope if slope < 0.0 else high
        if not low < stiff < high:
            stiff = 0.5 * (low + high)
        if high - low <= EXACT * high:
            break
        x, y = held_back(a, b, c, p, q, stiff)
    return x, y


@inline
def within_circle(a, b, c, p, q, most):
    """(x, y) with S (x, y) + (p, q) = 0, or of size `most` against what is left of it."""
    if not most > 0.0:
        return 0.0, 0.0
    x, y = held_back(a, b, c, p, q, 0.0)
    if x * x + y * y <= most * most:
        return x, y
    return on_bound(a, b, c, p, q, most, 0.0, 0.0)


@inline
def one_contact(w, q, mu):
    """The reaction (r_n, r_1, r_2) of a contact.

    w: its block (nn, n1, n2, 11, 12, 22), positive definite; q: velocity without the reaction.
    """
    if q[0] >= 0.0:
        return 0.0, 0.0, 0.0
    m1, m2 = w[1] / w[0], w[2] / w[0]
    a, b, c = w[3] - w[1] * m1, w[4] - w[1] * m2, w[5] - w[2] * m2
    p1, p2 = q[1] - m1 * q[0], q[2] - m2 * q[0]
    if mu == 0.0:
        return -q[0] / w[0], 0.0, 0.0
    x, y = held_back(a, b, c, p1, p2, 0.0)
    push = -q[0] / w[0] - m1 * x - m2 * y
    mu = min(mu, ROUGH)
    if push >= 0.0 and x * x + y * y <= mu * mu * push * push:
        return push, x, y
    x, y = on_bound(a, b, c, p1, p2, -mu * q[0] / w[0], -mu * m1, -mu * m2)
    return math.sqrt(x * x + y * y) / mu, x, y
