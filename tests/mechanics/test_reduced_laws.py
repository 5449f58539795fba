# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The laws of one body by hand: Jacobians, whole steps, what there is no law of."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.graph.derivative import PlainColumns
from rb_sim.graph.machine import compile_law, evaluate, interpreted
from rb_sim.graph.symbols import Graph
from rb_sim.mechanics import laws as engine
from rb_sim.mechanics.laws import ReducedLaws, dense, domain_law, is_coordinate, reference
from rb_sim.mechanics.methods import loop_of
from rb_sim.mechanics.samples import row_width
from rb_sim.mechanics.taylor_variables import variables_of
from rb_sim.numerics.vectors import sin
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import scene_from_mapping

MOMENTS, DRAG, TORQUE = np.array([0.2, 0.3, 0.4]), 0.3, np.array([0.01, 0.03, -0.02])


def laws_of(constraint: Any = None, **run: Any) -> tuple[ReducedLaws, np.ndarray, Any]:
    """Of a body that flies with drag, or hangs on an axle; its start and its method."""
    body = {
        "mass": 2.0, "inertia": MOMENTS.tolist(), "linear_velocity": [1.0, 2.0, 3.0],
        "angular_velocity": [0.3, -0.5, 0.7], "orientation": [0.1, 0.3, 0.5, 0.8],
    }  # fmt: skip
    drag = {"type": "linear_drag", "body": "b", "coefficient": DRAG}
    turn = {"type": "wrench", "body": "b", "frame": "body", "torque": TORQUE.tolist()}
    mapping: dict[str, Any] = {"bodies": {"b": body}, "effects": {"drag": drag, "turn": turn}}
    if constraint is not None:
        mapping["bodies"]["b"] = body | {
            "angular_velocity": [0, 0, 1],
            "linear_velocity": [0, 0, 0],
        }
        mapping["constraints"] = {"axle": constraint}
    mapping["simulation"] = {"duration": 1.0, "method": "rk4", "step": 0.1} | run
    scene = scene_from_mapping(mapping)
    compiled = compile_scene(scene)
    found = ReducedLaws(compiled.system, len(compiled.y), row_width(compiled.layout))
    return found, np.array(compiled.y), compile_method(scene.simulation, 1.0)


AXLE = {"type": "fixed_axis", "body": "b", "axis_B": [0.0, 0.0, 1.0]}


def value(law: Any, y: Any, count: int, *inputs: float) -> np.ndarray:
    out = np.zeros(count)
    evaluate(law, 0.0, np.ascontiguousarray(y, dtype=float), np.array([*inputs, 0.0]), out)
    return out


def rate(y: np.ndarray) -> np.ndarray:
    """Of the free body: drag and Euler's equations."""
    q, v, w = y[3:7], y[7:10], y[10:13]
    turn = np.array([*(q[3] * w + np.cross(q[:3], w)), -q[:3] @ w])
    spin = (TORQUE - np.cross(w, MOMENTS * w)) / MOMENTS
    return np.concatenate([v, 0.5 * turn, -DRAG / 2.0 * v, spin])


def test_there_is_no_law_of_a_domain_that_nothing_leaves() -> None:
    assert domain_law(True) is None and reference(None) == 0
    y = Graph().vector("y", 2)
    law = domain_law(y[1] < 3.0)
    assert value(law, [9.0, 2.0], 1) == 1.0 and value(law, [9.0, 4.0], 1) == 0.0
    assert laws_of()[0].inside is None


def test_which_coordinates_are_velocities() -> None:
    assert laws_of()[0].velocities == [0.0] * 7 + [1.0] * 6
    assert laws_of(AXLE)[0].velocities == [0.0, 1.0]


def test_a_jacobian_in_full_rows() -> None:
    y = Graph().vector("y", 3)
    law = compile_law(dense([y[0] * y[2], 5.0 * y[1], sin(y[0])], y))
    at = np.array([0.3, 0.7, 2.0])
    expected = [[2.0, 0.0, 0.3], [0.0, 5.0, 0.0], [np.cos(0.3), 0.0, 0.0]]
    assert_allclose(value(law, at, 9).reshape(3, 3), expected)


@pytest.mark.parametrize("most", [0, 10**6])
def test_the_jacobian_by_entries_and_by_columns(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """Beside differences of Euler's equations."""
    monkeypatch.setattr(engine, "BY_ENTRIES", most)
    laws, y, _ = laws_of()
    found = value(laws.jacobian, y, 169).reshape(13, 13)
    steps = 1e-6 * np.eye(13)
    expected = np.transpose([(rate(y + e) - rate(y - e)) / 2e-6 for e in steps])
    assert_allclose(found, expected, atol=1e-8)
    if interpreted():
        assert isinstance(laws.jacobian, PlainColumns) is (most == 0)


def test_the_way_back_is_a_law_where_something_leaves() -> None:
    """Of an angle there is none; a quaternion gets its length again."""
    assert laws_of(AXLE)[0].settle is None
    laws, y, _ = laws_of()
    y[3:7] *= 1.01
    settled = value(laws.settle, y, 13)
    assert_allclose(settled[3:7], y[3:7] / np.linalg.norm(y[3:7]))
    assert np.array_equal(np.delete(settled, range(3, 7)), np.delete(y, range(3, 7)))
    first, second = Graph().vector("y", 2)
    assert is_coordinate(first, 0) and is_coordinate(second, 1)
    for x, i in ((first, 1), (first + 1.0, 0), (0.0, 0), (Graph().input("p", 0), 0)):
        assert not is_coordinate(x, i)


def rk4(y: np.ndarray, h: float) -> np.ndarray:
    a = rate(y)
    b = rate(y + 0.5 * h * a)
    c = rate(y + 0.5 * h * b)
    return y + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(y + h * c))


def test_a_whole_step_is_one_law() -> None:
    """Kutta's, with a unit quaternion at its end; what rounding has lost is carried on."""
    laws, y, method = laws_of()
    found = loop_of(type(method))
    assert found is not None
    step, h = found[0], 0.1
    law = laws.whole(step, estimated=False)
    assert law is laws.whole(step, estimated=False)
    carry = np.zeros(13)
    carry[0], carry[8] = 1e-3, -2e-3
    out = value(law, [*y, *carry], 27, h)
    expected = rk4(y, h) + carry
    expected[3:7] /= np.linalg.norm(expected[3:7])
    assert_allclose(out[:13], expected, rtol=1e-12)
    assert np.abs(out[13:26]).max() < 1e-15
    assert out[26] == pytest.approx(out[:13].sum(), rel=1e-14)
    tiny = np.zeros(13)
    tiny[0] = 1e-20  # less than the last digit of what it is added to
    y[0] = 1.0
    lost = value(law, [*y, *tiny], 27, 1e-20)[13]
    assert lost == pytest.approx(1e-20 + 1e-20 * y[7], rel=1e-9)


def test_long_steps_are_no_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the operations of its stages, and by those that are left of them."""
    laws, _, method = laws_of()
    found = loop_of(type(method))
    assert found is not None
    operations = laws._rate_operations
    for most, there in ((4 * operations - 1, False), (4 * operations, None), (10**6, True)):
        monkeypatch.setattr(engine, "WHOLE", most)
        law = laws_of()[0].whole(found[0], estimated=False)
        if there is not None:
            assert (law is not None) is there
    assert laws_of()[0].whole(found[0], estimated=True) is not None


def test_a_sample_is_as_wide_as_it_is_asked_for() -> None:
    """State; no reactions; energy, potential, power, momentum and angular momentum, residual."""
    laws, y, _ = laws_of()
    out = value(laws.sample, y, laws.width)
    v, w = y[7:10], y[10:13]
    turned = Rotation.from_quat(y[3:7])
    assert np.array_equal(out[:13], y)
    assert out[13] == pytest.approx(v @ v + 0.5 * w @ (MOMENTS * w))
    assert out[15] == pytest.approx(TORQUE @ w - DRAG * v @ v)
    assert_allclose(out[16:19], 2.0 * v)
    assert_allclose(out[19:22], np.cross(y[:3], 2.0 * v) + turned.apply(MOMENTS * w))


def test_methods_that_are_not_traced_have_no_whole_step() -> None:
    laws, _, method = laws_of(method="gauss6")
    found = loop_of(type(method))
    assert found is not None and laws.whole(found[0]) is None


def test_laws_of_other_variables_find_them_behind_the_coordinates() -> None:
    """z at the start, dz/dt, and the change of y from y, z and the change of z, in this order."""
    body = {"mass": 2.0, "inertia": MOMENTS.tolist()}
    axle = AXLE | {"axis_B": [0.0, 1.0, 0.0], "point_B": [0.3, 0.0, 0.1]}
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    mapping: dict[str, Any] = {"bodies": {"b": body}, "constraints": {"axle": axle}}
    run = {"duration": 1.0, "method": "taylor", "tolerance": 1e-9}
    mapping |= {"effects": {"weight": weight}, "simulation": run}
    compiled = compile_scene(scene_from_mapping(mapping))
    laws = ReducedLaws(compiled.system, len(compiled.y), row_width(compiled.layout))
    known: Any = variables_of(laws.system)
    own = laws.variables
    if known is None:
        pytest.fail("a pendulum has variables of its own")
    assert own is not None
    at = np.array([0.4, 1.7])
    z = np.array(known.begin(laws.system, at))
    assert_allclose(value(own.begin, at, known.count), z, rtol=1e-14)
    rates = known.rates(laws.system, z)
    assert_allclose(value(own.rate, z, known.count), rates, rtol=1e-14)
    change = 1e-3 * np.arange(1.0, known.count + 1.0)
    found = value(own.end, [*at, *z, *change], 2)
    assert_allclose(found, known.change(laws.system, at, z, change), rtol=1e-14)
    assert np.abs(found).min() > 0.0
