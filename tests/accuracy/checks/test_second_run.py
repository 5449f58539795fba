# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The second run states the error that closed forms give, and reports it above its bound."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.known_motions import stick_slip
from rb_sim import Simulation, Trajectory
from rb_sim.accuracy.checks.second_run import SecondRun, apart
from rb_sim.accuracy.checks.step_search import quiet_step, step_that_runs
from rb_sim.accuracy.choice import counted_time
from rb_sim.cli.main import app

W = 2.0 * math.pi

SPRING: dict[str, Any] = {
    "bodies": {"b": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": [1.0, 0.0, 0.0]}},
    "effects": {"s": {"type": "spring", "body": "b", "stiffness": W * W}},
}


def oscillation(**simulation: Any) -> dict[str, Any]:
    """x = cos 2 pi t, y = z = 0."""
    return SPRING | {"simulation": {"duration": 3.0, "rate": 200.0} | simulation}


def true_error(run: Trajectory) -> float:
    """The largest error of the position over the largest way from the start, which is 2 m."""
    return float(np.abs(run.position["b"][:, 0] - np.cos(W * run.t)).max() / 2.0)


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
@pytest.mark.parametrize(
    "simulation",
    [
        {"method": "rk4", "step": 0.05},
        {"method": "rk4", "step": 0.01},
        {"method": "gauss6", "step": 0.2},
        {"method": "euler", "step": 5e-5},
        {"method": "dopri853", "tolerance": 1e-3},
        {"method": "dopri853", "tolerance": 1e-7},
        {"method": "radau5", "tolerance": 1e-4},
    ],
)
def test_the_global_error_is_that_of_the_closed_form(simulation: dict[str, Any]) -> None:
    run = Simulation(oscillation(**simulation)).run()
    assert run.global_error is not None
    assert run.global_error.relative == pytest.approx(true_error(run), rel=0.25)
    assert run.global_error.body == "b"
    reported = any(found.check == "global error" for found in run.findings)
    assert reported == (run.global_error.relative > 1e-2)


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
def test_radau5_that_damps_an_oscillation_in_steps_of_any_length_is_found_wrong() -> None:
    """Shorter steps damp it as well: position and energy of both runs are zero after a few."""
    run = Simulation(oscillation(method="radau5", step=10.0, rate=0.1, duration=200.0)).run()
    assert true_error(run) > 0.4
    assert run.global_error is not None
    assert run.global_error.relative > 0.4
    assert "global error" in {found.check for found in run.findings}


def test_radau5_that_damps_what_is_overdamped_is_right() -> None:
    """Of a spring and a dashpot that let it creep: x = exp(-k t / c)."""
    settings = {"method": "radau5", "step": 0.05, "duration": 3.0, "rate": 20.0}
    scene = oscillation(**settings)
    drag = {"type": "linear_drag", "body": "b", "coefficient": 1e6 * W * W}
    run = Simulation(scene | {"effects": scene["effects"] | {"d": drag}}).run()
    np.testing.assert_allclose(run.position["b"][:, 0], np.exp(-1e-6 * run.t), rtol=1e-9)
    assert run.findings == ()


def test_the_error_is_largest_when_it_says() -> None:
    run = Simulation(oscillation(method="rk4", step=0.02)).run()
    assert run.global_error is not None
    errors = np.abs(run.position["b"][:, 0] - np.cos(W * run.t))
    assert run.global_error.t == pytest.approx(run.t[int(np.argmax(errors))], abs=0.02)


def test_steps_that_knots_of_a_table_cut_are_shorter_too() -> None:
    """A body of 1 kg under F = 60 t^2 N as straight lines between knots, in steps of one knot
    each: the second run has to cut the steps between the knots, or it shows no error."""
    knots = [0.1 * k for k in range(41)]
    scene = {
        "bodies": {"b": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}},
        "effects": {
            "w": {"type": "wrench_table", "body": "b", "times": knots,
                  "forces": [[60.0 * t * t, 0.0, 0.0] for t in knots], "interpolation": "linear"}
        },
        "simulation": {"duration": 4.0, "rate": 10.0, "method": "euler", "step": 0.25},
    }  # fmt: skip
    run = Simulation(scene).run()
    exact = Simulation(scene | {"simulation": {"duration": 4.0, "rate": 10.0, "tolerance": 1e-12}})
    true = exact.run().position["b"]
    error = np.abs(run.position["b"] - true).max() / np.abs(true).max()
    assert run.global_error is not None
    error *= np.abs(true).max() / np.abs(run.position["b"]).max()  # over the smaller motion
    # of a load in time alone this method is of order 2, so that shorter steps show more than by 1
    assert error < run.global_error.relative < 2.0 * error


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
@pytest.mark.parametrize("method", ["euler", "rk4"])
@pytest.mark.parametrize("periods", [1, 2, 3, 8, 13])
def test_a_load_that_is_at_one_phase_in_all_steps_is_seen(method: str, periods: int) -> None:
    """A force sin(w t) with whole periods in half of a step seems to be zero in all stages of all
    steps, and of all half steps; it drives the body by w/2 (1 - cos w t) m/s."""
    step = 0.01
    w = 2.0 * W * periods / step
    load = {"type": "wrench", "body": "b", "sine_force": [0.5 * w * w, 0, 0]}
    scene = {
        "bodies": {"b": {"mass": 1.0, "inertia": [1, 1, 1], "linear_velocity": [w, 0, 0]}},
        "effects": {"w": load | {"angular_frequency": w}},
        "simulation": {"duration": 1.0, "rate": 100.0, "method": method, "step": step},
    }
    run = Simulation(scene).run()
    exact = 1.5 * w * run.t - 0.5 * np.sin(w * run.t)
    assert np.abs(run.position["b"][:, 0] - exact).max() > 0.3 * exact.max()
    assert run.global_error is not None
    assert run.global_error.relative > 0.1
    assert "global error" in {found.check for found in run.findings}


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
def test_steps_that_events_of_contacts_cut_do_not_agree_by_themselves() -> None:
    """A body of 1 kg flies out at 1 m/s until an elastic string of 1 m turns it round in 0.01 s: to
    both 0.04 s and 0.62 of it that is one step, in which rk4 loses the motion."""
    taut = 0.01
    elastic = {"stiffness": (math.pi / taut) ** 2}
    string = {"type": "string", "body": "b", "point_A": [0, 0, 0], "length": 1.0}
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "linear_velocity": [1.0, 0.0, 0.0]}
    scene = {
        "bodies": {"b": body},
        "constraints": {"s": string | {"compliance": elastic}},
        "simulation": {"duration": 2.0, "rate": 100.0, "method": "rk4", "step": 0.04},
    }
    run = Simulation(scene).run()
    back = 1.0 - (run.t - 1.0 - taut)
    exact = np.where(run.t < 1.0 + 0.5 * taut, np.minimum(run.t, 1.0), back)
    error = float(np.abs(run.position["b"][:, 0] - exact).max())
    assert error > 0.05
    assert run.global_error is not None
    assert run.global_error.relative == pytest.approx(error, rel=0.2)


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
@pytest.mark.parametrize("step", [2e-3, 5e-4])
def test_short_steps_that_come_nearer_to_another_motion_are_found_wrong(step: float) -> None:
    """A box on a shaken floor, held by a spring, sticks where time stepping lets it slip on: a
    shorter step changes little of what is wrong."""
    box = {"mass": 1.0, "shape": {"type": "box", "size": [0.3, 0.2, 0.2]}, "position": [0, 0, 0.1]}
    shaken = {"type": "shaken", "direction": [1, 0, 0], "amplitude": 0.16, "frequency": 1.4}
    friction = {"type": "coulomb", "static": 0.5, "kinetic": 0.23}
    floor = {"type": "contact", "body": "p", "friction": friction, "motion": shaken}
    spring = {"type": "spring", "body": "p", "point_A": [0, 0, 0.1], "stiffness": 95.0}
    scene = {
        "bodies": {"p": box},
        "constraints": {"c": floor},
        "effects": {"w": {"type": "gravity", "acceleration": [0, 0, -9.81]}, "s": spring},
        "simulation": {"duration": 3.0, "rate": 200.0, "method": "time_stepping", "step": step},
    }
    run = Simulation(scene).run()
    x, exact = run.position["p"][:, 0], stick_slip(scene, run.t)
    error = np.abs(x - exact).max() / min(np.abs(x).max(), np.abs(exact).max())
    assert run.global_error is not None
    assert run.global_error.relative == pytest.approx(error, rel=0.05)


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
def test_commands_act_in_the_second_run_as_in_the_first() -> None:
    """A push that begins during the run moves the place of rest by F / k."""
    scene = oscillation(method="rk4", step=0.05, duration=3.0, rate=1000.0)
    scene["effects"] = scene["effects"] | {"c": {"type": "commanded_wrench", "body": "b"}}
    simulation, pushes = Simulation(scene), []

    def push(t: float, end: float) -> None:
        if t < end:
            pushes.append(t)
            simulation.apply_wrench("b", [10.0 * W * W, 0.0, 0.0], [0.0, 0.0, 0.0])

    run = simulation.run(progress=push)
    (begun,) = pushes
    since, x, v = W * (run.t - begun), math.cos(W * begun), -W * math.sin(W * begun)
    after = 10.0 + (x - 10.0) * np.cos(since) + v / W * np.sin(since)
    exact = np.where(run.t < begun, np.cos(W * run.t), after)
    error = np.abs(run.position["b"][:, 0] - exact).max() / np.abs(exact - 1.0).max()
    assert run.global_error is not None
    assert run.global_error.relative == pytest.approx(error, rel=0.25)


PENDULUM: dict[str, Any] = {
    "bodies": {"b": {"mass": 1.0, "inertia": [0.1, 0.1, 0.1], "position": [0.0, 0.0, -1.0],
                     "angular_velocity": [0.0, 1.0, 0.0]}},
    "constraints": {"j": {"type": "fixed_point", "body": "b", "point_B": [0.0, 0.0, 1.0]}},
    "effects": {"g": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
}  # fmt: skip


def moved_at(scene: dict[str, Any], at: float, state: dict[str, Any], **how: Any) -> Trajectory:
    """A run of 3 s in which the state of b is set at the end of the first block after `at` [s]."""
    options = {"duration": 3.0, "rate": 2000.0, "project_initial": True} | how
    simulation, done = Simulation(scene | {"simulation": options}), []

    def move(t: float, end: float) -> None:
        if at < t < end and not done:
            done.append(t)
            simulation.set_state({"b": state}, project=True)

    run = simulation.run(progress=move)
    assert done
    return run


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
@pytest.mark.parametrize(
    ("scene", "state"),
    [
        (SPRING, {"position": [3.0, 0.0, 0.0], "linear_velocity": [0.0, 1.0, 0.0]}),
        (PENDULUM, {"angular_velocity": [1.0, -3.0, 0.0]}),
    ],
)
@pytest.mark.parametrize("how", [{"method": "rk4", "step": 0.05}, {"tolerance": 1e-4}])
def test_a_state_that_is_set_in_the_run_is_set_in_the_second_one(
    scene: dict[str, Any], state: dict[str, Any], how: dict[str, Any]
) -> None:
    """Of a spring and of a pendulum, which goes on in other coordinates than before."""
    run = moved_at(scene, 0.5, state, **how)
    exact = moved_at(scene, 0.5, state, tolerance=1e-12).position["b"]
    error = np.linalg.norm(run.position["b"] - exact, axis=1).max()
    error /= np.linalg.norm(exact - exact[0], axis=1).max()
    assert run.global_error is not None and run.global_error.known
    assert 0.4 * error < run.global_error.relative < 4.0 * error


def test_a_box_on_a_floor_that_is_put_elsewhere_is_compared() -> None:
    box = {"mass": 1.0, "shape": {"type": "box", "size": [0.2, 0.2, 0.2]}}
    friction = {"type": "coulomb", "static": 0.3}
    scene = {
        "bodies": {"b": box | {"position": [0, 0, 0.1], "linear_velocity": [1.0, 0, 0]}},
        "constraints": {"floor": {"type": "contact", "body": "b", "friction": friction}},
        "effects": {"g": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
    }
    state = {"position": [5.0, 0, 0.1], "linear_velocity": [0, 2.0, 0], "orientation": [0, 0, 0, 1]}
    state |= {"angular_velocity": [0.0, 0.0, 0.0]}
    run = moved_at(scene, 0.5, state)
    assert run.global_error is not None and run.global_error.known
    assert run.global_error.relative < 1e-6
    assert not run.findings


def test_a_motion_that_samples_do_not_show_is_compared_between_them() -> None:
    """Sampled once a period the run stands still, and the second one as well."""
    simulation = {"method": "dopri853", "tolerance": 1e-6, "duration": 100.0, "rate": 1.0}
    run = Simulation(oscillation(**simulation)).run()
    dense = Simulation(oscillation(**simulation | {"rate": 100.0})).run(check=False)
    assert run.global_error is not None
    assert run.global_error.relative == pytest.approx(true_error(dense), rel=0.25)


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
def test_a_motion_that_starts_anywhere_is_checked_from_there() -> None:
    simulation = Simulation(oscillation(method="rk4", step=0.1))
    first = simulation.run(1.0, checks=False)
    assert first.global_error is None
    second = simulation.run(2.0, check=True)
    x, v = first.position["b"][-1, 0], first.linear_velocity["b"][-1, 0]
    since = W * (second.t - second.t[0])
    error = np.abs(second.position["b"][:, 0] - x * np.cos(since) - v / W * np.sin(since))
    way = np.abs(second.position["b"][:, 0] - x).max()
    assert second.global_error is not None
    assert second.global_error.relative == pytest.approx(error.max() / way, rel=0.25)


def test_auto_that_cannot_assure_its_error_warns() -> None:
    """A pendulum of 1 m that starts 1e-4 rad beside its upright position: errors grow by e^9 in the
    first swing and again in each further one."""
    angle = -math.pi + 1e-4
    rod = {"mass": 1.0, "inertia": [0.05, 0.08, 0.11]}
    rod |= {"position": [math.sin(1e-4), 0.0, 1.0 + math.cos(1e-4) - 1.0]}
    rod |= {"orientation": {"axis": [0, 1, 0], "angle": angle}}
    scene = {
        "bodies": {"p": rod},
        "constraints": {"j": {"type": "fixed_point", "body": "p", "point_B": [0, 0, 1.0]}},
        "effects": {"w": {"type": "gravity", "acceleration": [0, 0, -9.81]}},
        "simulation": {"duration": 30.0, "rate": 2.0, "project_initial": True}
        | {"method": "auto", "tolerance": 1e-12},
    }
    simulation = Simulation(scene)
    assert simulation.choice is not None and not simulation.choice.reached
    with pytest.warns(match="cannot be"):
        run = simulation.run()
    (found,) = [found for found in run.findings if found.check == "auto"]
    assert found.bound == 1e-12 < found.figure


def with_limits(monkeypatch: pytest.MonkeyPatch, afforded: float, longest: float) -> None:
    monkeypatch.setattr("rb_sim.accuracy.checks.second_run.AFFORDED", afforded)
    monkeypatch.setattr("rb_sim.accuracy.checks.second_run.LONGEST", longest)


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
def test_of_a_very_long_run_the_beginning_is_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    """With no time for more than a part of the second run: its error is that of the closed form."""
    with_limits(monkeypatch, 1e-4, 1e-4)
    simulation = Simulation(oscillation(method="euler", step=2e-5, duration=30.0))
    run = simulation.run()
    error = run.global_error
    assert error is not None and error.upto is not None and 0.0 < error.upto < 30.0
    part = run.t <= error.upto
    wrong = np.abs(run.position["b"][part, 0] - np.cos(W * run.t[part])).max()
    way = np.abs(run.position["b"][part, 0] - 1.0).max()
    assert error.relative == pytest.approx(wrong / way, rel=0.25)


@pytest.mark.parametrize(
    "how", [{"method": "rk4", "step": 2e-3}, {"method": "dopri853", "tolerance": 1e-9}]
)
def test_a_long_run_is_right_where_a_coarser_one_agrees(
    monkeypatch: pytest.MonkeyPatch, how: dict[str, Any]
) -> None:
    """Its error is less than the difference of the two, and the whole run is compared."""
    with_limits(monkeypatch, 0.0, 20.0)
    run = Simulation(oscillation(**how)).run()
    error = run.global_error
    assert error is not None and error.upto is None and error.below
    assert true_error(run) < error.relative < 1e-2
    assert not run.findings


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
@pytest.mark.parametrize(
    "how",
    [
        {"method": "rk4", "step": 0.05},
        {"method": "euler", "step": 5e-3},
        {"method": "dopri853", "tolerance": 1e-3},
    ],
)
def test_a_long_run_that_differs_from_a_coarser_one_is_made_again_finer(
    monkeypatch: pytest.MonkeyPatch, how: dict[str, Any]
) -> None:
    with_limits(monkeypatch, 0.0, 20.0)
    run = Simulation(oscillation(**how)).run()
    error = run.global_error
    assert error is not None and error.upto is None and not error.below
    assert error.relative == pytest.approx(true_error(run), rel=0.25)


def test_what_is_compared_does_not_hang_on_a_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = Simulation(oscillation(method="rk4", step=0.01)).run().global_error
    clock = itertools.count(0.0, 100.0)
    monkeypatch.setattr("rb_sim.simulation.simulation.own_time", lambda: next(clock))
    slow = Simulation(oscillation(method="rk4", step=0.01))
    assert slow.run().global_error == plain
    assert slow.stepping_time >= 100.0


def balls(distance: float) -> dict[str, Any]:
    """27 balls in a lattice above a floor, so far apart, in units of their diameter."""
    places = itertools.product(range(3), repeat=3)
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}
    bodies = {
        f"b{i}{j}{k}": ball
        | {
            "position": [
                0.2 * distance * i,
                0.2 * distance * j,
                0.1 + 0.2 * distance * k + 0.01 * distance,
            ]
        }
        for i, j, k in places
    }
    of_all = {"type": "contact", "friction": {"type": "coulomb", "static": 0.3, "kinetic": 0.3}}
    return {
        "bodies": bodies,
        "constraints": {"each": of_all | {"between": "all"}, "floor": of_all | {"body": "all"}},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 0.1, "rate": 20.0, "method": "time_stepping", "step": 0.02},
    }


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
def test_the_solver_of_a_pile_is_counted() -> None:
    """The same bodies and steps: a pile costs what its contacts do, not what its bodies do."""
    counted = []
    for distance in (1.0, 10.0):
        simulation = Simulation(balls(distance), announce=None)
        simulation.run(0.1, 20.0, check=False)
        counted.append(counted_time(simulation.motion, simulation.setting))
    assert counted[0] > 3.0 * counted[1] > 0.0


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
def test_no_other_method_is_advised_where_none_takes_the_scene() -> None:
    """Two balls that fall on each other in long steps; only time stepping takes `between`."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}
    contact = {"type": "contact", "restitution": 0.8}
    scene = {
        "bodies": {"a": ball | {"position": [0, 0, 0.5]}, "b": ball | {"position": [0.02, 0, 0.9]}},
        "constraints": {"each": contact | {"between": "all"}, "floor": contact | {"body": "all"}},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 1.0, "method": "time_stepping", "step": 0.01},
    }
    simulation = Simulation(scene, announce=None)
    found = simulation.run().findings
    assert found and any("try step" in finding.advice for finding in found)
    assert not [finding for finding in found if "dopri853" in finding.advice]
    assert "dopri853" not in quiet_step(simulation, found)
    assert "dopri853" not in step_that_runs(simulation, 0.5, 1.0)


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
def test_a_run_of_few_steps_is_looked_at_where_they_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Anywhere else a look costs a step more, of which a run of five steps has five."""
    looks: list[float] = []
    kept = SecondRun._carried

    def carried(self: SecondRun, trial: Any, grid: Any, limit: float) -> Any:
        looks.extend(grid.tolist())
        return kept(self, trial, grid, limit)

    monkeypatch.setattr(SecondRun, "_carried", carried)
    run = Simulation(balls(1.0), announce=None).run(0.1, 20.0, check=True)
    assert run.global_error is not None and run.global_error.known
    ends = np.union1d(0.02 * np.arange(6), run.t)
    assert set(np.round(looks, 12)) == set(np.round(ends, 12))


def test_nobody_makes_a_second_run_who_is_not_to() -> None:
    simulation = Simulation(oscillation(method="rk4", step=0.01))
    assert simulation.run(check=False).global_error is None
    simulation.reset()
    assert simulation.run(checks=False).global_error is None


def test_a_run_at_rest_in_contact_has_no_error() -> None:
    scene = {
        "bodies": {"b": {"mass": 2.0, "shape": {"type": "box", "size": [1.0, 1.0, 1.0]},
                         "position": [0.0, 0.0, 0.5]}},
        "constraints": {"floor": {"type": "contact", "body": "b",
                                  "friction": {"type": "coulomb", "static": 0.5}}},
        "effects": {"g": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
    }  # fmt: skip
    for how in ({"tolerance": 1e-4}, {"method": "time_stepping", "step": 0.01}):
        simulation = {"duration": 1.0, "rate": 100.0} | how
        run = Simulation(scene | {"simulation": simulation}).run()
        assert run.global_error is not None
        assert run.global_error.relative < 1e-2


def test_the_summary_states_it_and_strict_ends_with_3(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps(oscillation(method="rk4", step=0.1)))
    out = tmp_path / "out"
    options = ["run", str(scene), "--out", str(out), "--no-plots", "--no-rerun", "--strict"]
    ended = CliRunner().invoke(app, options)
    assert ended.exit_code == 3
    summary = json.loads((out / "summary.json").read_text())
    shown = Trajectory.from_bag  # the bag tells the same
    with pytest.warns(match="global error"):
        run = shown(out / "bag")
    assert run.global_error is not None
    assert summary["global_error"]["relative"] == run.global_error.relative
    assert run.global_error.relative == pytest.approx(true_error(run), rel=0.25)
    said = " ".join(ended.output.split())
    assert f"global error {summary['global_error']['text']}" in said
    ended = CliRunner().invoke(app, [*options, "--overwrite", "--no-check"])
    assert json.loads((out / "summary.json").read_text())["global_error"]["unknown"]


@pytest.mark.parametrize("exploded", [1e160, math.inf, math.nan])
def test_a_second_run_that_has_exploded_is_no_agreement(exploded: float) -> None:
    """Its distance overflows, and so does the distance that rounding may move a body by."""
    simulation = Simulation(oscillation(method="euler", step=0.01))
    one = np.zeros((3, 1, 7))
    one[..., 6] = 1.0
    one[:, 0, 0] = [0.0, 1.0, 2.0]
    two = one.copy()
    two[2, 0, :3] = exploded
    found = apart(np.arange(3.0), one, two, simulation)
    assert found.relative > 1e-2
    assert found.t == 2.0
