# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""managed:=true: the transitions of a lifecycle node, over DDS."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rosgraph_msgs.msg import Clock

from tests.ros import bags
from tests.ros.client import NAME, Client, seconds
from tests.ros.conftest import START_TIMEOUT
from tests.ros.test_presence import latched
from tests.ros.test_shutdown import until_there


def change(client: Client, number: int) -> bool:
    """Ask for a transition; whether it was done."""
    state = f"{NAME}/state"
    client.until(lambda: client.node.count_publishers(state), "the node", START_TIMEOUT)
    transition = Transition(id=number)
    return client.call(ChangeState, "change_state", transition=transition).success


def state(client: Client) -> int:
    """Number of the present state."""
    return client.call(GetState, "get_state").current_state.id


def test_every_transition_does_what_it_says(sphere, start, client: Client, tmp_path: Path):
    node = start(sphere, ready=False, managed=True, out=tmp_path / "run", overwrite=True)
    node.wait_for("waits for the transition configure")
    assert state(client) == State.PRIMARY_STATE_UNCONFIGURED
    assert not change(client, Transition.TRANSITION_ACTIVATE)
    assert not client.trigger("step").success
    assert not (tmp_path / "run").exists()

    assert change(client, Transition.TRANSITION_CONFIGURE)
    assert state(client) == State.PRIMARY_STATE_INACTIVE
    poses = client.listen(PoseStamped, "ball/pose")
    clocks = client.listen(Clock, "/clock")
    refused = client.trigger("step")
    assert not refused.success and "inactive" in refused.message
    assert client.until_it_stands(clocks) == 0.0
    assert all(seconds(pose.header.stamp) == 0.0 for pose in poses)  # nothing moves

    assert change(client, Transition.TRANSITION_ACTIVATE)
    client.until(lambda: len(poses) > 20, "poses")
    assert state(client) == State.PRIMARY_STATE_ACTIVE
    assert change(client, Transition.TRANSITION_DEACTIVATE)
    last = client.until_it_stands(clocks)
    client.until(lambda: seconds(poses[-1].header.stamp) > last - 0.005, "the last pose")
    count = len(poses)
    client.spin(0.3)
    assert len(poses) == count
    assert seconds(poses[-1].header.stamp) == last
    assert change(client, Transition.TRANSITION_ACTIVATE)
    client.until(lambda: len(poses) > count + 20, "poses after activating again")
    np.testing.assert_allclose(seconds(poses[count].header.stamp), last + 0.01, atol=1e-9)
    assert change(client, Transition.TRANSITION_DEACTIVATE)

    assert change(client, Transition.TRANSITION_CLEANUP)
    assert state(client) == State.PRIMARY_STATE_UNCONFIGURED
    assert client.set("real_time_factor", 2.0).successful
    logged = bags.read(tmp_path / "run" / "bag")[f"{NAME}/ball/pose"].t
    np.testing.assert_allclose(logged, np.arange(len(logged)) / 100, atol=1e-9)
    assert logged[-1] >= last + 0.2

    assert change(client, Transition.TRANSITION_CONFIGURE)  # anew, from the start
    poses.clear()
    assert change(client, Transition.TRANSITION_ACTIVATE)
    client.until(lambda: len(poses) > 20, "poses of the second configuration")
    assert seconds(poses[-1].header.stamp) < 20.0
    values = client.diagnostics(lambda one: one["state"] == "running", "a report")
    assert values["real-time factor, set"] == "2", "what was set is what runs"
    client.send(force=(1.0, 0, 0))
    client.until(lambda: poses[-1].pose.position.x > 0.0, "the command to act")
    assert change(client, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert node.wait() == 0, node.text
    assert "Traceback" not in node.text


def test_what_cannot_be_configured_is_said_and_can_be_mended(start, client: Client, tmp_path: Path):
    """State and time are there before."""
    scene = tmp_path / "scene.yaml"
    scene.write_text("bodies: {}\n")
    node = start(scene, ready=False, managed=True)
    states, clocks = latched(client, "state"), client.listen(Clock, "/clock")
    client.until(lambda: states and len(clocks) > 2, "state and clock")
    assert states == ["unconfigured"]
    assert not change(client, Transition.TRANSITION_CONFIGURE)
    assert "not configured: " in node.text
    assert state(client) == State.PRIMARY_STATE_UNCONFIGURED
    scene.write_text("bodies: {ball: {mass: 1.0, shape: {type: sphere, radius: 0.1}}}\n")
    assert change(client, Transition.TRANSITION_CONFIGURE), node.text
    client.until(lambda: states[-1] == "inactive", "the state")
    assert all(seconds(message.clock) == 0.0 for message in clocks)
    assert change(client, Transition.TRANSITION_CLEANUP)
    client.until(lambda: states[-1] == "unconfigured", "the state")
    count = len(clocks)
    client.until(lambda: len(clocks) > count + 2, "the time, again and again")
    assert node.stop() == 0


WAITING = """
import sys
from rb_sim.ros import main, preparing
whole = preparing.is_alone
def for_ever(node, began, _, is_over):
    return whole(node, began, 1e9, is_over)
preparing.is_alone = for_ever
sys.exit(main.main(sys.argv[1:]))
"""


def test_a_signal_ends_the_wait_for_others_of_the_name(sphere, client: Client):
    """It was noted, and answered when the wait was over."""
    command = [sys.executable, "-c", WAITING, str(sphere), "--ros-args", "-p", "managed:=true"]
    node = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        states = latched(client, "state")
        transition = Transition(id=Transition.TRANSITION_CONFIGURE)
        client.ask(ChangeState, "change_state", transition=transition)
        client.until(lambda: "compiling" in states, "the transition")
        node.terminate()
        _, said = node.communicate(timeout=START_TIMEOUT)
        assert node.returncode == 0
        assert "not configured: ended by SIGTERM before the first sample" in said
    finally:
        node.kill()
        node.wait()


BROKEN = """
import sys
from rb_sim.ros import main
from rb_sim.ros import lifecycle as managed
def broken(*_):
    sys.stdin.readline()
    raise MemoryError("no room")
managed.prepared = broken
sys.exit(main.main(sys.argv[1:]))
"""


def test_a_transition_that_breaks_off_is_answered_and_ends_the_node(sphere, client: Client):
    """By what nobody foresaw: whoever asked is not left waiting, nor is the process. Until then the
    node answers: parameters, its state, and other transitions, which it refuses."""
    command = [sys.executable, "-c", BROKEN, str(sphere), "--ros-args", "-p", "managed:=true"]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE}
    node = subprocess.Popen(command, **pipes, text=True)
    try:
        transition = Transition(id=Transition.TRANSITION_CONFIGURE)
        asked = client.ask(ChangeState, "change_state", transition=transition)
        client.until(lambda: state(client) == State.TRANSITION_STATE_CONFIGURING, "the transition")
        assert client.set("real_time_factor", 2.0).successful
        assert "still compiling" in client.trigger("step").message
        assert not change(client, Transition.TRANSITION_CLEANUP)
        assert not asked.done()
        assert node.stdin is not None
        node.stdin.write("\n")
        node.stdin.flush()
        client.until(asked.done, "the answer")
        assert not asked.result().success
        assert node.wait(START_TIMEOUT) == 1
        assert node.stderr is not None and "MemoryError: no room" in node.stderr.read()
    finally:
        node.kill()
        node.wait()


ORDER = """
import sys
from rb_sim.ros import main
from rb_sim.ros.lifecycle import ManagedNode, Turn
answer, destroy = Turn.answer, ManagedNode.destroy_publisher
def answer_and_tell(turn, success):
    print("answered", success, flush=True)
    answer(turn, success)
def destroy_and_tell(node, publisher):
    print("destroyed", publisher.topic_name, flush=True)
    return destroy(node, publisher)
Turn.answer, ManagedNode.destroy_publisher = answer_and_tell, destroy_and_tell
sys.exit(main.main(sys.argv[1:]))
"""


def test_what_a_refused_transition_offered_is_gone_before_the_answer(client: Client):
    """The thread that serves goes on with the answer; where it looks at all that there is while
    something is being destroyed, it ends by an error, now and then."""
    command = [sys.executable, "-c", ORDER, "no_such_scene", "--ros-args", "-p", "managed:=true"]
    node = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert not change(client, Transition.TRANSITION_CONFIGURE)
        assert change(client, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
        said, _ = node.communicate(timeout=START_TIMEOUT)
        first, second, third = said.splitlines()[:3]
        assert (first, second, third) == ("destroyed /clock", "destroyed /clock", "answered False")
    finally:
        node.kill()
        node.wait()


TOLD = """
import sys
from rb_sim.ros import main
from rb_sim.ros.log_process import LogProcess
close = LogProcess.close
def and_tell(logs, *given, **named):
    close(logs, *given, **named)
    print("closed with", *logs.finished, flush=True)
LogProcess.close = and_tell
sys.exit(main.main(sys.argv[1:]))
"""


def test_cleanup_does_not_wait_for_plots(sphere, client: Client, tmp_path: Path):
    command = [sys.executable, "-c", TOLD, str(sphere), "--ros-args", "-p", "managed:=true"]
    command += ["-p", f"out:={tmp_path}", "-p", "log_rerun:=false", "-p", "discovery:=0.0"]
    node = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        for transition in ("CONFIGURE", "ACTIVATE", "DEACTIVATE", "CLEANUP"):
            assert change(client, getattr(Transition, f"TRANSITION_{transition}"))
        assert change(client, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
        assert node.stdout is not None and node.stdout.readline() == "closed with bag\n"
        assert node.wait(START_TIMEOUT) == 0
        until_there(tmp_path / "plots.png")
    finally:
        node.kill()
        node.wait()
