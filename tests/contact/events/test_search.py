# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Events within a step are found: what dips and comes back, what is dropped, many at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from benchmarks.contact.shapes import depth_below
from benchmarks.contact.stick_slips import Block, judged, pulled
from rb_sim import Simulation, load_scene
from rb_sim.base.errors import StepTooLargeError
from tests.contact.scenes import ball, body, scene, touch
from tests.contact_runs import contact_run

DISK = {"type": "disk", "radius": 0.1, "axis_B": [0.0, 0.0, 1.0]}


HASTY = Block(w=10.0, d=0.1, ratio=0.15, mass=1.0, kinetic=0.3)
"""It is pulled so fast that its slip falls below zero by 1 % only, for a twentieth of a period."""


def stick_slip(options: dict[str, Any]) -> str:
    return judged(pulled(HASTY, 1, options, ""))[0]


OPTIONS: dict[str, dict[str, Any]] = {
    "loose": {"method": "dopri853", "tolerance": 1e-4},
    "tight": {"method": "dopri853", "tolerance": 1e-9},
    "a tenth of a period": {"method": "rk4", "step": 0.0628},
}


@pytest.mark.parametrize("name", OPTIONS)
def test_no_stick_is_missed(name: str) -> None:
    """Piecewise sinusoids: a slip that dips below zero for a moment within a step."""
    assert stick_slip(OPTIONS[name]) == "fine"


def tossed(**contact: Any) -> dict[str, Any]:
    """A disk tossed up with spin and a wobble: in one long step its lean turns right round."""
    start = body(
        DISK,
        [0.0, 0.0, 0.12],
        orientation={"axis": [0.0198, 0.0189, 0.0], "angle": 0.02736},
        angular_velocity=[0.3147, -1.607, 25.36],
        linear_velocity=[0.2, 0.0, 1.0942],
    )
    return scene(start, touch(mu=0.3, **contact))


def test_tossed_disk_does_not_sink() -> None:
    """Its low point follows from the state alone while it is in flight."""
    times = np.linspace(0.0, 0.33, 100)
    found = contact_run(tossed(restitution=0.4), times, tolerance=1e-6)
    r = found.trajectory
    depth = depth_below(DISK, r.position["body"], r.orientation["body"], [0.0, 0.0, 1.0])
    assert depth.max() <= 1e-10
    assert found.times("impact")
    assert np.diff(r.energy).max() <= 1e-9


def test_tossed_disk_finds_soft_ground() -> None:
    """The support pushes exactly where the rim is below it."""
    soft = {"compliance": {"stiffness": 2000.0}}
    times = np.linspace(0.2, 0.3, 60)
    r = contact_run(tossed(**soft), times, tolerance=1e-9).trajectory
    depth = depth_below(DISK, r.position["body"], r.orientation["body"], [0.0, 0.0, 1.0])
    assert depth.max() > 1e-4
    push = r.reaction["floor"].force[:, 2]
    assert_allclose(push, 2000.0 * np.maximum(0.0, depth), atol=1e-8)


def above_a_shaken_floor(
    clearance: float, frequency: float = 47.3, phase: float = 0.0
) -> tuple[dict[str, Any], float]:
    """(A ball that sinks without gravity to a floor which is shaken, when they meet)."""
    amplitude, speed = 0.05, 0.02

    def gap(t: Any) -> Any:
        return clearance - speed * t - amplitude * np.sin(2.0 * math.pi * frequency * t + phase)

    times = np.linspace(0.0, 1.0, 1_000_001)
    after = int(np.argmax(gap(times) < 0.0))
    motion = {
        "type": "shaken", "direction": [0.0, 0.0, 1.0], "amplitude": amplitude,
        "frequency": frequency, "phase": phase,
    }  # fmt: skip
    start = ball([0.0, 0.0, 0.1 + clearance], linear_velocity=[0.0, 0.0, -speed])
    mapping = scene(start, touch(restitution=1.0, motion=motion), gravity=False)
    del mapping["simulation"]["tolerance"]
    return mapping, brentq(gap, times[after - 1], times[after], xtol=1e-15)


@pytest.mark.parametrize(("clearance", "step"), [(0.052, 0.7), (0.06, 1.0)])
def test_a_step_that_takes_too_many_looks_is_made_shorter(clearance: float, step: float) -> None:
    """The gap comes near zero some 50 times in the step: more than is looked at in one."""
    mapping, when = above_a_shaken_floor(clearance)
    found = contact_run(mapping, [0.0, 1.0], method="rk4", step=step)
    assert_allclose(found.times("impact")[0], when, atol=1e-12)


@pytest.mark.parametrize("phase", [0.0, 0.5 * math.pi, -0.5 * math.pi])
def test_steps_of_whole_periods_miss_no_impact_on_a_shaken_floor(phase: float) -> None:
    """The floor is at the same place at the ends and in the middle of every step."""
    mapping, when = above_a_shaken_floor(0.06, 50.0, phase)
    found = contact_run(mapping, [0.0, 1.0], method="rk4", step=0.7)
    assert_allclose(found.times("impact")[0], when, atol=1e-12)


def steps_of_a_bounce(damping: float) -> int:
    """Steps from a fall of 0.2 m to after the first contact."""
    soft = touch(compliance={"stiffness": 1e4, "damping": damping})
    mapping = scene(ball([0.0, 0.0, 0.3]), soft)
    mapping["simulation"]["duration"] = 0.3
    simulation = Simulation(load_scene(mapping))
    simulation.run(checks=False)
    assert len(simulation.events) == 2
    return simulation.steps


def test_what_leaves_a_damped_support_takes_no_shorter_steps() -> None:
    """Its force vanishes before the overlap does; where that ends nothing happens."""
    assert steps_of_a_bounce(20.0) <= 1.5 * steps_of_a_bounce(0.0)


def past_corner(depth: float, speed: float, spin: float) -> tuple[dict[str, Any], float]:
    """(A rod whose lower end goes in by the top of a fixed cube and out by its side, the time at
    which it is at the top).

    At 0.3 s it stands upright, its end below the edge along y by `depth` in x and z; it moves
    straight, and turns about y.
    """
    half, length, when = 0.5, 0.3, 0.3
    velocity = speed * np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0)
    centre = np.array([half - depth, 0.0, half - depth + 0.5 * length])

    def end(t: float) -> Any:
        angle = spin * (t - when)
        arm = 0.5 * length * np.array([np.sin(angle), 0.0, np.cos(angle)])
        return centre + velocity * (t - when) - arm

    def inside(t: float) -> float:
        return float(max(end(t)[0], end(t)[2]) - half)

    before = next(t for t in when - np.arange(0.0, 0.3, 1e-5) if inside(t) > 0.0)
    rod = body(
        {"type": "rod", "length": length},
        (centre - velocity * when).tolist(),
        orientation={"axis": [0.0, 1.0, 0.0], "angle": -spin * when},
        angular_velocity=[0.0, spin, 0.0],
        linear_velocity=velocity.tolist(),
    )
    cube = {"mass": 1.0, "shape": {"type": "box", "size": [2.0 * half] * 3}}
    contact = touch(parent="cube", surface={"type": "shape"}, restitution=0.5)
    mapping = scene(rod, contact, gravity=False)
    mapping["bodies"]["cube"] = cube
    return mapping, float(brentq(inside, before, when, xtol=1e-14))


@pytest.mark.parametrize("spin", [0.0, 4.0])
@pytest.mark.parametrize("speed", [1.0, 12.0])
@pytest.mark.parametrize("depth", [1e-4, 1e-2])
def test_no_point_cuts_through_a_corner(depth: float, speed: float, spin: float) -> None:
    """In by one face and out by the next, the gap to a solid has a kink between, in one step."""
    mapping, hit = past_corner(depth, speed, spin)
    found = contact_run(mapping, np.array([0.0, 0.8]), tolerance=1e-10)
    assert_allclose(found.times("impact")[0], hit, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("setting", [{"tolerance": 1e-3}, {"tolerance": 1e-6}])
@pytest.mark.parametrize("start", [-0.6, 0.6])
def test_a_soft_floor_is_met_within_a_long_step(start: float, setting: dict[str, Any]) -> None:
    """The end of a rod that spins at w, h above a soft floor, is at h - (l/2) sin(w t - start): no
    loose tolerance may step over the time in which it is below."""
    h, half, w, stiffness = 0.08, 0.085, 40.0, 1e4
    shape = {"type": "rod", "length": 2.0 * half, "axis_B": [1.0, 0.0, 0.0]}
    spinning = body(shape, [0.0, 0.0, h], angular_velocity=[0.0, w, 0.0])
    spinning["orientation"] = {"axis": [0.0, 1.0, 0.0], "angle": -start}
    soft = touch(compliance={"stiffness": stiffness})
    meets = (start + math.asin(h / half)) / w
    found = contact_run(scene(spinning, soft, gravity=False), [0.0, 1.5 * meets], **setting)
    assert_allclose(found.times("closes")[:1], [meets], rtol=0.0, atol=1e-3)


# Nothing that is let go, thrown up or thrown aside falls through a solid, however wide the scene.
#
# Free flight is exact, so the first step of a run is the whole run. Judged from poses alone: no
# sample lies inside the solid, and the first impact comes when the parabola first reaches it.


G = 9.81
FINE = 20_001
"""Points of the parabola that are looked at."""


def solid(kind: str, size: float, rng: np.random.Generator) -> tuple[dict[str, Any], float]:
    """(shape, height of its top above its centre)."""
    if kind == "sphere":
        return {"type": kind, "radius": size}, size
    if kind == "box":
        edges = size * np.array([rng.uniform(0.5, 1), rng.uniform(0.5, 1), rng.uniform(0.01, 1)])
        return {"type": kind, "size": edges.tolist()}, 0.5 * float(edges[2])
    length = size * rng.uniform(0.02, 1.0)
    return {"type": kind, "radius": size, "length": length, "axis_B": [0.0, 0.0, 1.0]}, length / 2


def depth(shape: dict[str, Any], radius: float, p: np.ndarray) -> np.ndarray:
    """Depth of a ball with centre p in a solid at the origin, shape (n,) [m]; negative outside."""
    if shape["type"] == "sphere":
        return radius + shape["radius"] - np.linalg.norm(p, axis=1)
    if shape["type"] == "box":
        beyond = np.abs(p) - 0.5 * np.array(shape["size"])
    else:
        round_ = np.hypot(p[:, 0], p[:, 1]) - shape["radius"]
        beyond = np.stack([round_, np.abs(p[:, 2]) - 0.5 * shape["length"]], axis=1)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return radius - outside - np.minimum(beyond.max(axis=1), 0.0)


@pytest.mark.parametrize("number", range(12))
def test_nothing_falls_through(number):
    rng = np.random.default_rng([20261128, number])
    shape, top = solid(("sphere", "box", "cylinder")[number % 3], 10 ** rng.uniform(-2, 1), rng)
    radius = 10 ** rng.uniform(-3, 0)
    start = [0.05 * top, 0.0, top + radius + 10 ** rng.uniform(-2, 1)]
    velocity = [rng.choice([0.0, rng.uniform(-1, 1)]), 0.0, rng.choice([0.0, rng.uniform(-2, 2)])]
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": radius}, "position": start}
    far = [float(rng.choice([-1, 1]) * 10 ** rng.uniform(0.5, 2.5)), 3.0, 50.0]
    scene = {
        "bodies": {
            "ball": ball | {"linear_velocity": velocity},
            "solid": {"mass": 10.0, "shape": shape},
            "bystander": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": far},
        },
        "constraints": {
            "hold": {"type": "weld", "body": "solid"},
            "hold_bystander": {"type": "weld", "body": "bystander"},
            "c": {"type": "contact", "body": "ball", "parent": "solid", "restitution": 0.4}
            | {"surface": {"type": "shape"}},
        },
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}},
        "simulation": {"duration": rng.uniform(1, 4), "rate": float(rng.choice([1, 10, 100]))},
    }
    run = Simulation(load_scene(scene)).run(checks=False)
    inmost = depth(shape, radius, run.position["ball"]).max()
    assert inmost < 1e-9 * (radius + abs(far[0]))
    t = np.linspace(0.0, run.t[-1], FINE)
    path = np.add(start, np.outer(t, velocity)) - np.outer(0.5 * G * t**2, [0.0, 0.0, 1.0])
    inside = depth(shape, radius, path) > 0.0
    if not inside.any():
        return
    first = t[inside.argmax()]
    assert run.events, f"falls through at t = {first:g} s"
    assert abs(run.events[0].t - first) <= 1.01 * t[1]


ENDS = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]])
CORNERS = np.array(
    [[0.6, 0, 0], [-0.3, 0.5, 0.1], [-0.3, -0.5, 0.1], [0, 0, -0.7], [0.1, 0.2, 0.8]]
)


def tumbling(seed: int, radius: float, spin: float, contact: dict[str, Any]) -> dict[str, Any]:
    """A body that tumbles above a sphere, outside or inside of it."""
    rng = np.random.default_rng(seed)
    side = contact["surface"]["side"]
    contact["surface"] |= {"type": "sphere", "radius": radius}
    contact["surface"]["center"] = [0.0, 0.0, radius if side == "inside" else -radius]
    body = {
        "mass": 1.0,
        "position": [0.0, 0.0, 1.0 + rng.uniform(0, 4)],
        "orientation": Rotation.random(random_state=seed).as_quat().tolist(),
        "linear_velocity": rng.normal(size=3).tolist(),
        "angular_velocity": (spin * rng.normal(size=3)).tolist(),
    }
    return {
        "bodies": {"b": body},
        "constraints": {"c": {"type": "contact", "body": "b"} | contact},
        "effects": {"g": {"type": "gravity"}},
    }


def deepest(scene: dict[str, Any], points: np.ndarray, tolerance: float, duration: float) -> float:
    """How deep any of the points lies beyond the sphere in a sample, from poses alone [m]."""
    options = {"method": "dopri853", "tolerance": tolerance, "duration": duration, "rate": 60.0}
    run = Simulation(load_scene(scene | {"simulation": options})).run(check=False, checks=False)
    sphere = scene["constraints"]["c"]["surface"]
    turned = Rotation.from_quat(run.orientation["b"]).as_matrix()
    places = run.position["b"][:, None] + points @ turned.transpose(0, 2, 1) - sphere["center"]
    beyond = np.linalg.norm(places, axis=2) - sphere["radius"]
    return float(beyond.max() if sphere["side"] == "inside" else -beyond.min())


@pytest.mark.parametrize("seed", [43, 46, 76, 124])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_an_end_that_dips_before_another_one_hits_is_not_missed(seed, tolerance):
    """A step of half a turn ends with one end of the rod in the bowl; the other end was in it, and
    out again, before."""
    scene = tumbling(seed, 15.0, 12.0, {"restitution": 0.8, "surface": {"side": "inside"}})
    scene["bodies"]["b"]["shape"] = {"type": "rod", "length": 1.0, "axis_B": [0.0, 0.0, 1.0]}
    assert deepest(scene, ENDS, tolerance, 4.0) < 1e-6


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_points_swing_through_nothing_within_half_a_turn(tolerance):
    scene = tumbling(228, 3.0, 10.0, {"restitution": 0.6, "surface": {"side": "outside"}})
    scene["bodies"]["b"]["inertia"] = [0.2, 0.25, 0.3]
    scene["constraints"]["c"]["points"] = CORNERS.tolist()
    assert deepest(scene, CORNERS, tolerance, 2.0) < 1e-6


# States inside a long step of an implicit method, where one step to them has no solution.


SCENE: dict[str, Any] = {
    "bodies": {
        "a": {
            "mass": 7.302,
            "inertia": [[3.338, -0.081, 0.352], [-0.081, 4.296, -0.431], [0.352, -0.431, 2.201]],
            "orientation": {"axis": [0.783, 0.395, -0.481], "angle": 1.241},
            "center_of_mass": [0.037, 0.023, 0.024],
            "angular_velocity": [-1.268, 1.916, -0.523],
        },
        "b": {
            "mass": 1.559,
            "shape": {"type": "ellipsoid", "semi_axes": [0.083, 0.13, 0.158]},
            "inertia": [0.004, 0.003, 0.005],
            "center_of_mass": [-0.012, 0.047, -0.048],
            "position": [0.187, -0.53, -0.32],
            "orientation": {"axis": [-0.772, -0.212, 0.599], "angle": 1.353},
            "linear_velocity": [-1.795, 1.991, -0.19],
            "angular_velocity": [5.113, 2.77, -3.08],
        },
    },
    "constraints": {
        "on": {
            "type": "contact",
            "body": "b",
            "parent": "a",
            "surface": {
                "type": "plane",
                "point": [0.193, -0.161, 0.026],
                "normal": [0.558, -0.036, 0.829],
            },
            "friction": {"type": "coulomb", "static": 0.935},
            "compliance": {"stiffness": 5043.835},
        }
    },
    "effects": {"weight": {"type": "gravity", "acceleration": [-1.461, 2.619, -0.075]}},
    "simulation": {"duration": 0.16, "rate": 4000.0, "method": "gauss6", "step": 0.01},
}
"""An ellipsoid that rubs on a soft plane of a free body while both turn, in steps of a period."""


@pytest.fixture(scope="module")
def often() -> Any:
    """The run with many samples inside a step."""
    return Simulation(load_scene(SCENE)).run(checks=False)


def test_every_sample_is_a_state(often: Any) -> None:
    """Samples that the method did not reach in one step were written as NaN, without a word."""
    found = often
    for name in ("a", "b"):
        assert np.isfinite(found.position[name]).all()
        norms = np.linalg.norm(found.orientation[name], axis=1)
        np.testing.assert_allclose(norms, 1.0, rtol=0.0, atol=1e-12)


def test_seldom_samples_show_the_same_motion(often: Any) -> None:
    """What is done for a sample does not change the steps."""
    options = SCENE["simulation"] | {"rate": 50.0}
    seldom = Simulation(load_scene(SCENE | {"simulation": options})).run(checks=False)
    np.testing.assert_array_equal(often.position["b"][-1], seldom.position["b"][-1])


def test_a_step_that_has_no_solution_in_flight_is_an_error() -> None:
    """An implicit method comes near the end of a slip in shorter steps, which it has no solution
    across. A damper beside the axis of a thin rod, which turns at once, is no such thing: the run
    crept through it in microseconds, a thousand to each step that was asked for."""
    rod = {
        "mass": 4.0,
        "shape": {"type": "rod", "length": 0.26},
        "orientation": {"axis": [0.0, 1.0, 0.0], "angle": 0.3},
        "position": [0.0, 0.0, 2.0],
    }
    spring = {
        "type": "spring",
        "body": "rod",
        "stiffness": 1400.0,
        "rest_length": 0.0,
        "damping": 12.0,
        "point_A": [0.5, -0.7, 1.6],
        "point_B": [0.11, -0.03, -0.04],
    }
    scene = {
        "bodies": {"rod": rod},
        "constraints": {"floor": {"type": "contact", "body": "rod"}},
        "effects": {"spring": spring},
        "simulation": {"method": "gauss6", "step": 4e-3, "duration": 0.1, "rate": 100.0},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    with pytest.raises(StepTooLargeError, match="too large for gauss6"):
        simulation.advance(0.1)


@pytest.mark.parametrize("spin", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("across", [1e-5, 1e-4])
def test_disk_that_lays_itself_down_gains_nothing(spin: float, across: float) -> None:
    """A step whose end has no state on the floor is rejected, not cut without asking its error."""
    r, tilt = 0.05, 0.3
    start = body(
        {"type": "disk", "radius": r},
        [0.0, 0.0, r * np.sin(tilt)],
        orientation=[float(np.sin(tilt / 2)), 0.0, 0.0, float(np.cos(tilt / 2))],
        angular_velocity=[-spin, across, 0.0],
        linear_velocity=[0.0, 0.0, -spin * r * float(np.cos(tilt))],
    )
    mapping = scene(start, touch()) | {"simulation": {"duration": 0.3, "tolerance": 3e-3}}
    energy = Simulation(load_scene(mapping)).run(checks=False).energy
    assert energy.max() <= 1.01 * energy[0]
