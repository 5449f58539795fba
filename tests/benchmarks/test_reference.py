# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The reference motions of the peer benchmark agree with independent derivations."""

import numpy as np
import pytest

from benchmarks.peers import check, scenes
from benchmarks.peers.reference import Reference, pose_error

SHORT = {"free_tumble": 2.0, "gazebo_boxes": 2.0, "pendulum": 3.0, "rolling_sphere": 2.0}
"""Horizon of the comparison with the closed form [s]: within it doubles keep 13 digits."""


def short(name: str, duration: float) -> scenes.Scene:
    return scenes.load(name)._replace(duration=duration)


@pytest.mark.parametrize("name", sorted(check.CLOSED_FORMS))
def test_reference_agrees_with_the_closed_form(name: str) -> None:
    scene = short(name, SHORT[name])
    closed = check.CLOSED_FORMS[name](scene, scene.times)
    true = Reference(scene).pose(scene.times)
    assert pose_error(*closed, *true).max() < 2e-13


@pytest.mark.parametrize("name", ["heavy_top", "rolling_disk"])
def test_reference_agrees_with_newton_euler_where_no_closed_form_exists(name: str) -> None:
    scene = short(name, 0.1 if name == "heavy_top" else 0.5)
    other = check.constrained(scene, scene.times)
    true = Reference(scene).pose(scene.times)
    # 1e-13 per unit of state over 15 rad of spin (top) and a metre of path (disk)
    assert pose_error(*other, *true).max() < 1e-11


def test_reference_is_the_initial_state_at_the_start() -> None:
    for name in scenes.NAMES:
        scene = short(name, 0.25)
        position, quaternion = Reference(scene).pose(np.zeros(1))
        start = scene.position[None], scene.quaternion[None]
        assert pose_error(position, quaternion, *start).max() < 1e-15


def test_pose_error_takes_the_sign_of_a_quaternion_and_counts_nan_as_infinite() -> None:
    half = 0.5 * 1e-9
    identity = np.array([[0.0, 0.0, 0.0, 1.0]])
    turned = -np.array([[np.sin(half), 0.0, 0.0, np.cos(half)]])
    zero = np.zeros((1, 3))
    assert pose_error(zero, turned, zero, identity)[0] == pytest.approx(1e-9, rel=1e-12)
    assert pose_error(zero + 3.0, turned, zero, identity)[0] == pytest.approx(np.sqrt(27.0))
    assert pose_error(zero + np.nan, turned, zero, identity)[0] == np.inf
