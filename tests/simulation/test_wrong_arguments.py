# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wrong arguments of the Python interface: one line with the field, the value, what is allowed."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import pytest

import rb_sim
from rb_sim import RbSimError, Simulation, Trajectory, load_scene

BALL = {
    "bodies": {"ball": {"mass": 1.0, "inertia": [1, 1, 1]}},
    "effects": {"weight": {"type": "gravity", "acceleration": [0, 0, -9.81]}},
    "simulation": {"duration": 0.1, "rate": 20},
}
ANY: Any = None


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation(load_scene(BALL), announce=None)


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return Simulation(load_scene(BALL), announce=None).run()


def line(act: Callable[[], Any]) -> str:
    """The message of the error; a test fails where it takes more than a line."""
    with pytest.raises(RbSimError) as caught:
        act()
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("source", [3, None, [], b"heavy_top"])
def test_a_scene_is_a_file_a_name_a_text_or_a_mapping(source: Any) -> None:
    for act in (load_scene, Simulation):
        said = line(lambda act=act: act(source))
        assert f"scene: got {source!r}; must be a file, the name of a shipped scene" in said


@pytest.mark.parametrize("value", ["2", [1], None, float("nan"), 1j, 10**400])
def test_times_are_numbers(simulation: Simulation, value: Any) -> None:
    assert line(lambda: simulation.advance(value)).startswith("duration: got ")
    assert line(lambda: simulation.linearize(turning=value)).startswith("turning: got ")


@pytest.mark.parametrize("value", ["2", [1], float("nan"), 0, -1.0])
def test_a_run_has_a_duration_and_a_rate(simulation: Simulation, value: Any) -> None:
    assert line(lambda: simulation.run(value)).startswith(f"duration: got {value!r}; must be")
    assert line(lambda: simulation.run(1.0, value)).startswith(f"rate: got {value!r}; must be")


def test_other_words_are_refused(simulation: Simulation) -> None:
    said = line(lambda: Simulation(load_scene(BALL), coordinates="minimal"))
    assert said == "coordinates: got 'minimal'; must be 'auto' or 'maximal'"
    assert line(lambda: simulation.set_state({"ball": ANY})).startswith("ball: got None; must be a")


def test_a_name_that_is_none_is_told_with_those_there_are(run: Trajectory) -> None:
    assert line(lambda: run.position["bal"]) == ("body: got 'bal'; must be ball")
    assert "reaction: got 'tip'; there is none" in line(lambda: run.reaction["tip"])
    assert "effect: got 'wind'; must be one of weight" in line(lambda: run.effect["wind"])
    assert "body: got 'x'" in line(lambda: run.state().position["x"])
    with pytest.raises(KeyError):
        run.orientation["x"]
    assert run.position.get("x") is None and "x" not in run.position


def test_values_by_name_survive_copies(run: Trajectory) -> None:
    for again in (copy.deepcopy(run.position), pickle.loads(pickle.dumps(run.position))):
        assert (again["ball"] == run.position["ball"]).all()
        assert "must be one of ball" in line(lambda again=again: again["x"])


@pytest.mark.parametrize("sample", [3, -4, 1.5, "first", None])
def test_a_state_is_of_a_sample(run: Trajectory, sample: Any) -> None:
    assert line(lambda: run.state(sample)) == (
        f"state: got {sample!r}; must be a whole number from -3 to 2"
    )


def test_a_point_has_finite_numbers(run: Trajectory) -> None:
    said = line(lambda: run.resultant("weight", [0.0, float("nan"), 0.0]))
    assert "must be a body, 3 finite numbers" in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"plan": [1]}, "plan: got [1]; must be a file, the name of a plan"),
        ({"out": None}, "out: got None; must be a folder"),
        ({"workers": "2"}, "workers: got '2'; must be a whole number >= 1"),
        ({"batch": 1.5}, "batch: got 1.5; must be a whole number >= 1"),
    ],
)
def test_a_sweep_says_what_it_takes(tmp_path: Any, arguments: dict[str, Any], said: str) -> None:
    pytest.importorskip("pyarrow")
    given: dict[str, Any] = {"plan": "coin", "out": tmp_path / "out", **arguments}
    assert said in line(lambda: rb_sim.sweep(**given))
