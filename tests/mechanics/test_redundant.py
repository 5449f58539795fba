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
import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rb_sim import Simulation
from rb_sim.mechanics.table_laws import BODIES, TableLaws
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.mechanics.bennett import Bennett
from tests.properties.test_newton_euler import CLOSE, defects

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
    run = simulation.run(checks=False)
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


@pytest.mark.parametrize(("tolerance", "most"), [(1e-3, 40), (1e-9, 120)])
def test_a_tolerance_costs_the_steps_of_a_smooth_motion(tolerance: float, most: int) -> None:
    simulation = simulation_of(1, method="dopri853", tolerance=tolerance)
    assert error(simulation) < 10.0 * tolerance
    assert simulation.steps + simulation.rejected_steps <= most


@pytest.mark.parametrize(("method", "bound"), [("rk4", 1e-5), ("gauss6", 1e-9)])
def test_a_ball_that_bounces_beside_a_loop_costs_it_no_accuracy(method: str, bound: float) -> None:
    """Contacts bring other loops, which leave out the same lines."""
    scene = with_ball(linkages(1, method=method, step=0.02))
    assert error(Simulation(scene_from_mapping(scene))) < bound


def watched(scene: dict[str, Any]) -> Any:
    """The run of a scene; whatever a watch finds is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Simulation(scene_from_mapping(scene)).run()


# Lines in loops are chosen anew after every step: the choice, and linkages in full turns.


TURNING = 4.0
"""[rad/s] at which the linkages turn: more than a full turn in TIME."""
TIME = 2.0


WAYS_CHOICE: dict[str, tuple[dict[str, Any], float]] = {
    "rk4": ({"step": 0.005}, 4e-7),
    "gauss6": ({"step": 0.01}, 5e-10),
    "dopri853": ({"tolerance": 1e-10}, 5e-10),
    "taylor": ({"tolerance": 1e-10}, 5e-10),
    "radau5": ({"tolerance": 1e-8}, 1e-9),
}
"""Of each method its setting and the error [m]; with lines chosen at the start alone they were
up to 8e-2, and gauss6 went on at no step."""


@cache
def middles(seed: int) -> np.ndarray:
    """Where the bars of a linkage are at ten instants a second."""
    return Bennett(seed).middles(TURNING, np.linspace(0.0, TIME, 21))


@pytest.mark.parametrize(
    ("seed", "method"),
    [(2, "rk4"), (2, "dopri853"), (2, "gauss6"), (2, "radau5"), (4, "taylor")],
)
def test_linkages_turn_full_turns(seed: int, method: str) -> None:
    linkage, (setting, close) = Bennett(seed), WAYS_CHOICE[method]
    run = watched(linkage.scene(TURNING, duration=TIME, rate=10.0, method=method, **setting))
    found = np.stack([run.position[f"bar{k}"] for k in range(3)], axis=1)
    assert np.abs(found - middles(seed)).max() < close


def test_reactions_of_linkages_move_them() -> None:
    scene = Bennett(2).scene(TURNING, duration=TIME, rate=10.0)
    for t in (0.7, 1.6):
        assert max(defects(scene, t)) < CLOSE


def test_a_run_in_pieces_is_the_run_in_one() -> None:
    """To the last bit, wherever samples are taken: what is chosen hangs on the steps alone, and a
    sample of the present changes nothing."""
    options = {"duration": TIME, "method": "rk4", "step": 0.005}
    scene = Bennett(2).scene(TURNING, rate=40.0, **options)
    whole = watched(scene)
    parts = Simulation(scene_from_mapping(scene))
    for t in (0.3, 0.7123, 1.4):
        parts.advance(t - parts.time)
        parts.sample()
    rest = parts.run(TIME - 1.4, 40.0, checks=False)
    coarse = watched(Bennett(2).scene(TURNING, rate=5.0, **options))
    for name in whole.position:
        np.testing.assert_array_equal(rest.position[name][-1], whole.position[name][-1])
        np.testing.assert_array_equal(coarse.position[name], whole.position[name][::8])


def placed(simulation: Simulation) -> np.ndarray:
    """Where the bars of a linkage are now."""
    sample = simulation.sample()
    return np.stack([sample.position[f"bar{k}"][0] for k in range(3)])


def test_a_state_that_is_set_has_lines_of_its_own() -> None:
    """One step from places at some of which the lines of the start serve badly."""
    linkage, step = Bennett(0), 0.01
    simulation = Simulation(scene_from_mapping(linkage.scene(TURNING, method="rk4", step=step)))
    fields = ("position", "orientation", "linear_velocity", "angular_velocity")
    for angle in np.arange(2.5, 3.5, 0.1):
        linkage.start = angle
        there = linkage.scene(TURNING)["bodies"]
        simulation.set_state({name: {f: body[f] for f in fields} for name, body in there.items()})
        simulation.advance(step)
        after = linkage.middles(TURNING, np.array([0.0, step]))[-1]
        assert np.abs(placed(simulation) - after).max() < 1e-7


# Linkages that hold more than they need turn full turns beside contacts as they do without.


def beside_a_ball(seed: int, **run: Any) -> dict[str, Any]:
    """A linkage, and a ball that bounces far away."""
    scene = Bennett(seed).scene(TURNING, duration=TIME, **run)
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.2}, "position": [50.0, 0.0, 1.0]}
    scene["bodies"]["ball"] = ball
    scene["constraints"]["floor"] = {"type": "contact", "body": "ball", "restitution": 0.8}
    scene["effects"] = {"weight": {"type": "gravity", "bodies": ["ball"]}}
    return scene


def test_full_turns() -> None:
    """With lines chosen at the start alone rk4 was wrong by 2e-2."""
    run = watched(beside_a_ball(2, rate=10.0, method="rk4", step=0.0025))
    found = np.stack([run.position[f"bar{k}"] for k in range(3)], axis=1)
    assert np.abs(found - middles(2)).max() < 3e-8


def test_what_is_chosen_hangs_on_the_steps_alone() -> None:
    """Samples between, and another run of the same scene between, change no bit."""
    options = {"method": "rk4", "step": 0.005}
    scene = scene_from_mapping(beside_a_ball(2, rate=10.0, **options))
    often = scene_from_mapping(beside_a_ball(2, rate=130.0, **options))
    whole, fine = (Simulation(asked).run(checks=False) for asked in (scene, often))
    first, second = Simulation(scene), Simulation(scene)
    for k in range(1, 21):
        for run, share in ((first, 1.0), (second, 0.37)):
            run.advance(share * 0.1 * k - run.time)
    for name in whole.position:
        last = whole.position[name][-1]
        np.testing.assert_array_equal(fine.position[name][-1], last)
        np.testing.assert_array_equal(first.sample().position[name][0], last)
