# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Long steps round loops whose lines depend on each other, beside the equation of one angle.

Two equal cranks that hang from the ground carry a coupler, on four hinges with parallel axes: of 20
lines on three bodies three depend on the others. The coupler does not turn, so that

    (2 J + m l^2) phi'' = -(m_crank + m) g l sin(phi),   J = j + m_crank l^2 / 4.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rb_sim import Simulation
from rb_sim.mechanics.tables.table_laws import BODIES, TableLaws
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping

G, LENGTH, APART, CRANK, COUPLER, ACROSS = 9.81, 0.8, 0.6, 0.7, 1.9, 0.04
START, DURATION = 1.1, 2.0


def hinge(body: str, point_B: list[float], **more: Any) -> dict[str, Any]:
    axes = {"type": "fixed_axis", "axis_B": [0, 1, 0], "bearing_distance": 0.2}
    return axes | {"body": body, "point_B": point_B} | more


def linkages(count: int, **run: Any) -> dict[str, Any]:
    """So many linkages side by side along y, released at START from hanging."""
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    s, c = math.sin(START), math.cos(START)
    turned = {"axis": [0, 1, 0], "angle": -START}
    for k in range(count):
        for side, x in (("left", 0.0), ("right", APART)):
            name = f"{side}{k}"
            bodies[name] = {
                "mass": CRANK,
                "inertia": [ACROSS, ACROSS, 0.01],
                "position": [x + 0.5 * LENGTH * s, float(k), -0.5 * LENGTH * c],
                "orientation": turned,
            }
            joints[f"ground_{name}"] = hinge(name, [0, 0, 0.5 * LENGTH])
        bodies[f"coupler{k}"] = {
            "mass": COUPLER,
            "inertia": [0.02, 0.2, 0.2],
            "position": [0.5 * APART + LENGTH * s, float(k), -LENGTH * c],
        }
        for side, x in (("left", -0.5 * APART), ("right", 0.5 * APART)):
            joints[f"pin_{side}{k}"] = hinge(f"coupler{k}", [x, 0, 0], parent=f"{side}{k}")
    return {
        "bodies": bodies,
        "constraints": joints,
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": DURATION, "rate": 20.0} | run,
    }


def angle() -> tuple[np.ndarray, np.ndarray]:
    """(t, phi) from the equation of motion."""
    inertia = 2.0 * (ACROSS + CRANK * LENGTH**2 / 4.0) + COUPLER * LENGTH**2
    k = (CRANK + COUPLER) * G * LENGTH / inertia
    t = np.linspace(0.0, DURATION, 41)
    found = solve_ivp(
        lambda _, y: [y[1], -k * math.sin(y[0])],
        (0.0, DURATION),
        [START, 0.0],
        "DOP853",
        t,
        rtol=1e-13,
        atol=1e-13,
    )
    return t, found.y[0]


def with_ball(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene beside a ball that bounces on a floor."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [5, 5, 1.0]}
    scene["bodies"]["ball"] = ball
    scene["constraints"]["floor"] = {"type": "contact", "body": "ball", "restitution": 0.5}
    return scene


def error(simulation: Simulation, count: int = 1) -> float:
    """Of the couplers' places along the run [m]."""
    run = simulation.run(watched=False)
    _, phi = angle()
    worst = 0.0
    for k in range(count):
        at = run.position[f"coupler{k}"]
        worst = max(worst, float(np.abs(at[:, 0] - 0.5 * APART - LENGTH * np.sin(phi)).max()))
        worst = max(worst, float(np.abs(at[:, 2] + LENGTH * np.cos(phi)).max()))
    return worst


def simulation_of(count: int, **run: Any) -> Simulation:
    return Simulation(scene_from_mapping(linkages(count, **run)))


@pytest.mark.parametrize("count", [1, BODIES // 3])
def test_errors_of_long_fixed_steps_fall_by_the_method_s_order(count: int) -> None:
    """Also where laws go over tables; a stage is off the manifold by the step's error."""
    scene = scene_from_mapping(linkages(count, method="rk4", step=0.02))
    assert isinstance(compile_scene(scene).laws, TableLaws) == (count > 1)
    coarse = error(simulation_of(count, method="rk4", step=0.04), count)
    fine = error(simulation_of(count, method="rk4", step=0.02), count)
    assert coarse < 2e-4
    assert 10.0 < coarse / fine < 30.0


@pytest.mark.parametrize(("tolerance", "most"), [(1e-3, 40), (1e-6, 60), (1e-9, 120)])
def test_a_tolerance_costs_the_steps_of_a_smooth_motion(tolerance: float, most: int) -> None:
    simulation = simulation_of(1, method="dopri853", tolerance=tolerance)
    assert error(simulation) < 10.0 * tolerance
    assert simulation.steps + simulation.rejected_steps <= most


@pytest.mark.parametrize(("method", "bound"), [("rk4", 1e-5), ("gauss6", 1e-9)])
def test_a_ball_that_bounces_beside_a_loop_costs_it_no_accuracy(method: str, bound: float) -> None:
    """Contacts bring other loops, which leave out the same lines."""
    scene = with_ball(linkages(1, method=method, step=0.02))
    assert error(Simulation(scene_from_mapping(scene))) < bound
