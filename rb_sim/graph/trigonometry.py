"""Sine and cosine from arithmetic alone, for code that computes several numbers at once.

x = k pi/2 + r with |r| <= pi/4: pi/2 is subtracted in three parts, of which k times the first two
is exact (Cody and Waite 1980), and r goes into the polynomials of FDLIBM (k_sin.c, k_cos.c; Sun
Microsystems 1993).  Good to two units in the last place of the larger of both.
"""

from __future__ import annotations

from typing import Any

from rb_sim.graph.functions import floor, where

NEAR = 2.0**20
"""|x| up to which `sine_and_cosine` holds [rad]."""

PARTS = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
"""pi / 2: 33 bits, 33 bits, and the rest."""
TWO_OVER_PI = 6.36619772367581382433e-01
SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


def polynomial(coefficients: tuple[float, ...], z: Any) -> Any:
    """c0 + c1 z + c2 z^2 ... by Horner's rule."""
    value: Any = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        value = c + z * value
    return value


def sine_and_cosine(x: Any) -> tuple[Any, Any]:
    """(sin x, cos x) for |x| <= NEAR [rad]; x: a float or a symbol."""
    k = floor(x * TWO_OVER_PI + 0.5)
    r = ((x - k * PARTS[0]) - k * PARTS[1]) - k * PARTS[2]
    z = r * r
    s = r + r * z * polynomial(SINE, z)
    half = 0.5 * z
    w = 1.0 - half
    c = w + (((1.0 - w) - half) + z * (z * polynomial(COSINE, z)))
    quadrant = k - 4.0 * floor(0.25 * k)
    odd = (quadrant - 2.0 * floor(0.5 * quadrant)) > 0.5
    sine, cosine = where(odd, c, s), where(odd, s, c)
    below = quadrant > 1.5
    left = (quadrant > 0.5) & (quadrant < 2.5)
    return where(below, -sine, sine), where(left, -cosine, cosine)
