# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Guides along splines: exact at every break, in both formulations.

The references are quadratures of the interpolant itself: with energy conserved, the time from one
parameter to another is the integral of |c'| / sqrt(v^2), piece by piece.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.curves import Pieces, share_of_step, spline_through
from rb_sim.graph.derivative import jacobian
from rb_sim.graph.functions import call
from rb_sim.graph.machine import PlainLaw, compile_law, evaluate
from rb_sim.graph.symbols import Graph
from tests.interpreted import trajectory

pytestmark = pytest.mark.filterwarnings("error::rb_sim.AccuracyWarning")
"""What agrees with its reference is not told as lost."""

G = 9.81
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)

Mapping = dict[str, Any]


def parabola(n: int) -> list[list[float]]:
    x = np.linspace(-1.0, 3.0, n)
    return np.stack([x, 0.0 * x, -0.5 * x * x], axis=-1).tolist()


LOOP = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.2], [-1.0, 0.1, 0.0], [0.0, -1.0, 0.3]]
"""Closed, and so few points that the spline is cubic: c'' has a kink at every point."""
VALLEY = [[-2.0, 0.0, 2.0], [-1.0, 0.1, 0.4], [0.1, 0.0, 0.0], [1.1, 0.0, 0.7], [2.0, 0.1, 2.2]]
"""Cubic, with one break at the bottom."""


def pieces(points: list[list[float]], closed: bool = False) -> Pieces:
    return spline_through(np.array(points), closed).pieces


def sliding(points: list[list[float]], s: float, speed: float, **options: Any) -> Mapping:
    """A body at the parameter s of a curve, with ds/dt = speed, under gravity."""
    closed = options.pop("closed", False)
    c, slope, _ = (np.array(x) for x in pieces(points, closed).point(s))
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": c.tolist()}
    guide = {"type": "curve", "points": points, "closed": closed}
    return {
        "bodies": {"b": body | {"linear_velocity": (speed * slope).tolist()}},
        "constraints": {"guide": {"type": "translation", "body": "b", "guide": guide}},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"project_initial": True, "rate": 10.0, "tolerance": 1e-12} | options,
    }


class Slide:
    """The motion of such a body while it does not turn, by quadrature."""

    def __init__(self, curve: Pieces, s: float, speed: float) -> None:
        self.curve, self.s = curve, s
        c, slope, _ = curve.point(s)
        self.energy = 0.5 * (speed * math.hypot(*slope)) ** 2 + G * c[2]

    def rate(self, s: float) -> float:
        """ds/dt."""
        c, slope, _ = self.curve.point(s)
        return math.sqrt(2.0 * (self.energy - G * c[2])) / math.hypot(*slope)

    def time(self, a: float, b: float) -> float:
        """From a to b within one piece."""
        half, middle = 0.5 * (b - a), 0.5 * (a + b)
        return half * sum(
            w / self.rate(middle + half * x) for x, w in zip(NODES, WEIGHTS, strict=True)
        )

    def parameter(self, t: float) -> float:
        """s after the time t."""
        breaks = [b for b in self.curve.breaks.tolist() if b > self.s]
        times, begin = [0.0], self.s
        for end in breaks:
            step = self.time(begin, end)
            if math.fsum([*times, step]) > t:
                break
            times.append(step)
            begin = end
        left, s = t - math.fsum(times), begin
        for _ in range(8):
            s += (left - self.time(begin, s)) * self.rate(s)
        return s


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
@pytest.mark.parametrize("n", [31, 1601])
def test_the_tolerance_holds_at_every_break(n: int, coordinates: str) -> None:
    """Without steps that end at breaks, 1601 points are 8e-9 off."""
    curve = pieces(parabola(n))
    slide = Slide(curve, 0.7, 2.0)
    scene = sliding(parabola(n), 0.7, 2.0, duration=0.7)
    block = Simulation(load_scene(scene), coordinates=coordinates).run().block
    exact = [curve.point(slide.parameter(t))[0] for t in block.t]
    assert_allclose(block.position[:, 0], exact, rtol=0.0, atol=5e-12)


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
@pytest.mark.parametrize(("method", "allowed"), [("rk4", 2e-11), ("gauss6", 2e-12)])
def test_fixed_steps_end_at_breaks_and_go_on_on_their_grid(
    method: str, allowed: float, coordinates: str
) -> None:
    """Around a cubic; over its breaks rk4 is 1e-9 to 5e-9 off and gauss6 1e-10 to 7e-10."""
    ends = []
    for options in ({}, {"method": method, "step": 1e-3, "tolerance": None}):
        scene = sliding(LOOP, 0.3, 4.0, closed=True, duration=0.6, **options)
        simulation = Simulation(load_scene(scene), coordinates=coordinates)
        simulation.advance(0.6)
        ends.append(simulation.sample().block.position[0, 0])
    assert_allclose(ends[0], ends[1], rtol=0.0, atol=allowed)
    assert simulation.steps == 600


def test_fixed_steps_cut_at_breaks_are_the_same_in_pieces() -> None:
    """Bit for bit, with samples between a break and the end of its step."""
    options = {"duration": 0.2, "method": "rk4", "step": 0.01, "tolerance": None}
    scene = load_scene(sliding(parabola(31), 0.7, 2.0, **options))
    whole, parts = Simulation(scene), Simulation(scene)
    whole.advance(0.1875)
    for _ in range(64):
        parts.advance(0.1875 / 64)
    for name in ("position", "linear_velocity", "reaction_force"):
        one, two = (getattr(s.sample().block, name).tobytes() for s in (whole, parts))
        assert one == two


@pytest.mark.parametrize("method", ["dopri853", "radau5"])
@pytest.mark.parametrize("speed", [4.0, -4.0])
@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
def test_around_a_closed_cubic_and_back_to_the_start(
    coordinates: str, speed: float, method: str
) -> None:
    curve = pieces(LOOP, True)
    slide = Slide(curve, 0.0, speed)
    ends = [np.linspace(a, b, 5) for a, b in zip(curve.breaks, curve.breaks[1:], strict=False)]
    period = math.fsum(
        slide.time(a, b) for part in ends for a, b in zip(part, part[1:], strict=False)
    )
    scene = sliding(LOOP, 0.0, speed, closed=True, duration=period, method=method)
    run = Simulation(load_scene(scene), coordinates=coordinates).run()
    assert_allclose(run.block.position[-1], run.block.position[0], rtol=0.0, atol=5e-12)


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
def test_swinging_through_a_kink_of_the_curvature(coordinates: str) -> None:
    """The period between the two points of rest, by quadrature without their singularities."""
    curve, start = pieces(VALLEY), 0.8
    slide = Slide(curve, start, 0.0)
    end = float(curve.breaks[-1]) - 0.5
    for _ in range(60):  # the height of the start on the other side
        c, slope, _ = curve.point(end)
        end -= (G * c[2] - slide.energy) / (G * slope[2])
    low = float(curve.breaks[1])

    def half(a: float, b: float) -> float:
        """From rest at a to b: s = a + (b - a) x^2."""
        x = 0.5 + 0.5 * np.polynomial.legendre.leggauss(80)[0]
        w = 0.5 * np.polynomial.legendre.leggauss(80)[1]
        return sum(
            wi * abs(b - a) * 2.0 * xi / slide.rate(a + (b - a) * xi * xi)
            for xi, wi in zip(x, w, strict=True)
        )

    period = 2.0 * (half(start, low) + half(end, low))
    scene = sliding(VALLEY, start, 0.0, duration=period)
    run = Simulation(load_scene(scene), coordinates=coordinates).run()
    assert_allclose(run.block.position[-1], run.block.position[0], rtol=0.0, atol=5e-11)


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
def test_who_leaves_the_end_of_an_open_guide_is_told(coordinates: str) -> None:
    scene = sliding(VALLEY, 0.8, 20.0, duration=1.0)
    with pytest.raises(SimulationError, match="passed the end of its guide"):
        Simulation(load_scene(scene), coordinates=coordinates).run()


def test_interpreted_runs_give_the_same_numbers() -> None:
    scene = sliding(LOOP, 0.3, 3.0, closed=True, duration=0.3, tolerance=1e-9)
    for coordinates in ("auto", "maximal"):
        compiled = Simulation(load_scene(scene), coordinates=coordinates).run().block
        plain = trajectory(scene, coordinates)
        for name in ("position", "linear_velocity", "reaction_force"):
            assert_allclose(getattr(compiled, name), getattr(plain, name), atol=1e-11)


def test_a_guide_beside_a_contact_runs() -> None:
    """A ball dropped beside: the guided body moves as alone."""
    scene = sliding(parabola(31), 0.7, 2.0, duration=0.3)
    alone = Simulation(load_scene(scene)).run().block
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [0.0, 5.0, 0.2]}
    scene["bodies"]["ball"] = ball
    scene["constraints"]["floor"] = {"type": "contact", "body": "ball"}
    block = Simulation(load_scene(scene)).run().block
    assert_allclose(block.position[:, 0], alone.position[:, 0], rtol=0.0, atol=1e-9)


class Straight:
    """Steps along the axis of pieces of length 1 with kinks of size 1 at 1, 2 and 3."""

    pieces = Pieces(
        np.arange(5.0),
        np.array([[[(-1.0) ** i / 12.0, 0.0, 1.0, 0.0], [0.0] * 4, [0.0] * 4] for i in range(4)]),
        0.0,
    )
    table = pieces.table

    @classmethod
    def share(cls, s0: float, v0: float, s1: float, v1: float) -> float:
        return share_of_step(cls.table, s0, v0, s1, v1, 1.0, 1e-9)


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        ((0.5, 0.2, 0.7, 0.2), 1.0),
        ((0.5, 1.0, 1.5, 1.0), 0.5),
        ((1.5, -1.0, 0.5, -1.0), 0.5),
        ((1.0, 0.5, 1.5, 0.5), 1.0),
        ((1.5, -0.5, 1.0, -0.5), 1.0),
        ((0.25, 3.0, 3.25, 3.0), 0.25),
        ((0.5, 0.2, 1.0 + 1e-12, 0.8), 1.0),
        ((3.5, 1.0, 4.5, 1.0), 1.0),  # the ends of an open curve are no breaks
        ((0.9, 0.8, 0.9, -0.8), 0.5 - 0.25 * math.sqrt(2.0)),  # s = 0.9 + 0.8 x (1 - x)
        ((1.1, -0.8, 1.1, 0.8), 0.5 - 0.25 * math.sqrt(2.0)),
    ],
)
def test_the_share_of_a_step_before_the_first_break(
    step: tuple[float, ...], expected: float
) -> None:
    assert Straight.share(*step) == pytest.approx(expected, abs=1e-12)


def test_the_slope_of_the_nearest_parameter() -> None:
    """ds/dp against central differences, off the curve; and zero for the coefficients."""
    curve = pieces(LOOP, True)
    p = np.array([0.8, 0.75, 0.15])
    graph = Graph()
    y = graph.vector("y", 3)
    (s,) = call(curve.nearest, *y)
    sparse = jacobian([s, *call(curve.piece, s)], y)
    assert sparse.rows == (0, 0, 0)
    found, values = np.zeros(3), list(sparse.values)
    evaluate(compile_law(values), 0.0, p, np.zeros(1), found)
    plain = np.zeros(3)
    PlainLaw(values)(0.0, p, np.zeros(1), plain)
    assert_allclose(found, plain, rtol=1e-13)
    h = 1e-5
    differences = [
        (curve.nearest.plain(*(p + e))[0] - curve.nearest.plain(*(p - e))[0]) / (2.0 * h)
        for e in h * np.eye(3)
    ]
    assert_allclose(found, differences, rtol=1e-8)
