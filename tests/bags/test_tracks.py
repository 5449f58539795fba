# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Velocities of somebody else's bag, in the axes that their frame names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation

from rb_sim.bags.tracks import tracks_of_bag
from rb_sim.base.errors import SinkError
from tests.bags.analysis import foreign
from tests.bags.analysis.test_foreign import POSE, TWIST, P, Q, T, pose, writing

V, W = np.c_[1.5 * np.cos(3.0 * T), 0.0 * T, 0.0 * T + 0.2], np.array([0.0, 0.0, 0.8])
"""Of the swing, world axes."""


def stamped(t: float, v: np.ndarray, w: np.ndarray, frame: str):
    types = foreign.STORE.types
    linear, angular = (types["geometry_msgs/msg/Vector3"](*map(float, x)) for x in (v, w))
    twist = types["geometry_msgs/msg/Twist"](linear=linear, angular=angular)
    return types[TWIST](header=foreign.header(t, frame), twist=twist)


def write(path: Path, frame: str, v: np.ndarray, other: str = "") -> Path:
    with writing(path) as bag:
        for k, t in enumerate(T):
            bag.add("/drone/pose", POSE, pose(t, P[k], Q[k]), t)
            bag.add("/drone/twist", TWIST, stamped(t, v[k], W, frame), t)
            if other:
                bag.add(f"/drone/{other}", POSE, pose(t, P[k] + 1.0, Q[k]), t)
    return path


@pytest.mark.parametrize("frame", ["map", "/map", "", "drone"])
def test_a_twist_in_the_axes_of_its_frame(tmp_path, frame):
    own = Rotation.from_quat(Q).inv().apply(V)
    tracks = tracks_of_bag(write(tmp_path / "x.mcap", frame, own if frame == "drone" else V))
    found = tracks.bodies["/drone/pose"].linear_velocity
    assert found is not None and np.abs(found - V).max() < 1e-12
    assert not tracks.notes


def test_a_twist_in_another_frame_is_left_out_and_told(tmp_path):
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
            bag.add("/drone/pose", POSE, pose(t if k != 100 else 1.5, P[k], Q[k]), t)
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
