# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""BODY/accel in bags: read by rosbags, against closed forms and the rate of BODY/twist."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rb_sim import load_scene
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.io.bag.reader import BagReader
from rb_sim.simulation.record import accelerating

FALLING = """\
bodies:
  ball: {mass: 2.0, inertia: [0.1, 0.1, 0.1], center_of_mass: [0.3, 0, 0],
    linear_velocity: [0.5, 0.6, 0.0], angular_velocity: [0.0, 0.0, 2.0]}
  rock: {mass: 1.0, inertia: [0.1, 0.2, 0.27], center_of_mass: [0.0, 0.2, 0.1], position: [3, 0, 0],
    angular_velocity: [3.0, 2.0, -1.0], orientation: {axis: [1, 2, 3], angle: 0.7}}
effects:
  weight: {type: gravity}
simulation: {duration: 0.02, rate: 1000, tolerance: 1.0e-12}
"""


def recorded(text: str, folder: Path, asked: bool = True) -> None:
    from rb_sim import Simulation

    simulation = Simulation(load_scene(text))
    sink = BagSink(folder, run={"by": "run"}, accelerations=accelerating if asked else None)
    simulation.run(sinks=[sink], checks=False)
    sink.close()


def messages(bag: Path, topic: str) -> np.ndarray:
    """Both vectors of the messages of a topic, (n, 6)."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        known = [c for c in reader.connections if c.topic == f"/rb_sim/{topic}"]
        rows: list[Any] = [
            reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(known)
        ]
    assert {row.header.frame_id for row in rows} == {"world"}

    def numbers(row: Any) -> list[float]:
        both = row.accel if hasattr(row, "accel") else row.twist
        return [getattr(v, k) for v in (both.linear, both.angular) for k in "xyz"]

    return np.array([numbers(row) for row in rows])


def test_the_bag_has_the_rate_of_the_twist(tmp_path: Path) -> None:
    recorded(FALLING, tmp_path / "bag")
    ball = messages(tmp_path / "bag", "ball/accel")
    assert len(ball) == 21
    # C falls; O is 0.3 m behind it on a body that turns at 2 rad/s: 0.3 w^2 towards C
    turn = 2.0 * 1e-3 * np.arange(21)
    expected = 1.2 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)
    np.testing.assert_allclose(ball[:, :3], expected + [0.0, 0.0, -9.81], atol=1e-9)
    np.testing.assert_allclose(ball[:, 3:], 0.0, atol=1e-12)
    twist, rock = messages(tmp_path / "bag", "rock/twist"), messages(tmp_path / "bag", "rock/accel")
    rate = (8.0 * (twist[3:-1] - twist[1:-3]) - (twist[4:] - twist[:-4])) / 12e-3
    np.testing.assert_allclose(rock[2:-2], rate, atol=1e-7)


def test_a_run_of_the_bag_has_them_again(tmp_path: Path) -> None:
    recorded(FALLING, tmp_path / "bag")
    again(tmp_path / "bag", tmp_path / "again")
    for topic in ("ball/accel", "rock/accel"):
        first, second = (messages(tmp_path / name, topic) for name in ("bag", "again"))
        np.testing.assert_array_equal(first, second)


def again(bag: Path, folder: Path) -> None:
    from rb_sim.bags.resim import resimulate
    from rb_sim.io.bag.reader import scene_as_run

    reader = BagReader(bag)
    resimulate(reader, scene_as_run(reader), folder)
