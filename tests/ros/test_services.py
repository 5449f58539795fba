# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Services of the node: pause, step, reset, set a state, and those of simulation_interfaces."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.context import Context
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from rb_sim.ros import build_interfaces, services
from rb_sim.ros.serving import Serving
from tests.ros import bags
from tests.ros.client import NAME, Client, seconds, vector
from tests.ros.conftest import importable


def test_reset_gives_the_initial_state_and_stamps_go_on(sphere, start, client: Client, tmp_path):
    node = start(sphere, out=tmp_path, start_paused=True)
    poses = client.listen(PoseStamped, "ball/pose")
    client.send(force=(1, 0, 0))
    for _ in range(5):
        client.trigger("step")
    answer = client.trigger("reset")
    assert answer.success and "t = 0.06 s" in answer.message
    # while nothing steps
    client.until(lambda: poses and seconds(poses[-1].header.stamp) > 0.055, "the initial state")
    assert seconds(poses[-1].header.stamp) == pytest.approx(0.06, abs=1e-9)
    np.testing.assert_allclose(vector(poses[-1].pose.position), [0, 0, 0.1], atol=1e-12)
    for _ in range(2):
        client.trigger("step")
    assert node.stop() == 0
    bag = bags.read(tmp_path / "bag")
    pose, wrench = bag[f"{NAME}/ball/pose"], bag[f"{NAME}/ball/wrench_applied"].wrench
    np.testing.assert_allclose(pose.t, 0.01 * np.arange(9), atol=1e-9)
    assert pose.position[5, 0] > 0.0
    np.testing.assert_allclose(pose.position[6:], np.tile([0, 0, 0.1], (3, 1)), atol=1e-12)
    np.testing.assert_array_equal(wrench[:, 0], [0, 1, 1, 1, 1, 1, 0, 0, 0])


def test_a_run_split_by_pauses_equals_the_run_in_one(sphere, start, client: Client, tmp_path):
    node = start(sphere, out=tmp_path / "split", start_paused=True)
    clocks = client.listen(Clock, "/clock")

    def reached(t: float) -> bool:
        return bool(clocks) and seconds(clocks[-1].clock) >= t

    client.pause(False)
    client.until(lambda: reached(0.1), "0.1 s")
    client.pause(True)
    for _ in range(3):
        client.trigger("step")
    between = client.until_it_stands(clocks)
    client.pause(False)
    client.until(lambda: reached(between + 0.1), "0.1 s more")
    assert node.stop() == 0
    one = start(sphere, out=tmp_path / "one", real_time_factor=0, duration=1)
    assert one.wait() == 0
    split = bags.read(tmp_path / "split" / "bag")[f"{NAME}/ball/pose"].raw
    whole = bags.read(tmp_path / "one" / "bag")[f"{NAME}/ball/pose"].raw
    count = min(len(split), len(whole))
    assert count > 10 and split[:count] == whole[:count]


# The services of simulation_interfaces, with a package of their names built for the test.


PACKAGE = "simulation_interfaces"
FEATURES = {
    "SIMULATION_RESET": 20, "SIMULATION_RESET_STATE": 22, "SIMULATION_STATE_GETTING": 24,
    "SIMULATION_STATE_SETTING": 25, "SIMULATION_STATE_PAUSE": 26, "STEP_SIMULATION_SINGLE": 31,
    "STEP_SIMULATION_MULTIPLE": 32,
}  # fmt: skip
RESULTS = ("FEATURE_UNSUPPORTED", "OK", "NOT_FOUND", "INCORRECT_STATE", "OPERATION_FAILED")
STATES = ("STOPPED", "PLAYING", "PAUSED", "QUITTING")
SCOPES = {"DEFAULT": 0, "TIME": 1, "STATE": 2, "SPAWNED": 4, "ALL": 255}


def constants(prefix: str, values: dict[str, int]) -> str:
    return "".join(f"uint8 {prefix}{name} = {value}\n" for name, value in values.items())


def numbered(names: tuple[str, ...]) -> dict[str, int]:
    return {name: k for k, name in enumerate(names)}


SOURCES = {
    "msg/Result.msg": constants("RESULT_", numbered(RESULTS))
    + "uint8 result\nstring error_message\n",
    "msg/SimulationState.msg": constants("STATE_", numbered(STATES)) + "uint8 state\n",
    "msg/SimulatorFeatures.msg": constants("", FEATURES)
    + "uint16[] features\nstring[] spawn_formats\nstring custom_info\n",
    "srv/GetSimulatorFeatures.srv": "---\nSimulatorFeatures features\n",
    "srv/GetSimulationState.srv": "---\nSimulationState state\nResult result\n",
    "srv/SetSimulationState.srv": "SimulationState state\n---\n"
    "uint8 ALREADY_IN_TARGET_STATE = 101\nResult result\n",
    "srv/StepSimulation.srv": "uint64 steps\n---\nResult result\n",
    "srv/ResetSimulation.srv": constants("SCOPE_", SCOPES) + "uint8 scope\n---\nResult result\n",
}


@pytest.fixture(scope="module")
def package() -> Any:
    """The stand-in, importable here and in nodes that start."""
    importable("rb_sim_interfaces")  # or this cannot be built either
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_interfaces, "sources", lambda _: SOURCES)
        folder = build_interfaces.build(PACKAGE)  # kept from one session to the next
        before = os.environ.get("PYTHONPATH", "")
        patch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(folder), before))))
        patch.syspath_prepend(str(folder))
        from simulation_interfaces import msg, srv  # type: ignore[import-not-found]

        yield msg, srv
    sys.modules.pop(PACKAGE, None)


def test_features_state_steps_and_reset(package, sphere, start, client: Client):
    msg, srv = package
    node = start(sphere, start_paused=True, max_sample_steps=10_000)
    poses = client.listen(PoseStamped, "ball/pose")
    clocks = client.listen(Clock, "/clock")

    def go_to(state: str) -> int:
        wanted = msg.SimulationState(state=getattr(msg.SimulationState, f"STATE_{state}"))
        answer = client.call(srv.SetSimulationState, "set_simulation_state", state=wanted)
        return answer.result.result

    def state() -> str:
        answer = client.call(srv.GetSimulationState, "get_simulation_state")
        assert answer.result.result == 1
        return STATES[answer.state.state]

    def step(steps: int) -> Any:
        return client.call(srv.StepSimulation, "step_simulation", steps=steps).result

    features = client.call(srv.GetSimulatorFeatures, "get_simulator_features").features
    assert sorted(features.features) == sorted(FEATURES.values())
    assert state() == "PAUSED" and go_to("PAUSED") == 101
    client.step_until(lambda: poses)
    before = client.until_it_stands(clocks)
    assert step(7).result == 1
    client.until(lambda: seconds(poses[-1].header.stamp) > before + 0.069, "seven samples")
    assert seconds(poses[-1].header.stamp) == pytest.approx(before + 0.07, abs=1e-9)

    reset = srv.ResetSimulation
    assert client.call(reset, "reset_simulation", scope=SCOPES["TIME"]).result.result == 0
    assert client.call(reset, "reset_simulation", scope=SCOPES["ALL"]).result.result == 1
    client.until(lambda: seconds(poses[-1].header.stamp) > before + 0.079, "the initial state")

    assert go_to("PLAYING") == 1 and state() == "PLAYING"
    refused = step(1)
    assert RESULTS[refused.result] == "INCORRECT_STATE" and "paused" in refused.error_message
    client.send(force=(1e12, 0.0, 0.0))
    client.until(lambda: state() == "PAUSED", "the error that the motion ends in")
    assert go_to("PAUSED") == 1, "it does not go on when the error is over"
    assert client.trigger("reset").success and state() == "PAUSED"
    assert go_to("PLAYING") == 1
    assert go_to("STOPPED") == 1 and state() == "STOPPED"
    assert step(1).result == 1 and state() == "PAUSED"
    assert go_to("QUITTING") == 1
    assert node.wait() == 0 and "stopped at t" in node.text


@pytest.mark.parametrize(
    "broken, words",
    [
        ("raise OSError('libmsg.so: undefined symbol: x')", "undefined symbol: x"),
        ("raise ImportError('no types\\nin here')", "no types in here"),
        ("", "cannot import name"),
    ],
)
def test_a_package_that_cannot_be_loaded_is_one_line(broken, words, tmp_path, monkeypatch):
    package = tmp_path / "simulation_interfaces"
    package.mkdir()
    (package / "__init__.py").write_text(broken)
    monkeypatch.syspath_prepend(str(tmp_path))
    # what is imported here is gone afterwards, and one that was there before is there again
    monkeypatch.setitem(sys.modules, "simulation_interfaces", None)
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
        monkeypatch.delitem(sys.modules, name)  # its parts as well
    monkeypatch.setattr(services, "OWN", "not_installed_anywhere")
    said: list[str] = []
    node: Any = SimpleNamespace(get_logger=lambda: SimpleNamespace(warning=said.append))
    nothing: Any = None
    services.offer_services(node, nothing, nothing, nothing, may_quit=True)
    (line,) = said
    assert line.startswith("no services of simulation_interfaces: ") and words in line
    assert "\n" not in line


# The thread that serves ROS, and what others have it do.


def test_what_it_is_to_do_is_done_between_requests_and_reported(context: Context):
    """Also where it does not serve yet, or not any more."""
    node, where = Node("served", context=context), []

    def note() -> None:
        where.append(threading.current_thread())

    def fail() -> None:
        note()
        raise ValueError("not done")

    try:
        serving = Serving(node)
        serving.do(note)
        with serving:
            serving.do(note)
            with pytest.raises(ValueError, match="not done"):
                serving.do(fail)
            serving.check()
        serving.do(note)
    finally:
        node.destroy_node()
    here = threading.current_thread()
    assert where[0] is here and where[3] is here
    assert where[1] is where[2] is not here and len(where) == 4


# ~/set_state: what is set is the next sample; what is off the joints is refused or moved there.


M, A = 2.0, 0.1


@pytest.fixture(scope="session")
def set_state(advance: type) -> type:
    from rb_sim_interfaces.srv import SetState  # type: ignore[import-not-found]

    return SetState


def state(body="ball", position=(0, 0, A), linear=(0, 0, 0), angular=(0, 0, 0), q=(0, 0, 0, 1)):
    from rb_sim_interfaces.msg import BodyState  # type: ignore[import-not-found]

    message: Any = BodyState(body=body)
    for of, names, numbers in (
        (message.pose.position, "xyz", position),
        (message.pose.orientation, "xyzw", q),
        (message.twist.linear, "xyz", linear),
        (message.twist.angular, "xyz", angular),
    ):
        for name, number in zip(names, numbers, strict=True):
            setattr(of, name, float(number))
    return message


def test_a_state_is_set_refused_projected_and_in_the_bag(
    set_state, advance, sphere, start, client: Client, tmp_path: Path
):
    """A homogeneous ball under force F: a = 5 F / (7 m); projected, its momenta about the point of
    contact stay: v = (5 v_0 + 2 a w_0) / 7 (Landau & Lifshitz, section 38)."""
    from rb_sim.bags.resim import resimulate
    from rb_sim.io.bag.reader import BagReader, scene_as_run

    node = start(sphere, out=tmp_path / "run", start_paused=True)
    client.send(force=(1.0, 0, 0))
    for _ in range(5):
        assert client.trigger("step").success

    slipping = state(position=(3, 4, A), linear=(1, 0, 0), angular=(0, 0, 2))
    answer = client.call(set_state, "set_state", bodies=[slipping])
    assert not answer.success and "constraints.floor: the given velocity violates" in answer.message
    for wrong, words in (
        (state(body="moon"), "must be one or more of ball"),
        (state(q=(0, 0, 0, 2)), "ball.orientation: got length 2"),
        (state(linear=(np.nan, 0, 0)), "must be 3 finite numbers"),
    ):
        answer = client.call(set_state, "set_state", bodies=[wrong])
        assert not answer.success and words in answer.message

    rolling = state(position=(3, 4, A), linear=(1, 0, 0), angular=(0, 1 / A, 2))
    answer = client.call(set_state, "set_state", bodies=[rolling])
    assert answer.success and answer.message == "set at t = 0.06 s"
    (body,) = answer.bodies
    np.testing.assert_allclose(vector(body.pose.position), (3, 4, A), atol=1e-14)
    np.testing.assert_allclose(vector(body.twist.angular), (0, 10, 2), atol=1e-12)
    for _ in range(10):
        assert client.trigger("step").success
    answer = client.call(set_state, "set_state", bodies=[slipping], project=True)
    assert answer.success
    (body,) = answer.bodies
    np.testing.assert_allclose(vector(body.twist.linear), (5 / 7, 0, 0), atol=1e-9)
    np.testing.assert_allclose(vector(body.twist.angular), (0, 50 / 7, 2), atol=1e-8)
    assert client.trigger("step").success
    assert node.stop() == 0

    bag = bags.read(tmp_path / "run" / "bag")
    x = bag[f"{NAME}/ball/pose"].position[:, 0]
    acceleration, t = 5 / (7 * M), 0.01 * np.arange(11)
    np.testing.assert_allclose(x[6:17], 3 + t + 0.5 * acceleration * t**2, rtol=1e-9)
    assert x[17] == 3.0 and len(x) == 19
    assert [m.position[0] for m in bag[f"{NAME}/ball/state_command"].messages] == [3.0, 3.0]
    reader = BagReader(tmp_path / "run" / "bag")
    resimulate(reader, scene_as_run(reader, (), {}), tmp_path / "again")
    again = bags.read(tmp_path / "again")
    of_the_node = (f"{NAME}/description", f"{NAME}/state")  # its own run and its own states
    for found in (bag, again):
        for name in of_the_node:
            found.pop(name, None)
    assert {name: series.raw for name, series in again.items()} == {
        name: series.raw for name, series in bag.items()
    }
