# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A cylinder that rolls lies on its plane along a line, wherever its start was."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rb_sim import load_scene
from rb_sim.base.errors import SceneError
from rb_sim.scene.compile import compile_scene
from tests.interpreted import interpreted

RADIUS, TILT = 0.1, 0.2
NORMAL, AT = [0.0, 0.6, 0.8], [9.0, 9.0, 9.0]
BYSTANDER = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": AT}
LEANS = np.array([1.0, 2.0, 0.5]) / math.sqrt(5.25) * math.sin(0.2)
LEANS = np.append(LEANS, math.cos(0.2))
"""Orientation of the board."""


def tilted(parent: bool, project: bool) -> dict[str, Any]:
    """A cylinder on one end of its line on a plane, of the world or of a board that leans."""
    board: dict[str, Any] = BYSTANDER | {"orientation": {"axis": [1.0, 2.0, 0.5], "angle": 0.4}}
    foot, normal = (AT, turned(LEANS, NORMAL)) if parent else (np.zeros(3), np.array(NORMAL))
    level = np.cross(normal, [1.0, 0.0, 0.0])
    axis = math.cos(TILT) * level / np.linalg.norm(level) + math.sin(TILT) * normal
    across = np.cross([0.0, 0.0, 1.0], axis)
    place = np.array(foot) + RADIUS * math.cos(TILT) * normal
    roller = {
        "mass": 2.0,
        "shape": {"type": "cylinder", "radius": RADIUS, "length": 0.5},
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


def turned(q: np.ndarray, v: list[float]) -> np.ndarray:
    """v turned by the quaternion q = [x, y, z, w]."""
    across = 2.0 * np.cross(q[:3], v)
    return np.array(v) + q[3] * across + np.cross(q[:3], across)


@pytest.mark.parametrize("parent", [False, True])
def test_its_axis_is_brought_along_the_plane_beside_other_bodies(parent: bool) -> None:
    board, roller = interpreted(start, parent, True)
    foot, normal = np.zeros(3), np.array(NORMAL)
    if parent:
        foot, normal = board[:3], turned(board[3:], NORMAL)
    axis = turned(roller[3:], [0.0, 0.0, 1.0])
    assert abs(axis @ normal) < 1e-12
    assert (roller[:3] - foot) @ normal == pytest.approx(RADIUS, abs=1e-12)


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
