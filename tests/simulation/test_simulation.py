# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Instants that a caller names, states at events, and what Simulation says about itself."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import rb_sim
from rb_sim import RbSimError, Simulation, Trajectory, load_scene
from rb_sim.scene.compile import compile_scene
from rb_sim.simulation.scene_in_motion import Commands

G = 9.81
THROWN = {
    "bodies": {"b": {"mass": 2.0, "inertia": [1, 1, 1], "linear_velocity": [1.0, 0.0, 3.0]}},
    "effects": {"weight": {"type": "gravity"}},
    "simulation": {"duration": 0.5, "rate": 10, "method": "rk4", "step": 0.01},
}
DROPPED = {
    "bodies": {
        "b": {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [0, 0, 0.5]}
    },
    "constraints": {"floor": {"type": "contact", "body": "b", "restitution": 0.5}},
    "effects": {"weight": {"type": "gravity"}},
    "simulation": {"duration": 0.4, "rate": 10, "method": "rk4", "step": 0.01},
}


def _at():
    simulation = Simulation(THROWN, announce=None)
    times = [0.0, 0.123, 1.0 / 3.0, 0.77]
    first = simulation.run(at=times)
    second = simulation.run(at=[0.8, 0.9])
    simulation.reset()
    return first, second, simulation.run(), repr(simulation), simulation.sample()


def test_samples_lie_at_the_instants_given():
    first, second, whole, said, sample = _at()
    assert first.t.tolist() == [0.0, 0.123, 1.0 / 3.0, 0.77] and second.t.tolist() == [0.8, 0.9]
    for run in (first, second, whole):
        t = run.t
        expected = np.c_[t, 0 * t, 3.0 * t - 0.5 * G * t**2]  # rk4 is exact on a parabola
        np.testing.assert_allclose(run.position["b"], expected, atol=1e-14)
    assert isinstance(sample, Trajectory) and sample.t.tolist() == [0.5]
    assert "rk4, step 0.01 s" in said and "b" in said
    assert repr(whole).startswith("<Trajectory of scene: b; 6 samples, t = 0 to 0.5 s; rk4, step")
    assert repr(sample).startswith("<Trajectory of scene: b; 1 sample, t = 0.5 s; rk4, step 0.01")


@pytest.mark.parametrize(
    ("at", "said"),
    [
        ([], "got none"),
        ([[0.0, 1.0]], "got no list of numbers"),
        ([0.1, 0.1], "got 0.1 after 0.1"),
        ([-0.1, 0.1], "got -0.1"),
        ([0.1, np.nan], "got nan"),
        (["soon"], "got ['soon']"),
    ],
)
def test_instants_that_will_not_do(at, said):
    simulation = Simulation(THROWN, announce=None)
    with pytest.raises(RbSimError, match="^at: must be increasing finite numbers") as caught:
        simulation.run(at=at)
    assert said in str(caught.value)
    with pytest.raises(RbSimError, match="without duration and rate"):
        simulation.run(1.0, at=[0.1])


def _events():
    simulation = Simulation(DROPPED, announce=None)
    plain = simulation.run()
    simulation.reset()
    return plain, simulation.run(events=True)


def test_states_at_events():
    """A ball that falls 0.4 m and bounces with e = 0.5: its speed just before and just after."""
    plain, run = _events()
    fall, speed = np.sqrt(2 * 0.4 / G), np.sqrt(2 * G * 0.4)
    (bounce,) = [found for found in run.at_events if found.event.kind == "impact"]
    assert abs(bounce.event.t - fall) < 1e-13
    assert abs(bounce.before.linear_velocity["b"][2] + speed) < 1e-12
    assert abs(bounce.after.linear_velocity["b"][2] - 0.5 * speed) < 1e-12
    assert bounce.before.t < bounce.event.t < bounce.after.t < bounce.before.t + 1e-13
    shared = np.isin(run.t, plain.t)
    np.testing.assert_array_equal(run.position["b"][shared], plain.position["b"])
    assert run.events == plain.events
    with pytest.raises(RbSimError, match="no sample lies beside the event at t = 0.285568"):
        _ = plain.at_events


PUSHED = {
    **DROPPED,
    "effects": {**DROPPED["effects"], "push": {"type": "commanded_wrench", "body": "b"}},
}


@pytest.mark.parametrize(
    ("scene", "words"), [(DROPPED, "commanded_wrench, and the scene has none$"), (PUSHED, ": b$")]
)
def test_a_command_to_a_body_that_takes_none_names_those_that_do(scene, words):
    simulation = Simulation(scene, announce=None)
    with pytest.raises(RbSimError, match=f"^body: got 'c'; must be a body with an .*{words}"):
        simulation.apply_wrench("c", (0.0, 0.0, 0.0))


def _events_later():
    simulation = Simulation(PUSHED, announce=None)
    simulation.apply_wrench("b", (0.0, 0.0, -G), (0.0, 0.0, 0.0))
    simulation.advance(0.1)
    simulation.apply_wrench("b", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    simulation.set_state({"b": {"linear_velocity": [0.0, 0.0, -1.0]}})
    simulation.advance(0.05)
    return simulation.run(0.3, 10.0, events=True)


def test_states_at_events_from_any_time_on():
    """Pushed for 0.1 s with its weight, then thrown down at 1 m/s, looked at from 0.15 s on."""
    run = _events_later()
    height = 0.4 - G * 0.1**2  # twice g/2
    fall = (-1.0 + np.sqrt(1.0 + 2.0 * G * height)) / G
    (bounce,) = [found for found in run.at_events if found.event.kind == "impact"]
    assert abs(run.t[0] - 0.15) < 1e-15 and abs(bounce.event.t - (0.1 + fall)) < 1e-13
    assert abs(bounce.before.linear_velocity["b"][2] + 1.0 + G * fall) < 1e-12
    assert abs(bounce.after.linear_velocity["b"][2] - 0.5 * (1.0 + G * fall)) < 1e-12


@pytest.mark.parametrize("scene", ["heavy_top", "rolling_sphere_commanded", "bouncing_ball"])
def test_a_step_with_its_sample_is_the_step_and_then_the_sample(scene):
    """To the last bit: also where a command comes between, and with contacts."""
    together, apart = Simulation(scene, announce=None), Simulation(scene, announce=None)
    for k in range(20):
        if k == 7 and together.layout.commanded:
            for simulation in (together, apart):
                simulation.apply_wrench(together.layout.commanded[0], (1, 2, 0), (0, 0, 0.1))
        (row,) = together.step_rows(np.array([together.time + 0.013]))
        assert apart.advance(0.013)
        expected = apart.sample_row()
        assert row.t == expected.t
        np.testing.assert_array_equal(row.row, expected.row)
        np.testing.assert_array_equal(row.command, expected.command)


def test_a_step_with_its_sample_ends_where_its_watch_says():
    simulation = Simulation("heavy_top", announce=None)
    assert simulation.step_rows(np.array([1e4]), lambda _: False) == []
    assert simulation.time == 0.0


# Wrong arguments of the Python interface: one line with the field, the value, what is allowed.


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


def test_options_of_a_scene_replace_its_own() -> None:
    assert Simulation("heavy_top", method="rk4", step=1e-3).setting.step == 1e-3
    with pytest.raises(RbSimError, match=r"metod: unknown option; must be method, or one of"):
        Simulation("heavy_top", metod="rk4")
    with pytest.raises(RbSimError, match=r"loaded already; give method=... to load_scene"):
        Simulation(load_scene("heavy_top"), method="rk4")


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


def test_a_name_that_is_none_is_answered_with_those_there_are(run: Trajectory) -> None:
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
        f"state: got {sample!r}; must be the index of a sample, from -3 to 2"
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


# Commanded wrenches: what is reported of them is what acts.


FORCE, TORQUE = [1.0, -2.0, 0.5], [0.3, 0.1, -0.2]
MASS = 1.5


def commanded() -> Any:
    """Two samples, very close, of a body that is turned, under a command in its own axes."""
    from rb_sim import Simulation, load_scene

    body = {
        "mass": MASS,
        "inertia": [0.2, 0.2, 0.2],
        "orientation": {"axis": [1.0, 2.0, 2.0], "angle": 1.1},
    }
    scene = {
        "bodies": {"b": body},
        "effects": {"hand": {"type": "commanded_wrench", "body": "b"}},
        "simulation": {"duration": 1.0, "tolerance": 1e-12},
    }
    simulation = Simulation(load_scene(scene))
    simulation.apply_wrench("b", FORCE, TORQUE, "body")
    return simulation.run(1e-6, 1e6).block


def test_a_command_in_body_axes_is_reported_in_the_worlds() -> None:
    block = commanded()
    turn = Rotation.from_rotvec(1.1 / 3.0 * np.array([1.0, 2.0, 2.0]))
    assert_allclose(block.command[0, 0], [*turn.apply(FORCE), *turn.apply(TORQUE)], rtol=1e-12)
    push = MASS * (block.linear_velocity[1, 0] - block.linear_velocity[0, 0]) / 1e-6
    assert_allclose(push, block.command[0, 0, :3], rtol=1e-6)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e101, 1e300])
def test_what_no_double_can_square_is_no_command(value: float) -> None:
    """A box on the ground stayed as if nothing pushed it with 1e155 N."""
    from rb_sim import load_scene

    box = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    hand = {"hand": {"type": "commanded_wrench", "body": "box"}}
    commands = Commands(compile_scene(load_scene({"bodies": {"box": box}, "effects": hand})))
    for force, torque in (([0.0, value, 0.0], [0.0] * 3), ([0.0] * 3, [value, 0.0, 0.0])):
        with pytest.raises(RbSimError, match=r"must be 3 finite numbers, none beyond 1e\+100"):
            commands.read("box", force, torque, "world")
    assert commands.read("box", [1e100] * 3, [0.0] * 3, "world").force_W == (1e100,) * 3


def recorded() -> list[tuple[float, str, tuple[float, ...]]]:
    """The commands of a run in which the same one came three times, and its motion's energy."""
    from rb_sim import Simulation, load_scene

    box = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    hand = {"hand": {"type": "commanded_wrench", "body": "box"}}
    simulation = Simulation(load_scene({"bodies": {"box": box}, "effects": hand}))
    given = []
    for _ in range(3):
        simulation.apply_wrench("box", [2.0, 0.0, 0.0], [0.0] * 3)
        given += simulation.take_inputs()
        simulation.advance(0.1)
    return [(one.t, one.body, one.force) for one in given]


def test_a_command_that_is_in_force_already_is_recorded_with_its_time() -> None:
    """A bag has commands as they came."""
    found = recorded()
    assert [one[1:] for one in found] == [("box", (2.0, 0.0, 0.0))] * 3
    assert_allclose([one[0] for one in found], [0.0, 0.1, 0.2], rtol=1e-12)
