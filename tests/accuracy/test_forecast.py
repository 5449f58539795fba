# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs that take long are told, runs that take for ever are given up, slow beginnings are not."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.accuracy import auto, checked
from rb_sim.accuracy.checks.step_search import advice_for
from rb_sim.base.errors import RbSimError, SimulationError
from rb_sim.cli.verbs.linearize import linearize
from rb_sim.cli.verbs.run import FAILED, RunOptions, run
from rb_sim.compiler import shipped
from rb_sim.compiler.builder import INTEGER
from rb_sim.compiler.program import ForC
from rb_sim.integrate.loop import record_into
from rb_sim.motion import motion as pieces
from rb_sim.motion.motion import Forecast
from rb_sim.numerics.kernels import LOOP, own_time
from rb_sim.scene.compile import compile_scene


class Clock:
    """Shows what it is set to."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def follow(duration: float, looks: list[tuple[float, float]]) -> tuple[Forecast, list[str]]:
    """A forecast shown (time spent, simulated time) in turn, and what it told."""
    clock, reported = Clock(), []
    made = Forecast(duration, reported.append, clock=clock)
    for clock.now, t in looks:
        if not made.goes_on(t):
            break
    return made, reported


def test_a_long_run_is_reported_once_with_its_time() -> None:
    made, reported = follow(10.0, [(5.0, 0.01), (10.0, 0.02), (20.0, 0.04)])
    assert not made.given_up
    (line,) = reported
    assert "t = 0.02 s of 10 s and would take 1.39 hours more" in line  # 5 s (10 - 0.02)/0.01


def test_what_precedes_the_first_step_is_no_pace() -> None:
    """Five seconds of tracing a large scene, then 2 s/s."""
    assert follow(10.0, [(5.0, 1e-5), (10.0, 2.5), (15.0, 5.0)])[1] == []


def test_a_short_run_is_not_reported() -> None:
    assert follow(10.0, [(5.0, 1.0), (10.0, 2.0)])[1] == []


def test_an_endless_run_is_given_up_after_some_patience() -> None:
    """5e9 s/s: 158 years; not before 15 s of patience."""
    made, _ = follow(1.0, [(5.0, 1e-9), (10.0, 2e-9)])
    assert not made.given_up
    made, _ = follow(1.0, [(5.0, 1e-9), (10.0, 2e-9), (15.0, 3e-9)])
    assert "158 years" in made.given_up


def test_a_run_that_stands_still_is_given_up() -> None:
    made, reported = follow(1.0, [(5.0, 0.0), (10.0, 0.0), (15.0, 0.0)])
    assert "infinite time" in made.given_up
    assert "infinite time" in reported[0]


def test_a_slow_beginning_is_no_endless_run() -> None:
    """The pace since the last look counts."""
    made, _ = follow(1.0, [(5.0, 1e-9), (10.0, 2e-9), (15.0, 0.1), (20.0, 0.2)])
    assert not made.given_up


def test_a_quick_beginning_does_not_hide_an_endless_end() -> None:
    """A tenth of the duration in the first 5 s, then 5e9 s/s, which for 0.9 s are 143 years: the
    whole run so far would say that the rest takes some minutes, for as long as one waits."""
    looks = [(5.0, 0.1), (10.0, 0.1 + 1e-9), (15.0, 0.1 + 2e-9), (20.0, 0.1 + 3e-9)]
    made, reported = follow(1.0, looks[:-1])
    assert not made.given_up and not reported
    made, _ = follow(1.0, looks)
    assert "143 years" in made.given_up


def test_slow_slips_of_a_box_are_reported_with_the_method_that_steps_over_them() -> None:
    """A millionth above the threshold of slipping the steps are 1e-7 s, of every tolerance."""
    shape = {"type": "box", "size": [0.2, 0.2, 0.2]}
    friction = {"type": "coulomb", "static": 0.3 * (1.0 - 1e-6)}
    scene = {
        "bodies": {"box": {"mass": 1.0, "shape": shape, "position": [0, 0, 0.1]}},
        "constraints": {"floor": {"type": "contact", "body": "box", "friction": friction}},
        "effects": {"tilt": {"type": "gravity", "acceleration": [2.943, 0, -9.81]}},
        "simulation": {"duration": 1.0, "rate": 100.0},
    }
    box = load_scene(scene)
    assert "try method time_stepping" in advice_for(box)
    smooth = scene | {"constraints": {"floor": {"type": "contact", "body": "box"}}}
    assert "try method time_stepping" in advice_for(load_scene(smooth))
    quick = load_scene(scene, method="time_stepping", step=1e-3)
    assert "time_stepping" not in advice_for(quick)
    assert "time_stepping" not in advice_for(load_scene("heavy_top"))
    run = Simulation(quick).run()
    down = 0.5 * 2.943e-6 * run.t[1:] ** 2
    # a step of a first-order method at the start of t: 2 h / t beside t^2 / 2
    assert np.abs(run.position["box"][1:, 0] / down - 1.0).max() < 0.21


def test_a_command_that_would_take_years_ends_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """2e18 steps of rk4 at some 50 ns are three thousand years."""
    monkeypatch.setattr(pieces, "EFFORT", 0.1)
    options = RunOptions(
        "heavy_top", out=tmp_path / "run", method="rk4", step=1e-18, no_plots=True, rerun=False
    )
    assert run(options) == FAILED
    said = capfd.readouterr().err
    assert re.search(r"given up after \d+ s: the run is at t = ", said)
    assert "years" in said


def test_a_run_ends_at_the_wall_time_given_and_keeps_its_log(
    capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """2e7 steps of rk4 are some seconds; a hundredth of a second is over before."""
    options = RunOptions(
        "heavy_top",
        out=tmp_path,
        method="rk4",
        step=1e-7,
        max_wall=0.01,
        no_plots=True,
        rerun=False,
    )
    assert run(options) == FAILED
    said = capfd.readouterr().err
    assert re.search(r"error: ended after 0\.\d+ s of wall-clock time: the run is at t = ", said)
    assert (tmp_path / "bag" / "metadata.yaml").exists()


def test_a_wall_time_of_nothing_is_refused() -> None:
    with pytest.raises(RbSimError, match=r"^--max-wall: got 0; must be > 0 s$"):
        run(RunOptions("heavy_top", max_wall=0.0))


def test_a_run_in_python_is_given_up_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """1e12 s of a top that turns 30 times a second; two samples, so that no block ends it."""
    monkeypatch.setattr(pieces, "EFFORT", 0.05)
    reported: list[str] = []
    scene = load_scene("heavy_top", duration=1e12, rate=1e-12)
    simulation = Simulation(scene, announce=reported.append)
    simulation.warm()
    reported.clear()
    with pytest.raises(SimulationError, match=r"^given up after .* years more at this pace"):
        simulation.run()
    assert len(reported) == 1 and "at this pace" in reported[0]


def test_a_linear_model_of_a_state_years_away_is_given_up_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pieces, "EFFORT", 0.05)
    with pytest.raises(SimulationError, match=r"^given up after .* years more at this pace"):
        linearize("heavy_top", at=1e12, axes="world", turning=0.0, out=None)


def test_the_search_of_auto_does_not_begin_runs_of_years(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is broken off at limits of 0.01 and 0.02 counted seconds, and says so."""
    monkeypatch.setattr(checked, "FIRST_PILOT", 0.01)
    scene = load_scene("heavy_top", duration=1e12, rate=1e-12)
    options = scene.simulation.model_copy(update={"tolerance": 1e-6})
    choice = auto.choose(compile_scene(scene), options)
    assert not choice.reached and "within 0.02 counted seconds" in choice.reason


def test_compiling_says_nothing_about_the_pace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A function that takes some tenths of a second, compiled inside a run."""
    reported: list[str] = []
    made = Forecast(1.0, reported.append, effort=0.0, wall=1e-3)
    monkeypatch.setenv("RB_SIM_CACHE", str(tmp_path))
    monkeypatch.setattr(shipped, "kept", lambda name: None)
    monkeypatch.setattr(shipped, "loops", lambda: shipped.NOTHING)
    timed, own = time.monotonic(), own_time()
    assert ForC(record_into.function, LOOP, INTEGER).address
    took, left = time.monotonic() - timed, own_time() - own
    assert left < 0.5 * took
    assert not made.goes_on(1e-6)  # the wall's time is over all the same
    assert "of wall-clock time" in made.given_up
