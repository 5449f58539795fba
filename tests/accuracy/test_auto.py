# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`method: auto` keeps the global error it is asked for, cheaply, and says where it cannot."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from benchmarks import auto_search
from benchmarks.peers import scenes
from benchmarks.peers.reference import Reference, pose_error
from rb_sim import Simulation, load_scene
from rb_sim.accuracy import auto
from rb_sim.accuracy.auto import choose
from rb_sim.accuracy.checked import CheckedRun
from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.closed_forms import closed_form
from rb_sim.accuracy.ladder import climb
from rb_sim.accuracy.runs import (
    Runner,
    affordable_times,
    pose_difference,
    sample_times,
)
from rb_sim.numerics.rotations import angle_between
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping

CONFIG = Path(__file__).resolve().parents[2] / "config"
BEST = {"free_tumble": 1e-9, "gazebo_boxes": 1e-10}
"""Sharpest of 1e-9, 1e-10 and 1e-11 that a shipped scene reaches, where it is not the last."""
KNOWN: dict[str, Any] = {}


def shipped(name: str, **overrides: Any):
    return load_scene(CONFIG / f"{name}.yaml", **overrides)


def truth(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(times, positions, quaternions) by a Taylor series in 192 bits, apart from rb_sim."""
    if name not in KNOWN:
        scene = scenes.load(name)
        KNOWN[name] = (scene.times, *Reference(scene).pose(scene.times))
    return KNOWN[name]


def true_error(name: str, simulation: Simulation) -> float:
    """Largest pose error [rad, m] over the scene, at the reference's instants."""
    times, position, quaternion = truth(name)
    rate = (len(times) - 1) / float(times[-1])
    own = simulation.run(float(times[-1]), rate, checks=False)
    (body,) = simulation.layout.bodies
    assert np.abs(own.t - times).max() < 1e-9
    pose = own.position[body], own.orientation[body]
    return float(pose_error(*pose, position, quaternion).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", scenes.NAMES)
def test_the_true_error_stays_under_the_target_on_every_shipped_scene(name: str) -> None:
    reached = []
    best = BEST.get(name, 1e-11)
    for target in sorted({1e-2, best, 1e-11}):
        simulation = Simulation(shipped(name, method="auto", tolerance=target))
        choice = simulation.choice
        assert choice is not None
        error = true_error(name, simulation)
        if choice.reached:
            assert error <= target, choice
            reached.append(target)
        else:
            # what it gives instead is what it says, and the target is in sight of round-off
            assert error <= 3.0 * choice.predicted_error, choice
            assert "cannot be" in choice.reason
            assert target < 1e-9
    assert min(reached) <= best


@pytest.mark.slow
def test_the_choice_costs_at_most_twice_the_cheapest_found_by_hand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`python -m benchmarks.auto_search` asks it of many scenes."""
    # costs are counted here: of each rung one run is timed, not as many as make a good figure
    measured = functools.partialmethod(Runner.measured_cost, budget=0.0)
    monkeypatch.setattr(Runner, "measured_cost", measured)
    scene = shipped("pendulum")
    accuracy = climb(scene, budget=15.0)
    compiled = compile_scene(scene)
    times = sample_times(scene.simulation)
    runner = Runner(compiled, scene.simulation.duration, times)
    for target in (1e-2, 1e-4, 1e-6, 1e-8):
        options = shipped("pendulum", method="auto", tolerance=target).simulation
        choice = choose(compiled, options)
        able = [r.setting for r in accuracy.rungs if r.errors.pose <= target]
        assert choice.reached and able
        by_hand = min(able, key=runner.cost)
        assert runner.cost(choice.setting) < 2.0 * runner.cost(by_hand), (choice, by_hand)


def test_a_simulation_with_method_auto_shows_its_choice() -> None:
    simulation = Simulation(shipped("pendulum", method="auto", tolerance=1e-6))
    choice = simulation.choice
    assert choice is not None and choice.reached
    assert choice.predicted_error <= 1e-6
    assert (choice.step is None) != (choice.tolerance is None)
    assert type(simulation.method).__name__.lower().endswith(choice.method)
    assert choice.as_dict()["target"] == 1e-6
    assert "1e-06 (rad, m) over 20 s" in str(choice)
    assert true_error("pendulum", simulation) <= 1e-6


def test_a_scene_with_another_method_has_no_choice() -> None:
    assert Simulation(shipped("pendulum", method="rk4", step=0.01)).choice is None


def test_a_target_below_round_off_is_refused_in_words_and_the_best_is_given() -> None:
    simulation = Simulation(shipped("pendulum", method="auto", tolerance=1e-15))
    choice = simulation.choice
    assert choice is not None and not choice.reached
    assert "cannot be kept" in choice.reason and "round-off" in choice.reason
    assert true_error("pendulum", simulation) < 1e-10


@pytest.fixture
def runners(monkeypatch: pytest.MonkeyPatch) -> list[Runner]:
    """The runners that searches make, as they make them."""
    found: list[Runner] = []

    def made(*arguments: Any) -> Runner:
        found.append(Runner(*arguments))
        return found[-1]

    monkeypatch.setattr(auto, "Runner", made)
    return found


@pytest.mark.parametrize("duration", [20.0, 2e3])
def test_the_search_costs_five_runs_or_a_second_of_counted_work(
    duration: float, runners: list[Runner]
) -> None:
    scene = shipped("pendulum", method="auto", tolerance=1e-4, duration=duration)
    choice = auto.choose(compile_scene(scene), scene.simulation)
    assert choice.reached
    (runner,) = runners
    assert runner.spent <= max(1.0, 5.0 * choice.cost * duration)


def test_no_run_goes_beyond_the_purse() -> None:
    """A fixed step whose price is known is not begun, an adaptive run is broken off."""
    scene = shipped("pendulum", duration=2e3)
    runner = Runner(compile_scene(scene), 2e3, sample_times(scene.simulation))
    runner.total_limit = 5e-3
    rows, steps = runner.sampled(Setting("rk4", step=1e-4))
    assert runner.stopped and steps == 0 and runner.spent == 0.0
    assert np.isnan(rows).all()
    runner.sampled(Setting("dopri853", tolerance=1e-12))
    assert runner.stopped and runner.spent < 1.3 * runner.total_limit
    assert runner.known_cost(Setting("dopri853", tolerance=1e-12)) == 0.0  # not infinite


def test_the_search_of_a_scene_nobody_tuned_for_keeps_its_purse(
    runners: list[Runner],
) -> None:
    """One whose last run went beyond the second."""
    scene = load_scene(auto_search.drawn("chain", 7))
    choice = auto.choose(compile_scene(scene), scene.simulation)
    assert runners[0].spent <= max(1.0, 5.0 * choice.cost * scene.simulation.duration)


PAIR = """
bodies:
  a: {mass: 1.0, inertia: [0.02, 0.03, 0.04], angular_velocity: [1, 2, 3]}
  b: {mass: 1.0, inertia: [0.02, 0.03, 0.04], position: [1, 0, 0], angular_velocity: [2, -1, 1]}
effects:
  s:
    {type: spring, body: a, parent: b, point_B: [0.1, 0, 0], point_A: [0, 0.1, 0], stiffness: 50.0,
     damping: 0.0, rest_length: 0.6}
simulation: {rate: 40, duration: 5.0, method: auto, tolerance: 1.0e-10}
"""


def run_by_auto(mapping: Any, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, set[str]]:
    """The choice, and the methods of which runs were made."""
    names: set[str] = set()

    class Noting(Runner):
        def sampled(self, setting: Any, y: Any = None) -> Any:
            names.add(setting.name)
            return super().sampled(setting, y)

    monkeypatch.setattr(auto, "Runner", Noting)
    scene = scene_from_mapping(mapping)
    return auto.choose(compile_scene(scene), scene.simulation), names


def test_taylor_is_weighed_in_maximal_coordinates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two bodies on a spring: by a run; at a loose target its price says enough."""
    mapping = yaml.safe_load(PAIR)
    choice, names = run_by_auto(mapping, monkeypatch)
    assert choice.reached and "taylor" in names
    assert run_by_auto(mapping, monkeypatch)[0] == choice
    mapping["simulation"]["tolerance"] = 1e-3
    choice, names = run_by_auto(mapping, monkeypatch)
    assert choice.reached and "taylor" not in names


def test_a_run_too_long_for_the_search_is_not_called_chaotic() -> None:
    """Ten thousand swings of a pendulum: an ulp grows by their number, the search ends before."""
    scene = shipped("pendulum", method="auto", tolerance=1e-4, duration=4e4)
    choice = choose(compile_scene(scene), scene.simulation)
    assert choice.reached or ("chaos" not in choice.reason and "differ by" in choice.reason)


OILED: dict[str, Any] = {
    "bodies": {
        "arm": {
            "mass": 1.0,
            "inertia": [0.02, 0.03, 0.04],
            "center_of_mass": [0.2, 0.0, 0.0],
            "angular_velocity": [1.0, 2.0, 3.0],
        },
        "tip": {"mass": 0.5, "inertia": [0.01, 0.02, 0.015], "position": [0.5, 0.0, 0.0]},
    },
    "constraints": {
        "pivot": {"type": "fixed_point", "body": "arm"},
        "rod": {"type": "distance", "body": "tip", "parent": "arm", "point_A": [0.2, 0.0, 0.0]},
    },
    "effects": {
        "weight": {"type": "gravity"},
        "oil": {"type": "angular_damping", "body": "arm", "coefficient": 1000.0},
    },
}


def test_a_decay_too_fast_for_fixed_steps_is_checked_by_an_adaptive_method() -> None:
    """The arm's spin decays in 0.03 ms: fixed steps as short do not come to the end of 2 s within
    the search, while radau5 takes longer ones."""
    options = {"duration": 2.0, "rate": 50.0, "project_initial": True}
    simulation = Simulation(
        load_scene(OILED | {"simulation": options | {"method": "auto", "tolerance": 1e-4}})
    )
    choice = simulation.choice
    assert choice is not None and choice.reached, choice
    assert choice.method == "radau5"
    sharp = Simulation(
        load_scene(OILED | {"simulation": options | {"method": "dopri853", "tolerance": 1e-12}})
    )
    run, true = (each.run(checks=False).block for each in (simulation, sharp))
    assert np.abs(run.position - true.position).max() <= 1e-4
    assert float(angle_between(run.orientation, true.orientation).max()) <= 1e-4


def test_what_one_ulp_does_not_make_is_not_called_round_off() -> None:
    """Of a motion that forgets its start, two methods part because the search ends."""
    oil = OILED["effects"]["oil"] | {"coefficient": 1e5}
    options = {"duration": 2.0, "rate": 50.0, "project_initial": True}
    scene = OILED | {
        "effects": OILED["effects"] | {"oil": oil},
        "simulation": options | {"method": "auto", "tolerance": 1e-8},
    }
    choice = Simulation(load_scene(scene)).choice
    assert choice is not None and not choice.reached
    assert "differ by" in choice.reason
    assert "round-off" not in choice.reason


def test_the_same_scene_gets_the_same_setting() -> None:
    scene = shipped("pendulum", method="auto", tolerance=1e-6)
    compiled = compile_scene(scene)
    first = choose(compiled, scene.simulation)
    assert choose(compile_scene(scene), scene.simulation) == first


def test_a_body_that_passes_its_anchor_is_right_at_a_loose_target() -> None:
    """The spring turns about at the anchor: two runs agree there by chance long before they are
    right, or not at all; the check goes on until they do."""
    mapping = yaml.safe_load(TUMBLER)
    loose = Simulation(scene_from_mapping(mapping)).choice
    assert loose is not None and loose.reached
    mapping["simulation"] |= {"method": "dopri853", "tolerance": 1e-14}
    true = Simulation(scene_from_mapping(mapping)).run(checks=False)
    mapping["simulation"] = {**mapping["simulation"], "method": loose.method}
    del mapping["simulation"]["tolerance"]
    knob = {"step": loose.step} if loose.step is not None else {"tolerance": loose.tolerance}
    own = Simulation(scene_from_mapping({**mapping, "simulation": mapping["simulation"] | knob}))
    found = own.run(checks=False)
    pose = found.position["a"], found.orientation["a"]
    assert pose_error(*pose, true.position["a"], true.orientation["a"]).max() <= 1e-3


TUMBLER = """
bodies:
  a:
    mass: 1.0
    shape: {type: box, size: [0.1, 0.2, 0.3]}
    angular_velocity: [1, 2, 3]
effects:
  weight: {type: gravity, acceleration: [0.0, 0.0, -9.81]}
  s:
    {type: spring, body: a, point_B: [0.05, 0, 0], point_A: [0, 0, 1.0], stiffness: 200.0,
     damping: 0.5, rest_length: 0.5}
simulation: {rate: 40, duration: 5.0, method: auto, tolerance: 1.0e-3}
"""

CHAOTIC = {
    "bodies": {
        "top": {
            "mass": 1.0,
            "inertia": [0.02, 0.03, 0.011],
            "center_of_mass": [0.05, 0.3, 0.1],
            "angular_velocity": [2.0, 3.0, 1.0],
        }
    },
    "constraints": {"tip": {"type": "fixed_point", "body": "top"}},
    "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
    "simulation": {"duration": 150.0, "method": "auto", "tolerance": 1e-6},
}


@pytest.mark.slow
def test_chaos_is_named_where_it_takes_the_target_away() -> None:
    choice = Simulation(scene_from_mapping(CHAOTIC)).choice
    assert choice is not None and not choice.reached
    assert choice.predicted_error > 1e-3
    assert "chaos" in choice.reason
    short = {**CHAOTIC, "simulation": {**CHAOTIC["simulation"], "duration": 3.0}}
    again = Simulation(scene_from_mapping(short)).choice
    assert again is not None and again.reached


def swung(duration: float, tolerance: float) -> Any:
    """A double pendulum that turns over, compiled, and the options of its run by auto."""
    rod = {"mass": 1.0, "inertia": [0.001, 0.08, 0.08]}
    hinge = {"type": "fixed_axis", "axis_B": [0, 1, 0], "axis_A": [0, 1, 0]}
    hinge["point_B"] = [-0.5, 0, 0]
    joint = {"body": "lower", "parent": "upper", "point_A": [0.5, 0, 0]}
    options = {"duration": duration, "rate": 50.0, "method": "auto", "tolerance": tolerance}
    scene = load_scene(
        {
            "bodies": {
                "upper": rod | {"position": [0.5, 0, 0]},
                "lower": rod | {"position": [1.5, 0, 0]},
            },
            "constraints": {"wall": hinge | {"body": "upper"}, "joint": hinge | joint},
            "effects": {"weight": {"type": "gravity"}},
            "simulation": options,
        }
    )
    return compile_scene(scene), scene.simulation


def test_two_runs_that_err_alike_are_told_apart_by_a_third() -> None:
    """Chaos turns the errors of all methods one way; here the checker errs just as the run does."""
    compiled, options = swung(8.0, 1e-6)
    runner = Runner(compiled, options.duration, sample_times(options))
    setting = Setting("dopri853", tolerance=1e-8)
    rows, steps = runner.sampled(setting)
    alike = CheckedRun(rows, rows, setting, setting, np.zeros(len(rows)), 8.0 / steps)
    tight, _ = runner.sampled(Setting("dopri853", tolerance=1e-13))
    error = float(pose_difference(rows, tight, compiled.layout).max())
    base, _ = runner.sampled(setting)
    growth = max(
        auto.apart(rows, base, runner) for rows in auto.from_one_ulp_apart(runner, setting, 1)
    )
    assert 0.5 * error < auto.change_when_sharper(runner, alike, growth) < 2.0 * error
    assert error > 1e-7


def test_a_search_that_ends_for_its_budget_says_so() -> None:
    """Not chaos and not round-off: gauss6 at a step of 1 ms and dopri853 at a tolerance of 1e-13
    agree to 2e-9."""
    compiled, options = swung(12.0, 1e-8)
    choice = choose(compiled, options)
    assert not choice.reached
    assert "counted seconds of search" in choice.reason and "differ by" in choice.reason
    assert "round-off" not in choice.reason


def test_a_commanded_body_gets_a_method_that_adapts_its_step() -> None:
    drive = {"drive": {"type": "commanded_wrench", "body": "nut"}}
    body = {"mass": 1.0, "inertia": [1.0, 2.0, 3.0], "angular_velocity": [0.01, 2.0, 0.01]}
    options = {"duration": 5.0, "method": "auto", "tolerance": 1e-6}
    mapping = {"bodies": {"nut": body}, "effects": drive, "simulation": options}
    choice = Simulation(scene_from_mapping(mapping)).choice
    assert choice is not None and choice.reached
    assert choice.tolerance is not None and choice.step is None


@pytest.mark.slow
@pytest.mark.parametrize("target", [1e-3, 1e-9])
def test_the_true_error_stays_under_the_target_on_a_scene_in_contact(target: float) -> None:
    simulation = Simulation(shipped("turntable", method="auto", tolerance=target))
    choice, exact = simulation.choice, closed_form(simulation.compiled)
    assert choice is not None and choice.reached and exact is not None
    own = simulation.run(14.7, 20.0, checks=False)
    y = exact.coordinates(own.t)
    pose = own.position["ball"], own.orientation["ball"]
    assert pose_error(*pose, y[:, 0:3], y[:, 3:7]).max() <= target


def resting(points: int) -> dict[str, Any]:
    """A box on so many points, of its face or fewer; they hold it by three lines each."""
    lies = {"mass": 1.0, "shape": {"type": "box", "size": [0.4, 0.3, 0.2]}}
    corners = [[x, y, -0.1] for x in (-0.2, 0.2) for y in (-0.15, 0.15)]
    floor = {"type": "contact", "body": "b", "points": corners[:points]}
    floor["friction"] = {"type": "coulomb", "static": 0.5}
    return {
        "bodies": {"b": lies | {"position": [0.0, 0.0, 0.1]}},
        "constraints": {"floor": floor},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 5.0, "method": "auto", "tolerance": 1e-6},
    }


def test_a_search_whose_samples_are_dear_takes_fewer(runners: list[Runner]) -> None:
    scene = load_scene(resting(4))
    choice = auto.choose(compile_scene(scene), scene.simulation)
    times = runners[0].times
    assert choice.reached and runners[0].spent <= 1.0
    assert times[0] == 0.0 and times[-1] == 5.0 and 64 <= len(times) < 200
    assert np.allclose(np.diff(times), times[1], rtol=1e-9)
    cheap = shipped("pendulum")
    fine = affordable_times(compile_scene(cheap), cheap.simulation)
    assert np.array_equal(fine, sample_times(cheap.simulation))


@pytest.mark.parametrize("bodies", [1, 2])
def test_no_time_is_lost_to_an_iteration_that_friction_turns_away(
    bodies: int, runners: list[Runner]
) -> None:
    """A box slides and spins to rest on its face. Fixed steps of gauss6, the checker that comes
    first, have no solution at the end of the slip, and took 0.7 s for one box and 3 s for two to
    find none in ever shorter steps, inside one call of the loop, which counts no step of it."""
    box = {"mass": 1.0, "shape": {"type": "box", "size": [0.3, 0.2, 0.1]}}
    box |= {"linear_velocity": [0.0, 2.0, 0.0], "angular_velocity": [0.0, 0.0, 3.0]}
    rub = {"type": "coulomb", "static": 0.5, "kinetic": 0.4}
    names = [f"box{i}" for i in range(bodies)]
    scene = load_scene(
        {
            "bodies": {n: box | {"position": [2.0 * i, 0.0, 0.05]} for i, n in enumerate(names)},
            "constraints": {
                f"floor{n}": {"type": "contact", "body": n, "friction": rub} for n in names
            },
            "effects": {"weight": {"type": "gravity"}},
            "simulation": {"duration": 2.0, "rate": 100.0, "method": "auto", "tolerance": 1e-5},
        }
    )
    choice = auto.choose(compile_scene(scene), scene.simulation)
    (runner,) = runners
    assert choice.reached and "rk4" in choice.reason
    assert not any(setting.name == "gauss6" for setting in runner._rows)
    assert runner.spent <= max(1.0, 5.0 * choice.cost * 2.0)


def test_a_trial_that_the_purse_cannot_pay_is_not_begun(runners: list[Runner]) -> None:
    """Three boxes; the second start one ulp apart was broken off, and what it had not told made
    the two runs, which agree to 1e-15, "no reference"."""
    scene = load_scene(auto_search.drawn("resting", 3))
    choice = auto.choose(compile_scene(scene), scene.simulation)
    assert choice.reached and choice.predicted_error < 1e-14
