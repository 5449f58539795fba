# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A vehicle on more wheels than are needed to carry it, slipping and turning on the spot."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from rb_sim import Simulation
from rb_sim.scene.load import scene_from_mapping

RADIUS, MASS, HALF_TRACK, FRICTION, TORQUE = 0.1, 0.5, 0.25, 0.6, 2.5
SPIN_INERTIA = 0.4 * MASS * RADIUS**2
YAW_INERTIA = 0.25
"""Of the chassis alone [kg m^2]."""
TIME, RATE = 0.12, 500.0


def places_of(base: float) -> np.ndarray:
    """x and y of each wheel [m]."""
    return np.array([[x, y] for y in (-HALF_TRACK, HALF_TRACK) for x in (base / 2, -base / 2)])


def vehicle(places: np.ndarray, tolerance: float) -> dict[str, Any]:
    scene: dict[str, Any] = {
        "bodies": {
            "chassis": {
                "mass": 8.0,
                "inertia": [0.1, 0.15, YAW_INERTIA],
                "position": [0.0, 0.0, 0.12],
            }
        },
        "constraints": {},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {
            "duration": TIME,
            "rate": RATE,
            "method": "dopri853",
            "tolerance": tolerance,
        },
    }
    for i, (x, y) in enumerate(places.tolist()):
        name = f"wheel_{i}"
        scene["bodies"][name] = {
            "mass": MASS,
            "shape": {"type": "sphere", "radius": RADIUS},
            "position": [x, y, RADIUS],
        }
        scene["constraints"][f"axle_{i}"] = {
            "type": "fixed_axis",
            "body": name,
            "parent": "chassis",
            "axis_B": [0, 1, 0],
        }
        scene["constraints"][f"tyre_{i}"] = {
            "type": "contact",
            "body": name,
            "friction": {"type": "coulomb", "static": FRICTION, "kinetic": FRICTION},
        }
        scene["effects"][f"motor_{i}"] = {
            "type": "wrench",
            "body": name,
            "frame": "body",
            "torque": [0.0, -np.sign(y) * TORQUE, 0.0],
        }
    return scene


def yaw_and_spins(places: np.ndarray, loads: CubicSpline) -> np.ndarray:
    """Yaw rate of the chassis and spins of the wheels at TIME: Coulomb's law with these loads."""
    x, y = places.T
    yaw = YAW_INERTIA + np.sum(MASS * (x**2 + y**2) + SPIN_INERTIA)

    def rates(t: float, s: np.ndarray) -> np.ndarray:
        slip = np.array([-s[0] * y - RADIUS * s[1:], s[0] * x])
        size = np.linalg.norm(slip, axis=0)
        # at rest each wheel is about to slip along its own drive
        way = slip / size if size.all() else np.array([np.sign(y), 0.0 * x])
        fx, fy = -FRICTION * loads(t) * way
        spins = (-np.sign(y) * TORQUE - RADIUS * fx) / SPIN_INERTIA
        return np.array([np.sum(x * fy - y * fx) / yaw, *spins])

    start = np.zeros(1 + len(places))
    return solve_ivp(rates, (0.0, TIME), start, "DOP853", rtol=1e-11, atol=1e-11).y[:, -1]


@pytest.mark.parametrize(("base", "tolerance"), [(0.4, 1e-5), (0.7, 1e-9)])
def test_a_vehicle_turns_on_the_spot_in_a_few_steps(base: float, tolerance: float) -> None:
    places = places_of(base)
    simulation = Simulation(scene_from_mapping(vehicle(places, tolerance)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # how the wheels share the load is not determined
        run = simulation.run()
    tyres = [run.reaction[f"tyre_{i}"].force[:, 2] for i in range(len(places))]
    # at t = 0, where nothing slips yet, the load may be shared otherwise than just after
    loads = CubicSpline(run.t[1:], np.array(tyres).T[1:])
    expected = yaw_and_spins(places, loads)
    got = [run.angular_velocity["chassis"][-1, 2]]
    got += [run.angular_velocity[f"wheel_{i}"][-1, 1] for i in range(len(places))]
    assert np.abs(got - expected).max() < 10.0 * tolerance * np.abs(expected).max()
    assert simulation.steps + simulation.rejected_steps < 60


def test_samples_asked_for_one_at_a_time_are_those_asked_for_at_once() -> None:
    """As a node asks for them: also where several lie in one step, in which no more lines count
    than at its start. The chassis stays level, since the wheels are the corners of a rectangle."""
    scene = scene_from_mapping(vehicle(places_of(0.4), 1e-10))
    times = np.linspace(0.0, TIME, 61)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        at_once = Simulation(scene).run(at=times, check=False)
        simulation = Simulation(scene)
        alone = [simulation.run(at=[t], check=False) for t in times]
    one = np.array([run.position["chassis"][0] for run in alone])
    assert np.abs(one - [0.0, 0.0, 0.12]).max() < 1e-10
    np.testing.assert_array_equal(one, at_once.position["chassis"])
    turning = [run.angular_velocity["wheel_1"][0] for run in alone]
    np.testing.assert_array_equal(turning, at_once.angular_velocity["wheel_1"])
