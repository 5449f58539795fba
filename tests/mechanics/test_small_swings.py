# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What swings on joints by a nanometre keeps its digits at the default tolerance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene

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
@pytest.mark.parametrize(("length", "amplitude"), [(1.0, 1e-6), (1e-3, 1e-9)])
@pytest.mark.parametrize(
    ("count", "joint", "options"),
    [
        (1, "fixed_axis", {}),
        (1, "fixed_point", STIFF),
        (1, "fixed_axis", SERIES),
        (2, "fixed_point", {}),
        (2, "fixed_axis", SERIES),
        (3, "fixed_axis", STIFF),
        (3, "fixed_point", {}),
    ],
)
def test_a_swing_keeps_its_digits(
    count: int, joint: str, length: float, amplitude: float, options: dict[str, Any]
) -> None:
    # 100 steps of 1e-10 of the swing, or 600 of 1e-8 of an estimate (radau5); rounding of a
    # quaternion is 1e-7 of a swing of 1e-9 in a step, of any sign. 3e-2 to all of it was lost in SI
    simulation = Simulation(load_scene(rods(count, joint, length, amplitude, **options)))
    run = simulation.run()
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
    run = simulation.run()
    assert simulation.held_bodies == {"swing"}
    way = speed / drag * (1.0 - np.exp(-drag * run.t))
    assert np.abs(run.position["slow"][:, 0] - way).max() < 1e-9 * speed
