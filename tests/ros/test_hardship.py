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

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from std_srvs.srv import Trigger

from benchmarks.node_soak import FAST, soak
from rb_sim.ros.serving import Answers
from rb_sim.ros.topics import command
from rb_sim.ros.topics.command import Command, Limits, Refusal, beyond
from tests.ros import bags
from tests.ros.client import NAME, Client


def test_of_the_answers_to_clients_that_have_gone_one_is_sent(context):
    """DDS waits 0.1 s for a client of each: 30 s for these, and so did the samples."""
    node = Node("asked", context=context)
    service: Any = node.create_service(Trigger, "reset", lambda _, answer: answer)
    headers: Any = [SimpleNamespace(received_timestamp=time.time_ns())] * 300
    assert hasattr(rclpy_implementation.rmw_service_info_t, "received_timestamp")
    sent: list[int] = []
    service.send_response = lambda answer, _: sent.append(answer)
    answers = Answers(node, service)
    for answer, header in enumerate(headers):
        answers.send(answer, header)
    assert sent == [0]
    # who asks after that may be a client that is still being found
    later: Any = SimpleNamespace(received_timestamp=time.time_ns() + 1)
    answers.send(300, later)
    assert sent == [0, 300]
    node.destroy_node()


def test_a_long_run_keeps_its_memory_and_every_sample():
    """A quarter of an hour, as fast as it comes: a few seconds, of which the first fills the queue
    of the log."""
    found = soak(seconds=900.0, rate=32.0, factor=FAST)
    assert found.samples == 900 * 32 + 1 and found.missing == 0
    # a leak of one sample's messages each (1.3 kB) would be 37 MB
    assert found.growth < 30_000, found


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
