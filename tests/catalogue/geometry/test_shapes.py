"""The contact point is the lowest point of the surface, and moves as its rate says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.interpreted import interpreted

CENTRE = (0.02, -0.01, 0.03)
AXIS = (0.48, -0.6, 0.64)
GAMMA = (0.6, 0.48, 0.64)
GAMMA_DOT = tuple(np.cross(GAMMA, (0.7, -1.1, 0.4)).tolist())


def cloud(kind: str) -> np.ndarray:
    """Many points of the surface, about its centre."""
    u, w = np.meshgrid(np.linspace(0.0, 2.0 * math.pi, 721), np.linspace(0.0, math.pi, 361))
    ball = np.stack([np.cos(u) * np.sin(w), np.sin(u) * np.sin(w), np.cos(w)], -1).reshape(-1, 3)
    if kind == "sphere":
        return 0.3 * ball
    if kind == "ellipsoid":
        return ball * [0.3, 0.2, 0.1]
    e1 = np.cross(AXIS, (0.0, 0.0, 1.0)) / np.linalg.norm(np.cross(AXIS, (0.0, 0.0, 1.0)))
    s = np.linspace(0.0, 2.0 * math.pi, 7201)[:, None]
    return 0.3 * (np.cos(s) * e1 + np.sin(s) * np.cross(AXIS, e1))


def contact(kind: str, gamma: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """(support, its rate for GAMMA_DOT)."""
    from rb_sim.catalogue.geometry import smooth_surfaces as c

    surface = {
        "sphere": c.SphereSurface(CENTRE, 0.3),
        "disk": c.RimSurface(CENTRE, 0.3, AXIS),
        "ellipsoid": c.EllipsoidSurface(CENTRE, (0.3, 0.2, 0.1)),
    }[kind]
    return np.array(c.support(surface, gamma)), np.array(c.support_rate(surface, gamma, GAMMA_DOT))


@pytest.mark.parametrize("kind", ["sphere", "disk", "ellipsoid"])
def test_support_is_the_lowest_point(kind: str) -> None:
    point, _ = interpreted(contact, kind, GAMMA)
    points = cloud(kind)
    lowest = points[np.argmin(points @ GAMMA)]
    assert_allclose(point - CENTRE, lowest, atol=2e-3)
    assert (point - CENTRE) @ np.array(GAMMA) <= (points @ GAMMA).min() + 1e-12


@pytest.mark.parametrize("kind", ["sphere", "disk", "ellipsoid"])
def test_rate_is_the_derivative(kind: str) -> None:
    h = 1e-5
    ahead, behind = (
        interpreted(contact, kind, tuple((np.array(GAMMA) + s * np.array(GAMMA_DOT)).tolist()))[0]
        for s in (h, -h)
    )
    assert_allclose(interpreted(contact, kind, GAMMA)[1], (ahead - behind) / (2.0 * h), atol=1e-9)


def lying(gamma: tuple[float, ...]) -> tuple[np.ndarray, ...]:
    """Support and rate of a rim that may lie flat, then those of one that may not."""
    from rb_sim.catalogue.geometry import smooth_surfaces as c

    both = c.LyingRimSurface(CENTRE, 0.3, AXIS), c.RimSurface(CENTRE, 0.3, AXIS)
    of = [(c.support(rim, gamma), c.support_rate(rim, gamma, GAMMA_DOT)) for rim in both]
    return tuple(np.array(values) for pair in of for values in pair)


@pytest.mark.parametrize("lean", [1.0, 0.1, 1e-6, 1e-9])
def test_a_rim_that_may_lie_flat_is_a_rim_as_long_as_it_leans(lean: float) -> None:
    flat = np.array(AXIS) / np.linalg.norm(AXIS)
    gamma = flat + lean * (np.array(GAMMA) - flat)
    point, rate, expected, its_rate = interpreted(lying, tuple(gamma.tolist()))
    assert_allclose(point, expected, atol=1e-15)
    assert_allclose(rate, its_rate, rtol=1e-12)


def test_a_rim_that_lies_flat_touches_somewhere() -> None:
    """The rim has no lowest point then: one of its points, which stays."""
    from rb_sim.catalogue.geometry import smooth_surfaces as c

    axis = tuple((np.array(AXIS) / np.linalg.norm(AXIS)).tolist())
    rim = c.LyingRimSurface(CENTRE, 0.3, axis)
    point = np.array(interpreted(c.support, rim, axis)) - CENTRE
    assert_allclose([np.linalg.norm(point), point @ axis], [0.3, 0.0], atol=1e-15)
    assert interpreted(c.support_rate, rim, axis, GAMMA_DOT) == (0.0, 0.0, 0.0)
