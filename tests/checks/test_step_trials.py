"""Which steps are tried, in which order, and what is said of them; the runs are stood for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from rb_sim import SimulationError
from rb_sim.base.diagnostic import Finding
from rb_sim.checks import step_search as search


class Tried:
    """Stands for runs in other steps: which are quiet, which loud, what was asked for."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, quiet: float, loud: float = 0.0) -> None:
        self.steps: list[float] = []

        def run(trials: Any, step: float) -> bool:
            self.steps.append(step)
            if step not in (pytest.approx(quiet), pytest.approx(loud)):
                raise SimulationError("fails")
            return step == pytest.approx(quiet)

        monkeypatch.setattr(search._Trials, "_run", run)
        options = SimpleNamespace(duration=10.0)
        self.simulation: Any = SimpleNamespace(
            setting=SimpleNamespace(step=0.1, name="rk4"),
            layout=SimpleNamespace(bodies=("a",)),
            scene=SimpleNamespace(simulation=options),
        )


SMALLER = [0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5]
SMALLER += [5e-6, 2e-6, 1e-6, 5e-7]
"""Those that are tried of a step of 0.1 s that failed."""


@pytest.mark.parametrize(("quiet", "tried"), [(0.005, 4), (5e-7, 16)])
def test_smaller_steps_are_tried(monkeypatch: pytest.MonkeyPatch, quiet: float, tried: int) -> None:
    fake = Tried(monkeypatch, quiet)
    found = search.step_that_runs(fake.simulation, 2.0, 10.0)
    assert fake.steps == pytest.approx(SMALLER[:tried])
    assert found == f"use step {quiet:g} s, which runs to the end"


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
    findings = found_by("turn", 0.05), found_by("step", 0.02), found_by("aim", None)
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
