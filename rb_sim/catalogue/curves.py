"""Guide curves c(s): point, first and second derivative by the parameter; nearest parameter."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rb_sim.catalogue.splines import Pieces
from rb_sim.catalogue.types import Vec3
from rb_sim.graph.functions import call
from rb_sim.numerics.kernels import dispatch
from rb_sim.numerics.vectors import add, atan2, cos, dot, scale, sin, sub

SPLINE_DEGREE = 7
"""Seventh degree: curvature, and the reaction with it, is sixth-order accurate in the spacing."""


class LineCurve(NamedTuple):
    """A straight line."""

    point: Vec3
    direction: Vec3
    """unit vector; s is the length along it [m]."""


class CircleCurve(NamedTuple):
    """A circle in a plane."""

    centre: Vec3
    e1: Vec3
    e2: Vec3
    """unit vectors in the plane; c = centre + radius (cos s e1 + sin s e2), s in rad."""
    radius: float


class SplineCurve(NamedTuple):
    """A spline through points."""

    pieces: Pieces
    """polynomials of the parameter s, about the length [m] along chords."""


def spline_through(points: np.ndarray, closed: bool) -> SplineCurve:
    """Interpolating spline through points (n, 3) by chord length.

    A closed curve repeats its first point at the end by itself.
    """
    from scipy.interpolate import make_interp_spline  # slow to import, and few scenes need it

    p = np.asarray(points, dtype=float)
    if closed and not np.array_equal(p[0], p[-1]):
        p = np.vstack([p, p[:1]])
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    degree = min(SPLINE_DEGREE, len(p) - 1)
    degree -= 1 - degree % 2  # an odd one, which has its breaks at points
    spline = make_interp_spline(chord, p, k=degree, bc_type="periodic" if closed else None)
    breaks = np.unique(spline.t[degree : len(spline.t) - degree])
    powers = [
        spline(breaks[:-1], nu=order) / math.factorial(order) for order in range(degree, -1, -1)
    ]
    coefficients = np.ascontiguousarray(np.stack(powers, axis=-1))
    return SplineCurve(Pieces(breaks, coefficients, float(chord[-1]) if closed else 0.0))


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
    return curve.pieces.point(s)


@curve_nearest.register(SplineCurve)
def spline_nearest(curve, p):
    return call(curve.pieces.nearest, *p)[0]
