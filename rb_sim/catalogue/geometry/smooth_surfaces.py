# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Smooth convex surfaces on a plane: the contact point as a function of the plane's normal.

For a unit normal gamma (body axes, pointing from the plane into the body) `support` gives the
vector from the centre of mass C to the contact point P, and `support_rate` its change in the body
frame when gamma changes at the rate gamma_dot.
"""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.catalogue.spec import Vec3
from rb_sim.numerics.kernels import dispatch
from rb_sim.numerics.vectors import add, dot, perpendicular, scale, sqrt, sub, where

FLAT = 1e-10
"""Tilt of a rim [rad] below which it counts as flat."""


class SphereSurface(NamedTuple):
    """|x - centre| = radius."""

    centre_C: Vec3
    """centre of the sphere from C, body axes [m]."""
    radius: float


class RimSurface(NamedTuple):
    """Circle |x - centre| = radius normal to the axis: the edge of a thin disk."""

    centre_C: Vec3
    radius: float
    axis_B: Vec3


class LyingRimSurface(NamedTuple):
    """A rim that may lie flat on the plane: one of its points then represents all."""

    centre_C: Vec3
    radius: float
    axis_B: Vec3


class EllipsoidSurface(NamedTuple):
    """sum (x_i / a_i)^2 = 1 along the body axes."""

    centre_C: Vec3
    semi_axes: Vec3


@dispatch
def support(surface, gamma):
    """r_CP [m], body axes."""


@dispatch
def support_rate(surface, gamma, gamma_dot):
    """d(r_CP)/dt in the body frame [m/s]."""


@support.register(SphereSurface)
def sphere_support(surface, gamma):
    """centre - radius gamma."""
    return sub(surface.centre_C, scale(surface.radius, gamma))


@support_rate.register(SphereSurface)
def sphere_support_rate(surface, gamma, gamma_dot):
    """-radius gamma_dot."""
    return scale(-surface.radius, gamma_dot)


@support.register(RimSurface)
def rim_support(surface, gamma):
    """The lowest point of the rim: the centre less radius times the unit vector of gamma normal to
    the axis.

    gamma may not be along the axis: use LyingRimSurface then.
    """
    k = surface.axis_B
    u = sub(gamma, scale(dot(gamma, k), k))
    return sub(surface.centre_C, scale(surface.radius / sqrt(dot(u, u)), u))


@support_rate.register(RimSurface)
def rim_support_rate(surface, gamma, gamma_dot):
    """Rate of `rim_support`; gamma may not be along the axis."""
    k = surface.axis_B
    u = sub(gamma, scale(dot(gamma, k), k))
    u_dot = sub(gamma_dot, scale(dot(gamma_dot, k), k))
    length2 = dot(u, u)
    s = -surface.radius / sqrt(length2)
    return scale(s, sub(u_dot, scale(dot(u, u_dot) / length2, u)))


def lies_flat(surface, gamma):
    """Whether gamma is along the rim's axis to within FLAT [rad]."""
    u = sub(gamma, scale(dot(gamma, surface.axis_B), surface.axis_B))
    return dot(u, u) < FLAT * FLAT


@support.register(LyingRimSurface)
def lying_rim_support(surface, gamma):
    """As `rim_support`; if flat, the point in an arbitrary fixed direction normal to the axis."""
    across, _ = perpendicular(surface.axis_B)
    some_point = sub(surface.centre_C, scale(surface.radius, across))
    flat = lies_flat(surface, gamma)
    return where(flat, some_point, rim_support(surface, where(flat, across, gamma)))


@support_rate.register(LyingRimSurface)
def lying_rim_support_rate(surface, gamma, gamma_dot):
    """As `rim_support_rate`; zero if flat."""
    across, _ = perpendicular(surface.axis_B)
    flat = lies_flat(surface, gamma)
    tilted = where(flat, across, gamma)  # any tilted direction: the result is not used if flat
    return where(flat, (0.0, 0.0, 0.0), rim_support_rate(surface, tilted, gamma_dot))


@support.register(EllipsoidSurface)
def ellipsoid_support(surface, gamma):
    """centre - (a_i^2 gamma_i) / sqrt(sum a_i^2 gamma_i^2)."""
    a = surface.semi_axes
    e = (a[0] * a[0] * gamma[0], a[1] * a[1] * gamma[1], a[2] * a[2] * gamma[2])
    return sub(surface.centre_C, scale(1.0 / sqrt(dot(e, gamma)), e))


@support_rate.register(EllipsoidSurface)
def ellipsoid_support_rate(surface, gamma, gamma_dot):
    """Rate of `ellipsoid_support`."""
    a = surface.semi_axes
    e = (a[0] * a[0] * gamma[0], a[1] * a[1] * gamma[1], a[2] * a[2] * gamma[2])
    e_dot = (a[0] * a[0] * gamma_dot[0], a[1] * a[1] * gamma_dot[1], a[2] * a[2] * gamma_dot[2])
    h2 = dot(e, gamma)
    s = -1.0 / sqrt(h2)
    return add(scale(s, e_dot), scale(-s * dot(e, gamma_dot) / h2, e))
