# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Trees of transforms: the pose in the root against the motion of which the tree was made."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from rb_sim.bags import readings
from rb_sim.bags import transforms as composed
from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.bags.readings import Readings
from tests.bags.analysis import foreign
from tests.bags.analysis.foreign import Bag, transforms, writing
from tests.bags.analysis.foreign import pose_stamped as pose

T, P, Q = foreign.swing()
"""The motion of base_link in map."""
MADE = "/tf:base_link (in map by transforms)"


def odom(t: np.ndarray, jump: float = 0.0) -> tuple[np.ndarray, Rotation]:
    """The pose of odom in map: it drifts and turns, and jumps at 2 s."""
    p = np.c_[0.3 * t + jump * (t >= 2.0), -0.1 * t, 0.2 + 0.0 * t]
    return p, Rotation.from_rotvec(np.c_[0 * t, 0.2 * t, 0.5 * t])


def in_odom(t: np.ndarray, p: np.ndarray, q: np.ndarray, jump: float = 0.0):
    """Pose of base_link in odom, so that in map it is (p, q)."""
    p_mo, turn = odom(t, jump)
    return turn.inv().apply(p - p_mo), (turn.inv() * Rotation.from_quat(q)).as_quat()


def robot(bag: Bag, every: int = 1, jump: float = 0.0) -> None:
    """map -> odom, at each `every`-th instant, and odom -> base_link."""
    p_mo, turn = odom(T, jump)
    p, q = in_odom(T, P, Q, jump)
    for k, t in enumerate(T):
        if k % every == 0:
            entry = ("map", "odom", p_mo[k], turn[k].as_quat())
            bag.add("/tf", *transforms(t, entry), t)
        bag.add("/tf", *transforms(t, ("odom", "base_link", p[k], q[k])), t)


def of(path, name: str, **options) -> np.ndarray:
    """t and poses of a source, shape (n, 8)."""
    found = Readings(path, **options)
    parts = [np.c_[p.stamp * 1e-9, p.values] for p in found.pieces() if p.source == name]
    return np.concatenate(parts)


def apart(rows: np.ndarray, p: np.ndarray, q: np.ndarray) -> float:
    turn = Rotation.from_quat(rows[:, 4:]).inv() * Rotation.from_quat(q)
    return max(np.abs(rows[:, 1:4] - p).max(), turn.magnitude().max())


@pytest.mark.parametrize("together", [1, 10_000])
def test_the_pose_in_the_root(tmp_path, monkeypatch, together):
    """All at once and message by message."""
    monkeypatch.setattr("rb_sim.io.bag.batches._TOGETHER", together)
    with writing(tmp_path / "x.mcap", chunk_size=2000) as bag:
        robot(bag)
    rows = of(tmp_path / "x.mcap", MADE)
    assert len(rows) == len(T)
    assert apart(rows, P, Q) < 1e-12


def test_what_moves_in_the_root_has_the_forces_there(tmp_path):
    """The swing accelerates by 4.5 m/s^2 in map; in odom it is something else."""
    with writing(tmp_path / "x.mcap") as bag:
        robot(bag)
    found = analyze(tmp_path / "x.mcap", masses={"base_link": Body(2.0, np.eye(3), np.zeros(3))})
    reported = found.as_dict()
    assert reported["bodies"][MADE]["wrench"]["Fx"]["largest"] == pytest.approx(9.0, rel=1e-3)
    assert "wrench" not in reported["bodies"]["/tf:base_link"]
    assert found.balances["base_link"]["stretches"] == 1
    assert "along the tree of transforms also in map: /tf:base_link" in found.notes
    assert not any("which moves" in note for note in found.notes)


def test_the_only_mass_is_of_no_frame_that_has_another_name(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        robot(bag)
    found = analyze(tmp_path / "x.mcap", masses={"body": Body(2.0, np.eye(3), np.zeros(3))})
    assert "body: no frame and no topic has this name: no balance" in found.notes
    assert not found.balances


def test_a_parent_between_two_stamps(tmp_path):
    """As tf2: linear and by slerp; a slower parent is told."""
    with writing(tmp_path / "x.mcap") as bag:
        robot(bag, every=8, jump=1.0)
    rows = of(tmp_path / "x.mcap", MADE)
    p_mo, turn = odom(T, 1.0)
    p, q = in_odom(T, P, Q, 1.0)
    last = (len(T) - 1) // 8 * 8 + 1
    own = T[::8]
    mid = np.stack([np.interp(T[:last], own, column[::8]) for column in p_mo.T], axis=1)
    slerp = Slerp(own, turn[::8])(T[:last])
    expected = (slerp * Rotation.from_quat(q[:last])).as_quat()
    assert apart(rows, mid + slerp.apply(p[:last]), expected) < 1e-12
    found = analyze(tmp_path / "x.mcap")
    assert any(n.startswith(f"{MADE}: {len(T) - last} poses skipped") for n in found.notes)
    assert any(f"of {last} poses by transforms between two stamps" in n for n in found.notes)


def test_a_parent_that_is_silent_for_long(tmp_path):
    """Nothing is made up for the time between."""
    with writing(tmp_path / "x.mcap") as bag:
        p_mo, turn = odom(T)
        p, q = in_odom(T, P, Q)
        for k, t in enumerate(T):
            if not 1.0 < t < 2.5:
                entry = ("map", "odom", p_mo[k], turn[k].as_quat())
                bag.add("/tf", *transforms(t, entry), t)
            bag.add("/tf", *transforms(t, ("odom", "base_link", p[k], q[k])), t)
    rows = of(tmp_path / "x.mcap", MADE)
    t = rows[:, 0] - foreign.EPOCH
    known = (T <= 1.0) | (T >= 2.5)
    assert np.abs(t - T[known]).max() < 1e-6
    assert apart(rows, P[known], Q[known]) < 1e-12


def test_a_link_that_is_fixed_to_what_moves(tmp_path):
    """base_footprint moves, base_link is fixed to it by two static transforms."""
    mast, eye = np.array([0.0, 0.3, 0.1]), np.array([1.0, 0.0, 0.0])
    up, down = Rotation.from_rotvec([0.0, 0.4, 0.0]), Rotation.from_rotvec([0.2, 0.0, 0.1])
    with writing(tmp_path / "x.mcap") as bag:
        for entry in (
            ("mast", "base_link", eye, down.as_quat()),
            ("base_footprint", "mast", mast, up.as_quat()),
        ):
            bag.add("/tf_static", *transforms(0.0, entry), 0.0)
        for t, p, q in zip(T, P, Q, strict=True):
            bag.add("/tf", *transforms(t, ("odom", "base_footprint", p, q)), t)
    name = "/tf_static:base_link (in odom by transforms)"
    rows = of(tmp_path / "x.mcap", name, frames=frozenset({"base_link"}))
    turn = Rotation.from_quat(Q)
    assert apart(rows, P + turn.apply(mast + up.apply(eye)), (turn * up * down).as_quat()) < 1e-12
    plain = Readings(tmp_path / "x.mcap")
    assert all("by transforms" not in piece.source for piece in plain.pieces())


def test_poses_of_a_topic_in_a_frame_of_the_tree(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        p_mo, turn = odom(T)
        p, q = in_odom(T, P, Q)
        for k, t in enumerate(T):
            entry = ("map", "odom", p_mo[k], turn[k].as_quat())
            bag.add("/tf", *transforms(t, entry), t)
            bag.add("/drone", *pose(t, p[k], q[k], "odom"), t)
    rows = of(tmp_path / "x.mcap", "/drone (in map by transforms)")
    assert apart(rows, P, Q) < 1e-12


def test_each_namespace_has_its_own_tree(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        for t, p, q in zip(T, P, Q, strict=True):
            for name, along in (("/a", 1.0), ("/b", 5.0)):
                entry = ("map", "odom", np.array([along, 0.0, 0.0]), Q[0])
                bag.add(f"{name}/tf", *transforms(t, entry), t)
                bag.add(f"{name}/tf", *transforms(t, ("odom", "base_link", p, q)), t)
    for name, along in (("/a", 1.0), ("/b", 5.0)):
        rows = of(tmp_path / "x.mcap", f"{name}{MADE}")
        assert apart(rows, P + [along, 0.0, 0.0], Q) < 1e-12


def test_frames_that_have_no_place_in_a_tree(tmp_path):
    """Two parents, and a circle: nothing is made."""
    with writing(tmp_path / "x.mcap") as bag:
        for t, p, q in zip(T, P, Q, strict=True):
            two = (("map", "odom", p, q), ("world", "odom", p, q), ("odom", "base_link", p, q))
            bag.add("/tf", *transforms(t, *two), t)
            bag.add("/a/tf", *transforms(t, ("x", "y", p, q), ("y", "x", p, q)), t)
    found = Readings(tmp_path / "x.mcap")
    assert all("by transforms" not in piece.source for piece in found.pieces())


def test_a_bag_that_was_played_twice(tmp_path):
    """Stamps go back by 4 s: no pose is made of transforms of both rounds."""
    with writing(tmp_path / "x.mcap") as bag:
        robot(bag)
        p_mo, turn = odom(T)
        for k, t in enumerate(T):  # the second time odom stands 7 m further
            p, q = in_odom(T[k : k + 1], P[k : k + 1], Q[k : k + 1])
            entry = ("map", "odom", p_mo[k] + [7.0, 0.0, 0.0], turn[k].as_quat())
            bag.add("/tf", *transforms(t, entry, ("odom", "base_link", p[0], q[0])), 10.0 + t)
    rows = of(tmp_path / "x.mcap", MADE)
    expected = np.concatenate([P, P + [7.0, 0.0, 0.0]])
    assert apart(rows, expected, np.concatenate([Q, Q])) < 1e-12


def test_memory_is_bounded_where_a_parent_falls_silent(tmp_path, monkeypatch):
    monkeypatch.setattr(composed, "MOST", 50)
    monkeypatch.setattr(readings, "AHEAD", 1)
    monkeypatch.setattr("rb_sim.io.bag.batches._TOGETHER", 1)
    made = []

    class CheckedSamples(composed.Composed):
        def __init__(self, *arguments) -> None:
            super().__init__(*arguments)
            made.append(self)

        def ready(self, *, last: bool = False):
            yield from super().ready(last=last)
            assert all(sum(len(t) for t, _ in w) <= 50 for w in self._waiting.values())

    monkeypatch.setattr(readings, "Composed", CheckedSamples)
    p, q = in_odom(T, P, Q)
    with writing(tmp_path / "x.mcap", chunk_size=400) as bag:
        for k, t in enumerate(T):
            if k < 2:
                bag.add("/tf", *transforms(t, ("map", "odom", P[k], Q[k])), t)
            bag.add("/tf", *transforms(t, ("odom", "base_link", p[k], q[k])), t)
    rows = of(tmp_path / "x.mcap", MADE)
    assert len(rows) == 2
    assert any(f"{len(T) - 2} poses skipped" in note for note in made[0].notes)
