# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Derivatives carried along a motion: closed forms, high-order differences, and clear refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.scene.load import scene_from_mapping
from rb_sim.simulation.sensitivity import (
    SIXTH,
    NotSmoothError,
    TangentSimulation,
)

BALL = {"mass": 2.0, "inertia": [0.1, 0.1, 0.1]}


def oscillator(x: Any) -> Any:
    """A mass on a spring without rest length: z'' = -k z / m from (z0, v0)."""
    stiffness, mass, z0, v0 = (float(v) for v in x)
    body = BALL | {"mass": mass, "position": [0, 0, z0], "linear_velocity": [0, 0, v0]}
    spring = {"type": "spring", "body": "ball", "point_A": [0, 0, 0], "stiffness": stiffness}
    return scene_from_mapping(
        {
            "bodies": {"ball": body},
            "effects": {"hook": spring | {"rest_length": 0.0}},
            "simulation": {"duration": 2.0, "rate": 10, "tolerance": 1e-12},
        }
    )


def test_an_oscillator_by_its_closed_form() -> None:
    """z = z0 cos wt + v0/w sin wt with w = sqrt(k/m)."""
    x = np.array([50.0, 2.0, 0.3, 0.7])
    k, m, z0, v0 = x
    simulation = TangentSimulation(oscillator, x, x)
    t = simulation.run(checks=False).t
    found = np.array([block.position[:, 0, 2] for block in simulation.take_derivatives()])
    w = np.sqrt(k / m)
    by_w = -z0 * t * np.sin(w * t) + v0 * (t * np.cos(w * t) / w - np.sin(w * t) / w**2)
    expected = [by_w * w / (2 * k), -by_w * w / (2 * m), np.cos(w * t), np.sin(w * t) / w]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10)


def chain(x: Any) -> Any:
    """Two links on each other in maximal coordinates, pulled by a commandable wrench or not."""
    mass, length, rate, pull = (float(v) for v in x)
    link = {"inertia": [0.1, 0.1, 0.02]}
    bodies = {
        "upper": link | {"mass": mass, "position": [0.5, 0, 0]},
        "lower": link | {"mass": 1.0, "position": [1.0 + length, 0, 0]},
    }
    bodies["lower"]["angular_velocity"] = [rate, 0.0, 0.0]
    joint = {"type": "fixed_point", "point_B": [-0.5, 0, 0], "point_A": [0, 0, 0]}
    lower = {"body": "lower", "parent": "upper", "point_A": [0.5, 0, 0], "point_B": [-length, 0, 0]}
    return scene_from_mapping(
        {
            "bodies": bodies,
            "constraints": {"top": joint | {"body": "upper"}, "knee": joint | lower},
            "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 1.0, pull]}},
            "simulation": {"duration": 0.2, "rate": 50, "method": "rk4", "step": 0.01},
        }
    )


FIELDS = ("position", "orientation", "angular_velocity", "reaction_force", "reaction_torque")


def columns(block: Any) -> np.ndarray:
    parts = [getattr(block, name).reshape(len(block.t), -1) for name in FIELDS]
    return np.concatenate([*parts, block.energy[:, None]], axis=1)


def carried_and_differences() -> list[tuple[np.ndarray, np.ndarray]]:
    x, h = np.array([1.5, 0.4, 2.0, -9.81]), 2e-3
    simulation = TangentSimulation(chain, x, x)
    simulation.run(checks=False)
    found = []
    for k, block in enumerate(simulation.take_derivatives()):
        total: Any = 0.0
        for j, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
            e = np.eye(4)[k] * j * h * x[k]
            sides = [
                columns(Simulation(chain(x + s * e)).run(checks=False).block) for s in (1.0, -1.0)
            ]
            total = total + weight * (sides[0] - sides[1]) / (60.0 * h * x[k])
        found.append((columns(block), total))
    return found


def test_two_links_in_fixed_steps_by_high_order_differences() -> None:
    """Poses, velocities, reactions and energy, by constants, geometry, start and gravity."""
    for carried, differences in carried_and_differences():
        scale = np.abs(differences).max()
        assert scale > 0.01
        np.testing.assert_allclose(carried, differences, rtol=0.0, atol=3e-8 * scale)


def door(x: Any) -> Any:
    """A door on two hinges, of whose 10 lines 5 are redundant."""
    mass, gravity, spread = (float(v) for v in x)
    body = {"mass": mass, "inertia": [0.04, spread, 0.03], "center_of_mass": [0.4, 0.1, 0.2]}
    hinge = {"type": "fixed_axis", "body": "door", "axis_B": [0, 0.6, 0.8]}
    push = {"type": "wrench", "body": "door", "force": [0, 0.7, 0], "torque": [0.2, 0, 0.3]}
    scene = {
        "bodies": {"door": body | {"angular_velocity": [0.0, 0.6, 0.8]}},
        "constraints": {
            "upper": hinge | {"point_B": [0, 0.6, 0.8]},
            "lower": hinge | {"point_B": [0, -0.6, -0.8]},
        },
        "effects": {
            "weight": {"type": "gravity", "acceleration": [0.3, 0.0, -gravity]},
            "push": push,
        },
        "simulation": {
            "duration": 0.1, "rate": 50.0, "method": "rk4", "step": 2e-3, "project_initial": True
        },
    }  # fmt: skip
    return scene_from_mapping(scene)


def test_reactions_of_least_norm_by_high_order_differences() -> None:
    """They were refused as "a function called by its address".

    Along one way that changes all three numbers: each point of it is another scene to compile.
    """
    x = np.array([0.7, 9.81, 0.05])
    way = 1e-2 * x * [1.0, -0.7, 0.4]
    simulation = TangentSimulation(door, x, x)
    simulation.run(checks=False)
    by_number = [columns(block) for block in simulation.take_derivatives()]
    expected = sum(
        weight * columns(Simulation(door(x + j * way)).run(checks=False).block)
        for j, weight in SIXTH.items()
    )
    assert all(np.abs(h * part).max() > 1e-4 for h, part in zip(way, by_number, strict=True))
    carried = np.einsum("k,k...->...", way, by_number)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(carried, expected, rtol=0.0, atol=1e-9 * scale)


def ball_on_floor(x: Any) -> Any:
    floor = {"type": "contact", "body": "ball", "friction": {"type": "rough"}}
    ball = BALL | {"position": [0, 0, float(x[0])], "shape": {"type": "sphere", "radius": 0.1}}
    return scene_from_mapping({"bodies": {"ball": ball}, "constraints": {"floor": floor}})


def box_near_a_cube(x: Any) -> Any:
    """Its principal axes turn by 90 degrees where two moments pass each other."""
    inertia = [[0.1, 1e-5, 0.0], [1e-5, 0.1 * float(x[0]), 0.0], [0.0, 0.0, 0.15]]
    box = {"mass": 1.0, "inertia": inertia, "angular_velocity": [1, 2, 3]}
    return scene_from_mapping({"bodies": {"box": box}})


def ball_for_a_while(x: Any) -> Any:
    return scene_from_mapping({"bodies": {"ball": BALL}, "simulation": {"duration": float(x[0])}})


@pytest.mark.parametrize(
    ("scene_at", "why"),
    [
        (ball_on_floor, "has contacts"),
        (box_near_a_cube, "smoothly"),
        (ball_for_a_while, "simulation.duration depends on the numbers"),
    ],
)
def test_what_has_no_derivative_is_refused(scene_at: Any, why: str) -> None:
    with pytest.raises(NotSmoothError, match=why):
        TangentSimulation(scene_at, np.array([1.0]), [1.0])


def test_a_number_at_the_edge_of_what_is_possible_is_refused() -> None:
    with pytest.raises(NotSmoothError, match="neighbouring scene is invalid: .*mass"):
        TangentSimulation(oscillator, np.array([50.0, 0.001, 0.3, 0.7]), [50.0, 1.0, 1.0, 1.0])
