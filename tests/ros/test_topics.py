# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the node publishes: names, types, stamps, frames, numbers."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, UInt8

from tests.ros import bags
from tests.ros.client import NAME, Client, seconds, vector

# A body whose centre of mass lies 0.3 m from its origin O, free: C moves uniformly, and with all
# moments of inertia equal the spin is constant, so O = C - R r_OC in closed form.
OFFSET = """\
bodies:
  ball:
    mass: 2.0
    inertia: [0.1, 0.1, 0.1]
    center_of_mass: [0.3, 0.0, 0.0]
    position: [0.0, 0.0, 0.0]
    linear_velocity: [0.5, 0.6, 0.0]
    angular_velocity: [0.0, 0.0, 2.0]
effects:
  drive: {type: commanded_wrench, body: ball}
simulation: {duration: 1.0, method: dopri853, tolerance: 1.0e-12, rate: 50}
"""


# A ball dropped from h = 0.05 m on a floor with restitution 0.5.
BOUNCE = """\
bodies:
  ball: {mass: 0.5, shape: {type: sphere, radius: 0.05}, position: [0, 0, 0.1]}
  puck: {mass: 1.0, inertia: [0.1, 0.1, 0.1], position: [1, 0, 0]}
constraints:
  floor: {type: contact, body: ball, restitution: 0.5}
  ice: {type: contact, body: puck, points: [[0.2, 0, 0], [-0.1, 0.1, 0], [-0.1, -0.1, 0]]}
effects:
  weight: {type: gravity, acceleration: [0, 0, -9.81]}
simulation: {duration: 100.0, rate: 50, tolerance: 1.0e-10}
"""


@pytest.fixture
def offset(tmp_path: Path) -> Path:
    path = tmp_path / "offset.yaml"
    path.write_text(OFFSET)
    return path


def test_pose_and_twist_are_those_of_the_body_origin(offset, start, client: Client, tmp_path):
    start(offset, out=tmp_path, start_paused=True)
    poses = client.listen(PoseStamped, "ball/pose")
    twists = client.listen(TwistStamped, "ball/twist")
    client.step_for(20, poses, twists)
    for pose, twist in zip(poses[-20:], twists[-20:], strict=True):
        assert pose.header.stamp == twist.header.stamp
        t = seconds(pose.header.stamp)
        assert pose.header.frame_id == twist.header.frame_id == "world"
        angle, spin, arm = 2.0 * t, 2.0, 0.3
        # C starts at (0.3, 0, 0) with v_C = v_O + w x r = (0.5, 0.6 + 2 * 0.3, 0)
        centre = np.array([0.3 + 0.5 * t, 1.2 * t, 0.0])
        r = arm * np.array([math.cos(angle), math.sin(angle), 0.0])
        v = np.array([0.5, 1.2, 0.0]) - spin * np.array([-r[1], r[0], 0.0])
        np.testing.assert_allclose(vector(pose.pose.position), centre - r, atol=1e-10)
        q = pose.pose.orientation
        half = (0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))
        np.testing.assert_allclose((q.x, q.y, q.z, q.w), half, atol=1e-10)
        np.testing.assert_allclose(vector(twist.twist.linear), v, atol=1e-10)
        np.testing.assert_allclose(vector(twist.twist.angular), (0, 0, spin), atol=1e-10)


def test_a_command_acts_at_the_body_origin_not_at_the_centre_of_mass(
    offset, start, client: Client, tmp_path
):
    """m a_C = F and I alpha = -r x F, at the first step, about C."""
    node = start(offset, out=tmp_path, start_paused=True, rate=1000)
    client.send(force=(0.0, 4.0, 0.0))
    assert client.trigger("step").success
    assert client.trigger("step").success
    assert node.stop() == 0
    twist = bags.read(tmp_path / "bag")[f"{NAME}/ball/twist"].twist
    r, dt = 0.3, 1e-3
    alpha = -r * 4.0 / 0.1  # torque of F at O about C: (-r) x F, over I
    assert (twist[1, 5] - twist[0, 5]) / dt == pytest.approx(alpha, rel=1e-4)


def test_topics_have_the_documented_names_and_types(sphere, start, client: Client):
    start(sphere, start_paused=True)
    expected = {
        "/clock": "rosgraph_msgs/msg/Clock",
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
        f"{NAME}/ball/pose": "geometry_msgs/msg/PoseStamped",
        f"{NAME}/ball/twist": "geometry_msgs/msg/TwistStamped",
        f"{NAME}/ball/wrench": "geometry_msgs/msg/WrenchStamped",
        f"{NAME}/ball/wrench_applied": "geometry_msgs/msg/WrenchStamped",
        f"{NAME}/reactions/floor": "geometry_msgs/msg/WrenchStamped",
        f"{NAME}/energy": "std_msgs/msg/Float64",
    }

    def offered() -> dict[str, str]:
        found = dict(client.node.get_topic_names_and_types())
        return {topic: kind for topic in expected for kind in found.get(topic, [])}

    client.until(lambda: offered() == expected, "all topics")
    (clock,) = client.node.get_publishers_info_by_topic("/clock")
    assert clock.qos_profile.depth in (0, 1)  # 0: not told by the discovery protocol


def test_the_topics_and_the_bag_hold_the_same_bytes(sphere, start, client: Client, tmp_path):
    node = start(sphere, out=tmp_path, start_paused=True)
    received = {
        topic: client.listen(kind, topic, raw=True)
        for topic, kind in {"ball/pose": PoseStamped, "reactions/floor": WrenchStamped}.items()
    }
    client.send(force=(1.0, 2.0, 0.0), torque=(0.0, 0.1, 0.2))
    client.step_until(lambda: all(len(messages) >= 5 for messages in received.values()))
    assert node.stop() == 0
    recorded = bags.read(tmp_path / "bag")
    for topic, messages in received.items():
        raw = recorded[f"{NAME}/{topic}"].raw
        client.until(lambda m=messages, raw=raw: m[-1] == raw[-1], "the last one")
        assert [bytes(m) for m in messages] == raw[-len(messages) :]


def test_the_bag_has_the_state_and_the_odometry_that_were_published(
    sphere, start, client: Client, tmp_path
):
    node = start(sphere, out=tmp_path, start_paused=True, odometry=True)
    received = client.listen(Odometry, "ball/odometry", raw=True)
    client.step_until(lambda: len(received) >= 5)
    client.pause(False)
    client.until(lambda: len(received) >= 15, "samples")
    client.pause(True)
    client.spin(0.2)  # samples that were sent before
    assert node.stop() == 0
    recorded = bags.read(tmp_path / "bag")
    states = [message.data for message in recorded[f"{NAME}/state"].messages]
    assert states[:2] == ["paused", "running"]
    raw = recorded[f"{NAME}/ball/odometry"].raw
    assert bytes(received[-1]) in raw and len(raw) >= 15


def test_measured_reaction_and_acceleration_are_those_of_the_book(sphere, start, client, tmp_path):
    """Landau & Lifshitz, section 38, problem 1, commanded over DDS."""
    node = start(sphere, out=tmp_path, start_paused=True)
    m, a, g = 2.0, 0.1, 9.81
    F, K = np.array([1.5, -0.7, 3.0]), np.array([0.05, 0.08, -0.02])
    client.send(force=F, torque=K)
    for _ in range(10):
        client.trigger("step")
    assert node.stop() == 0
    bag = bags.read(tmp_path / "bag")
    reaction = bag[f"{NAME}/reactions/floor"]
    R = (5 * K[1] / (7 * a) - 2 / 7 * F[0], -5 * K[0] / (7 * a) - 2 / 7 * F[1], m * g - F[2])
    np.testing.assert_allclose(reaction.wrench[1:, :3], np.tile(R, (10, 1)), rtol=1e-9)
    twist = bag[f"{NAME}/ball/twist"]
    measured = (twist.twist[10] - twist.twist[0]) / (twist.t[10] - twist.t[0])
    expected = 5 / (7 * m) * np.array([F[0] + K[1] / a, F[1] - K[0] / a])
    np.testing.assert_allclose(measured[:2], expected, rtol=1e-9)
    assert measured[5] == pytest.approx(K[2] / (0.4 * m * a * a), rel=1e-9)
    applied = bag[f"{NAME}/ball/wrench_applied"]
    assert applied.messages[0].header.frame_id == "ball/origin"
    np.testing.assert_array_equal(applied.wrench[1:], np.tile([*F, *K], (10, 1)))
    np.testing.assert_array_equal(applied.wrench[0], np.zeros(6))


def test_states_work_and_events_of_contacts(
    start, client: Client, tmp_path, monkeypatch: pytest.MonkeyPatch
):
    """The first impact is at sqrt(2 h / g), with the impulse m (1 + e) sqrt(2 g h)."""
    monkeypatch.setenv("RB_SIM_INTERPRETED", "1")  # compiling takes longer than these few steps
    path = tmp_path / "bounce.yaml"
    path.write_text(BOUNCE)
    node = start(path, out=tmp_path, start_paused=True)
    events = client.listen(DiagnosticArray, "contact_events")
    raw = client.listen(DiagnosticArray, "contact_events", raw=True)
    states = client.listen(UInt8, "contacts/floor/state")
    points = client.listen(UInt8, "contacts/ice/point_2/state")
    work = client.listen(Float64, "contact_work")
    reactions = client.listen(WrenchStamped, "reactions/ice/point_2")
    impacts: list[DiagnosticArray] = []
    for _ in range(20):  # a subscription that is still being matched gets nothing
        client.trigger("reset")
        for _ in range(6):
            client.trigger("step")
        client.spin(0.1)
        told = [array for array in events if array.status[0].name == "floor"]
        impacts = [array for array in told if array.status[0].message == "impact"]
        if impacts and work and states and points and reactions:
            break
    v, g = math.sqrt(2.0 * 9.81 * 0.05), 9.81
    (last,) = impacts[-1].status
    since_reset = seconds(impacts[-1].header.stamp) - v / g  # stamps go on at a reset
    assert 50.0 * since_reset == pytest.approx(round(50.0 * since_reset), abs=1e-6)
    values = {pair.key: float(pair.value) for pair in last.values}
    assert values["t"] == pytest.approx(seconds(impacts[-1].header.stamp), abs=1e-9)
    assert values["impulse_z"] == pytest.approx(0.5 * 1.5 * v, rel=1e-10)
    assert work[-1].data == pytest.approx(-0.75 * 0.5 * g * 0.05, rel=1e-9)
    assert states[-1].data == 0 and points[-1].data == 1
    assert reactions[-1].wrench.force.z == pytest.approx(g / 3.0, rel=1e-9)
    assert node.stop() == 0
    recorded = bags.read(tmp_path / "bag")[f"{NAME}/contact_events"]
    assert bytes(raw[-1]).startswith(recorded.raw[-1])  # DDS fills up to four bytes
    closed = [m.status[0].name for m in recorded.messages if m.status[0].message == "closes"]
    assert closed[:3] == ["ice/1", "ice/2", "ice/3"]


def test_clock_runs_with_the_samples(sphere, start, client: Client):
    start(sphere, rate=50, duration=0)
    clocks = client.listen(Clock, "/clock")
    client.until(lambda: len(clocks) >= 20, "20 clocks")
    ticks = np.diff([seconds(message.clock) for message in clocks])
    assert (ticks > 0).all()
    np.testing.assert_allclose(ticks / 0.02, np.rint(ticks / 0.02), atol=1e-6)


def test_two_nodes_in_one_domain_do_not_disturb_each_other(sphere, start, client: Client):
    """One tells the time, the other stands still beside it."""
    start(sphere, ros=("-r", "__ns:=/one"), tf=False)
    start(sphere, ros=("-r", "__ns:=/two"), tf=False, publish_clock=False, start_paused=True)
    clocks = client.listen(Clock, "/clock")
    energy = client.listen(Float64, "/one/rb_sim/energy")
    still = client.listen(Float64, "/two/rb_sim/energy")
    client.until(lambda: len(clocks) >= 50 and len(energy) >= 20, "time")
    assert len(still) <= 1  # the last sample, for who comes in a pause
    (info,) = client.node.get_publishers_info_by_topic("/clock")
    assert info.node_namespace == "/one"
    assert client.node.count_publishers("/tf") == 0
    times = [seconds(message.clock) for message in clocks]
    assert times == sorted(set(times))


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ("class TFMessage:\n    pass\n", "should be a ROS 2 message type"),
        ("raise OSError('libtf2_msgs.so: undefined symbol: x')\n", "undefined symbol: x"),
    ],
)
def test_a_tf2_msgs_that_cannot_be_loaded_costs_its_topic_alone(
    broken: str, words: str, offset: Path, start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line says so, and blames nothing else; all other topics are there."""
    package = tmp_path / "broken" / "tf2_msgs"
    (package / "msg").mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "msg" / "__init__.py").write_text(broken)
    before = os.environ.get("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(package.parent), before))))
    node = start(offset, ready=False, duration=0.1, real_time_factor=0)
    assert node.wait() == 0
    (line,) = [line for line in node.text.splitlines() if "[INFO]" not in line]
    assert "no topic /tf" in line and words in line
    assert "qos_overrides" not in line
