# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One node of the shipped sphere with its defaults, which all of these tests ask."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.qos import QoSReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from tests.ros.client import NAME, Client, seconds, vector
from tests.ros.conftest import NodeProcess, starting
from tests.ros.test_lockstep import wrench
from tests.ros.test_presence import latched

CHANGED = {"real_time_factor": 1.0, "wrench_timeout": 0.0, "max_force": 0.0}
"""Parameters that a test changes, as they were."""


@pytest.fixture(scope="module")
def node(sphere: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[NodeProcess]:
    with starting(tmp_path_factory.mktemp("one_node")) as start:
        yield start(sphere, start_paused=True, publish_depth=1000, max_sample_steps=10_000)


@pytest.fixture
def client(node: NodeProcess, client: Client) -> Iterator[Client]:
    """Of the node in a pause, at the initial state."""
    assert client.pause().success and client.trigger("reset").success
    yield client
    for name, value in CHANGED.items():
        assert client.set(name, value).successful


def test_topics_have_the_documented_names_and_types(client: Client):
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
    (pose,) = client.node.get_publishers_info_by_topic(f"{NAME}/ball/pose")
    assert pose.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE
    (clock,) = client.node.get_publishers_info_by_topic("/clock")
    assert clock.qos_profile.depth in (0, 1)  # 0: not told by the discovery protocol
    topics = {name for name, _ in client.node.get_topic_names_and_types()}  # not asked for
    assert not topics & {f"{NAME}/ball/odometry", f"{NAME}/joint_states"}


def test_a_late_joiner_of_a_paused_node_sees_what_there_is(client: Client):
    states, descriptions = latched(client, "state"), latched(client, "description")
    clocks = client.listen(Clock, "/clock")
    client.until(lambda: states and descriptions and clocks, "state, description and clock")
    assert states[-1] == "paused"
    reported = json.loads(descriptions[-1])
    assert reported["scene"] == "rolling_sphere_commanded" and reported["rate"] == 100.0
    assert reported["bodies"] == {"ball": {"mass": 2.0}}
    assert reported["constraints"] == {"floor": "rolling"}
    client.pause(False)
    client.until(lambda: states[-1] == "running", "state")


def test_tf_has_the_poses_and_the_frames_of_the_reactions(transforms, client: Client):
    poses = client.listen(PoseStamped, "ball/pose")
    floor = client.listen(WrenchStamped, "reactions/floor")
    found = client.listen(transforms, "/tf")
    client.send(force=(1.0, 0.3, 0))
    client.step_for(5, poses, floor, found)
    for message, pose, reaction in zip(found[-5:], poses[-5:], floor[-5:], strict=True):
        frames = {one.child_frame_id: one for one in message.transforms}
        assert set(frames) == {"ball", "ball/origin", "floor/anchor"}
        for one in message.transforms:
            assert one.header.stamp == pose.header.stamp and one.header.frame_id == "world"
        ball = frames["ball"].transform
        assert vector(ball.translation) == vector(pose.pose.position)
        assert ball.rotation == pose.pose.orientation
        # the ball of radius 0.1 m touches the floor right below its centre
        below = np.array(vector(pose.pose.position)) - (0, 0, 0.1)
        assert reaction.header.frame_id == "floor/anchor"
        anchor = vector(frames["floor/anchor"].transform.translation)
        np.testing.assert_allclose(anchor, below, atol=1e-12)


def test_step_is_one_sample_period_with_its_clock_and_only_while_paused(client: Client):
    assert client.pause(False).success
    answer = client.trigger("step")
    assert not answer.success and "only while paused" in answer.message
    assert client.pause().success
    clocks = client.listen(Clock, "/clock")
    before = client.until_it_stands(clocks)
    for k in range(1, 6):
        answer = client.trigger("step")
        assert answer.success
        # done when answered: the message tells the time reached
        assert float(answer.message.split()[2]) == pytest.approx(before + 0.01 * k, abs=1e-9)
    client.until(lambda: seconds(clocks[-1].clock) > before + 0.049, "5 clocks")
    # a clock that stands still is told again and again
    times = sorted({seconds(message.clock) for message in clocks})
    np.testing.assert_allclose(times[-5:], before + 0.01 * np.arange(1, 6), atol=1e-9)
    # nothing moves while it is paused, and going on does not catch up
    client.until_it_stands(clocks)
    stopped, count = clocks[-1].clock, len(clocks)
    client.until(lambda: len(clocks) >= count + 3, "the time, again and again")
    assert all(message.clock == stopped for message in clocks[count:])
    assert client.pause(False).success
    client.until(lambda: clocks[-1].clock != stopped, "clock again")
    after = next(seconds(m.clock) for m in clocks[count:] if m.clock != stopped)
    assert after == pytest.approx(seconds(stopped) + 0.01, abs=1e-9)
    # without their package there are no services of simulation_interfaces
    names = {name for name, _ in client.node.get_service_names_and_types()}
    assert "/rb_sim/pause" in names and "/rb_sim/step_simulation" not in names


def test_changes_while_running(node: NodeProcess, client: Client):
    """And what they are is told: ranges, meanings, which may change."""
    assert client.pause(False).success
    described = client.describe("real_time_factor")
    assert "as fast as possible" in described.description
    (limits,) = described.floating_point_range
    assert (limits.from_value, limits.to_value) == (0.0, 1e4)
    assert not described.read_only
    assert client.describe("rate").read_only
    assert "dopri853" in client.describe("method").additional_constraints
    for value, reason in (
        (-1.0, "out of range"),
        (float("nan"), "out"),
        ("fast", "must be of type"),
    ):
        result = client.set("real_time_factor", value)
        assert not result.successful and reason in result.reason, result
    result = client.set("rate", 10.0)
    assert not result.successful and "read-only" in result.reason
    assert client.set("wrench_timeout", 1).successful  # an integer where a number is meant
    assert client.set("real_time_factor", 4.0).successful
    values = client.diagnostics(
        lambda v: (
            v["real-time factor, set"] == "4" and float(v["real-time factor, measured"]) > 0.0
        ),
        "measured real-time factor",
    )
    assert float(values["step time, mean [us]"]) > 0.0
    assert float(values["constraint residual"]) < 1e-12
    assert node.process.poll() is None


def test_a_request_is_taken_whole_or_not_at_all(advance, client: Client):
    assert client.set("max_force", 50.0).successful
    for wrong, words in (
        ({"body": "moon"}, "bodies that take a command: ball"),
        ({"frame": "map"}, "frame_id 'map' is neither 'world' nor 'ball'"),
        ({"force": (math.nan, 0, 0)}, "not a finite number"),
        ({"force": (100, 0, 0)}, "beyond max_force = 50 N"),
        ({"force": (2, 0, 0)}, "ball: wrench refused: the body is given twice"),
    ):
        asked = [wrench((1, 0, 0)), wrench(**wrong)]
        answer = client.call(advance, "advance", wrenches=asked, samples=5)
        assert not answer.success and answer.samples == 0
        assert words in answer.message
    answer = client.call(advance, "advance", samples=5)
    assert answer.success
    np.testing.assert_array_equal(vector(answer.bodies[0].twist.linear), np.zeros(3))
    # nor after an error, nor while it runs
    assert client.set("max_force", 0.0).successful
    answer = client.call(advance, "advance", wrenches=[wrench((1e12, 0, 0))], samples=3)
    assert not answer.success and answer.samples == 0
    assert "no longer advances" in answer.message and "1e+12" in answer.message
    assert not client.call(advance, "advance", samples=1).success
    assert client.trigger("reset").success
    assert client.call(advance, "advance", samples=1).success
    client.pause(False)
    answer = client.call(advance, "advance", samples=1)
    assert not answer.success and "only while paused" in answer.message


def test_no_request_is_lost_where_many_are_on_the_way(advance, client: Client):
    """ROS keeps ten of a service by itself."""
    service = client.service(advance, "advance", depth=1000)
    futures: list[Any] = [service.call_async(advance.Request(samples=1)) for _ in range(200)]
    client.until(lambda: all(future.done() for future in futures), "all answers")
    stamps = [seconds(future.result().stamp) for future in futures]
    np.testing.assert_allclose(np.diff(stamps), 0.01, atol=1e-9)


def test_a_topic_is_heard_again_after_nobody_listened(advance, client: Client):
    """What nobody listens to is not sent; a subscriber that comes back in a pause gets the last
    sample, and misses nothing."""
    clocks = client.listen(Clock, "/clock")
    first, topic = client.until_it_stands(clocks), f"{NAME}/ball/pose"
    for _ in range(2):
        poses: list[PoseStamped] = []
        subscription = client.node.create_subscription(PoseStamped, topic, poses.append, 5000)
        client.until(lambda poses=poses: poses, "the last sample")
        assert client.call(advance, "advance", samples=1500).success
        client.until(lambda poses=poses: len(poses) == 1501, "all samples")
        stamps = [seconds(pose.header.stamp) for pose in poses]
        np.testing.assert_allclose(stamps, first + 0.01 * np.arange(1501), atol=1e-9)
        client.node.destroy_subscription(subscription)
        client.until_it_stands(clocks)  # the node looks who listens, meanwhile
        assert client.call(advance, "advance", samples=1100).success  # to nobody
        first += 26.0


def test_a_client_without_ros_reads_poses_and_commands(client: Client):
    assert client.pause(False).success
    command = [sys.executable, Path(__file__).with_name("dds_client.py")]
    command += [os.environ["ROS_DOMAIN_ID"], "50"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    reported = json.loads(done.stdout)
    assert (reported["frame"], reported["applied_frame"]) == ("world", "ball/origin")
    assert set(np.diff(reported["t"])) == {10_000_000}
    np.testing.assert_allclose(reported["z"], 0.1, atol=1e-12)
    assert reported["force"] == 1.5


STOPPED = """
import rclpy, time
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, QoSHistoryPolicy
rclpy.init()
node = rclpy.create_node("stopped")
everything = QoSProfile(history=QoSHistoryPolicy.KEEP_ALL)
node.create_subscription(PoseStamped, "/rb_sim/ball/pose", print, everything)
while not node.count_publishers("/rb_sim/ball/pose"):
    time.sleep(0.05)
print("there", flush=True)
time.sleep(1000)
"""


def test_a_subscriber_that_never_reads_holds_up_nobody(client: Client):
    """It asked for everything, reliably, and its process is stopped, so it acknowledges nothing."""
    assert client.pause(False).success
    never = subprocess.Popen([sys.executable, "-c", STOPPED], stdout=subprocess.PIPE, text=True)
    try:
        assert never.stdout is not None and never.stdout.readline() == "there\n"
        poses = client.listen(PoseStamped, "ball/pose")
        client.until(lambda: poses, "poses")
        never.send_signal(signal.SIGSTOP)
        before = len(poses)
        client.until(lambda: len(poses) >= before + 500, "500 poses more")
        stamps = [seconds(message.header.stamp) for message in poses]
        np.testing.assert_allclose(np.diff(stamps), 0.01, atol=1e-9)
        assert client.pause().success
    finally:
        never.kill()
        never.wait()


def test_twenty_thousand_commands_leave_the_last_one_in_force(node, client: Client):
    assert client.pause(False).success

    def handled(values: dict[str, str]) -> int:
        return int(values["commands applied"]) + int(values.get("commands overtaken", 0))

    before = handled(client.diagnostics(lambda one: one["state"] == "running", "counters"))
    publisher = client.commander()
    applied = client.listen(WrenchStamped, "ball/wrench_applied")
    message = WrenchStamped()
    message.header.frame_id = "world"
    for k in range(20_000):
        message.wrench.force.x = 1e-6 * k
        publisher.publish(serialize_message(message))
    client.send(force=(0.125, 0.0, 0.0))
    client.until(lambda: applied and applied[-1].wrench.force.x == 0.125, "the last command")
    values = client.diagnostics(lambda one: handled(one) > before, "counters")
    assert handled(values) - before <= 20_001 and values["state"] == "running"
    shown = [(seconds(one.header.stamp), one.wrench.force.x) for one in applied]
    assert shown == sorted(shown)
    assert node.process.poll() is None


def test_a_second_node_of_the_same_name_is_refused(node, sphere, start):
    second = start(sphere, ready=False, discovery=3.5)
    # where discovery is slower than the start, both go on and say so
    reported = (
        "a node called /rb_sim runs already: rename this one",
        "another node is called /rb_sim",
    )
    end = time.monotonic() + 240.0
    while not any(words in second.text for words in reported):
        assert time.monotonic() < end, second.text
        time.sleep(0.05)
    if reported[0] in second.text:
        assert second.wait() == 2
    else:
        assert second.stop() == 0
    other = start(sphere, ready=False, ros=("-r", "__node:=other"), duration=0.1, discovery=3.5)
    assert other.wait() == 0 and node.process.poll() is None
