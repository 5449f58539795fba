# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A tolerance means the same for bodies that move by nanometres, alone or with each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.mechanics.error_scales import Turn, of_pair, spin_lengths


def oscillators(amplitude: float, centre: float, **options: Any) -> dict[str, Any]:
    """A small one of 10 rad/s beside one of a metre, not coupled to it."""
    return {
        "bodies": {
            "small": {"mass": 1e-9, "inertia": [1e-9] * 3, "position": [centre + amplitude, 0, 0]},
            "large": {
                "mass": 1.0,
                "inertia": [1.0] * 3,
                "position": [0, 1.0, 0],
                "linear_velocity": [1.0, 0, 0],
            },
        },
        "effects": {
            "soft": {
                "type": "spring",
                "body": "small",
                "stiffness": 1e-7,
                "point_A": [centre, 0, 0],
            },
            "stiff": {"type": "spring", "body": "large", "stiffness": 1.0},
        },
        "simulation": {"duration": 2.0, "rate": 20.0} | options,
    }


def error(amplitude: float, centre: float = 0.0, **options: Any) -> float:
    """Relative to the amplitude."""
    run = Simulation(load_scene(oscillators(amplitude, centre, **options))).run(checks=False)
    way = run.position["small"][:, 0] - centre
    return float(np.abs(way / amplitude - np.cos(10.0 * run.t)).max())


@pytest.mark.parametrize("amplitude", [1.0, 1e-6, 1e-12])
@pytest.mark.parametrize("options", [{}, {"method": "radau5", "tolerance": 1e-8}], ids=str)
def test_an_oscillator_keeps_its_digits_at_any_size(
    amplitude: float, options: dict[str, Any]
) -> None:
    # 60 steps of 1e-10 (dopri853), of order 3 and 1e-8 with a factor of the extrapolation (radau5)
    assert error(amplitude, **options) < 6e-9


@pytest.mark.parametrize(
    ("joint", "method"),
    [("translation", "dopri853"), ("translation", "radau5"), ("plane", "taylor")],
)
def test_a_small_part_on_a_guide_keeps_its_digits(joint: str, method: str) -> None:
    """It swings by a micrometre while nothing else moves: 5e-4 of it was lost in SI."""
    mapping = oscillators(1e-6, 0.0, method=method)
    mapping["bodies"]["large"]["linear_velocity"] = [0.0, 0.0, 0.0]
    mapping["effects"] = {"soft": mapping["effects"]["soft"]}
    mapping["constraints"] = {
        "wall": {"type": "weld", "body": "large"},
        "rail": {"type": joint, "body": "small"},
    }
    if joint == "plane":
        mapping["constraints"]["rail"]["normal_A"] = [0, 0, 1]
    else:
        mapping["constraints"]["rail"]["guide"] = {"type": "line", "direction": [1, 0, 0]}
    run = Simulation(load_scene(mapping)).run(duration=20.0, checks=False)
    way = run.position["small"][:, 0] / 1e-6
    assert np.abs(way - np.cos(10.0 * run.t)).max() < 2e-8


def test_far_from_the_origin_doubles_are_the_limit() -> None:
    # an ulp of 0.5 is 1e-7 of a nanometre
    assert error(1e-6, 0.5) < 1e-8
    assert error(1e-9, 0.5) < 2e-6


def test_a_start_too_small_to_tell_does_not_stall() -> None:
    """A constant push from rest never turns the body: it is held to SI, and exact all the same."""
    mapping = oscillators(1e-9, 0.0)
    mapping["effects"]["soft"] = {
        "type": "wrench", "body": "small", "force": [1e-16, 0.0, 0.0],
    }  # fmt: skip
    simulation = Simulation(load_scene(mapping))
    run = simulation.run(checks=False)
    way = run.position["small"][:, 0] - 1e-9
    assert np.abs(way - 0.5e-7 * run.t**2).max() < 1e-17
    assert simulation.steps < 60


def chain(ratio: float, **options: Any) -> dict[str, Any]:
    """A body that hangs from the world by one `ratio` times lighter."""
    spin = {"angular_velocity": [0.0, 0.3, 0.0]}
    return {
        "bodies": {
            "light": {"mass": 1e-3, "inertia": [1e-3] * 3} | spin,
            "heavy": {
                "mass": 1e-3 * ratio,
                "inertia": [1e-4 * ratio] * 3,
                "position": [0.0, 0.0, -1.0],
                "linear_velocity": [-0.3, 0.0, 0.0],
            }
            | spin,
        },
        "constraints": {
            "hinge": {"type": "fixed_point", "body": "light"},
            "link": {
                "type": "fixed_point", "body": "heavy", "parent": "light", "point_B": [0, 0, 1],
            },
        },
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"duration": 0.2, "rate": 50.0, "project_initial": True} | options,
    }  # fmt: skip


def test_a_mass_ratio_that_doubles_cannot_carry_is_refused_as_that() -> None:
    run = Simulation(load_scene(chain(1e9, method="radau5", tolerance=1e-8))).run(checks=False)
    assert run.residual.max() < 1e-13
    with pytest.raises(SceneError, match="masses of 0.001 kg and 1e.09 kg connected by"):
        Simulation(load_scene(chain(1e12)))


def test_a_heavy_body_carries_one_a_million_million_times_lighter() -> None:
    run = Simulation(load_scene(chain(1e-12))).run(checks=False)
    assert run.residual.max() < 1e-13
    swinging = run.block  # the heavy one turns about its centre, the pivot: no work between them
    speed = np.linalg.norm(swinging.linear_velocity[:, 1], axis=1)
    spin = np.linalg.norm(swinging.angular_velocity[:, 1], axis=1)
    own = 0.5 * speed**2 + 0.05 * spin**2 + 9.81 * swinging.position[:, 1, 2]
    assert np.ptp(own) < 1e-9


def beside_a_command(**more: Any) -> dict[str, Any]:
    """A nanometre on a spring, of which nothing is found out where commands may come."""
    bob = {"mass": 1.0, "inertia": [0.1] * 3, "position": [1e-9, 0.0, 0.0]}
    far = {"mass": 1.0, "inertia": [0.1] * 3, "position": [0.0, 1.0, 0.0]}
    return {
        "bodies": {"bob": bob | more, "far": far},
        "effects": {
            "spring": {"type": "spring", "body": "bob", "stiffness": 400.0},
            "hand": {"type": "commanded_wrench", "body": "far"},
        },
        "simulation": {"duration": 5.0, "rate": 50.0},
    }


@pytest.mark.parametrize("method", ["dopri853", "radau5", "taylor"])
def test_an_absolute_tolerance_is_that_of_its_body(method: str) -> None:
    """x = 1e-9 m cos(20 t): a step may err by 1e-19 m, or by 1e-10 of a metre."""
    errors = []
    for more in ({}, {"absolute_tolerance": 1e-19}):
        scene = load_scene(beside_a_command(**more), method=method, tolerance=1e-10)
        simulation = Simulation(scene, announce=None)
        run = simulation.run(checks=False)
        x = run.position["bob"][:, 0]
        errors.append(np.abs(x - 1e-9 * np.cos(20.0 * run.t)).max() / 1e-9)
    assert errors[0] > 1e-3 and errors[1] < 1e-6


def test_an_absolute_tolerance_may_be_loose() -> None:
    """A micrometre a step is enough for a metre: fewer steps than a tolerance of 1e-10 takes."""
    steps = []
    for more in ({}, {"absolute_tolerance": 1e-6}):
        scene = beside_a_command(**more)
        scene["bodies"]["bob"]["position"] = [1.0, 0.0, 0.0]
        simulation = Simulation(load_scene(scene), announce=None)
        simulation.run(checks=False)
        steps.append(simulation.steps)
    assert steps[1] < 0.5 * steps[0]


def test_an_absolute_tolerance_is_refused_in_contact() -> None:
    scene = beside_a_command(absolute_tolerance=1e-12, position=[0.0, 0.0, 0.1])
    scene["bodies"]["bob"]["shape"] = {"type": "sphere", "radius": 0.1}
    scene["constraints"] = {"floor": {"type": "contact", "body": "bob"}}
    with pytest.raises(SceneError, match=r"bodies\.bob\.absolute_tolerance: got 1e-12; must be"):
        Simulation(load_scene(scene), announce=None)


# What swings on joints by a nanometre keeps its digits at the default tolerance.


G = 9.81
STIFF, SERIES = {"method": "radau5", "tolerance": 1e-8}, {"method": "taylor"}

Array = Any


def rods(count: int, joint: str, length: float, amplitude: float, **options: Any) -> dict[str, Any]:
    """Rods that hang from each other in one straight line, which is turned by the amplitude."""
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    for i in range(count):
        away = (i + 0.5) * length
        bodies[f"rod{i}"] = {
            "mass": 1.0,
            "inertia": [length**2 / 12.0] * 3,
            "position": [-away * np.sin(amplitude), 0.0, -away * np.cos(amplitude)],
            "orientation": {"axis": [0, 1, 0], "angle": amplitude},
        }
        own = {"type": joint, "body": f"rod{i}", "point_B": [0, 0, 0.5 * length]}
        own |= {"parent": f"rod{i - 1}", "point_A": [0, 0, -0.5 * length]} if i else {}
        own |= {"axis_B": [0, 1, 0], "axis_A": [0, 1, 0]} if joint == "fixed_axis" else {}
        joints[f"joint{i}"] = own | ({} if i else {"point_A": [0, 0, 0]})
    period = 2.0 * np.pi * (length / G) ** 0.5
    simulation = {"duration": 3.0 * period, "rate": 10.0 / period, "project_initial": True}
    return {
        "bodies": bodies,
        "constraints": joints,
        "effects": {"weight": {"type": "gravity", "acceleration": [0, 0, -G]}},
        "simulation": simulation | options,
    }


def linear(count: int, length: float, t: Array) -> Array:
    """Angles over the amplitude, (n, count): the normal modes of the rods."""
    levers = np.tril(np.full((count, count), length), -1) + 0.5 * length * np.eye(count)
    masses = levers.T @ levers + length**2 / 12.0 * np.eye(count)
    squared, modes = np.linalg.eig(np.linalg.solve(masses, G * np.diag(levers.sum(axis=0))))
    shares = np.linalg.solve(modes, np.ones(count))
    return np.cos(np.sqrt(squared) * t[:, None]) * shares @ modes.T


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("count", "joint", "length", "amplitude", "options"),
    [
        (1, "fixed_axis", 1.0, 1e-6, {}),
        (1, "fixed_point", 1e-3, 1e-9, STIFF),
        (1, "fixed_axis", 1e-3, 1e-9, SERIES),
        (2, "fixed_axis", 1.0, 1e-6, SERIES),
        (3, "fixed_axis", 1.0, 1e-6, STIFF),
        (3, "fixed_point", 1e-3, 1e-9, {}),
    ],
)
def test_a_swing_keeps_its_digits(
    count: int, joint: str, length: float, amplitude: float, options: dict[str, Any]
) -> None:
    # 100 steps of 1e-10 of the swing, or 600 of 1e-8 of an estimate (radau5); rounding of a
    # quaternion is 1e-7 of a swing of 1e-9 in a step, of any sign. 3e-2 to all of it was lost in SI
    simulation = Simulation(load_scene(rods(count, joint, length, amplitude, **options)))
    run = simulation.run(checks=False)
    angles = np.stack([2.0 * run.orientation[f"rod{i}"][:, 1] for i in range(count)], axis=1)
    error = np.abs(angles / amplitude - linear(count, length, run.t)).max()
    assert error < 1e-7
    assert simulation.steps < 1500


def test_large_swings_take_the_steps_that_they_took() -> None:
    # a rod let go at 1 rad is held to max(1, |y|)
    assert not Simulation(load_scene(rods(1, "fixed_axis", 1.0, 1.0))).held_bodies
    assert not Simulation(load_scene("heavy_top")).held_bodies


def test_what_only_slows_down_keeps_its_digits_beside_a_small_swing() -> None:
    """All of the scene is a micrometre: without the swing its tolerance is made smaller by that."""
    drag, speed = 30.0, 1e-6
    scene = rods(1, "fixed_point", 1e-6, 1e-4, duration=1.0, rate=20.0)
    scene["constraints"]["joint0"]["body"] = "swing"
    scene["bodies"] = {
        "swing": scene["bodies"]["rod0"],
        "slow": {"mass": 1.0, "inertia": [1.0] * 3, "linear_velocity": [speed, 0, 0]},
    }
    scene["effects"] = {
        "weight": {"type": "torsion_spring", "body": "swing", "axis_B": [0, 1, 0],
                   "stiffness": 1e-11, "rest_angle": 1e-4},
        "air": {"type": "linear_drag", "body": "slow", "coefficient": drag},
    }  # fmt: skip
    simulation = Simulation(load_scene(scene))
    run = simulation.run(checks=False)
    assert simulation.held_bodies == {"slow", "swing"}
    way = speed / drag * (1.0 - np.exp(-drag * run.t))
    assert np.abs(run.position["slow"][:, 0] - way).max() < 1e-9 * speed


# What two bodies do relative to each other keeps its digits, however far they go together.


def pair(amplitude: float, drift: float, spin: float = 0.0, **options: Any) -> dict[str, Any]:
    """Two bodies of 1 kg on a spring of 50 N/m, 1 m apart: at rest relative to each other they
    start `amplitude` further apart, and their distance swings with 10 rad/s where they only drift.
    """
    half = 0.5 * (1.0 + amplitude)
    body = {"mass": 1.0, "inertia": [1.0] * 3, "angular_velocity": [0.0, 0.0, spin]}
    ends = {
        name: body
        | {
            "position": [end * half, 0.0, 0.0],
            "linear_velocity": [drift, 0.3 * drift + spin * end * half, 0.0],
        }
        for name, end in (("a", -1.0), ("b", 1.0))
    }
    spring = {"type": "spring", "body": "b", "parent": "a", "stiffness": 50.0, "rest_length": 1.0}
    return {
        "bodies": ends,
        "effects": {"spring": spring},
        "simulation": {"duration": 10.0, "rate": 20.0} | options,
    }


def error_of_motions(scene: dict[str, Any], amplitude: float) -> tuple[float, int]:
    """Of the distance, relative to the amplitude; and steps."""
    simulation = Simulation(load_scene(scene))
    run = simulation.run(checks=False)
    way = np.linalg.norm(run.position["b"] - run.position["a"], axis=1) - 1.0
    return float(np.abs(way / amplitude - np.cos(10.0 * run.t)).max()), simulation.steps


@pytest.mark.parametrize(
    ("drift", "options"), [(0.0, STIFF), (1.0, {}), (1.0, STIFF), (10.0, SERIES)]
)
def test_a_micrometre_between_bodies_that_drift_keeps_its_digits(
    drift: float, options: dict[str, Any]
) -> None:
    """Errors relative to the metres that they drift were 3e-4 of the micrometre.

    Bound: 240 steps of 1e-10, and where they have gone 100 m an ulp of 1.4e-14 is 1.4e-8 of it.
    """
    assert error_of_motions(pair(1e-6, drift, **options), 1e-6)[0] < (
        3e-8 if drift < 10.0 else 1e-6
    )


@pytest.mark.parametrize("method", ["dopri853", "radau5"])
def test_small_bodies_on_a_spring_that_is_much_stiffer_keep_their_digits(method: str) -> None:
    """1 N/m to the world and 1e8 N/m between them: the motion is not followed until they turn."""
    body = {"mass": 1.0, "inertia": [1.0] * 3, "linear_velocity": [1e-6, 0.0, 0.0]}
    spring = {"type": "spring", "rest_length": 1.0}
    mapping = {
        "bodies": {"a": body, "b": body | {"position": [1.0, 0.0, 0.0]}},
        "effects": {
            "soft": spring | {"body": "a", "point_A": [-1.0, 0.0, 0.0], "stiffness": 1.0},
            "stiff": spring | {"body": "b", "parent": "a", "stiffness": 1e8},
        },
        "simulation": {"duration": 5.0, "rate": 20.0, "method": method},
    }
    run = Simulation(load_scene(mapping)).run(checks=False)
    square, modes = np.linalg.eigh(np.array([[1.0 + 1e8, -1e8], [-1e8, 1e8]]))
    rates = np.sqrt(square)
    start = 1e-6 * modes.sum(axis=0) / rates
    x = (modes * start) @ np.sin(np.outer(rates, run.t))
    assert np.abs(run.position["a"][:, 0] - x[0]).max() < 1e-6 * 1e-6


def test_far_away_doubles_are_the_limit() -> None:
    """At 1,000 m an ulp is 1.1e-13, 1e-7 of a micrometre in each of 150 steps."""
    found, steps = error_of_motions(pair(1e-6, 100.0), 1e-6)
    assert found < 1.5e-5 and steps < 300


def test_a_tolerance_below_what_doubles_tell_does_not_crawl() -> None:
    """A nanometre at 0.5 m from the origin, of which an ulp is 1e-7: asked for 1e-14 of it the run
    took 26 million steps over the rounding of its own spring."""
    found, steps = error_of_motions(pair(1e-9, 0.0, tolerance=1e-14), 1e-9)
    assert found < 2e-5 and steps < 1000


def test_bodies_that_turn_about_each_other_cost_no_more_than_before() -> None:
    """Apart by 1 + x, 50 x = w^2 (1 + x) / 2 with w = 1: relative to each other they are at rest,
    and rounding is not taken for a motion to be kept."""
    stretch = 1.0 / 99.0
    simulation = Simulation(load_scene(pair(stretch, 1.0, 1.0)))
    run = simulation.run(checks=False)
    way = np.linalg.norm(run.position["b"] - run.position["a"], axis=1)
    assert np.abs(way - 1.0 - stretch).max() < 1e-8
    assert not simulation.held_bodies and simulation.steps < 200


def test_a_swing_seen_from_a_parent_that_turns_is_held() -> None:
    """A disk of 1 kg m^2 on the axis of another swings by a microradian on a torsion spring of
    50 N m while both turn at 3 rad/s and drift: w^2 = 50 (1 + 1).

    6e-3 of it was lost. Bound: 90 steps, each of which may round by 4 ulps of the attitude.
    """
    body = {
        "mass": 1.0,
        "inertia": [0.5, 0.5, 1.0],
        "linear_velocity": [2.0, 0.0, 0.0],
        "angular_velocity": [0.0, 0.0, 3.0],
    }
    kick = 1e-6 * 10.0
    scene: dict[str, Any] = {
        "bodies": {
            "a": body,
            "b": body | {"angular_velocity": [0.0, 0.0, 3.0 + kick], "position": [0, 0, 0.5]},
        },
        "constraints": {
            "axle": {
                "type": "fixed_axis", "body": "b", "parent": "a", "point_B": [0, 0, -0.5],
                "point_A": [0, 0, 0], "axis_B": [0, 0, 1], "axis_A": [0, 0, 1],
            }
        },
        "effects": {
            "spring": {
                "type": "torsion_spring", "body": "b", "parent": "a", "axis_B": [0, 0, 1],
                "stiffness": 50.0,
            }
        },
        "simulation": {"duration": 5.0, "rate": 20.0},
    }  # fmt: skip
    simulation = Simulation(load_scene(scene))
    run = simulation.run(checks=False)
    half = [2.0 * np.arctan2(run.orientation[k][:, 2], run.orientation[k][:, 3]) for k in "ab"]
    angle = np.angle(np.exp(1j * (half[1] - half[0])))
    assert simulation.held_bodies == {"a", "b"}
    assert np.abs(angle / 1e-6 - np.sin(10.0 * run.t)).max() < 1e-7


def test_an_attitude_is_held_to_what_it_turns_of_the_other_body() -> None:
    rests = Turn(0.0, 0.0, False, 0.0)
    place, turn = Turn(1e-6, 2e-6, True, 1.0), Turn(1e-4, 3e-4, True, 1.0)
    assert of_pair(place, turn, 1e-9, 1e-3) == (place, turn)
    assert of_pair(place, turn, 1e-9, 2.0) == (place, Turn(0.5e-6, 1e-6, True, 1.0))
    assert of_pair(place, turn._replace(speed=1e-7), 1e-9, 2.0)[1].speed == 1e-7
    unmoved = Turn(1.0, 1.0, True, 0.0)
    assert of_pair(place, rests, 1e-9, 1e-9) == (place, unmoved)
    assert of_pair(rests, turn, 1e-9, 2.0) == (unmoved, turn)


def test_many_pairs_keep_their_digits_as_one_does() -> None:
    """More than eight were not followed, and 2.7e-4 of the micrometre wrong without a word."""
    first = pair(1e-6, 1.0)
    scene = {"bodies": {}, "effects": {}, "simulation": first["simulation"]}
    for k in range(12):
        for name, body in first["bodies"].items():
            x, y, z = body["position"]
            scene["bodies"][f"{name}{k}"] = body | {"position": [x, y + 2.0 * k, z]}
        ends = {"body": f"b{k}", "parent": f"a{k}"}
        scene["effects"][f"spring{k}"] = first["effects"]["spring"] | ends
    run = Simulation(load_scene(scene)).run(checks=False)
    for k in range(12):
        way = np.linalg.norm(run.position[f"b{k}"] - run.position[f"a{k}"], axis=1) - 1.0
        assert np.abs(way / 1e-6 - np.cos(10.0 * run.t)).max() < 1e-7


def test_a_chain_that_falls_from_one_end_is_not_held_to_how_the_other_begins() -> None:
    """Its last links move by 1e-10 m to and fro before they whip by metres."""
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    for i in range(20):
        bodies[f"b{i}"] = {"mass": 1.0, "inertia": [0.01, 0.09, 0.08], "position": [0.5 + i, 0, 0]}
        above = {"parent": f"b{i - 1}", "point_A": [0.5, 0, 0]} if i else {}
        end = {"type": "fixed_point", "body": f"b{i}", "point_B": [-0.5, 0, 0]}
        joints[f"j{i}"] = end | above
    scene = {
        "bodies": bodies,
        "constraints": joints,
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 0.1, "rate": 20.0},
    }
    assert not Simulation(load_scene(scene)).held_bodies


@pytest.mark.parametrize(("stiffness", "place"), [(1e290, 1e100), (1e300, 1.0)])
def test_numbers_beyond_all_steps_end_in_one_line(stiffness: float, place: float) -> None:
    """The search divided by a step that had come to nothing."""
    body = {"mass": 1e-12, "inertia": [1e-12, 0.9e-12, 0.4e-12], "position": [1e-6, place, 0]}
    scene = {
        "bodies": {"bob": body},
        "effects": {"spring": {"type": "spring", "body": "bob", "stiffness": stiffness}},
        "simulation": {"duration": 2.0, "rate": 20.0},
    }
    with pytest.raises(RbSimError):
        Simulation(load_scene(scene)).run(checks=False)


def test_a_spin_counts_as_its_angular_momentum_over_the_largest_radius_of_gyration() -> None:
    """m |A w| = |I w| / R of two bodies at once, R = sqrt(largest moment / m)."""
    inertia, mass = np.array([np.diag([4.0, 3.0, 1e-6]), np.diag([0.5, 2.0, 2.0])]), [1.0, 0.5]
    w, radius = np.array([0.3, -0.2, 1e4]), [2.0, 2.0]
    lengths = spin_lengths(inertia, np.array(mass))
    for k in range(2):
        expected = np.linalg.norm(inertia[k] @ w) / radius[k] / mass[k]
        assert np.linalg.norm(lengths[k] @ w) == pytest.approx(expected)
