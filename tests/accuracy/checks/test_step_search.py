# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The step that warnings or a failure name has been tried: no check finds fault with it."""

from __future__ import annotations

import re
import warnings
from types import SimpleNamespace
from typing import Any

import pytest

from rb_sim import Simulation, SimulationError, load_scene
from rb_sim.accuracy.checks import step_search as search
from rb_sim.accuracy.checks.check import effort_of
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.base.errors import Finding
from rb_sim.cli.verbs.run import FAILED, RunOptions
from rb_sim.cli.verbs.run import run as command

W = 1e3
"""Frequency of the oscillator [rad/s]."""

OSCILLATOR = {
    "bodies": {"bob": {"mass": 1.0, "inertia": [0.1] * 3, "position": [0.01, 0.0, 0.0]}},
    "effects": {
        "spring": {"type": "spring", "body": "bob", "stiffness": W * W, "rest_length": 0.0}
    },
    "simulation": {"duration": 0.4, "rate": 250},
}
SPINNER = {
    "bodies": {"wheel": {"mass": 1.0, "inertia": [1, 1, 2], "angular_velocity": [0, 0, 40]}},
    "simulation": {"duration": 2.0, "rate": 50},
}
DRAGGED = {
    "bodies": {"ball": {"mass": 1.0, "inertia": [1, 1, 1], "linear_velocity": [3.0, 0, 0]}},
    "effects": {"air": {"type": "linear_drag", "body": "ball", "coefficient": 8.0}},
    "simulation": {"duration": 2.0, "rate": 200},
}
TWO_ARMS = {
    "bodies": {
        "upper": {
            "mass": 1.0,
            "inertia": [0.1, 0.1, 0.01],
            "center_of_mass": [0.0, 0.0, -0.5],
            "orientation": {"axis": [0.0, 1.0, 0.0], "angle": 2.0},
        },
        "lower": {
            "mass": 1.0,
            "inertia": [0.1, 0.1, 0.01],
            "center_of_mass": [0.0, 0.0, -0.5],
            "position": [-0.9092974268256817, 0.0, 0.4161468365471424],
        },
    },
    "constraints": {
        "shoulder": {
            "type": "fixed_axis",
            "body": "upper",
            "axis_B": [0.0, 1.0, 0.0],
            "bearing_distance": 0.2,
        },
        "elbow": {
            "type": "fixed_axis",
            "body": "lower",
            "parent": "upper",
            "axis_B": [0.0, 1.0, 0.0],
            "bearing_distance": 0.2,
        },
    },
    "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
    "simulation": {"duration": 5.0, "rate": 100},
}


def reported(capfd: pytest.CaptureFixture[str], scene: Any, **how: Any) -> list[str]:
    """The lines of warning of a run on the command line."""
    command(RunOptions(scene, quiet=True, **how))
    return [line for line in capfd.readouterr().err.splitlines() if line.startswith("warning")]


@pytest.mark.parametrize("scene", [OSCILLATOR, TWO_ARMS])
def test_a_trial_does_not_trace_the_laws_again(scene: dict[str, Any]) -> None:
    """Which is most of its time where the motion is short; in one set of coordinates and in the
    other."""
    how = {"method": "rk4", "step": 1e-3}
    simulation = Simulation(load_scene(scene | {"simulation": scene["simulation"] | how}))
    trial = simulation.with_step(2e-3)
    assert trial.setting.step == 2e-3
    assert trial.compiled.laws is simulation.compiled.laws
    assert trial.with_step(4e-3).compiled.laws is simulation.compiled.laws


@pytest.mark.parametrize(
    ("scene", "method", "step", "watch"),
    [
        ("heavy_top", "rk4", 0.004, "energy"),
        ("heavy_top", "gauss6", 0.02, "momentum"),
        ("pendulum", "euler", 0.05, "global error"),
        ("free_tumble", "rk4", 0.5, "global error"),
        (OSCILLATOR, "gauss6", 0.004, "step"),
        (OSCILLATOR, "euler", 4e-4, "step"),
        (SPINNER, "rk4", 0.1, "global error"),
        (DRAGGED, "euler", 0.05, "step"),
        (TWO_ARMS, "rk4", 0.05, "energy"),
    ],
)
def test_the_step_named_ends_every_warning(
    capfd: pytest.CaptureFixture[str],
    tmp_path: Any,
    scene: Any,
    method: str,
    step: float,
    watch: str,
) -> None:
    if isinstance(scene, dict):
        file = tmp_path / "scene.yaml"
        file.write_text(load_scene(scene).text, encoding="utf-8")
        scene = str(file)
    lines = reported(capfd, scene, method=method, step=step)
    assert any(line.startswith(f"warning: {watch}: ") for line in lines), lines
    (named,) = re.findall(r"use step ([0-9.e-]+) s, which passes", "".join(lines))  # said once
    finer = float(named)
    assert finer <= 0.5 * step
    assert reported(capfd, scene, method=method, step=finer) == []


def watched(scene: dict[str, Any], **how: Any) -> tuple[Simulation, tuple[Finding, ...]]:
    """A run to its end, and what its checks found."""
    simulation = Simulation(load_scene(scene, **how), announce=None)
    check_list = CheckList(simulation.scene, simulation.layout)
    options = simulation.scene.simulation
    for block in simulation.blocks(options.duration, options.rate):
        check_list.add(block, effort_of(simulation))
    return simulation, check_list.findings


def test_a_step_that_could_not_be_tried_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation, findings = watched(OSCILLATOR, method="gauss6", step=0.004)
    said = search.quiet_step(simulation, findings, lambda: False)
    assert (
        "by the order of the method" in said
        and f"step {min(f.finer_step or 1.0 for f in findings):g} s" in said
    )


def test_no_step_is_named_where_none_is_to_blame() -> None:
    simulation, findings = watched(OSCILLATOR, method="rk4", step=1e-4)
    assert findings == () and search.quiet_step(simulation, findings) == ""


STIFF = {
    "bodies": {"b": {"mass": 1.0, "inertia": [1, 1, 1], "position": [1, 0, 0]}},
    "effects": {"k": {"type": "spring", "body": "b", "stiffness": 1e4, "rest_length": 0.0}},
    "simulation": {"duration": 40.0, "rate": 0.1, "method": "rk4", "step": 0.5},
}
"""omega = 100 rad/s: rk4 is stable up to a step of 2 sqrt(2) / omega, and loses (omega h)^6 / 72 of
the energy in each step below."""


def failure(scene: Any) -> str:
    """How the run failed; a warning of Python's, of numbers that overflow, fails the test."""
    with pytest.raises(SimulationError) as caught, warnings.catch_warnings():
        warnings.simplefilter("error")
        Simulation(load_scene(scene), announce=None).run(checks=False)
    return str(caught.value)


def test_a_failed_run_names_a_step_that_keeps_the_energy() -> None:
    said = failure(STIFF)
    found = re.search(
        r"step 0.5 s is too large for rk4 .*; use step ([0-9.e-]+) s, which runs", said
    )
    assert found, said
    step, omega = float(found[1]), 100.0
    assert 40.0 / step * (omega * step) ** 6 / 72.0 < 1e-3  # the share of the energy that is lost
    simulation, findings = watched(STIFF, step=step)
    assert simulation.time == 40.0 and findings == ()


def test_of_a_long_run_its_beginning_is_tried() -> None:
    said = search.step_that_runs(Simulation(load_scene(STIFF, duration=4e4)), 5.0, 4e4)
    assert "which runs at least to t = 12.5 s" in said  # 1.5 * 5 s and ten of the steps


def test_trials_end_with_their_time_or_a_signal(monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = Simulation(load_scene(STIFF))
    plain = "use method dopri853 with a tolerance"
    assert search.step_that_runs(simulation, 1.0, 40.0, lambda: False) == plain
    monkeypatch.setattr(search, "MOST_TIME", -1.0)
    assert failure(STIFF).endswith(f"; {plain}")


def test_a_trial_that_fails_asks_for_no_step_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def step_that_runs(simulation: Any, *rest: Any) -> str:
        asked.append(simulation.setting.step)
        return ""

    monkeypatch.setattr(search, "step_that_runs", step_that_runs)
    with pytest.raises(SimulationError):
        Simulation(load_scene(STIFF)).with_step(0.2).run()
    assert asked == []
    failure(STIFF)
    assert asked == [0.5]


def test_a_failed_run_names_one_step_and_no_watch_finds_fault_with_it(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """heavy_top at 0.05 s runs to its end from 0.0125 s on, but loses 5 % of its energy there."""
    assert command(RunOptions("heavy_top", method="rk4", step=0.05, quiet=True)) == FAILED
    said = capfd.readouterr().err
    (step,) = map(float, re.findall(r"use step ([0-9.e-]+) s, which runs to the end", said))
    assert "step below" not in said and "warning: step: " in said
    assert reported(capfd, "heavy_top", method="rk4", step=step) == []


# Which steps are tried, in which order, and what is said of them; the runs are stood for.


class Tried:
    """Stands for runs in other steps: which are quiet, which loud, what was asked for."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, quiet: float, loud: float = 0.0) -> None:
        self.steps: list[float] = []

        def run(trial: Any, *_: Any) -> tuple[Finding, ...]:
            self.steps.append(trial.setting.step)
            if trial.setting.step not in (pytest.approx(quiet), pytest.approx(loud)):
                raise SimulationError("fails")
            return () if trial.setting.step == pytest.approx(quiet) else (found_by("step", 1e-9),)

        monkeypatch.setattr(search, "_findings", run)
        monkeypatch.setattr(search, "counted_time", lambda *_: 0.0)
        options = SimpleNamespace(duration=10.0)
        self.simulation: Any = SimpleNamespace(
            setting=SimpleNamespace(step=0.1, name="rk4"),
            layout=SimpleNamespace(bodies=("a",)),
            scene=SimpleNamespace(simulation=options),
            compiled=SimpleNamespace(between=None, system=None),
            with_step=lambda step: SimpleNamespace(motion=None, setting=SimpleNamespace(step=step)),
        )


def test_what_is_said_where_no_step_does(monkeypatch: pytest.MonkeyPatch) -> None:
    fake = Tried(monkeypatch, -1.0)
    found = search.step_that_runs(fake.simulation, 2.0, 10.0)
    assert found == "steps down to 5e-07 s fail as well; use method dopri853 with a tolerance"
    fake.simulation.setting.name = "time_stepping"
    assert "which locates the events" in search.step_that_runs(fake.simulation, 2.0, 10.0)
    loud = search.step_that_runs(Tried(monkeypatch, -1.0, 0.01).simulation, 2.0, 10.0)
    assert loud == "step 0.01 s runs to the end, but with a warning"


@pytest.mark.parametrize(("bodies", "horizon"), [(7, "to the end"), (8, "at least to t = 4 s")])
def test_of_a_run_too_long_for_trials_its_beginning_is_tried(
    monkeypatch: pytest.MonkeyPatch, bodies: int, horizon: str
) -> None:
    """200,000 steps of 0.1/256 s are 10 s of 7.8 bodies; else half as long again as it came and ten
    steps, 1.5 2 s + 1 s, but no further than its end."""
    fake = Tried(monkeypatch, 0.01)
    fake.simulation.layout.bodies = ("a",) * bodies
    assert horizon in search.step_that_runs(fake.simulation, 2.0, 10.0)
    assert "the end" in search.step_that_runs(fake.simulation, 9.0, 10.0)


def found_by(watch: str, finer: float | None) -> Finding:
    return Finding(watch, 0.0, 1.0, 0.5, "", "", "", finer)


def test_the_least_of_the_steps_that_findings_name_is_tried_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    findings = found_by("energy", 0.05), found_by("step", 0.02), found_by("aim", None)
    fake = Tried(monkeypatch, 0.01)
    assert search.quiet_step(fake.simulation, findings) == (
        "use step 0.01 s, which passes all checks"
    )
    assert fake.steps == pytest.approx([0.02, 0.01])
    fake = Tried(monkeypatch, -1.0, 0.01)
    assert search.quiet_step(fake.simulation, findings) == (
        "steps down to 2e-07 s do not help; use method dopri853 with a tolerance"
    )
    assert search.quiet_step(fake.simulation, findings[2:]) == ""
    fake.simulation.setting.step = None
    assert search.quiet_step(fake.simulation, findings) == ""
