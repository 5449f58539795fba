# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What each constraint holds, in terms of points and axes of two bodies that are turned.

The derivatives of the lines are compared with differences in tests/properties/test_catalogue;
here it is said what is zero, and that a partner that is left out is where the body starts.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import load_scene
from rb_sim.base.errors import SceneError
from rb_sim.scene.compile import compile_scene
from tests.interpreted import interpreted
from tests.moving import random_state

MASS_CENTRES = {"b": np.array([0.04, -0.03, 0.05]), "a": np.array([-0.1, 0.2, 0.07])}
POINT_B, POINT_A = np.array([0.1, -0.2, 0.3]), np.array([0.4, 0.1, -0.2])
AXIS_B, AXIS_A = np.array([0.6, 0.0, 0.8]), np.array([2.0, 3.0, 6.0]) / 7.0
RADIUS, CENTRE = 0.2, np.array([0.02, 0.01, 0.03])


def scene(joint: dict[str, Any], parent: bool) -> dict[str, Any]:
    """Body `b`, on its parent `a` or on the world, both anywhere."""
    bodies: dict[str, Any] = {}
    for i, (name, centre) in enumerate(MASS_CENTRES.items()):
        turn = {"axis": [0.3 - i, -0.5, 0.8], "angle": 0.9 + i}
        bodies[name] = {"mass": 1.3, "inertia": [0.3, 0.4, 0.5], "center_of_mass": centre.tolist()}
        bodies[name] |= {"position": [0.3 * i, 0.8, -0.4], "orientation": turn}
    shape = {"type": "sphere", "radius": RADIUS, "center_B": CENTRE.tolist()}
    bodies["b"]["shape"] = shape
    on = {"body": "b"} | ({"parent": "a"} if parent else {})
    simulation = {"project_initial": True}
    return {"bodies": bodies, "constraints": {"joint": joint | on}, "simulation": simulation}


def lines(joint: dict[str, Any], parent: bool, seed: int | None) -> tuple[Any, ...]:
    """(rows, B, A): the table of the joint's lines at the start, or at random states."""
    from rb_sim import load_scene
    from rb_sim.catalogue.constraints import rows
    from rb_sim.catalogue.spec import WORLD
    from rb_sim.scene.place import InitialPlace

    read = load_scene(scene(joint, parent))
    place = InitialPlace(read)
    B, A = place.state("b"), place.state("a") if parent else WORLD
    if seed is not None:
        rng = np.random.default_rng(seed)
        B, A = random_state(rng), random_state(rng) if parent else WORLD
    table = []
    for part in read.constraints["joint"].parts(place):
        own = np.zeros((rows.COUNT[type(part.row)], rows.ROW_WIDTH))
        rows.fill(part.row, 0.0, B, A, own, 0)
        table.append(own)
    return np.vstack(table), B, A


def errors(joint: dict[str, Any], parent: bool, seed: int | None) -> tuple[np.ndarray, Any, Any]:
    from rb_sim.catalogue.constraints.rows import ERROR, HOLONOMIC

    table, B, A = interpreted(lines, joint, parent, seed)
    assert (table[:, HOLONOMIC] == 1.0).all()
    return table[:, ERROR], B, A


def of_b(B: Any, point: Any) -> np.ndarray:
    """World position of a point given from the origin of `b`."""
    return np.array(B.p_WC) + turned(B, np.array(point) - MASS_CENTRES["b"])


def of_a(A: Any, point: Any, parent: bool) -> np.ndarray:
    return np.array(A.p_WC) + turned(A, np.array(point) - (MASS_CENTRES["a"] if parent else 0.0))


def turned(S: Any, axis: Any) -> np.ndarray:
    return Rotation.from_quat(S.q_WB).apply(axis)


BY_START: dict[str, dict[str, Any]] = {
    "fixed_point": {"point_B": POINT_B.tolist()},
    "fixed_axis": {"point_B": POINT_B.tolist(), "axis_B": AXIS_B.tolist()},
    "distance": {"point_B": POINT_B.tolist(), "point_A": POINT_A.tolist()},
    "plane": {"point_B": POINT_B.tolist(), "normal_A": AXIS_A.tolist()},
    "parallel": {"axis_B": AXIS_B.tolist()},
    "weld": {"point_B": POINT_B.tolist()},
}


@pytest.mark.parametrize("parent", [False, True])
@pytest.mark.parametrize("kind", BY_START)
def test_what_is_left_out_is_where_the_body_starts(kind: str, parent: bool) -> None:
    found, _, _ = errors({"type": kind} | BY_START[kind], parent, None)
    assert_allclose(found, 0.0, atol=1e-14)
    elsewhere, _, _ = errors({"type": kind} | BY_START[kind], parent, 3)
    assert np.abs(elsewhere).min() > 1e-3


@pytest.mark.parametrize("parent", [False, True])
def test_points(parent: bool) -> None:
    """p_B - p_A of a fixed point, its length of a rod, its part along the normal of a plane."""
    ends = {"point_B": POINT_B.tolist(), "point_A": POINT_A.tolist()}
    found, B, A = errors({"type": "fixed_point"} | ends, parent, 1)
    gap = of_b(B, POINT_B) - of_a(A, POINT_A, parent)
    assert_allclose(found, gap, atol=1e-14)
    found, _, _ = errors({"type": "distance", "length": 0.7} | ends, parent, 1)
    assert_allclose(found, np.linalg.norm(gap) - 0.7, atol=1e-14)
    found, _, _ = errors({"type": "plane", "normal_A": AXIS_A.tolist()} | ends, parent, 1)
    assert_allclose(found, turned(A, AXIS_A) @ gap, atol=1e-14)


@pytest.mark.parametrize("parent", [False, True])
def test_axes(parent: bool) -> None:
    """Two errors, whose squares sum up to that of the sine between the axes."""
    axes = {"axis_B": AXIS_B.tolist(), "axis_A": AXIS_A.tolist()}
    found, B, A = errors({"type": "parallel"} | axes, parent, 1)
    sine = np.linalg.norm(np.cross(turned(B, AXIS_B), turned(A, AXIS_A)))
    assert np.linalg.norm(found) == pytest.approx(sine, abs=1e-14)


@pytest.mark.parametrize("frame", ["world", "body"])
def test_a_velocity(frame: str) -> None:
    """linear . v_P + angular . w, the coefficients constant in either axes; its rate."""
    joint = {"type": "velocity", "point_B": POINT_B.tolist(), "frame": frame, "rate": 0.4}
    linear, angular = np.array([0.1, 1.0, -0.3]), np.array([0.2, -0.5, 0.7])
    joint |= {"linear": linear.tolist(), "angular": angular.tolist()}
    table, B, _ = interpreted(lines, joint, False, 1)
    if frame == "body":
        linear, angular = turned(B, linear), turned(B, angular)
    spin = turned(B, B.w_WB_B)
    at = of_b(B, POINT_B) - np.array(B.p_WC)
    expected = linear @ (np.array(B.v_WC) + np.cross(spin, at)) + angular @ spin
    assert table[0, :6] @ np.array(B.v_WC + B.w_WB_B) == pytest.approx(expected, abs=1e-13)
    assert not table[0, 6:12].any()
    assert table[0, 13:].tolist() == [0.0, 0.4, 0.0]


def refused(joint: dict[str, Any], **body: Any) -> str:
    """Why a scene with this joint is refused; empty if it is not."""
    from rb_sim import load_scene
    from rb_sim.base.errors import SceneError
    from rb_sim.scene.compile import compile_scene

    whole = scene(joint, False)
    whole["bodies"]["b"] |= body
    try:
        compile_scene(load_scene(whole))
    except SceneError as error:
        return str(error)
    return ""


def test_a_rod_needs_points_that_are_apart() -> None:
    """Also where its length is given; a metre is apart."""
    pose = {"position": [0.5, 0.25, -1.0], "orientation": [0.0, 0.0, 0.0, 1.0]}
    pose["center_of_mass"] = [0.0, 0.0, 0.0]
    for length in ({}, {"length": 1.0}):
        joint = {"type": "distance", "point_A": [0.5, 0.25, -1.0]} | length
        assert "its points coincide at the start" in refused(joint, **pose)
        joint["point_A"] = [1.5, 0.25, -1.0]
        assert refused(joint, **pose) == ""


def test_a_velocity_needs_a_coefficient() -> None:
    velocity = {"type": "velocity"}
    assert "a coefficient that is not zero" in refused(velocity)
    for name in ("linear", "angular"):
        assert refused(velocity | {name: [0.0, 1.0, 0.0]}) == ""


def test_a_curve_needs_four_points_that_are_apart() -> None:
    points = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [2.0, 0.0, 0.2], [3.0, 0.1, 0.0]]
    guide = {"type": "curve", "points": points}
    joint = {"type": "translation", "guide": guide}
    assert refused(joint) == ""
    guide["points"] = points[:3]
    assert "a curve through at least 4 points" in refused(joint)
    guide["points"] = [*points, points[-1]]
    assert "a curve whose neighbouring points differ" in refused(joint)


# A cylinder that rolls lies on its plane along a line, wherever its start was.


RADIUS_ROLLING, TILT = 0.1, 0.2
NORMAL, AT = [0.0, 0.6, 0.8], [9.0, 9.0, 9.0]
BYSTANDER = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": AT}
LEANS = np.array([1.0, 2.0, 0.5]) / math.sqrt(5.25) * math.sin(0.2)
LEANS = np.append(LEANS, math.cos(0.2))
"""Orientation of the board."""


def tilted(parent: bool, project: bool) -> dict[str, Any]:
    """A cylinder on one end of its line on a plane, of the world or of a board that leans."""
    board: dict[str, Any] = BYSTANDER | {"orientation": {"axis": [1.0, 2.0, 0.5], "angle": 0.4}}
    foot, normal = (
        (AT, turned_of_rolling(LEANS, NORMAL)) if parent else (np.zeros(3), np.array(NORMAL))
    )
    level = np.cross(normal, [1.0, 0.0, 0.0])
    axis = math.cos(TILT) * level / np.linalg.norm(level) + math.sin(TILT) * normal
    across = np.cross([0.0, 0.0, 1.0], axis)
    place = np.array(foot) + RADIUS_ROLLING * math.cos(TILT) * normal
    roller = {
        "mass": 2.0,
        "shape": {"type": "cylinder", "radius": RADIUS_ROLLING, "length": 0.5},
        "position": place.tolist(),
        "orientation": {"axis": across.tolist(), "angle": math.acos(axis[2])},
    }
    rolling: dict[str, Any] = {"type": "rolling", "body": "roller", "normal_A": NORMAL}
    return {
        "bodies": {"board": board, "roller": roller},
        "constraints": {"rolls": rolling | ({"parent": "board"} if parent else {})},
        "simulation": {"project_initial": project},
    }


def start(parent: bool, project: bool) -> np.ndarray:
    """Rows of position and orientation of board and roller."""
    found = compile_scene(load_scene(tilted(parent, project)), coordinates="maximal")
    return np.asarray(found.y).reshape(2, 13)[:, :7]


def turned_of_rolling(q: np.ndarray, v: list[float]) -> np.ndarray:
    """v turned by the quaternion q = [x, y, z, w]."""
    across = 2.0 * np.cross(q[:3], v)
    return np.array(v) + q[3] * across + np.cross(q[:3], across)


@pytest.mark.parametrize("parent", [False, True])
def test_its_axis_is_brought_along_the_plane_beside_other_bodies(parent: bool) -> None:
    board, roller = interpreted(start, parent, True)
    foot, normal = np.zeros(3), np.array(NORMAL)
    if parent:
        foot, normal = board[:3], turned_of_rolling(board[3:], NORMAL)
    axis = turned_of_rolling(roller[3:], [0.0, 0.0, 1.0])
    assert abs(axis @ normal) < 1e-12
    assert (roller[:3] - foot) @ normal == pytest.approx(RADIUS_ROLLING, abs=1e-12)


@pytest.mark.parametrize("parent", [False, True])
def test_a_tilt_is_refused_beside_other_bodies_as_it_is_alone(parent: bool) -> None:
    with pytest.raises(SceneError, match=r"constraints\.rolls: the initial position violates it"):
        interpreted(start, parent, False)


@pytest.mark.parametrize(
    ("shape", "found"),
    [(None, "none"), ({"type": "box", "size": [1.0, 1.0, 1.0]}, "box")],
)
def test_what_has_no_round_shape_is_refused(shape: dict[str, Any] | None, found: str) -> None:
    body = BYSTANDER | ({} if shape is None else {"shape": shape})
    joint = {"type": "rolling", "body": "b"}
    scene = {"bodies": {"b": body}, "constraints": {"rolls": joint}}
    with pytest.raises(SceneError, match=rf"constraints\.rolls: .*; b has {found}"):
        compile_scene(load_scene(scene))
