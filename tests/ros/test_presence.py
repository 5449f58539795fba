# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What those see who come late, and requests while one part of the node hands over."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import psutil
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from tests.ros.client import NAME, Client, stamp_of
from tests.ros.conftest import START_TIMEOUT

LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


def latched(client: Client, topic: str) -> list[str]:
    found: list[str] = []
    client.node.create_subscription(
        String, f"{NAME}/{topic}", lambda message: found.append(message.data), LATCHED
    )
    return found


SLIDER = """\
bodies:
  slider: {mass: 1.0, inertia: [1, 1, 1], linear_velocity: [1, 0, 0]}
constraints:
  rail: {type: translation, body: slider, guide: {type: line, direction: [1, 0, 0]}}
simulation: {duration: 1000.0, rate: 100}
"""


def test_who_comes_in_a_pause_gets_the_last_sample(tmp_path, start, client: Client, transforms):
    """By ordinary (volatile) subscriptions, as tf's and those of robot_state_publisher are, or by
    best effort: poses, transforms and joint states of one instant, each once, and what nobody new
    listens to is not sent again."""
    scene = tmp_path / "slider.yaml"
    scene.write_text(SLIDER)
    start(scene, joint_states=True, odometry=True, start_paused=True)
    twists = client.listen(TwistStamped, "slider/twist")
    clocks = client.listen(Clock, "/clock")
    client.step_until(lambda: twists)
    now = float(client.trigger("step").message.split()[2])
    client.until(lambda: stamp_of(twists[-1]) == pytest.approx(now, abs=1e-9), "the last twist")
    client.until_it_stands(clocks)
    heard, now = len(twists), stamp_of(twists[-1])
    kinds = {
        f"{NAME}/slider/pose": PoseStamped,
        "/tf": transforms,
        f"{NAME}/joint_states": JointState,
        f"{NAME}/slider/odometry": Odometry,
    }
    for profile in (10, qos_profile_sensor_data):
        late: dict[str, list] = {topic: [] for topic in kinds}
        subscriptions = [
            client.node.create_subscription(kind, topic, late[topic].append, profile)
            for topic, kind in kinds.items()
        ]
        client.until(lambda late=late: all(late.values()), "the last sample")
        client.until_it_stands(clocks)  # the node looks who listens, meanwhile
        assert {topic: [*map(stamp_of, found)] for topic, found in late.items()} == {
            topic: [now] for topic in late
        }
        joints, pose = late[f"{NAME}/joint_states"][0], late[f"{NAME}/slider/pose"][0]
        assert joints.position[0] == pytest.approx(now, abs=1e-9)
        assert pose.pose.position.x == pytest.approx(now, abs=1e-9)
        for subscription in subscriptions:
            client.node.destroy_subscription(subscription)
        client.until_it_stands(clocks)
    assert len(twists) == heard


HELD = """
import sys, time
from pathlib import Path
from rb_sim.ros import main
from rb_sim.ros import preparing
whole = preparing.is_alone
def held(*given):
    while not Path(sys.argv[2]).exists():
        time.sleep(0.02)
    return whole(*given)
preparing.is_alone = held
sys.exit(main.main([sys.argv[1], *sys.argv[3:]]))
"""
"""SCENE FILE ...: a node that compiles, and then waits for the file before it begins to run."""


def test_a_node_that_compiles_is_there_already_and_answers(
    sphere, client: Client, tmp_path, monkeypatch
):
    """From an empty cache: a node that was told to start paused does, and steps then, and what was
    set is what runs. It waits for a file, since compiling may be over before a client finds it.
    """
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    states, clocks, go_on = latched(client, "state"), [], tmp_path / "go_on"
    client.node.create_subscription(Clock, "/clock", clocks.append, 10)
    command = [sys.executable, "-c", HELD, str(sphere), str(go_on), "--ros-args"]
    node = subprocess.Popen([*command, "-p", "discovery:=0.0"])
    try:
        client.until(lambda: states, "state", timeout=120.0)
        assert states == ["compiling"]
        client.until(lambda: clocks, "clock", timeout=120.0)
        answer = client.call(SetBool, "pause", data=True)
        assert answer.success and "it will start paused" in answer.message
        for name in ("step", "reset"):
            answer = client.trigger(name)
            assert not answer.success and "still compiling" in answer.message
        assert client.set("real_time_factor", 0.5).successful
        assert not client.describe("real_time_factor").read_only
        assert "must be of type" in client.set("real_time_factor", "slow").reason
        go_on.touch()
        client.until(lambda: states[-1:] == ["paused"], "the end of compiling", timeout=240.0)
        assert "running" not in states
        assert client.trigger("step").message == "t = 0.01 s"
        values = client.diagnostics(lambda one: one["state"] == "paused", "a report")
        assert values["real-time factor, set"] == "0.5"
        node.terminate()
        assert node.wait(START_TIMEOUT) == 0
    finally:
        node.kill()
        node.wait()


SEEN = """
import sys
from rb_sim.ros import main
from rb_sim.ros.topics.presence import Presence, Clock
def told(owner, name, module):
    whole = getattr(owner, name)
    def and_tell(*given):
        print(name, *given[1:], module, module in sys.modules, flush=True)
        return whole(*given)
    setattr(owner, name, and_tell)
told(Presence, "tell", "rb_sim.scene.schema")
told(Presence, "describe", "rb_sim.ros.node")
sys.exit(main.main(sys.argv[1:]))
"""


def test_what_is_seen_first_does_not_wait_for_what_simulates(sphere):
    """The state is told before a scene can be read, the scene before a simulation can be made:
    loading either takes as long as all that comes before it."""
    command = [sys.executable, "-c", SEEN, str(sphere), "--ros-args"]
    command += ["-p", "duration:=0.1", "-p", "discovery:=0.0"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=START_TIMEOUT)
    assert ended.returncode == 0, ended.stderr
    lines = [line for line in ended.stdout.splitlines() if line.startswith(("tell", "describe"))]
    assert lines[0] == "tell compiling rb_sim.scene.schema False"
    assert lines[1].startswith("describe ") and lines[1].endswith("rb_sim.ros.node False")


# Requests while one part of the node hands over to the next: none stays without an answer.


MOST = 50
"""Requests of each service that wait for an answer."""


def hammered(client: Client, requests: list[tuple[type, str, Any]], over: Callable[[], bool]):
    """Send requests (kind, name, request) without a break until it is over, and then for a while;
    the answers of each, in order. All are waited for."""
    kinds = [client.service(kind, name, depth=1000) for kind, name, _ in requests]
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


def test_who_asks_on_when_the_duration_is_over_is_reported(sphere, start, client: Client, tmp_path):
    """The logs are still being finished then."""
    node = start(sphere, start_paused=True, duration=0.03, out=tmp_path / "run")
    (writer,) = psutil.Process(node.process.pid).children()
    services = [client.service(Trigger, name) for name in ("step", "reset")]
    for _ in range(2):
        assert client.trigger("step").success
    writer.suspend()
    assert client.trigger("step").success
    futures = [service.call_async(Trigger.Request()) for service in services]
    client.until(lambda: all(future.done() for future in futures), "answers")
    writer.resume()
    step, reset = [future.result() for future in futures]
    assert not step.success and step.message == "the duration of 0.03 s is over"
    assert node.wait() == 0
    assert "Traceback" not in node.text
    # it came before the loop had looked, or behind it
    assert reset.success or reset.message == "the node is ending"
