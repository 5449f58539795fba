# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Requests while one part of the node hands over to the next: none stays without an answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from tests.ros.client import NAME, Client

MOST = 50
"""Requests of each service that wait for an answer."""
LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
KEPT = QoSProfile(depth=1000)


def hammered(client: Client, requests: list[tuple[type, str, Any]], over: Callable[[], bool]):
    """Send requests (kind, name, request) without a break until it is over, and then for a while;
    the answers of each, in order. All are waited for."""
    kinds = [client.node.create_client(kind, f"{NAME}/{name}", qos_profile=KEPT) for kind, name, _
             in requests]  # fmt: skip
    for service, (_, _, request) in zip(kinds, requests, strict=True):
        client.until(service.service_is_ready, service.srv_name)
        # ROS drops an answer to a client that the node's side of DDS has not seen yet
        first = service.call_async(request)
        while not first.done():
            first = service.call_async(request)
            client.spin(0.1)
    sent: list[list[Any]] = [[] for _ in requests]
    more = 300
    while more:
        for service, (_, _, request), futures in zip(kinds, requests, sent, strict=True):
            if sum(not future.done() for future in futures[-MOST:]) < MOST:
                futures.append(service.call_async(request))
        client.spin_once()
        more -= over()
    every = [future for futures in sent for future in futures]
    client.until(lambda: all(future.done() for future in every), "answers to all")
    return [[future.result() for future in futures] for futures in sent]


def test_every_request_is_answered_while_the_node_begins_to_run(sphere, start, client: Client):
    """An executor that is told of a request and then given up must not keep it: the next one was
    told of none, and all later answers were one request behind."""
    node = start(sphere, ready=False, discovery=4)
    requests = [
        (Trigger, "step", Trigger.Request()),
        (Trigger, "reset", Trigger.Request()),
        (GetParameters, "get_parameters", GetParameters.Request(names=["rate"])),
    ]
    steps, resets, parameters = hammered(client, requests, lambda: "takes commands" in node.text)
    assert all(len(one.values) == 1 for one in parameters)
    assert "still compiling" in steps[0].message and "only while paused" in steps[-1].message
    begun = [one.success for one in resets].index(True)
    assert all(one.success for one in resets[begun:])


def test_a_pause_that_is_promised_while_the_node_begins_to_run_is_kept(
    sphere, start, client: Client
):
    states: list[str] = []
    client.node.create_subscription(
        String, f"{NAME}/state", lambda message: states.append(message.data), LATCHED
    )
    node = start(sphere, ready=False, discovery=4)
    request = [(SetBool, "pause", SetBool.Request(data=True))]
    (answers,) = hammered(client, request, lambda: "takes commands" in node.text)
    assert answers[0].message == "compiling; it will start paused"
    assert {one.message for one in answers[1:]} == {answers[0].message, "paused at t = 0 s"}
    client.until(lambda: states[-1:] == ["paused"], "state")
    assert "running" not in states


def test_who_asks_on_when_the_duration_is_over_is_told(sphere, start, client: Client, tmp_path):
    """The logs are still being finished then."""
    node = start(sphere, start_paused=True, duration=0.03, out=tmp_path / "run",
                 log_plots=True)  # fmt: skip
    for _ in range(3):
        assert client.trigger("step").success
    futures = [client.ask(Trigger, name) for name in ("step", "reset")]
    client.until(lambda: all(future.done() for future in futures), "answers")
    step, reset = [future.result() for future in futures]
    assert not step.success and step.message == "the duration of 0.03 s is over"
    assert node.wait() == 0
    assert "Traceback" not in node.text
    # it came before the loop had looked, or behind it
    assert reset.success or reset.message == "the node is ending"
