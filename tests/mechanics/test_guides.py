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
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.curves import Pieces, spline_through
from rb_sim.cli.main import app
from rb_sim.scene import yaml_reader
from rb_sim.scene.load import scene_from_mapping
from rb_sim.simulation.sensitivity import TangentSimulation

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
    block = Simulation(load_scene(scene), coordinates=coordinates).run(checks=False).block
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


@pytest.mark.parametrize(
    ("coordinates", "speed", "method"),
    [
        ("auto", 4.0, "dopri853"),
        ("auto", -4.0, "radau5"),
        ("maximal", -4.0, "dopri853"),
        ("maximal", 4.0, "radau5"),
    ],
)
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
    run = Simulation(load_scene(scene), coordinates=coordinates).run(checks=False)
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
    run = Simulation(load_scene(scene), coordinates=coordinates).run(checks=False)
    assert_allclose(run.block.position[-1], run.block.position[0], rtol=0.0, atol=5e-11)


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
def test_who_leaves_the_end_of_an_open_guide_is_reported(coordinates: str) -> None:
    scene = sliding(VALLEY, 0.8, 20.0, duration=1.0)
    with pytest.raises(SimulationError, match="passed the end of its guide"):
        Simulation(load_scene(scene), coordinates=coordinates).run()


def test_a_guide_beside_a_contact_runs() -> None:
    """A ball dropped beside: the guided body moves as alone."""
    scene = sliding(parabola(31), 0.7, 2.0, duration=0.3)
    alone = Simulation(load_scene(scene)).run(checks=False).block
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [0.0, 5.0, 0.2]}
    scene["bodies"]["ball"] = ball
    scene["constraints"]["floor"] = {"type": "contact", "body": "ball"}
    block = Simulation(load_scene(scene)).run(checks=False).block
    assert_allclose(block.position[:, 0], alone.position[:, 0], rtol=0.0, atol=1e-9)


# Linear models, carried derivatives and many bodies on guides along splines, by closed forms.


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


@pytest.mark.parametrize(
    ("coordinates", "points"),
    [("auto", hollow(31)), ("maximal", hollow(31)), ("maximal", hollow(30)), ("auto", VALLEY)],
)
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
    times = simulation.run(checks=False).t
    (found,) = simulation.take_derivatives()
    slide, start = Slide(curve, s, speed), curve.point(s)[1]
    for t, moved in zip(times, found.position[:, 0], strict=True):
        now = slide.parameter(t)
        by_speed = -slide.rate(now) * by_energy(slide, s, now) * speed * np.dot(start, start)
        assert_allclose(moved, by_speed * np.array(curve.point(now)[1]), rtol=0.0, atol=1e-10)


def test_twelve_bodies_each_on_a_spline() -> None:
    """Many enough for laws over tables: each moves as if alone, for its own start, in steps that
    end at the breaks of each; over those breaks rk4 is 2e-8 off."""
    speeds = [4.0 + 0.2 * k for k in range(12)]
    bodies, constraints = {}, {}
    for k, speed in enumerate(speeds):
        alone = sliding(LOOP, 0.3, speed, closed=True)
        bodies[f"b{k}"] = alone["bodies"]["b"]
        constraints[f"guide{k}"] = alone["constraints"]["guide"] | {"body": f"b{k}"}
    steps = {"duration": 0.5, "method": "rk4", "step": 1e-3, "tolerance": None}
    whole = sliding(LOOP, 0.3, 1.0, closed=True, **steps)
    scene = load_scene(whole | {"bodies": bodies, "constraints": constraints})
    block = Simulation(scene).run(checks=False).block
    curve = pieces(LOOP, True)
    for k, speed in enumerate(speeds):
        slide = Slide(curve, 0.3, speed)
        exact = [curve.point(slide.parameter(t))[0] for t in block.t]
        assert_allclose(block.position[:, k], exact, rtol=0.0, atol=1e-10)


# A motion so fast that one step passes pieces of a spline without end can be ended even so.


RING = """
import math

around = [2.0 * math.pi * k / 32 for k in range(32)]
scene = {
    "bodies": {
        "bead": {
            "mass": 0.03,
            "inertia": [1e-3] * 3,
            "position": [1.0, 0.0, 0.0],
            "linear_velocity": [0.0, 1e10, 0.0],
        },
    },
    "constraints": {
        "wire": {
            "type": "translation",
            "body": "bead",
            "guide": {
                "type": "curve",
                "closed": True,
                "points": [[math.cos(a), math.sin(a), 0.0] for a in around],
            },
        },
    },
    "simulation": {
        "duration": 10.0, "rate": 100.0, "method": "rk4", "step": 4e-3, "project_initial": True,
    },
}
"""
SCRIPT = """
import signal
import rb_sim.motion.traced
from rb_sim import Simulation

# Without its own end, which a fast machine comes to before the signal does.
rb_sim.motion.traced.MOST_ROUNDS = 10**9

def ended(number, frame):
    raise KeyboardInterrupt

simulation = Simulation(scene)
simulation.warm()
signal.signal(signal.SIGALRM, ended)
signal.alarm(1)
try:
    simulation.run()
except KeyboardInterrupt:
    print("ended at", simulation.time)
"""


def test_a_signal_ends_a_run_that_passes_pieces_without_end() -> None:
    """A step of 4 ms is 4e7 m of a ring whose pieces are 0.2 m long: 2e8 parts, minutes in which
    nobody would be asked.  A motion that blows up on a wire comes to the same, but when and how
    hangs on its last digits, so on the machine."""
    done = subprocess.run(
        [sys.executable, "-c", RING + SCRIPT],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.stdout.startswith("ended at"), done.stderr


def ring() -> dict[str, Any]:
    """The scene of the script."""
    space: dict[str, Any] = {}
    exec(RING, space)
    return space["scene"]


def test_a_step_that_passes_pieces_without_end_is_an_error(monkeypatch) -> None:
    monkeypatch.setattr("rb_sim.motion.traced.MOST_ROUNDS", 4)
    with pytest.raises(SimulationError, match="8192 pieces of a guide .* too large"):
        Simulation(ring()).run(checks=False)


def test_a_run_that_ends_in_its_first_step_keeps_what_was_logged(monkeypatch, tmp_path) -> None:
    """A sample was, and no step, so that none had a price: the summary divided by zero."""
    monkeypatch.setattr("rb_sim.motion.traced.MOST_ROUNDS", 4)
    scene, out = tmp_path / "ring.yaml", tmp_path / "out"
    mapping = ring()
    mapping["simulation"] |= {"duration": 1e-5, "rate": 1e7}
    scene.write_text(yaml_reader.write(mapping))
    reported = CliRunner().invoke(app, ["run", str(scene), "--out", str(out), "--no-rerun"])
    assert reported.exit_code == 1
    assert "8192 pieces of a guide" in " ".join(reported.output.split())
    assert (out / "summary.json").exists()
