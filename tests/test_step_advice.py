"""The step that a failed run names does; "smaller" is not said where it is worse."""

from __future__ import annotations

import re

import pytest

from rb_sim import step_advice

STIFFNESS = 1.0e4
"""[N/m], on 1 kg: omega = 100 rad/s."""

LIMIT = 2.0 * 2.0**0.5 / 100.0
"""[s]; rk4 on x'' = -omega^2 x is stable up to omega h = 2 sqrt(2)."""

OSCILLATOR = {
    "bodies": {"b": {"mass": 1.0, "inertia": [1, 1, 1], "position": [1, 0, 0]}},
    "effects": {"k": {"type": "spring", "body": "b", "stiffness": STIFFNESS, "rest_length": 0.5}},
    "simulation": {"duration": 40.0, "rate": 0.1, "method": "rk4", "step": 0.5},
}


def run(scene):
    """The end of the run [s], or how it failed."""
    from rb_sim import Simulation, SimulationError, load_scene

    try:
        return Simulation(load_scene(scene)).run().t[-1]
    except SimulationError as error:
        return str(error)


def test_the_step_named_is_stable_and_the_failing_one_was_not():
    told = run(OSCILLATOR)
    found = re.search(r"step 0.5 s is too large for rk4 .*; with step ([0-9.e-]+) s it runs", told)
    assert found, told
    step = float(found[1])
    assert LIMIT / 16.0 < step < LIMIT  # well below the limit, rk4 damps the oscillation to rest
    again = OSCILLATOR | {"simulation": OSCILLATOR["simulation"] | {"step": step}}
    assert run(again) == 40.0


@pytest.mark.parametrize(
    ("good", "expected"),
    [
        (lambda step: step <= 0.3, "with step 0.25 s it runs to the end"),
        (lambda step: step >= 2.0, "smaller steps fail, too; with step 2 s it runs to the end"),
        (lambda step: False, "steps down to 1.52588e-05 s fail, too; use method dopri853"),
    ],
)
def test_smaller_is_not_said_where_it_is_worse(monkeypatch, good, expected):
    class Method:
        step = 1.0

    class Compiled:
        class layout:  # noqa: N801
            bodies = ("b",)

    monkeypatch.setattr(step_advice._Trials, "does", lambda self, step, *alike: good(step))
    monkeypatch.setattr(step_advice, "MOST_STEPS", 10**9)
    assert step_advice.advice(Compiled, Method, 1.0, 2.0).startswith(expected)


def test_trials_end_with_their_time(monkeypatch):
    monkeypatch.setattr(step_advice, "MOST_TIME", -1.0)
    told = run(OSCILLATOR)
    assert "it runs" not in told and told.endswith("use method dopri853 with a tolerance")


def test_a_failed_run_names_one_step_and_no_watch_finds_fault_with_it(capfd):
    """heavy_top at 0.05 s runs to its end from 0.0125 s on, but loses 5 % of its energy there."""
    from rb_sim.cli.run import FAILED, RunOptions
    from rb_sim.cli.run import run as command

    assert command(RunOptions("heavy_top", method="rk4", step=0.05, quiet=True)) == FAILED
    said = capfd.readouterr().err
    (step,) = map(float, re.findall(r"with step ([0-9.e-]+) s it runs to the end", said))
    assert "step below" not in said and "angle in one step" in said
    assert command(RunOptions("heavy_top", method="rk4", step=step, quiet=True)) == 0
    assert "warning" not in capfd.readouterr().err
