# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Linear models, carried derivatives and many bodies on guides along splines, by closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.scene.load import scene_from_mapping
from rb_sim.simulation.sensitivity import TangentSimulation
from tests.mechanics.test_guides import NODES, VALLEY, WEIGHTS, G, Slide, parabola, pieces, sliding


def hollow(n: int) -> list[list[float]]:
    """z = x^2 / 2, which the spline has exactly."""
    x = np.linspace(-1.0, 1.0, n)
    return np.stack([x, 0.0 * x, 0.5 * x * x], axis=-1).tolist()


def lowest(points: list[list[float]]) -> float:
    """The parameter at which the slope of the curve is level, by bisection."""
    curve = pieces(points)
    low, high = curve.breaks[0], curve.breaks[-1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if curve.point(middle)[1][2] < 0.0 else (low, middle)
    return 0.5 * (low + high)


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
@pytest.mark.parametrize("points", [hollow(31), hollow(30), VALLEY])
def test_small_oscillations_at_the_bottom(points: list[list[float]], coordinates: str) -> None:
    """w^2 = g z'' / |c'|^2; hollow(31) has a break just there."""
    s = lowest(points)
    _, slope, bend = pieces(points).point(s)
    scene = load_scene(sliding(points, s, 0.0, duration=1.0))
    model = Simulation(scene, coordinates=coordinates).linearize()
    w = math.sqrt(G * bend[2] / np.dot(slope, slope))
    assert len(model.states) == 2
    assert_allclose(np.sort(model.eigenvalues.imag), [-w, w], rtol=1e-9)
    assert_allclose(model.eigenvalues.real, 0.0, atol=1e-9)


def by_energy(slide: Slide, a: float, b: float) -> float:
    """dt/dE of the time from a to b, m = 1: minus the integral of |c'| / v^3 over ds."""
    marks = [a, *(x for x in slide.curve.breaks.tolist() if a < x < b), b]
    total = []
    for begin, end in zip(marks, marks[1:], strict=False):
        half, middle = 0.5 * (end - begin), 0.5 * (begin + end)
        for w, x in zip(WEIGHTS, NODES, strict=True):
            c, slope, _ = slide.curve.point(middle + half * x)
            speed = math.sqrt(2.0 * (slide.energy - G * c[2]))
            total.append(-half * w * math.hypot(*slope) / speed**3)
    return math.fsum(total)


@pytest.mark.parametrize(("points", "s"), [(parabola(31), 0.7), (VALLEY, 0.3)])
def test_derivatives_by_the_speed_at_the_start(points: list[list[float]], s: float) -> None:
    """The place at t moves along the curve by minus dt/dE of its arc for each unit of energy."""
    curve, speed = pieces(points), 2.0

    def scene_at(x: Any) -> Any:
        return scene_from_mapping(sliding(points, s, float(x[0]), duration=0.5, tolerance=1e-13))

    simulation = TangentSimulation(scene_at, np.array([speed]), [speed])
    times = simulation.run(watched=False).t
    (found,) = simulation.take_derivatives()
    slide, start = Slide(curve, s, speed), curve.point(s)[1]
    for t, moved in zip(times, found.position[:, 0], strict=True):
        now = slide.parameter(t)
        by_speed = -slide.rate(now) * by_energy(slide, s, now) * speed * np.dot(start, start)
        assert_allclose(moved, by_speed * np.array(curve.point(now)[1]), rtol=0.0, atol=1e-10)


def test_twelve_bodies_each_on_a_spline() -> None:
    """Many enough for laws over tables: each moves as if alone, for its own start."""
    points = parabola(31)
    speeds = [2.0 + 0.1 * k for k in range(12)]
    bodies, constraints = {}, {}
    for k, speed in enumerate(speeds):
        alone = sliding(points, 0.7, speed)
        bodies[f"b{k}"] = alone["bodies"]["b"]
        constraints[f"guide{k}"] = alone["constraints"]["guide"] | {"body": f"b{k}"}
    whole = sliding(points, 0.7, 1.0, duration=0.5, tolerance=1e-12)
    scene = load_scene(whole | {"bodies": bodies, "constraints": constraints})
    block = Simulation(scene).run(watched=False).block
    for k, speed in enumerate(speeds):
        slide = Slide(pieces(points), 0.7, speed)
        exact = [slide.curve.point(slide.parameter(t))[0] for t in block.t]
        assert_allclose(block.position[:, k], exact, rtol=0.0, atol=1e-10)
