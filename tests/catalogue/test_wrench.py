# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Prescribed wrenches at one instant: force and torque about C by hand, in both axes."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import load_scene
from rb_sim.catalogue.effects.wrench import CommandRow
from rb_sim.catalogue.types import WORLD, BodyState, Inertial, wrench
from rb_sim.scene.compile import compile_scene

Axes = Literal["world", "body"]
AXES: tuple[Axes, ...] = ("world", "body")
CENTRE, POINT = np.array([0.04, -0.03, 0.05]), np.array([0.1, 0.2, -0.3])
STATE = BodyState((0.4, 0.1, -0.2), (0.5, -0.1, 0.7, 0.5), (1.0, 2.0, -0.5), (3.0, -2.0, 1.0))
STATE = STATE._replace(q_WB=tuple((np.array(STATE.q_WB) / np.linalg.norm(STATE.q_WB)).tolist()))
TURN = Rotation.from_quat(STATE.q_WB)
BODY = Inertial(1.6, (0.3, 0.4, 0.5, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
FORCE, TORQUE = np.array([1.0, -2.0, 1.5]), np.array([0.1, 0.2, -0.15])
TIMES = [0.1, 0.3, 0.7]
FORCES = np.array([[1.0, 0.5, 2.0], [3.0, -3.0, 1.0], [-1.0, 1.0, 0.5]])
TORQUES = np.array([[0.1, -0.4, 0.6], [0.5, 0.2, -0.1], [0.3, 0.7, 0.2]])


def rows_of(effect: dict[str, Any]) -> list[Any]:
    body = {"mass": 1.6, "inertia": [0.3, 0.4, 0.5], "center_of_mass": CENTRE.tolist()}
    effect = effect | {"body": "b"}
    scene = {"bodies": {"b": body}, "effects": {"e": effect}}
    compiled = compile_scene(load_scene(scene), coordinates="maximal")
    return [placed.row for placed in compiled.system.effects]


def total(rows: list[Any], t: float) -> np.ndarray:
    """[force, world axes; torque about C, axes of the body]."""
    acting = [np.concatenate(wrench(row, t, BODY, STATE, WORLD)) for row in rows]
    return np.sum(acting, axis=0)


def by_hand(force: np.ndarray, torque: np.ndarray, axes: Axes, point: np.ndarray) -> np.ndarray:
    """K + r x F about C of a force at a point of the body."""
    if axes == "world":
        force, torque = TURN.inv().apply(force), TURN.inv().apply(torque)
    return np.concatenate([TURN.apply(force), torque + np.cross(point - CENTRE, force)])


@pytest.mark.parametrize("axes", AXES)
def test_constant_and_harmonic_parts(axes: Axes) -> None:
    own = {"type": "wrench", "frame": axes, "point_B": POINT.tolist()}
    steady = {"force": FORCE.tolist(), "torque": TORQUE.tolist()}
    waves = {"sine_force": FORCES[0].tolist(), "sine_torque": TORQUES[0].tolist()}
    waves |= {"angular_frequency": 7.0, "phase": 0.3}
    share = np.sin(7.0 * 0.25 + 0.3)
    for given, force, torque in (
        (steady, FORCE, TORQUE),
        (waves, share * FORCES[0], share * TORQUES[0]),
        (steady | waves, FORCE + share * FORCES[0], TORQUE + share * TORQUES[0]),
        ({"force": FORCE.tolist()}, FORCE, np.zeros(3)),
        ({"torque": TORQUE.tolist()}, np.zeros(3), TORQUE),
        (waves | {"sine_force": [0.0] * 3}, np.zeros(3), share * TORQUES[0]),
        (waves | {"sine_torque": [0.0] * 3}, share * FORCES[0], np.zeros(3)),
    ):
        expected = by_hand(force, torque, axes, POINT)
        assert_allclose(total(rows_of(own | given), 0.25), expected, atol=1e-14)


INSTANTS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 0.71)


def in_table(values: np.ndarray, t: float, interpolation: str) -> np.ndarray:
    if not TIMES[0] <= t <= TIMES[-1]:
        return np.zeros(3)
    if interpolation == "hold":
        return values[int(np.sum(np.array(TIMES) <= t)) - 1]
    return np.array([np.interp(t, TIMES, column) for column in values.T])


@pytest.mark.parametrize("interpolation", ["linear", "hold"])
@pytest.mark.parametrize("axes", AXES)
def test_a_table(axes: Axes, interpolation: str) -> None:
    table = {"type": "wrench_table", "frame": axes, "interpolation": interpolation}
    table |= {"times": TIMES, "point_B": POINT.tolist()}
    table |= {"forces": FORCES.tolist(), "torques": TORQUES.tolist()}
    (row,) = rows_of(table)
    for t in INSTANTS:
        force, torque = (in_table(values, t, interpolation) for values in (FORCES, TORQUES))
        expected = by_hand(force, torque, axes, POINT)
        assert_allclose(total([row], t), expected, atol=1e-14)


def test_a_command_acts_at_the_origin_in_axes_of_world_and_body_at_once() -> None:
    (idle,) = rows_of({"type": "commanded_wrench"})
    assert not total([idle], 0.2).any()
    parts = [tuple(x.tolist()) for x in (FORCE, TORQUE, FORCES[0], TORQUES[0])]
    row = CommandRow(*parts, idle.r_B)
    expected = by_hand(FORCE, TORQUE, "world", np.zeros(3))
    expected = expected + by_hand(FORCES[0], TORQUES[0], "body", np.zeros(3))
    assert_allclose(total([row], 0.2), expected, atol=1e-14)
