# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of somebody else that are whole, but not of one body in one frame of one type."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.base.errors import SinkError
from rb_sim.scene.load import load_scene
from tests.bags.analysis import foreign
from tests.bags.analysis.foreign import (
    POSE,
    transforms,
    twist_stamped,
    wrench_stamped,
    writing,
)
from tests.bags.analysis.foreign import pose_stamped as pose

T, P, Q = foreign.swing()
PEAK = 0.5 * 3.0**2
"""Largest acceleration of the swing along x [m/s^2]."""
UNIT = {"body": Body(1.0, np.eye(3), np.zeros(3))}


def peak(found: dict, source: str) -> float:
    """Largest acceleration along x, from the poses of a source, per unit of mass."""
    return found["bodies"][source]["wrench"]["Fx"]["largest"]


def test_two_types_under_one_name(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        for t, p, q in zip(T, P, Q, strict=True):
            bag.add("/body", *pose(t, p, q), t)
            bag.add("/body", *twist_stamped(t, [1.0, 2.0, 3.0], [1.0, 2.0, 3.0], "map"), t)
    found = analyze(tmp_path / "x.mcap")
    assert found.kinds == {"/body": "pose", "/body (TwistStamped)": "twist"}
    assert all(figures.rates.count == len(T) for figures in found.figures.values())
    assert "/body: not all of one type and frame: /body (TwistStamped) for itself" in found.notes


def test_one_topic_in_two_frames_is_not_one_motion(tmp_path):
    """The jump of the frame is none of the body."""
    with writing(tmp_path / "x.mcap") as bag:
        for k, (t, p, q) in enumerate(zip(T, P, Q, strict=True)):
            late = k >= len(T) // 2
            bag.add("/body", *pose(t, p + 50.0 * late, q, "odom" if late else "map"), t)
    found = analyze(tmp_path / "x.mcap", masses=UNIT)
    reported = found.as_dict()
    assert peak(reported, "/body") == pytest.approx(PEAK, rel=1e-3)
    assert reported["sources"]["/body (in odom)"]["count"] == len(T) // 2
    assert any("/body (in odom) for itself" in note for note in found.notes)


def test_two_parents_of_one_child(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        for t, p, q in zip(T, P, Q, strict=True):
            both = transforms(t, ("map", "body", p, q), ("odom", "body", p + 5.0, q))
            bag.add("/tf", *both, t)
    found = analyze(tmp_path / "x.mcap", masses=UNIT)
    reported = found.as_dict()
    assert reported["sources"]["/tf:body"]["count"] == len(T)
    assert reported["sources"]["/tf:body"]["backwards"] == 0
    assert reported["sources"]["/tf:body (in odom)"]["values"]["y"]["least"] == pytest.approx(5.1)
    assert peak(reported, "/tf:body") == pytest.approx(PEAK, rel=1e-3)


def test_a_child_in_messages_of_several_lengths_keeps_its_order(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        for k, (t, p, q) in enumerate(zip(T, P, Q, strict=True)):
            more = [("map", "post", np.zeros(3), Q[0])] * (k % 2)
            bag.add("/tf", *transforms(t, *more, ("map", "body", p, q)), t)
    reported = analyze(tmp_path / "x.mcap", masses=UNIT).as_dict()
    assert reported["sources"]["/tf:body"]["backwards"] == 0
    assert peak(reported, "/tf:body") == pytest.approx(PEAK, rel=1e-3)


def test_a_topic_in_two_channels_keeps_its_order_and_is_reported(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        for k, (t, p, q) in enumerate(zip(T, P, Q, strict=True)):
            bag.add("/body", *pose(t, p, q), t, channel=k % 2)
    found = analyze(tmp_path / "x.mcap", masses=UNIT)
    assert peak(found.as_dict(), "/body") == pytest.approx(PEAK, rel=1e-3)
    assert found.figures["/body"].rates.backwards == 0
    assert "/body: comes in 2 channels, which are taken as one source" in found.notes


@pytest.mark.parametrize("slash", ["", "/"])
def test_a_frame_that_moves_and_is_in_no_tree_is_reported(tmp_path, slash):
    """Odometry gives no tree: what is relative to a moving parent is not the whole motion. ROS 1
    wrote a slash before the names of frames."""
    with writing(tmp_path / "x.mcap") as bag:
        for t, p, q in zip(T, P, Q, strict=True):
            kind, odometry = foreign.odometry(t, p, q)
            bag.add("/odom", kind, odometry, t)
            arm = transforms(t, (f"{slash}base_link", "arm", np.array([0, 0, 0.3]), q))
            bag.add("/tf", *arm, t)
    found = analyze(tmp_path / "x.mcap", masses=UNIT)
    (line,) = [note for note in found.notes if "which moves" in note]
    assert line.startswith(
        f"/tf:arm: its poses are in the frame {slash}base_link, which moves (/odom)"
    )


@pytest.mark.parametrize("joined", [False, True])
def test_bodies_of_one_scene_in_frames_that_nothing_connects(tmp_path, joined):
    """Their distance follows from no transform: told; with a transform between it is right."""
    offset = np.array([5.0, 0.0, 0.0])
    masses = {name: Body(1.0, np.eye(3), np.zeros(3)) for name in ("a", "b")}
    rod = {"type": "distance", "body": "a", "parent": "b", "point_A": [0, 0, 0], "length": 1.0}
    bodies = {"a": {"position": [1, 0, 0]}, "b": {"position": [0, 0, 0]}}
    scene = load_scene({
        "bodies": {n: {"mass": 1, "inertia": [1, 1, 1], **b} for n, b in bodies.items()},
        "constraints": {"rod": rod},
    })  # fmt: skip
    with writing(tmp_path / "x.mcap") as bag:
        if joined:
            static = transforms(0.0, ("map", "odom", offset, np.array([0, 0, 0, 1.0])))
            bag.add("/tf_static", *static, 0.0)
        for t, p, q in zip(T, P, Q, strict=True):
            bag.add("/a/pose", *pose(t, p + [1.0, 0.0, 0.0], q), t)
            bag.add("/b/pose", *pose(t, p - offset, q, "odom"), t)
    found = analyze(tmp_path / "x.mcap", masses=masses, scene=scene)
    reported = [note for note in found.notes if "no transform connects" in note]
    error = found.as_dict()["constraints"]["position"]["rod"]["largest"]
    if joined:
        assert not reported and error < 1e-12
    else:
        assert len(reported) == 1 and "(a in map, b in odom)" in reported[0]
        assert error == pytest.approx(5.0)


@pytest.mark.parametrize("at", [0, 100])
@pytest.mark.parametrize("cut", [0, 68])
def test_a_message_that_is_none_costs_nothing_else(tmp_path, at, cut):
    """In the first chunk of several, first or not: a body without end, one cut short."""
    with writing(tmp_path / "x.mcap", chunk_size=4000) as bag:
        for k, (t, p, q) in enumerate(zip(T, P, Q, strict=True)):
            whole = bytes(foreign.STORE.serialize_cdr(pose(t, p, q)[1], POSE))
            bag.add("/body", POSE, whole[:cut] if k == at else whole, t)
    found = analyze(tmp_path / "x.mcap")
    assert found.figures["/body"].rates.count == len(T) - 1
    (line,) = found.notes
    assert line == f"/body: 1 message skipped: a message of {cut} bytes is not a {POSE}"


def test_a_frame_of_its_own_in_each_message(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        for k, (t, p, q) in enumerate(zip(T, P, Q, strict=True)):
            bag.add("/body", *pose(t, p, q, f"frame{k}"), t)
    found = analyze(tmp_path / "x.mcap")
    assert len(found.figures) == 16
    assert "/body: the rest is skipped: it has more than 16 frames" in found.notes


def test_a_pose_that_comes_twice_is_one(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        for t, p, q in zip(T, P, Q, strict=True):
            bag.add("/body", *pose(t, p, q), t)
            bag.add("/body", *pose(t, p, q), t)
    found = analyze(tmp_path / "x.mcap", masses=UNIT)
    assert peak(found.as_dict(), "/body") == pytest.approx(PEAK, rel=1e-3)
    assert any(f"{len(T)} poses have the stamp of the one before" in n for n in found.notes)


@pytest.mark.filterwarnings("error")
def test_a_quaternion_beyond_all_bounds_is_left_out(tmp_path):
    """Its length is not taken: the squares overflow."""
    t, position, q = foreign.swing(50)
    q[20, 1] = 1e200
    found = analyze(foreign.write(tmp_path / "bag", t=t, position=position, q=q))
    assert "/body: 1 readings beyond 1e+100 skipped" in found.notes


@pytest.mark.filterwarnings("error")
def test_a_reading_beyond_all_bounds_is_left_out(tmp_path):
    with writing(tmp_path / "x.mcap") as bag:
        for k, (t, p, q) in enumerate(zip(T, P, Q, strict=True)):
            bag.add("/body", *pose(t, p * (1e300 if k == 200 else 1.0), q), t)
    found = analyze(tmp_path / "x.mcap", masses=UNIT)
    assert peak(found.as_dict(), "/body") == pytest.approx(PEAK, rel=1e-3)
    assert "/body: 1 readings beyond 1e+100 skipped" in found.notes


def test_a_compression_that_nobody_knows_is_no_wrong_checksum(tmp_path):
    path = tmp_path / "x.mcap"
    with writing(path) as bag:
        bag.add("/body", *pose(T[0], P[0], Q[0]), T[0])
    data = path.read_bytes()
    path.write_bytes(data.replace(b"\x04\0\0\0zstd", b"\x04\0\0\0brot"))
    with pytest.raises(SinkError, match="its compression is neither zstd nor lz4"):
        analyze(path)


@pytest.mark.parametrize(("n", "cut", "found"), [
    (1, [], "1 pose"), (10, [], "10 poses"), (18, [9], "18 poses, 9 at most without a gap"),
])  # fmt: skip
def test_poses_too_few_in_a_row_are_counted_and_reported(tmp_path, n, cut, found):
    shift = 1.0 * (np.searchsorted(cut, np.arange(n), side="right"))
    bag = foreign.write(tmp_path / "b", t=T[:n] + shift, position=P[:n], q=Q[:n])
    result = analyze(bag, masses=UNIT)
    reported = result.bodies["/body"].as_dict()
    assert reported == {"note": f"{found}: not differentiated, which needs 11 in a row"}
    assert "too few poses in a row of body: no balance, no constraints" in result.notes


def test_topics_that_hold_no_readings_are_named_by_their_types(tmp_path):
    with writing(tmp_path / "a.mcap") as bag:
        bag.add("/chatter", "std_msgs/msg/String", bytes(16), 0.0)
    line = r"nothing to analyze: its topics are of other types \(std_msgs/msg/String\)$"
    with pytest.raises(SinkError, match=line):
        analyze(tmp_path / "a.mcap")


def test_messages_that_lie_in_no_order_are_told_from_a_clock_that_was_set(tmp_path):
    order = np.random.default_rng(0).permutation(len(T))
    bag = foreign.write(tmp_path / "a", t=T[order], position=P[order], q=Q[order])
    (line,) = [note for note in analyze(bag).notes if "goes back" in note]
    assert line.endswith("sort the bag first (`mcap sort`)")
    back = np.concatenate([T[:200], T[200:300] - 1.0, T[300:] - 2.0])
    bag = foreign.write(tmp_path / "b", t=back, position=P, q=Q)
    assert "/body: time goes back 2 times" in analyze(bag).notes


# Wrenches of a sensor that sits on a body: its frame, its clock, and where it is silent.


C = np.array([0.1, -0.2, 0.3])
BODY = Body(2.0, np.diag([0.1, 0.2, 0.3]), C)
SPIN = 0.8
FLANGE = np.array([0.0, 0.4, 0.1]), Rotation.from_rotvec([0.5, 0.0, 0.2])
SENSOR = np.array([0.3, 0.0, -0.1]), Rotation.from_rotvec([0.0, -1.0, 0.4])


def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The swing's poses of the body's origin, and what it takes: m a_C in the body's axes, and no
    torque about C, as it turns about a principal axis at an even rate."""
    _, p, q = foreign.swing()
    turn = Rotation.from_quat(q)
    a = np.c_[-4.5 * np.sin(3.0 * T), 0 * T, 0 * T]
    a -= SPIN**2 * turn.apply(C * [1.0, 1.0, 0.0])
    return p, q, turn.inv().apply(BODY.mass * a)


def write(
    path: Path, frame: str, *, fixed: bool = True, moved: bool = False,
    clock: float = 0.0, silent: tuple[float, float] = (0.0, 0.0),
) -> Path:  # fmt: skip
    """base_link moves in odom; flange and sensor are fixed to it one behind the other.

    clock: by how much the sensor's is ahead [s]; silent: from when to when it says nothing.
    """
    p, q, force = motion()
    turn = FLANGE[1] * SENSOR[1]
    r = FLANGE[0] + FLANGE[1].apply(SENSOR[0])
    f, k = turn.inv().apply(force), turn.inv().apply(np.cross(C - r, force))
    with writing(path) as bag:
        for child, (at, way), parent in (("ft_sensor", SENSOR, "flange"),
                                         ("flange", FLANGE, "base_link")) * fixed:  # fmt: skip
            entry = (parent, child, at, way.as_quat())
            bag.add("/tf_static", *transforms(0.0, entry), 0.0)
        if moved:
            entry = ("base_link", "flange", FLANGE[0] + 0.1, FLANGE[1].as_quat())
            bag.add("/tf_static", *transforms(0.0, entry), 0.0)
        for i, t in enumerate(T):
            if not silent[0] < t < silent[1]:
                bag.add("/push", *wrench_stamped(t + clock, frame, f[i], k[i]), t)
            bag.add("/tf", *transforms(t, ("odom", "base_link", p[i], q[i])), t)
    return path


@pytest.mark.parametrize("frame", ["ft_sensor", "/ft_sensor"])
def test_a_wrench_is_carried_over_to_its_body(tmp_path, frame):
    """Forces turned, torques about the body's origin: energy and both momenta balance."""
    found = analyze(write(tmp_path / "x.mcap", frame), masses={"base_link": BODY})
    (balance,) = found.balances.values()
    assert balance["wrenches"] == ["/push"]
    assert abs(balance["energy"]["error"]) < 1e-4 * balance["energy"]["scale"]
    for part in ("linear", "angular"):
        reported = balance["momentum"][part]
        assert reported["error"] < 1e-4 * reported["scale"]
    line = "/push: carried over to the frame base_link by static transforms"
    assert line in found.notes


@pytest.mark.parametrize("wrong", [{"fixed": False}, {"moved": True}])
def test_without_one_transform_it_is_left_out(tmp_path, wrong):
    bag = write(tmp_path / "x.mcap", "ft_sensor", **wrong)
    found = analyze(bag, masses={"base_link": BODY})
    assert "/push: not in the balance: neither its frame nor its topic names a body" in found.notes
    (balance,) = found.balances.values()
    assert not balance["wrenches"]
    assert balance["momentum"]["linear"]["error"] > 0.1


def test_the_nearest_body_above_takes_it(tmp_path):
    """The flange is a body of its own: what acts on it does not act on the base."""
    bag = write(tmp_path / "x.mcap", "ft_sensor")
    found = analyze(bag, masses={"base_link": BODY, "flange": BODY})
    reported = {name: balance["wrenches"] for name, balance in found.balances.items()}
    assert reported == {"base_link": [], "flange": ["/push"]}


@pytest.mark.parametrize("clock", [3.0, -1.0, -float(foreign.EPOCH)])
def test_another_clock_is_reported(tmp_path, clock):
    """Stamps that are ahead, behind, or count from zero where the poses' count from the epoch."""
    bag = write(tmp_path / "x.mcap", "ft_sensor", clock=clock)
    found = analyze(bag, masses={"base_link": BODY})
    (line,) = [note for note in found.notes if note.startswith("stamps of different clocks")]
    assert f"/push lie {-clock:.6g} s" in line or f"/push {-clock:.6g} s" in line
    count = {3.0: 300, -1.0: 100}.get(clock, 400) - 4  # the filter takes four at either end
    (line,) = [note for note in found.notes if note.startswith("/push: no reading near")]
    assert abs(int(line.split()[4]) - count) <= 8 and "of 392 instants" in line


def test_a_sensor_that_is_silent_for_a_while_is_reported(tmp_path):
    bag = write(tmp_path / "x.mcap", "ft_sensor", silent=(1.0, 2.0))
    found = analyze(bag, masses={"base_link": BODY})
    (line,) = [note for note in found.notes if note.startswith("/push: no reading near")]
    assert "no reading near 99 of 392 instants" in line
    assert not any("clock" in note for note in found.notes)
