"""Guide curves c(s): point, first and second derivative by the parameter; nearest parameter."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rb_sim.catalogue.types import Vec3
from rb_sim.maths.jit import dispatch
from rb_sim.maths.scalars import atan2, cos, sin
from rb_sim.maths.vectors import add, dot, scale, sub

SPLINE_DEGREE = 7
"""Seventh degree: curvature, and the reaction with it, is sixth-order accurate in the spacing."""


class LineCurve(NamedTuple):
    point: Vec3
    direction: Vec3
    """unit vector; s is the length along it [m]."""


class CircleCurve(NamedTuple):
    centre: Vec3
    e1: Vec3
    e2: Vec3
    """unit vectors in the plane; c = centre + radius (cos s e1 + sin s e2), s in rad."""
    radius: float


class SplineCurve(NamedTuple):
    breaks: np.ndarray
    """shape (m + 1,)."""
    coefficients: np.ndarray
    """highest power first, shape (m, 3, degree + 1)."""
    period: float
    """length of the parameter range of a closed curve, 0 for an open one."""


def spline_through(points: np.ndarray, closed: bool) -> SplineCurve:
    """Interpolating spline through points (n, 3) by chord length.

    A closed curve repeats its first point at the end by itself.
    """
    from scipy.interpolate import make_interp_spline  # slow to import, and few scenes need it

    p = np.asarray(points, dtype=float)
    if closed and not np.array_equal(p[0], p[-1]):
        p = np.vstack([p, p[:1]])
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    degree = min(SPLINE_DEGREE, (len(p) - 1) // 2 * 2 + 1, len(p) - 1)
    if degree % 2 == 0:
        degree -= 1
    spline = make_interp_spline(chord, p, k=degree, bc_type="periodic" if closed else None)
    breaks = np.unique(spline.t[degree : len(spline.t) - degree])
    powers = [
        spline(breaks[:-1], nu=order) / math.factorial(order) for order in range(degree, -1, -1)
    ]
    coefficients = np.ascontiguousarray(np.stack(powers, axis=-1))
    return SplineCurve(breaks, coefficients, float(chord[-1]) if closed else 0.0)


@dispatch
def curve_point(curve, s):
    """(c, c', c'') at the parameter s."""


@dispatch
def curve_nearest(curve, p):
    """Parameter of the point of the curve nearest to p, for p close to the curve."""


@curve_point.register(LineCurve)
def line_point(curve, s):
    return add(curve.point, scale(s, curve.direction)), curve.direction, (0.0, 0.0, 0.0)


@curve_nearest.register(LineCurve)
def line_nearest(curve, p):
    return dot(sub(p, curve.point), curve.direction)


@curve_point.register(CircleCurve)
def circle_point(curve, s):
    c, q = curve.radius * cos(s), curve.radius * sin(s)
    radial = add(scale(c, curve.e1), scale(q, curve.e2))
    tangent = add(scale(-q, curve.e1), scale(c, curve.e2))
    return add(curve.centre, radial), tangent, scale(-1.0, radial)


@curve_nearest.register(CircleCurve)
def circle_nearest(curve, p):
    d = sub(p, curve.centre)
    return atan2(dot(d, curve.e2), dot(d, curve.e1))


@curve_point.register(SplineCurve)
def spline_point(curve, s):
    if curve.period > 0.0:
        s = s - curve.period * math.floor(s / curve.period)
    m = curve.breaks.shape[0] - 1
    i = min(max(np.searchsorted(curve.breaks, s, side="right") - 1, 0), m - 1)
    u = s - curve.breaks[i]
    a = curve.coefficients[i]
    x0 = x1 = x2 = y0 = y1 = y2 = z0 = z1 = z2 = 0.0
    for j in range(a.shape[1]):
        x2, y2, z2 = x2 * u + 2.0 * x1, y2 * u + 2.0 * y1, z2 * u + 2.0 * z1
        x1, y1, z1 = x1 * u + x0, y1 * u + y0, z1 * u + z0
        x0, y0, z0 = x0 * u + a[0, j], y0 * u + a[1, j], z0 * u + a[2, j]
    return (x0, y0, z0), (x1, y1, z1), (x2, y2, z2)


@curve_nearest.register(SplineCurve)
def spline_nearest(curve, p):
    """Nearest of the breakpoints, then Newton's iteration on (c - p) . c' = 0."""
    best, s = np.inf, curve.breaks[0]
    for i in range(curve.coefficients.shape[0]):
        k = curve.coefficients.shape[2] - 1
        a = curve.coefficients[i]
        d = (a[0, k] - p[0], a[1, k] - p[1], a[2, k] - p[2])
        if dot(d, d) < best:
            best, s = dot(d, d), curve.breaks[i]
    for _ in range(30):
        c, c1, c2 = spline_point(curve, s)
        d = sub(c, p)
        step = dot(d, c1) / (dot(c1, c1) + max(dot(d, c2), -0.5 * dot(c1, c1)))
        s -= step
        if abs(step) <= 1e-15 * (1.0 + abs(s)):
            break
    return s
