# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The services of simulation_interfaces, with a package of their names built for the test."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Clock

from rb_sim.ros import build_interfaces, services
from tests.ros.client import Client, seconds
from tests.ros.conftest import importable

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


def test_without_the_package_there_are_none_of_its_services(sphere, start, client: Client):
    start(sphere)
    client.until(lambda: client.pause().success, "the node")
    names = {name for name, _ in client.node.get_service_names_and_types()}
    assert "/rb_sim/pause" in names and "/rb_sim/step_simulation" not in names


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The stand-in, importable here and in nodes that start."""
    importable("rb_sim_interfaces")  # or this cannot be built either
    place = tmp_path_factory.mktemp("built")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_interfaces, "sources", lambda _: SOURCES)
        folder = build_interfaces.Builder(PACKAGE, Path(place)).build()
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
