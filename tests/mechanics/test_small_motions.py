# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A tolerance means the same for a body that swings by a nanometre beside one of a metre."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SceneError


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
    run = Simulation(load_scene(oscillators(amplitude, centre, **options))).run(watched=False)
    way = run.position["small"][:, 0] - centre
    return float(np.abs(way / amplitude - np.cos(10.0 * run.t)).max())


@pytest.mark.parametrize("amplitude", [1.0, 1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("options", [{}, {"method": "radau5", "tolerance": 1e-8}], ids=str)
def test_an_oscillator_keeps_its_digits_at_any_size(
    amplitude: float, options: dict[str, Any]
) -> None:
    # 60 steps of 1e-10 (dopri853), of order 3 and 1e-8 with a factor of the extrapolation (radau5)
    assert error(amplitude, **options) < 6e-9


@pytest.mark.parametrize("joint", ["translation", "plane"])
@pytest.mark.parametrize("method", ["dopri853", "radau5", "taylor"])
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
    run = Simulation(load_scene(mapping)).run(duration=20.0, watched=False)
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
    run = simulation.run(watched=False)
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
    run = Simulation(load_scene(chain(1e9, method="radau5", tolerance=1e-8))).run(watched=False)
    assert run.residual.max() < 1e-13
    with pytest.raises(SceneError, match="masses of 0.001 kg and 1e.09 kg connected by"):
        Simulation(load_scene(chain(1e12)))


def test_a_heavy_body_carries_one_a_million_million_times_lighter() -> None:
    run = Simulation(load_scene(chain(1e-12))).run(watched=False)
    assert run.residual.max() < 1e-13
    swinging = run.block  # the heavy one turns about its centre, the pivot: no work between them
    speed = np.linalg.norm(swinging.linear_velocity[:, 1], axis=1)
    spin = np.linalg.norm(swinging.angular_velocity[:, 1], axis=1)
    own = 0.5 * speed**2 + 0.05 * spin**2 + 9.81 * swinging.position[:, 1, 2]
    assert np.ptp(own) < 1e-9


def test_steps_at_the_usual_size_are_as_they_were() -> None:
    """Bodies that move by a metre take the steps that max(1, |y|) gives, those of one alone."""
    mapping = oscillators(1.0, 0.0)
    mapping["effects"]["soft"]["stiffness"] = 1e-9
    whole = Simulation(load_scene(mapping))
    whole.run()
    assert whole.steps < 40


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
        run = simulation.run(watched=False)
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
        simulation.run(watched=False)
        steps.append(simulation.steps)
    assert steps[1] < 0.5 * steps[0]


def test_an_absolute_tolerance_is_refused_in_contact() -> None:
    scene = beside_a_command(absolute_tolerance=1e-12, position=[0.0, 0.0, 0.1])
    scene["bodies"]["bob"]["shape"] = {"type": "sphere", "radius": 0.1}
    scene["constraints"] = {"floor": {"type": "contact", "body": "bob"}}
    with pytest.raises(SceneError, match=r"bodies\.bob\.absolute_tolerance: got 1e-12; must be"):
        Simulation(load_scene(scene), announce=None)
