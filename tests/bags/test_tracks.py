# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motions in bags of somebody else: velocities in the axes of their frame, joint states."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial.transform import Rotation

import rb_sim
from rb_sim.bags.compare import summary
from rb_sim.bags.tracks import tracks_of_bag
from rb_sim.base.errors import SinkError
from rb_sim.cli.verbs.replay import replay
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.scene.load import load_scene
from rb_sim.simulation.simulation import Simulation
from tests.bags.analysis import foreign
from tests.bags.analysis.foreign import pose_stamped as pose
from tests.bags.analysis.foreign import twist_stamped, writing
from tests.bags.analysis.test_foreign import P, Q, T

V, W = np.c_[1.5 * np.cos(3.0 * T), 0.0 * T, 0.0 * T + 0.2], np.array([0.0, 0.0, 0.8])
"""Of the swing, world axes."""


def write(path: Path, frame: str, v: np.ndarray, other: str = "") -> Path:
    with writing(path) as bag:
        for k, t in enumerate(T):
            bag.add("/drone/pose", *pose(t, P[k], Q[k]), t)
            bag.add("/drone/twist", *twist_stamped(t, v[k], W, frame), t)
            if other:
                bag.add(f"/drone/{other}", *pose(t, P[k] + 1.0, Q[k]), t)
    return path


@pytest.mark.parametrize("frame", ["map", "/map", "", "drone"])
def test_a_twist_in_the_axes_of_its_frame(tmp_path, frame):
    own = Rotation.from_quat(Q).inv().apply(V)
    tracks = tracks_of_bag(write(tmp_path / "x.mcap", frame, own if frame == "drone" else V))
    found = tracks.bodies["/drone/pose"].linear_velocity
    assert found is not None and np.abs(found - V).max() < 1e-12
    assert not tracks.notes


def test_a_twist_in_another_frame_is_left_out_and_reported(tmp_path):
    tracks = tracks_of_bag(write(tmp_path / "x.mcap", "lidar", V))
    assert tracks.bodies["/drone/pose"].linear_velocity is None
    assert tracks.notes == [
        "/drone/twist: its frame lidar is neither that of the poses, map, nor the body's: not used"
    ]


def test_a_twist_beside_two_poses_is_of_neither(tmp_path):
    tracks = tracks_of_bag(write(tmp_path / "x.mcap", "map", V, other="estimate"))
    assert all(track.linear_velocity is None for track in tracks.bodies.values())
    (line,) = tracks.notes
    assert line.startswith("/drone/twist: may belong to any of /drone/pose, /drone/estimate")


def test_poses_whose_stamps_go_back_are_counted(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        for k, t in enumerate(T):
            bag.add("/drone/pose", *pose(t if k != 100 else 1.5, P[k], Q[k]), t)
    tracks = tracks_of_bag(tmp_path / "x.mcap")
    # that of sample 100 is 1.5 s: so long the clock of the others is behind it
    assert len(tracks.bodies["/drone/pose"].t) == len(T) - 50
    assert tracks.notes == ["/drone/pose: 50 poses skipped: stamps do not increase"]


def test_a_bag_that_is_broken_says_so(tmp_path):
    """Not only that there is no pose in it."""
    path = write(tmp_path / "x.mcap", "map", V)
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    for chunk in summary.chunk_indexes:
        data[chunk.chunk_start_offset + 200] ^= 0x55
    path.write_bytes(data)
    with pytest.raises(SinkError, match=r"no pose in it .*; .*(damaged|checksum)"):
        tracks_of_bag(path)


# Joint states of somebody else's bag place the bodies of a scene: compare and fit take them.


SCENE = """\
bodies:
  cart: {{mass: 2.0, inertia: [1, 1, 1], position: [0.1, 0.2, 0.3]}}
  arm:
    mass: {mass}
    inertia: [0.1, 0.1, 0.02]
    center_of_mass: [0, 0, 0.5]
    position: [0.1, 0.2, 0.3]
    orientation: {{axis: [0, 1, 0], angle: 0.5}}
  tip:
    mass: 0.5
    inertia: [0.01, 0.01, 0.01]
    position: [0.579425538604203, 0.2, 1.177582561890373]
constraints:
  rail: {{type: translation, body: cart, guide: {{type: line, direction: [0.6, 0.8, 0]}}}}
  left-pin: {{type: fixed_axis, body: arm, parent: cart, axis_B: [0, 1, 0]}}
  glue: {{type: weld, body: tip, parent: arm}}
effects: {{weight: {{type: gravity}}}}
simulation: {{duration: 0.5, rate: 50}}
"""


@pytest.fixture(scope="module")
def bags(tmp_path_factory) -> tuple[Path, Path, Path]:
    """Scene, our bag of it, and one of somebody else with its joint states alone."""
    folder = tmp_path_factory.mktemp("joints")
    path = folder / "crane.yaml"
    path.write_text(SCENE.format(mass=1.0))
    scene = load_scene(path)
    simulation = Simulation(scene)
    sink = BagSink(folder / "ours")
    sink.open(scene, simulation.layout)
    for block in simulation.blocks(0.5, 50.0):
        sink.write(block)
    sink.close()
    writer = Writer(folder / "theirs", version=9, storage_plugin=StoragePlugin.MCAP)
    kind = "sensor_msgs/msg/JointState"
    with AnyReader([folder / "ours"], default_typestore=foreign.STORE) as reader, writer:
        mine = [c for c in reader.connections if c.topic == "/rb_sim/joint_states"]
        there = writer.add_connection("/joint_states", kind, typestore=foreign.STORE)
        for _, time, data in reader.messages(mine):
            writer.write(there, time, data)
    return path, folder / "ours", folder / "theirs"


def test_they_are_the_poses_that_we_recorded(bags):
    path, ours, theirs = bags
    mine, found = tracks_of_bag(ours), tracks_of_bag(theirs, load_scene(path))
    assert set(found.bodies) == {"cart", "arm", "tip"}
    for body, track in found.bodies.items():
        np.testing.assert_allclose(track.position, mine.bodies[body].position, atol=1e-8)
        turn = np.abs(np.sum(track.orientation * mine.bodies[body].orientation, axis=1))
        np.testing.assert_allclose(turn, 1.0, atol=1e-12)


def test_compare_lays_the_scene_beside_them(bags):
    path, _, theirs = bags
    reported = summary(rb_sim.compare(theirs, path, align="none"), {})
    assert set(reported["differences"]) == {"cart", "arm", "tip"}
    assert all(row["position"]["max"] < 1e-6 for row in reported["differences"].values())


def test_fit_finds_a_mass_by_them(bags, tmp_path):
    """The cart's way tells the ratio of the masses."""
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(SCENE.format(mass=1.02))
    found = rb_sim.fit(bags[2], ["bodies.arm.mass"], scene=wrong)
    assert found.values[0] == pytest.approx(1.0, rel=1e-4)


def test_one_line_says_that_none_is_of_the_scene(bags, tmp_path):
    _, _, theirs = bags
    other = tmp_path / "other.yaml"
    other.write_text(SCENE.format(mass=1.0).replace("rail", "beam").replace("left-pin", "axle"))
    with pytest.raises(SinkError) as caught:
        tracks_of_bag(theirs, load_scene(other))
    line = "its joint states are of rail, left_pin; the scene's joints are beam, axle"
    assert line in str(caught.value) and "\n" not in str(caught.value)


def test_without_a_scene_they_are_no_poses(bags):
    """The line says what there is instead."""
    with pytest.raises(SinkError, match="no pose in it .*; other types in it: sensor_msgs/msg/Jo"):
        tracks_of_bag(bags[2])


def test_joint_states_without_stamps_have_the_times_of_the_log(bags, tmp_path):
    path, ours, theirs = bags
    kind = "sensor_msgs/msg/JointState"
    with (
        AnyReader([theirs], default_typestore=foreign.STORE) as reader,
        Writer(tmp_path / "unset", version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        there = writer.add_connection("/joint_states", kind, typestore=foreign.STORE)
        for _, time, data in reader.messages():
            message = foreign.STORE.deserialize_cdr(data, kind)
            message.header.stamp.sec = message.header.stamp.nanosec = 0
            writer.write(there, time, foreign.STORE.serialize_cdr(message, kind))
    mine, found = tracks_of_bag(ours), tracks_of_bag(tmp_path / "unset", load_scene(path))
    arm = found.bodies["arm"]
    np.testing.assert_allclose(arm.t, mine.bodies["arm"].t, atol=1e-9)
    np.testing.assert_allclose(arm.position, mine.bodies["arm"].position, atol=1e-8)
    (line,) = found.notes
    assert line.endswith("its stamps are zero: times of the log are taken")


def test_replay_draws_them_with_a_scene(bags, tmp_path):
    """A recording of poses, which the joint states alone do not give; ours has its own scene."""
    path, ours, theirs = bags
    file = tmp_path / "theirs.rrd"
    replay(theirs, save=file, scene=str(path))
    assert b"tip" in file.read_bytes()
    with pytest.raises(SinkError, match="no pose in it"):
        replay(theirs, save=file)
    with pytest.raises(SinkError, match="--scene: .* has its own scene"):
        replay(ours, save=file, scene=str(path))
