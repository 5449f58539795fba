# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of others in the viewer: what of them is drawn, where and when."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from rb_sim.bags.compare import differences
from rb_sim.bags.comparison_views import drawn, motion_of, overlay
from rb_sim.bags.tracks import Tracks, tracks_of_bag
from rb_sim.base.errors import MissingExtraError, RbSimError, SinkError
from rb_sim.cli.verbs.replay import PlayOptions, play, replay
from tests.bags.analysis import foreign
from tests.bags.analysis.foreign import pose_stamped as stamped
from tests.bags.analysis.foreign import transforms, writing
from tests.bags.analysis.test_foreign import P, Q, T
from tests.bags.fit.test_fit_foreign import poses, pushes, write
from tests.io.test_rerun import column, needs_rerun, run

CART = r"\/cart\/pose"
"""The topic as one part of an entity's path."""


@needs_rerun
@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_replay_draws_the_poses_of_others_at_their_times(tmp_path, plugin, capsys):
    """From the first pose on: times of a calendar are none that a viewer shows."""
    bag = write(tmp_path / "bag", poses(), pushes(), plugin=plugin)
    replay(bag, tmp_path / "x.rrd")
    assert capsys.readouterr().out == f"wrote {tmp_path / 'x.rrd'}\n"
    run("rrd", "verify", tmp_path / "x.rrd")
    track = tracks_of_bag(bag).bodies["/cart/pose"]
    times, rows = column(tmp_path / "x.rrd", "/world/\\/cart\\/pose", "Transform3D:translation")
    assert np.abs(times * 1e-9 - (track.t - track.t[0])).max() < 1e-6
    assert np.abs(np.array(rows)[:, 0] - track.position).max() < 1e-6
    times, rows = column(tmp_path / "x.rrd", "/plots/force/\\/cart\\/push", "Scalars:scalars")
    assert np.array(rows)[:, 0].tolist() == [3.0, -6.0, 0.0, 4.0]
    assert times[0] == pytest.approx(-0.05e9, abs=1e3)


@needs_rerun
def test_poses_on_a_map_are_drawn_about_a_local_origin(tmp_path):
    """In single precision a northing of 4,200 km has steps of 0.5 m."""
    tracks = tracks_of_bag(write(tmp_path / "bag", poses()))
    track = tracks.bodies["/cart/pose"]
    way = track.position.copy()
    track.position[:] += [5e5, 4.2e6, 0.0]
    motion_of(tracks, tmp_path / "x.rrd")
    found = differences(tracks, tracks)
    overlay(tracks, tracks, found, tmp_path / "y.rrd")
    for file, name in (("x", CART), ("y", f"A/{CART}"), ("y", f"B/{CART}")):
        _, rows = column(tmp_path / f"{file}.rrd", f"/world/{name}", "Transform3D:translation")
        assert np.ptp(np.array(rows)[:, 0] - way, axis=0) == pytest.approx(0.0, abs=1e-6)


@needs_rerun
def test_names_with_blanks_are_drawn_without_a_word_of_rerun(tmp_path, capfd):
    """Names of a scene may have blanks and brackets, which paths of entities do not take."""
    track = tracks_of_bag(write(tmp_path / "bag", poses())).bodies["/cart/pose"]
    tracks = Tracks("x", {"wheel (left)": track})
    overlay(tracks, tracks, differences(tracks, tracks), tmp_path / "x.rrd")
    assert capfd.readouterr().err == ""
    times, _ = column(tmp_path / "x.rrd", r"/world/B/wheel\ \(left\)", "Transform3D:translation")
    assert len(times) == len(track.t)


def test_its_span_is_that_of_the_poses(tmp_path):
    pytest.importorskip("rerun")
    tracks = tracks_of_bag(write(tmp_path / "bag", poses()))
    span = motion_of(tracks, tmp_path / "x.rrd", motion_only=True)
    assert span == pytest.approx(1.94, abs=0.03)


def test_frames_are_drawn_in_the_root_of_their_tree(tmp_path):
    """`base` in `odom`, which moves in `map`: not at its place in `odom`, and no sensor on it."""
    still = np.array([0.0, 0.0, 0.0, 1.0])
    with writing(tmp_path / "x.mcap") as bag:
        static = transforms(T[0], ("base", "lidar", np.array([0.0, 0.0, 1.0]), still))
        bag.add("/tf_static", *static, T[0])
        for t, p, q in zip(T, P, Q, strict=True):
            odom = "map", "odom", np.array([t, 0.0, 0.0]), still
            bag.add("/tf", *transforms(t, odom, ("odom", "base", p, q)), t)
    tracks = tracks_of_bag(tmp_path / "x.mcap")
    assert drawn(tracks) == ["/tf:odom", "/tf:base (in map by transforms)"]


@needs_rerun
def test_frames_that_nothing_connects_are_reported(tmp_path, capsys):
    with writing(tmp_path / "x.mcap") as bag:
        for t, p, q in zip(T, P, Q, strict=True):
            bag.add("/a", *stamped(t, p, q, "map"), t)
            bag.add("/b", *stamped(t, p, q, "mocap"), t)
    replay(tmp_path / "x.mcap", tmp_path / "x.rrd")
    reported = "warning: no transform connects the frames map, mocap: drawn as if they were one\n"
    assert reported in capsys.readouterr().err


def test_without_poses_or_rerun_one_line_says_so(tmp_path, monkeypatch):
    bag = write(tmp_path / "bag", pushes())
    with pytest.raises(SinkError, match=r"no pose in it \(PoseStamped, Odometry or TF\)"):
        replay(bag, tmp_path / "x.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'rb_sim\[rerun\]'"):
        replay(write(tmp_path / "other", poses()), tmp_path / "x.rrd")
    assert not Path(tmp_path / "x.rrd").exists()


def test_topics_of_others_are_played_by_another_program(tmp_path):
    bag = foreign.write(tmp_path / "bag")
    with pytest.raises(RbSimError) as caught:
        play(bag, PlayOptions())
    assert str(caught.value) == (
        f"--publish: {bag} was not recorded by rb_sim; play it with ros2 bag play --clock 100 {bag}"
    )
