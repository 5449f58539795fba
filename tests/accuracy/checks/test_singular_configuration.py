# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A loop that loses rank on the way is told once, with time and constraint; others are not."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rb_sim import Simulation
from rb_sim.accuracy.checks import singular_configuration
from rb_sim.accuracy.checks.check import Effort
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.accuracy.checks.singular_configuration import (
    Conditioning,
    Follower,
    Vanishing,
    has_loops,
)
from rb_sim.base.errors import SimulationError, StepTooLargeError
from rb_sim.mechanics.samples import SampleBlock
from rb_sim.scene.load import scene_from_mapping

SPEED, ANGLE = 3.0, 1.2


def four_bar(base: float, rocker: float = 1.0) -> dict[str, Any]:
    """Crank of 1 m, a massless coupler as long as the ground link, rocker; turning at SPEED.

    Both links start parallel at ANGLE above the ground link, so that with a rocker of 1 m it is a
    parallelogram, whose change points lie where all four links are in line.
    """
    along = np.array([math.cos(ANGLE), 0.0, math.sin(ANGLE)])
    spin = np.array([0.0, -SPEED, 0.0])
    turn = [0.0, -math.sin(ANGLE / 2), 0.0, math.cos(ANGLE / 2)]
    bodies, joints = {}, {}
    for name, x, length in (("crank", 0.0, 1.0), ("rocker", base, rocker)):
        middle = 0.5 * length * along
        bodies[name] = {
            "mass": 1.0,
            "inertia": [0.01, 0.09, 0.09],
            "position": [x + middle[0], 0.0, middle[2]],
            "orientation": turn,
            "angular_velocity": spin.tolist(),
            "linear_velocity": np.cross(spin, middle).tolist(),
        }
        joints[name + "_hinge"] = {
            "type": "fixed_axis",
            "body": name,
            "point_B": [-0.5 * length, 0, 0],
            "axis_B": [0, 1, 0],
            "bearing_distance": 0.2,
        }
    ends = {"point_B": [0.5 * rocker, 0, 0], "point_A": [0.5, 0, 0]}
    joints["coupler"] = {"type": "distance", "body": "rocker", "parent": "crank", **ends}
    options = {"duration": 1.0, "rate": 50.0, "method": "rk4", "step": 1e-3}
    options["project_initial"] = True
    return {"bodies": bodies, "constraints": joints, "simulation": options}


def driven_to_the_end() -> dict[str, Any]:
    """A mass on a rod of 1 m, driven at 0.5 m/s along x from x = 0.2: impossible from 1.6 s on."""
    start = {"position": [0.2, 0.0, -math.sqrt(0.96)]}
    start["linear_velocity"] = [0.5, 0.0, 0.1 / math.sqrt(0.96)]
    joints = {
        "rod": {"type": "distance", "body": "b", "point_A": [0, 0, 0], "length": 1.0},
        "drive": {"type": "velocity", "body": "b", "linear": [1, 0, 0], "rate": 0.5},
        "plane": {"type": "plane", "body": "b", "normal_A": [0, 1, 0]},
    }
    joints["drive"]["frame"] = "world"
    options = {"duration": 1.8, "rate": 50.0, "method": "rk4", "step": 1e-3}
    body = {"mass": 1.0, "inertia": [0.01, 0.01, 0.01]} | start
    return {"bodies": {"b": body}, "constraints": joints, "simulation": options}


def followed(
    mapping: dict[str, Any], pieces: int = 1
) -> singular_configuration.SingularConfiguration | None:
    scene = scene_from_mapping(mapping)
    simulation = Simulation(scene)
    watch = Conditioning(scene, simulation.layout)
    block = simulation.run(checks=False).block
    for part in np.array_split(np.arange(len(block)), pieces):
        watch.add(cut(block, part))
    return watch.found


def cut(block: SampleBlock, part: np.ndarray) -> SampleBlock:
    from rb_sim.mechanics.samples import ARRAYS

    return replace(block, **{name: getattr(block, name)[part] for name in ARRAYS})


@pytest.mark.parametrize("pieces", [1, 17])
def test_a_parallelogram_tells_its_change_point(pieces):
    """In line once the crank has turned on to pi, however the samples come."""
    found = followed(four_bar(2.0), pieces)
    assert found is not None
    assert found.t == pytest.approx((math.pi - ANGLE) / SPEED, abs=2e-3)
    assert found.constraint == "coupler"


@pytest.mark.parametrize("turn", [0.2, 0.4])
def test_a_change_point_between_samples_far_apart_is_reported(turn):
    """However much the cranks turn from one to the next [rad]: silent above 0.15 before."""
    scene = four_bar(2.0)
    scene["simulation"]["rate"] = SPEED / turn
    found = followed(scene, 3)
    assert found is not None
    assert found.t == pytest.approx((math.pi - ANGLE) / SPEED, abs=2e-3)
    assert not found.too_many


@pytest.mark.parametrize("turn", [1.3, 3.0, 7.0, 40.0])
@pytest.mark.parametrize("rocker", [1.0, 1.3])
def test_what_lies_between_samples_is_seen_on_the_motion_itself(turn: float, rocker: float) -> None:
    """Cranks turn on by any angle [rad] between two samples: a parallelogram tells its first change
    point, and a linkage that has none tells nothing."""
    scene = four_bar(2.0, rocker)
    scene["simulation"] |= {"rate": SPEED / turn, "duration": 2.0, "method": "dopri853"}
    del scene["simulation"]["step"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        findings = Simulation(scene, announce=None).run(check=False).findings
    reported = [found.t for found in findings if found.check == "singular configuration"]
    change_point = [pytest.approx((math.pi - ANGLE) / SPEED, abs=2e-3)]
    assert reported == (change_point if rocker == 1.0 else [])


@pytest.mark.parametrize("turn", [0.02, 0.2, 0.4])
def test_change_points_of_a_long_run_are_reported(turn):
    """It comes in line once in each half turn."""
    scene = four_bar(2.0)
    scene["simulation"] |= {"rate": SPEED / turn, "duration": 1000 * turn / SPEED, "step": 4e-3}
    assert followed(scene) is not None


@pytest.mark.parametrize("rocker", [1.001, 1.05])
@pytest.mark.parametrize("turn", [0.02, 0.3])
def test_links_that_come_all_but_in_line_are_reported_as_such_by_no_samples(turn, rocker):
    """A hair off a parallelogram no lines come to depend on others, whatever samples suggest."""
    scene = four_bar(2.0, rocker)
    scene["simulation"] |= {"rate": SPEED / turn, "duration": 2.0}
    assert followed(scene) is None


def test_a_four_bar_that_does_not_fold_tells_nothing():
    """Links of 1, 1.5, 2 and 2.23 m: a crank-rocker by Grashof's rule, 1 + 2.23 < 1.5 + 2."""
    assert followed(four_bar(2.0, rocker=1.5)) is None


def test_a_drive_that_becomes_impossible_is_reported_when_it_does():
    found = followed(driven_to_the_end())
    assert found is not None
    assert found.t == pytest.approx(1.6, abs=5e-3)
    assert found.constraint in ("rod", "drive")


@pytest.mark.parametrize("joint", ["fixed_axis", "fixed_point"])
def test_a_driven_slider_crank_has_no_singular_configuration(joint):
    """It passes both stretched positions; a crank of 1 m is driven at SPEED, the rod has 1.5 m.

    Two of its hinges hold the plane of motion twice, and which lines are needed changes on the way.
    """
    angle, rod = 0.5, 1.5
    tip = np.array([math.cos(angle), 0.0, math.sin(angle)])
    lean = math.asin(tip[2] / rod)
    piston = np.array([tip[0] + rod * math.cos(lean), 0.0, 0.0])
    turns = {"crank": -angle, "rod": lean}
    bodies: dict[str, Any] = {
        "crank": {"position": (tip / 2).tolist()},
        "rod": {"position": ((tip + piston) / 2).tolist()},
        "piston": {"position": piston.tolist()},
    }
    for name, body in bodies.items():
        half = turns.get(name, 0.0) / 2
        body |= {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
        body["orientation"] = [0.0, math.sin(half), 0.0, math.cos(half)]
    slope = SPEED * tip[0] / (rod * math.cos(lean))
    speed = np.cross([0.0, -SPEED, 0.0], tip)
    sliding = np.array([speed[0] - rod * math.sin(lean) * slope, 0.0, 0.0])
    bodies["crank"] |= {"angular_velocity": [0, -SPEED, 0], "linear_velocity": (speed / 2).tolist()}
    bodies["rod"]["angular_velocity"] = [0.0, slope, 0.0]
    bodies["rod"]["linear_velocity"] = ((speed + sliding) / 2).tolist()
    bodies["piston"]["linear_velocity"] = sliding.tolist()
    hinge = {"type": "fixed_axis", "axis_B": [0, 1, 0]}
    pin = {"type": joint} | ({"axis_B": [0, 1, 0]} if joint == "fixed_axis" else {})
    guide = {"type": "line", "direction": [1, 0, 0]}
    constraints = {
        "hinge": hinge | {"body": "crank", "point_B": [-0.5, 0, 0]},
        "drive": {"type": "velocity", "body": "crank", "angular": [0, -1, 0], "rate": SPEED},
        "slide": {"type": "translation", "body": "piston", "guide": guide},
        "knee": hinge | {"body": "rod", "parent": "crank", "point_B": [-rod / 2, 0, 0]},
        "pin": pin | {"body": "rod", "parent": "piston", "point_B": [rod / 2, 0, 0]},
    }
    options = {"duration": 2.5, "rate": 50.0, "tolerance": 1e-9, "project_initial": True}
    scene = {"bodies": bodies, "constraints": constraints, "simulation": options}
    assert followed(scene) is None


def test_it_is_one_finding_with_time_and_constraint():
    scene = scene_from_mapping(four_bar(2.0))
    simulation = Simulation(scene)
    check_list = CheckList(scene, simulation.layout)
    block = simulation.run(checks=False).block
    for _ in range(2):
        check_list.add(block, Effort("rk4", 1e-3, None, 1000))
    reported = [
        finding for finding in check_list.findings if finding.check == "singular configuration"
    ]
    assert len(reported) == 1
    assert (reported[0].where, reported[0].t) == ("coupler", pytest.approx(0.6472, abs=2e-3))


def test_trees_are_not_watched():
    scene = four_bar(2.0)
    del scene["constraints"]["coupler"]
    assert not has_loops(scene_from_mapping(scene))
    assert has_loops(scene_from_mapping(four_bar(2.0)))


def spatial_loop() -> dict[str, Any]:
    """A Bennett linkage: four hinges whose axes are skew, sin(twist) over length the same for all
    links, so that it moves although 20 lines hold 18 coordinates (Bennett 1903)."""
    length, twist, other = 0.5, 0.6, 1.1
    second = length * math.sin(other) / math.sin(twist)
    ratio = math.sin(0.5 * (other + twist)) / math.sin(0.5 * (other - twist))
    first = 0.7
    angles = (first, 2.0 * math.atan(ratio / math.tan(0.5 * first)))
    angles += (2.0 * math.pi - angles[0], 2.0 * math.pi - angles[1])
    frames = [(np.zeros(3), Rotation.identity())]
    for angle, (a, alpha) in zip(angles, ((length, twist), (second, other)) * 2, strict=True):
        point, turn = frames[-1]
        turn = turn * Rotation.from_rotvec([0, 0, angle])
        frames.append((point + turn.apply([a, 0, 0]), turn * Rotation.from_rotvec([alpha, 0, 0])))
    assert np.abs(frames[4][0]).max() < 1e-12  # it closes
    bodies, joints = {}, {}
    for k in range(4):
        axis = {"type": "fixed_axis", "axis_B": frames[k][1].apply([0, 0, 1]).tolist()}
        name = f"link{min(k, 2)}"
        if k < 3:
            middle = 0.5 * (frames[k][0] + frames[k + 1][0])
            bodies[name] = {"mass": 1.0, "inertia": [0.02] * 3, "position": middle.tolist()}
        point = frames[k][0] - np.array(bodies[name]["position"])
        joints[f"hinge{k}"] = axis | {"body": name, "point_B": point.tolist()}
        if k in (1, 2):
            joints[f"hinge{k}"]["parent"] = f"link{k - 1}"
    bodies["link0"]["angular_velocity"] = [0.0, 0.0, -6.0]
    options = {"duration": 1.5, "rate": 100.0, "tolerance": 1e-10, "project_initial": True}
    return {"bodies": bodies, "constraints": joints, "simulation": options}


def test_a_linkage_that_holds_too_much_has_no_singular_configuration():
    """Its lines are chosen anew on the way, and together they keep their rank."""
    assert followed(spatial_loop()) is None


def test_lines_left_out_that_come_to_be_needed_are_reported_as_that(monkeypatch):
    """In loops too long to choose lines anew the choice of the start serves for good."""
    monkeypatch.setattr("rb_sim.mechanics.systems.elimination.MOST_CHANGING", 19)
    found = followed(spatial_loop())
    assert found is not None
    assert found.too_many
    assert "needed here" in str(found.finding)


def test_a_change_point_beside_lines_too_many_is_reported_as_one():
    scene = four_bar(2.0)
    scene["constraints"]["crank_hinge"]["floating"] = "none"
    found = followed(scene)
    assert found is not None
    assert not found.too_many


def parallelograms(count: int = 2) -> dict[str, Any]:
    """Links of 1 m and 1 kg, one more than `count` upright ones, bars of 1 m from each to the next,
    which falls under gravity: joints of this kind hold each bar more often than needed."""
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}

    def hinge(name: str, body: str, x: float, parent: dict[str, str]) -> None:
        end = {"point_B": [x, 0, 0], "axis_B": [0, 0, 1]}
        joints[name] = {"type": "fixed_axis", "body": body, **end, **parent}

    for k in range(count + 1):
        upright = {"position": [k, 0.5, 0], "orientation": [0, 0, 0.5**0.5, 0.5**0.5]}
        moving = {"linear_velocity": [0.5, 0, 0], "angular_velocity": [0, 0, -1.0]}
        bodies[f"link{k}"] = {"mass": 1.0, "inertia": [1 / 12] * 3, **upright, **moving}
        hinge(f"ground{k}", f"link{k}", -0.5, {})
    for k in range(count):
        across = {"position": [k + 0.5, 1.0, 0], "linear_velocity": [1.0, 0, 0]}
        bodies[f"bar{k}"] = {"mass": 1.0, "inertia": [1 / 12] * 3, **across}
        hinge(f"left{k}", f"bar{k}", -0.5, {"parent": f"link{k}"})
        hinge(f"right{k}", f"bar{k}", 0.5, {"parent": f"link{k + 1}"})
    gravity = {"type": "gravity", "acceleration": [0, -9.81, 0]}
    options = {"duration": 5.0, "rate": 20.0, "method": "dopri853", "tolerance": 1e-11}
    return {
        "bodies": bodies,
        "constraints": joints,
        "effects": {"gravity": gravity},
        "simulation": options,
    }


def test_steps_near_a_singular_configuration_are_not_moved_by_round_off() -> None:
    """Tight tolerances make short steps there: what rounds off of the joints was put right by jumps
    of 1e-3 of the energy."""
    for tolerance in (1e-9, 1e-11):
        links = parallelograms()
        links["simulation"]["tolerance"] = tolerance
        run = Simulation(scene_from_mapping(links)).run(checks=False)
        assert np.abs(run.energy - run.energy[0]).max() < 1e-5
    bars = four_bar(1.0)
    bars["simulation"] = {"duration": 4.0, "rate": 20.0, "method": "dopri853", "tolerance": 1e-12}
    run = Simulation(scene_from_mapping(bars)).run(checks=False)
    angle = ANGLE + SPEED * run.t
    exact = np.stack([1.0 + 0.5 * np.cos(angle), 0.0 * angle, 0.5 * np.sin(angle)], axis=1)
    assert np.abs(run.position["rocker"] - exact).max() < 5e-8


def test_beyond_a_singular_configuration_no_tighter_tolerance_is_advised() -> None:
    mapping = parallelograms()
    mapping["simulation"]["duration"] = 1.5
    scene = scene_from_mapping(mapping)
    simulation = Simulation(scene)
    block = simulation.run(checks=False).block
    energies = np.where(block.t > 1.2, 1e-3 * abs(block.kinetic_energy).max(), 0.0)
    check_list = CheckList(scene, simulation.layout)
    jumped = replace(block, kinetic_energy=block.kinetic_energy + energies)
    check_list.add(jumped, Effort("dopri853", None, 1e-11, simulation.steps))
    advice = {finding.check: finding.advice for finding in check_list.findings}
    assert "singular configuration" in advice
    assert "a tighter tolerance does not help" in advice["energy"]


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
@pytest.mark.parametrize(("method", "tolerance"), [("radau5", 1e-9), ("dopri853", 1e-8)])
def test_no_error_is_stated_of_what_is_beyond_one(method: str, tolerance: float) -> None:
    """Two runs of radau5 lose the same 1e-5 there and part by 1e-6. The links are a pendulum:
    (3/3 + 2) a'' = g (3/2 + 2) sin a, a from the upright."""
    mapping = parallelograms()
    mapping["simulation"] |= {"method": method, "tolerance": tolerance, "duration": 1.5}
    run = Simulation(scene_from_mapping(mapping), announce=None).run()
    (reported,) = [found for found in run.findings if found.check == "singular configuration"]
    error = run.global_error
    assert error is not None and error.upto == reported.t < 1.0
    assert "not known beyond the singular configuration" in str(error)

    def pendulum(_: float, y: Any) -> list[float]:
        return [y[1], 9.81 * 3.5 / 3.0 * math.sin(y[0])]

    before = run.t <= error.upto
    tight = {"rtol": 1e-13, "atol": 1e-13}
    exact = solve_ivp(pendulum, (0.0, 1.0), [0.0, 1.0], "DOP853", run.t[before], **tight)
    off = run.position["bar0"][before, 0] - 0.5 - np.sin(exact.y[0])
    assert np.abs(off).max() < 2.0 * error.pose + 1e-11


# A motion that ends at a singular configuration names time and constraint, and blames no step.


def failure(mapping: dict[str, Any], method: str, step: float | None) -> SimulationError:
    options = {k: v for k, v in mapping["simulation"].items() if k not in ("step", "tolerance")}
    options |= {"method": method} | ({} if step is None else {"step": step})
    simulation = Simulation(scene_from_mapping(mapping | {"simulation": options}), announce=None)
    with pytest.raises(SimulationError) as caught:
        simulation.run(checks=False)
    return caught.value


@pytest.mark.parametrize("rate", [50.0, 1.0])
@pytest.mark.parametrize(
    ("method", "step"),
    [("gauss6", 1e-3), ("gauss6", 0.05), ("radau5", None), ("dopri853", None)],
)
def test_a_drive_at_the_end_of_its_way(method: str, step: float | None, rate: float) -> None:
    """A rod of 1 m at x = 0.2 + t / 2: the end of its way is at 1.6 s, however far samples are
    apart."""
    scene = driven_to_the_end()
    scene["simulation"]["rate"] = rate
    reported = failure(scene, method, step)
    assert not isinstance(reported, StepTooLargeError)
    assert "singular configuration at t = 1.6" in str(reported)
    assert "'drive'" in str(reported) or "'rod'" in str(reported)


def test_a_change_point_within_the_step_that_fails() -> None:
    """In line at 0.6472 s; steps end at 0.65 s."""
    scene = four_bar(2.0)
    for rate in (50.0, 5.0, 2.0):
        scene["simulation"]["rate"] = rate
        failed = failure(scene, "gauss6", 0.05)
        found = re.match(r"singular configuration at t = ([0-9.]+) s", str(failed))
        assert found is not None and abs(float(found[1]) - 0.6472) < 0.01, (rate, failed)


@pytest.mark.usefixtures("no_advice")
def test_a_step_that_is_too_large_for_a_loop_is_blamed_all_the_same() -> None:
    scene = four_bar(2.0, rocker=1.5)
    spring = {"type": "spring", "body": "rocker", "point_A": [2.0, 0.0, 3.0]}
    scene["effects"] = {"spring": spring | {"stiffness": 1e9, "rest_length": 0.0}}
    scene["simulation"]["duration"] = 10.0
    reported = failure(scene, "rk4", 0.01)
    assert isinstance(reported, StepTooLargeError)
    assert "singular configuration" not in str(reported)


# Where a figure passes through zero as |x| does, of motions and figures in closed form.


SPIN = 1.3
"""[rad/s] about z, beside a body that stands."""
LENGTH = 0.5


def spun(t: np.ndarray) -> np.ndarray:
    """A body that turns about z beside one that stands, shape (n, 26); every other quaternion has
    the other sign."""
    y = np.zeros((len(t), 2, 13))
    half, sign = 0.5 * SPIN * t, np.where(np.arange(len(t)) % 2, 1.0, -1.0)
    y[:, 1, 5], y[:, 1, 6], y[:, 1, 12] = sign * np.sin(half), sign * np.cos(half), SPIN
    y[:, 0, 6] = 1.0
    return y.reshape(len(t), -1)


def angle_of(y: np.ndarray) -> np.ndarray:
    return np.mod(2.0 * np.arctan2(y[:, 13 + 5], y[:, 13 + 6]), 2.0 * np.pi)


def run_of(t: np.ndarray) -> np.ndarray:
    """Two bodies that part by 1.3 LENGTH a second while both go on, as fast as they like."""
    y = np.zeros((len(t), 2, 13))
    y[:, :, 6], y[:, :, 7] = 1.0, (50.0, 50.0 + 2.0 * SPIN * LENGTH)
    y[:, :, 0] = t[:, None] * y[0, :, 7]
    return y.reshape(len(t), -1)


def way_of(y: np.ndarray) -> np.ndarray:
    return (y[:, 13] - y[:, 0]) / (2.0 * LENGTH)


KINDS = {"turns": (spun, angle_of), "goes on": (run_of, way_of)}


def follow(
    t: np.ndarray, kind: str, least: float, pieces: int = 1, at: float = 2.0
) -> Vanishing | None:
    """What is found of s, which is least where the body has turned, or gone on, by `at`: there a V
    of line 1, between one of slope 1/2 and s = 1 that belong to line 0."""
    states, place = KINDS[kind]

    def figure(_: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x = np.sin(0.5 * (place(y) - at)) * 2.0
        s = np.minimum(np.hypot(x, least), 1.0)
        return s, (s < 1.0).astype(int)

    follower, y = Follower(figure, LENGTH), states(t)
    for part in np.array_split(np.arange(len(t)), pieces):
        found = follower.add(t[part], y[part])
        if found is not None:
            return found
    return None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pieces", [1, 2, 3, 7])
@pytest.mark.parametrize("turn", [0.03, 0.13, 0.37, 0.71])
def test_a_figure_that_passes_through_zero_is_found(turn: float, pieces: int, kind: str) -> None:
    """However far apart samples are, and wherever blocks end."""
    t = np.arange(0.0, 4.0, turn) / SPIN
    found = follow(t, kind, 0.0, pieces=pieces)
    assert found is not None and found.row == 1
    assert found.at == pytest.approx(2.0 / SPIN, abs=2e-3)
    assert found.s < 0.02
    assert 4 <= len(found.t) == len(found.y) <= 9
    assert found.t[0] < found.at < found.t[-1]
    place = KINDS[kind][1](found.y)
    assert_allclose(place, SPIN * found.t, atol=2e-3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pieces", [1, 3])
@pytest.mark.parametrize("turn", [0.03, 0.13, 0.37, 0.71])
@pytest.mark.parametrize("least", [0.03, 0.3])
def test_one_that_comes_near_zero_is_not(turn: float, least: float, pieces: int, kind: str) -> None:
    t = np.arange(0.0, 4.0, turn) / SPIN
    assert follow(t, kind, least, pieces=pieces) is None


def seen_often(tolerance: float) -> Simulation:
    """A parallelogram that comes into line at 0.6472 s, at 2 kHz: within a step across that instant
    the stages of the steps to some of the samples find no solution."""
    mapping = four_bar(2.0)
    mapping["simulation"] |= {
        "method": "radau5",
        "tolerance": tolerance,
        "rate": 2000.0,
        "duration": 1.4,
    }
    del mapping["simulation"]["step"]
    return Simulation(scene_from_mapping(mapping), announce=None)


def test_samples_are_taken_in_parts_where_the_step_to_them_fails() -> None:
    run = seen_often(1e-6).run(check=False, checks=False)
    turn = run.orientation["crank"]
    angle = np.unwrap(2.0 * np.arctan2(-turn[:, 1], turn[:, 3]))
    # no load: the links keep their speed
    np.testing.assert_allclose(angle, ANGLE + SPEED * run.t, atol=1e-5)


def test_a_sample_that_no_step_comes_to_ends_the_run() -> None:
    """It is refused with the time, and no row of NaN comes before it."""
    rows: list[np.ndarray] = []

    class Rows:
        def open(self, scene: Any, layout: Any) -> None: ...
        def close(self, summary: Any = None) -> None: ...
        def write(self, block: Any) -> None:
            rows.append(block.position)

    try:
        seen_often(1e-8).run(check=False, checks=False, sinks=[Rows()])
    except SimulationError as error:
        assert "singular configuration at t = 0.647" in str(error)
    assert np.isfinite(np.concatenate(rows)).all()
