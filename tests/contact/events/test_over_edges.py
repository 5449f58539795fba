# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A point that slides over the edge of another body's box falls from there, with all its energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError

G, M, INERTIA, m = 9.81, 3.0, 0.2, 0.5
HALF, HIGH = 0.4, 0.1
"""Half length and half height of the table [m]."""
START, SPEED = -0.1, 1.5
"""Place on the table [m] and speed of the point along it [m/s]."""
TILT, RELATIVE_SPIN = 0.2, 0.7
"""Of the table [rad], [rad/s], about y."""


def scene(shape: dict[str, Any], held: bool, **simulation: Any) -> dict[str, Any]:
    """A point slides on a table that floats freely, or is welded to the world."""
    e1, e3 = axes(TILT)
    place = START * e1 + HIGH * e3
    spin = np.array([0.0, RELATIVE_SPIN, 0.0]) * (not held)
    velocity = SPEED * e1 + np.cross(spin, place)
    table = {
        "mass": M,
        "inertia": [INERTIA] * 3,
        "shape": shape,
        "orientation": {"axis": [0, 1, 0], "angle": TILT},
        "angular_velocity": spin.tolist(),
    }
    point = {
        "mass": m,
        "inertia": [0.01] * 3,
        "position": place.tolist(),
        "linear_velocity": velocity.tolist(),
    }
    contact = {
        "type": "contact",
        "body": "point",
        "parent": "table",
        "points": [[0, 0, 0]],
        "surface": {"type": "shape"},
        "friction": {"type": "smooth"},
    }
    weight = {"type": "gravity", "acceleration": [0, 0, -G], "bodies": ["point"]}
    joints = {"floor": {"type": "weld", "body": "table"}} if held else {}
    return {
        "bodies": {"point": point, "table": table},
        "constraints": {"slide": contact, **joints},
        "effects": {"weight": weight},
        "simulation": simulation,
    }


BOX = {"type": "box", "size": [2 * HALF, 1.0, 2 * HIGH]}
DRUM = {"type": "cylinder", "radius": HALF, "length": 2 * HIGH, "axis_B": [0, 0, 1]}


def axes(angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Along the table and normal to it, world."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c, 0.0, -s]), np.array([s, 0.0, c])


def lagrange(t: float, state: np.ndarray) -> np.ndarray:
    """Of a table with coordinates (x, z, angle) and a point at s along it, frictionless."""
    q, rate = state[:4], state[4:]
    (e1, e3), s = axes(q[2]), q[3]
    ex, ez = np.eye(3)[0], np.eye(3)[2]
    J = np.stack([ex, ez, HIGH * e1 - s * e3, e1], axis=1)
    changing = rate[2] ** 2 * (-s * e1 - HIGH * e3) - 2.0 * rate[3] * rate[2] * e3
    mass = np.diag([M, M, INERTIA, 0.0]) + m * J.T @ J
    return np.append(rate, np.linalg.solve(mass, -m * J.T @ (changing + G * ez)))


def at_the_edge() -> tuple[float, np.ndarray]:
    """(time, coordinates and rates) at which the point has come to the edge."""

    def edge(t: float, state: np.ndarray) -> float:
        return state[3] - HALF

    edge.terminal = True  # type: ignore[attr-defined]
    start = [0.0, 0.0, TILT, START, 0.0, 0.0, RELATIVE_SPIN, SPEED]
    options: dict[str, Any] = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "events": edge}
    found = solve_ivp(lagrange, (0.0, 1.0), start, **options)
    return float(found.t[-1]), found.y[:, -1]


METHODS: list[dict[str, Any]] = [
    {"method": "dopri853", "tolerance": 1e-12},
    {"method": "rk4", "step": 1e-4},
    {"method": "gauss6", "step": 1e-3},
]


@pytest.mark.parametrize("shape", [BOX, DRUM], ids=["box", "drum"])
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m["method"])
def test_a_point_slides_off_a_table_that_turns(shape: dict, method: dict) -> None:
    """Both fly on freely from the edge; Lagrange's equations of s, the table's place and angle."""
    when, state = at_the_edge()
    span = 0.2
    run = Simulation(
        load_scene(scene(shape, False, duration=when + span, rate=200, **method)), announce=None
    ).run(at=[0.0, 0.5 * when, when + span], checks=False)
    (event,) = [event for event in run.events if event.kind == "opens"]
    assert event.kind == "opens" and abs(event.t - when) < 1e-10
    (e1, e3), (v, w) = axes(state[2]), (state[4:6], state[6])
    place = np.array([state[0], 0.0, state[1]]) + state[3] * e1 + HIGH * e3
    velocity = np.array([v[0], 0.0, v[1]]) + w * (HIGH * e1 - state[3] * e3) + state[7] * e1
    fallen = place + span * velocity - 0.5 * G * span**2 * np.array([0, 0, 1])
    np.testing.assert_allclose(run.position["point"][-1], fallen, atol=2e-9)
    table = np.array([state[0] + span * v[0], 0.0, state[1] + span * v[1]])
    np.testing.assert_allclose(run.position["table"][-1], table, atol=2e-9)
    half = 0.5 * (state[2] + span * w)
    np.testing.assert_allclose(
        run.orientation["table"][-1], [0, np.sin(half), 0, np.cos(half)], atol=2e-9
    )
    assert abs(run.energy[-1] - run.energy[0]) < 1e-10


@pytest.mark.parametrize("shape", [BOX, DRUM], ids=["box", "drum"])
def test_a_point_slides_off_a_slope_at_any_speed(shape: dict) -> None:
    """From rest at the top, faster and faster: s = g sin(tilt) t^2 / 2, then a parabola."""
    mapping = scene(shape, True, duration=1.2, rate=100, tolerance=1e-11)
    mapping["bodies"]["point"]["linear_velocity"] = [0.0, 0.0, 0.0]
    run = Simulation(load_scene(mapping), announce=None).run(checks=False)
    down = G * np.sin(TILT)
    when = np.sqrt(2.0 * (HALF - START) / down)
    (event,) = [event for event in run.events if event.kind == "opens"]
    assert abs(event.t - when) < 1e-9
    (e1, e3), left = axes(TILT), 1.2 - when
    edge = HALF * e1 + HIGH * e3
    expected = edge + left * down * when * e1 - 0.5 * G * left**2 * np.array([0, 0, 1])
    np.testing.assert_allclose(run.position["point"][-1], expected, atol=1e-8)
    assert abs(run.energy[-1] - run.energy[0]) < 1e-10


@pytest.mark.parametrize("method", METHODS, ids=lambda m: m["method"])
def test_a_bilateral_contact_ends_at_the_edge(method: dict) -> None:
    """Nothing guides it beyond; what comes before is as where the point slides."""
    when, _ = at_the_edge()
    mapping = scene(BOX, False, duration=1.0, rate=200, **method)
    mapping["constraints"]["slide"]["mode"] = "bilateral"
    simulation = Simulation(load_scene(mapping), announce=None)
    with pytest.raises(SimulationError, match="contact slide reaches the edge") as reported:
        simulation.run(checks=False)
    assert f"t = {when:.6f}" in str(reported.value)
