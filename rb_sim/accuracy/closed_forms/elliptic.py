"""Jacobi's elliptic functions and integrals of the first kind in long doubles.

R. Bulirsch, Numer. Math. 7 (1965) 78 (descending Landen transformation); B. C. Carlson, Numer.
Algorithms 10 (1995) 13 (duplication).  The complementary parameter m1 = 1 - m is the argument, so
that nothing is lost near the separatrix, where m1 is small.
"""

from __future__ import annotations

from rb_sim.accuracy.closed_forms.extended import EPS, Array, Long, long, np


def jacobi(u: Array, m1: Long) -> tuple[Array, Array, Array]:
    """(sn, cn, dn) of u, shape (n,), for 0 < m1 <= 1."""
    means, roots = [], []
    a, c, rest = Long(1), Long(1), Long(m1)
    while True:
        root = np.sqrt(rest)
        means.append(a)
        roots.append(root)
        c = (a + root) / 2
        if abs(a - root) <= np.sqrt(EPS) * a / 8:
            break
        rest, a = root * a, c
    angle = long(u) * c
    s = np.sin(angle)
    safe = np.where(s == 0, 1, s)
    a = np.cos(angle) / safe
    c = c * a
    dn = np.ones_like(angle)
    for mean, root in zip(reversed(means), reversed(roots), strict=True):
        a = a * c
        c = c * dn
        dn = (root + a) / (mean + a)
        a = c / mean
    sn = np.sign(s) / np.sqrt(c * c + 1)
    cn = np.where(s == 0, np.cos(angle), c * sn)
    return sn, cn, np.where(s == 0, 1, dn)


def carlson_rf(x: Long, y: Long, z: Long) -> Long:
    """R_F(x, y, z) = 1/2 integral of dt / sqrt((t + x)(t + y)(t + z))."""
    for _ in range(200):
        shift = np.sqrt(x * y) + np.sqrt(y * z) + np.sqrt(z * x)
        x, y, z = (x + shift) / 4, (y + shift) / 4, (z + shift) / 4
        mean = (x + y + z) / 3
        spread = max(abs(x - mean), abs(y - mean), abs(z - mean)) / mean
        if spread < Long(EPS) ** (Long(1) / 8):
            break
    X, Y = 1 - x / mean, 1 - y / mean
    Z = -X - Y
    e2, e3 = X * Y - Z * Z, X * Y * Z
    series = (
        1 - e2 / 10 + e3 / 14 + e2 * e2 / 24 - 3 * e2 * e3 / 44
        - 5 * e2**3 / 208 + 3 * e3 * e3 / 104 + e2 * e2 * e3 / 16
    )  # fmt: skip
    return series / np.sqrt(mean)


def quarter_period(m1: Long) -> Long:
    """K(m) by the arithmetic-geometric mean."""
    a, b = Long(1), np.sqrt(Long(m1))
    while abs(a - b) > EPS * a * 2:
        a, b = (a + b) / 2, np.sqrt(a * b)
    return 2 * np.arctan(Long(1)) / a


def argument(sn: Long, cn: Long, m1: Long) -> Long:
    """u in (-2K, 2K] with these sn and cn."""
    size = np.sqrt(sn * sn + cn * cn)
    sn, cn = sn / size, cn / size
    first = sn * carlson_rf(cn * cn, cn * cn + m1 * sn * sn, Long(1))
    if cn >= 0:
        return first
    return (2 if sn >= 0 else -2) * quarter_period(m1) - first
