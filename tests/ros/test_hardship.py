# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Clients as they may be, commands that no method can follow, and long runs."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from benchmarks.node_soak import FAST, soak
from rb_sim.ros.topics import command
from rb_sim.ros.topics.command import Command, Limits, Refusal, beyond
from tests.ros import bags
from tests.ros.client import NAME, Client, seconds

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


def test_a_client_without_ros_reads_poses_and_commands(sphere, start):
    start(sphere)
    command = [sys.executable, Path(__file__).with_name("dds_client.py")]
    command += [os.environ["ROS_DOMAIN_ID"], "50"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    reported = json.loads(done.stdout)
    assert (reported["frame"], reported["applied_frame"]) == ("world", "ball/origin")
    assert set(np.diff(reported["t"])) == {10_000_000}
    np.testing.assert_allclose(reported["z"], 0.1, atol=1e-12)
    assert reported["force"] == 1.5


def test_a_subscriber_that_never_reads_holds_up_nobody(sphere, start, client: Client):
    """It asked for everything, reliably, and its process is stopped, so it acknowledges nothing."""
    start(sphere, publish_depth=1000)
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


def test_twenty_thousand_commands_leave_the_last_one_in_force(sphere, start, client: Client):
    node = start(sphere)
    publisher = client.commander()
    applied = client.listen(WrenchStamped, "ball/wrench_applied")
    message = WrenchStamped()
    message.header.frame_id = "world"
    for k in range(20_000):
        message.wrench.force.x = 1e-6 * k
        publisher.publish(serialize_message(message))
    client.send(force=(0.125, 0.0, 0.0))
    client.until(lambda: applied and applied[-1].wrench.force.x == 0.125, "the last command")
    values = client.diagnostics(
        lambda one: int(one["commands applied"]) > 0 and "commands overtaken" in one, "counters"
    )
    assert int(values["commands applied"]) + int(values["commands overtaken"]) <= 20_001
    assert values["state"] == "running"
    shown = [(seconds(one.header.stamp), one.wrench.force.x) for one in applied]
    assert shown == sorted(shown)
    assert node.process.poll() is None


def test_a_node_that_was_held_up_catches_up_without_a_burst(sphere, start, client: Client):
    """20 samples are late each time; a subscriber of depth 10 that looks every 0.02 s gets all:
    five come at once, one that was on its way, and then one every half period. (Whether this one
    would, is up to the machine: so by when each was sent.)"""
    node = start(sphere)
    stamps: list[float] = []
    sent: list[float] = []

    def note(message: PoseStamped, info: dict[str, int]) -> None:
        stamps.append(seconds(message.header.stamp))
        sent.append(info["source_timestamp"] * 1e-9)

    client.node.create_subscription(PoseStamped, f"{NAME}/ball/pose", note, 1000)
    for k in range(1, 5):
        client.until(lambda n=50 * k: len(stamps) >= n, "poses")
        node.process.send_signal(signal.SIGSTOP)
        client.spin(0.2)
        node.process.send_signal(signal.SIGCONT)
    client.until(lambda: len(stamps) >= 250, "poses")
    np.testing.assert_allclose(np.diff(stamps), 0.01, atol=1e-9)
    gaps = np.diff(sent)
    assert np.count_nonzero(gaps > 0.19) >= 4, "it was held up"
    assert np.min(np.array(sent[10:]) - sent[:-10]) > 0.02


def test_a_client_that_goes_with_requests_under_way_holds_up_nobody(
    sphere, start, context, client: Client
):
    """DDS waits 0.1 s for each client that it does not find: 30 s for these."""
    node = start(sphere)
    clocks = client.listen(Clock, "/clock")
    gone = Client(context)
    service = gone.service(Trigger, "reset", depth=1000)
    asked = [service.call_async(Trigger.Request()) for _ in range(300)]
    gone.until(lambda: any(future.done() for future in asked), "an answer")
    gone.close()
    clocks.clear()
    client.until(lambda: len(clocks) > 350, "samples", timeout=15.0)
    assert client.trigger("reset").success
    assert "failed to send" not in node.text


def test_a_long_run_keeps_its_memory_and_every_sample():
    """Half an hour, as fast as it comes: a few seconds, of which the first fills the queue of the
    log."""
    found = soak(seconds=1800.0, rate=32.0, factor=FAST)
    assert found.samples == 1800 * 32 + 1 and found.missing == 0
    # a leak of one sample's messages each (1.3 kB) would be 75 MB
    assert found.growth < 30_000, found


def test_a_reliable_subscriber_of_depth_ten_gets_every_sample():
    """At 20 Hz: ten samples are 0.5 s, which a busy machine may take. `python -m
    benchmarks.node_soak` measures it at 500 Hz."""
    found = soak(seconds=12.0, rate=20.0)
    assert found.received > 200 and found.lost == 0 and found.missing == 0, found


# Commands that no method can follow: the node stays alive, says what happened, and can go on.


def test_a_force_that_stalls_the_motion_is_an_error_state_with_reset_as_the_way_out(
    sphere, start, client: Client, tmp_path
):
    node = start(
        sphere, out=tmp_path, start_paused=True, max_sample_steps=100_000, max_sample_time=1e9
    )
    reported = client.listen(Log, "/rosout")
    assert client.trigger("step").success
    client.send(force=(1e12, 0, 0))
    answer = client.trigger("step")
    assert not answer.success
    for words in ("t = 0.01 s", "ball force (1e+12, 0, 0) N", "since t = 0.01 s"):
        assert words in answer.message, answer.message
    values = client.diagnostics(lambda v: v["state"] == "error", "error state")
    assert values["level"] == "2" and values["message"] == answer.message
    client.until(lambda: any(answer.message in log.msg for log in reported), "line on /rosout")
    assert not client.trigger("step").success
    assert client.trigger("reset").success
    assert client.trigger("step").success
    assert client.diagnostics(lambda v: v["state"] == "paused", "state")["level"] != "2"
    client.send(force=(1e30, 0, 0))
    again = client.trigger("step").message  # the motion began anew at the reset
    assert "stopped at t = 0.03 s" in again and "(times of the motion from t = 0.02 s on)" in again
    assert "times of the motion" not in answer.message
    assert client.trigger("reset").success
    assert node.stop() == 0
    pose = bags.read(tmp_path / "bag")[f"{NAME}/ball/pose"]
    np.testing.assert_array_equal(pose.position, np.tile([0, 0, 0.1], (len(pose.raw), 1)))


def test_a_signal_is_answered_inside_a_sample_without_end(sphere, start, client: Client, tmp_path):
    """The samples so far are in a whole bag."""
    node = start(
        sphere, out=tmp_path, start_paused=True, max_sample_steps=10**12, max_sample_time=1e9
    )
    assert client.trigger("step").success
    client.send(force=(1e12, 0, 0))
    client.pause(False)
    client.spin(0.5)  # it is in the sample now, where it would stay for an hour
    assert node.stop() == 0
    assert "stopped at t = 0.01 s (SIGTERM)" in node.text
    assert len(bags.read(tmp_path / "bag")[f"{NAME}/ball/pose"].raw) == 2


@pytest.mark.parametrize("how", ["step", "advance"])
def test_a_request_that_cannot_go_on_ends_the_node_where_that_was_asked_for(
    how, advance, sphere, start, client: Client
):
    """It answered, and stayed as if nothing had been."""
    node = start(sphere, start_paused=True, exit_on_error=True, max_sample_steps=1000)
    client.send(force=(1e12, 0, 0))
    kind, fields = (Trigger, {}) if how == "step" else (advance, {"samples": 3})
    answer = client.call(kind, how, **fields)
    assert not answer.success and "ball force (1e+12, 0, 0) N" in answer.message
    assert node.wait() == 1
    assert "rb_sim_node: the motion no longer advances" in node.text


def test_commands_beyond_the_limits_are_refused_and_counted(
    sphere, start, client: Client, tmp_path
):
    node = start(sphere, out=tmp_path, start_paused=True)
    assert client.set("max_force", 5.0).successful and client.set("max_torque", 1).successful
    for force, torque in (((3, 4, 0), (0, 0, 0)), ((3, 4.1, 0), (0, 0, 0)), ((0, 0, 0), (2, 0, 0))):
        client.send(force=force, torque=torque)
        assert client.trigger("step").success
    values = client.diagnostics(
        lambda v: v.get(f"commands {command.TOO_STRONG}") == "2", "count of refusals"
    )
    assert values["commands applied"] == "1"
    assert node.stop() == 0
    assert "its force of 5.08035 N is beyond max_force = 5 N" in node.text
    applied = bags.read(tmp_path / "bag")[f"{NAME}/ball/wrench_applied"].wrench
    np.testing.assert_array_equal(applied[:, :3], [[0, 0, 0], *[[3, 4, 0]] * 3])


@pytest.mark.parametrize(
    ("force", "torque", "limits", "refused"),
    [
        ((3.0, 4.0, 0.0), (0.0, 0.0, 0.0), Limits(5.0, 0.0), False),
        ((3.0, 4.0, 1e-3), (0.0, 0.0, 0.0), Limits(5.0, 0.0), True),
        ((0.0, 0.0, 0.0), (0.0, 0.0, -2.0), Limits(0.0, 1.0), True),
        ((1e300, 0.0, 0.0), (0.0, 0.0, 0.0), Limits(), False),
        ((1e308, 1e308, 1e308), (0.0, 0.0, 0.0), Limits(1e300, 0.0), True),
    ],
)
def test_limits_are_of_the_size(force, torque, limits, refused):
    assert isinstance(beyond(Command("world", force, torque), limits), Refusal) is refused
