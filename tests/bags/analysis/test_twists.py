# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A twist beside the derivative of the poses: other axes, units or signs than it says are told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.run import analyze
from tests.bags.analysis import foreign
from tests.bags.analysis.test_foreign import POSE, TWIST, T, pose, writing

ODOMETRY = "nav_msgs/msg/Odometry"
TURN = Rotation.from_rotvec(np.c_[0.3 * np.sin(T), 0.0 * T, 0.8 * T])
P = np.c_[0.5 * np.sin(3.0 * T), 0.1 + 0.3 * T, 0.2 * T]
V = np.c_[1.5 * np.cos(3.0 * T), 0.3 + 0.0 * T, 0.2 + 0.0 * T]
H = 1e-5
W = (
    Rotation.from_rotvec(np.c_[0.3 * np.sin(T + H), 0.0 * T, 0.8 * (T + H)])
    * Rotation.from_rotvec(np.c_[0.3 * np.sin(T - H), 0.0 * T, 0.8 * (T - H)]).inv()
).as_rotvec() / (2.0 * H)


def vector(values: np.ndarray) -> Any:
    return foreign.STORE.types["geometry_msgs/msg/Vector3"](*map(float, values))


def notes(path: Path, v: np.ndarray, w: np.ndarray, p: np.ndarray = P, **options: Any) -> list[str]:
    """What is told of an Odometry with these velocities."""
    with writing(path) as bag:
        for k, t in enumerate(T):
            _, message = foreign.odometry(t, p[k], TURN.as_quat()[k])
            message.twist.twist.linear, message.twist.twist.angular = vector(v[k]), vector(w[k])
            bag.add("/body", ODOMETRY, message, t)
    return [line for line in analyze(path, **options).notes if "velocity" in line]


def in_body(values: np.ndarray) -> np.ndarray:
    return TURN.inv().apply(values)


INNER = slice(4, -4)  # where the filter has a whole window
OFF = float(np.sqrt(np.sum((V - in_body(V))[INNER] ** 2) / np.sum(V[INNER] ** 2)))


def test_the_derivative_in_the_body_s_axes_is_told_nowhere(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    v, w = in_body(V) + rng.normal(0, 0.05, V.shape), in_body(W) + rng.normal(0, 0.02, W.shape)
    assert notes(tmp_path / "x.mcap", v, w) == []
    masses = {"base_link": Body(1.0, np.eye(3), np.array([1.4, 0.1, 0.2]))}
    assert notes(tmp_path / "c.mcap", in_body(V), in_body(W), masses=masses) == []
    noisy = P + rng.normal(0, 0.1, P.shape)  # whose derivative is noise, which tells nothing
    assert notes(tmp_path / "n.mcap", 0.0 * V, in_body(W), noisy) == []


@pytest.mark.parametrize(
    ("v", "w", "p", "line"),
    [
        (V, in_body(W), P, "linear velocity is not the derivative of its poses in the body's axes "
                           f"({OFF:.0%} off), but in the axes of the poses (0.0% off)"),
        (1e3 * in_body(V), in_body(W), P, "but in the body's axes times 1000 (is it in mm?)"),
        (in_body(V), in_body(W), 1e3 * P, "body's axes over 1000 (are the poses in mm?)"),
        (1e3 * V, in_body(W), P, "but in the axes of the poses times 1000 (is it in mm?)"),
        (-in_body(V), in_body(W), P, "but in the body's axes with the other sign"),
        (in_body(V), np.degrees(in_body(W)), P, "axes times 57.3 (is it in degrees?)"),
        (0.0 * V, in_body(W), P, "linear velocity is zero, though its poses move"),
        (np.roll(in_body(V), 1, axis=1), in_body(W), P, "linear velocity is not the derivative of "
                                                        "its poses in the body's axes: "),
    ],
)  # fmt: skip
def test_what_it_is_instead_is_told(tmp_path: Path, v, w, p, line: str) -> None:
    (told,) = notes(tmp_path / "x.mcap", v, w, p)
    assert told.startswith("/body:twist: its ") and line in told


@pytest.mark.parametrize(("frame", "told"), [("map", 0), ("body", 1), ("camera", 0)])
def test_a_topic_of_its_own(tmp_path: Path, frame: str, told: int) -> None:
    """In the axes of the poses, at half of their stamps; its frame says which axes it has."""
    path = tmp_path / "x.mcap"
    with writing(path) as bag:
        for k, t in enumerate(T):
            bag.add("/body/pose", POSE, pose(t, P[k], TURN.as_quat()[k]), t)
            if k % 2:
                header = foreign.header(t + 3e-3, frame)
                both = foreign.STORE.types["geometry_msgs/msg/Twist"](vector(V[k]), vector(W[k]))
                message = foreign.STORE.types[TWIST](header=header, twist=both)
                bag.add("/body/twist", TWIST, message, t + 3e-3)
    lines = [line for line in analyze(path).notes if "linear velocity" in line]
    assert len(lines) == told
    assert all("but in the axes of the poses (" in line for line in lines)
