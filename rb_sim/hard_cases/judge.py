"""Runs a case with each of its settings and measures what must hold."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.errors import turn_between
from rb_sim.errors import RbSimError
from rb_sim.hard_cases.case import Case, Check, Setting
from rb_sim.hard_cases.formula import largest
from rb_sim.scene.listing import find_scene
from rb_sim.scene.load import load_scene
from rb_sim.simulation import Simulation
from rb_sim.trajectory import Trajectory
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.watch_list import WatchList

HOLDS, FAILS, LIMIT = "holds", "FAILS", "limit"
"""Verdicts; limit: what is not held, and said so in the case."""

MOST_STEPS = 5e7
"""Steps between two samples beyond which a run is given up as one that does not advance."""


class Row(NamedTuple):
    """One line of the table."""

    case: str
    method: str
    knob: str
    """the step, or the tolerance."""
    check: str
    figure: float
    bound: float
    seconds: float
    """CPU time of the run."""
    verdict: str
    said: str
    """what an error or a watch said, or ""."""

    @property
    def margin(self) -> float:
        """Bound over figure."""
        return self.bound / self.figure if self.figure > 0.0 else float("inf")


class Outcome(NamedTuple):
    """What one run gave."""

    run: Trajectory | None
    watches: WatchList | None
    error: str
    seconds: float


def rows_of(case: Case) -> Iterator[Row]:
    """The rows of a case, as they are measured."""
    for setting in case.runs:
        outcome = run(case, setting)
        for check in case.checks:
            figure, said = measure(case, check, outcome)
            holds = figure <= check.bound
            verdict = HOLDS if holds else LIMIT if case.limit else FAILS
            knob = f"{setting.step:g} s" if setting.step is not None else f"{setting.tolerance:g}"
            yield Row(
                case.name, setting.method, knob, check.figure, figure, check.bound,
                outcome.seconds, verdict, said,
            )  # fmt: skip


def run(case: Case, setting: Setting) -> Outcome:
    """The case under one setting, watched."""
    from rb_sim.watch import Limits

    given = {
        name: value
        for name in ("method", "step", "tolerance", "duration")
        if (value := getattr(setting, name)) is not None
    }
    source: Any = find_scene(case.scene) if isinstance(case.scene, str) else case.scene
    began = time.process_time()
    watches = blocks = None
    try:
        simulation = Simulation(load_scene(source, **given))
        simulation.warm()
        began = time.process_time()
        options = simulation.scene.simulation
        blocks = []
        watches = WatchList(simulation.scene, simulation.layout, simulation.compiled)
        limits = Limits(steps=MOST_STEPS)
        with np.errstate(all="ignore"):
            for block in simulation.blocks(options.duration, options.rate, limits=limits):
                watches.add(block, partial(effort_of, simulation))
                blocks.append(block)
            watches.finish()
        seconds = time.process_time() - began
    except (RbSimError, ZeroDivisionError) as error:
        # plain Python divides by zero where compiled code goes on with infinity, then NaN
        return Outcome(None, watches, str(error) or "division", time.process_time() - began)
    from rb_sim.engine.samples import concatenate

    whole = concatenate(blocks, simulation.layout)
    return Outcome(Trajectory(whole, simulation.layout), watches, "", seconds)


def measure(case: Case, check: Check, outcome: Outcome) -> tuple[float, str]:
    """(figure, what was said); infinite where the run did not come to its end."""
    findings = outcome.watches.findings if outcome.watches is not None else ()
    lines = [outcome.error] if outcome.error else [str(finding) for finding in findings]
    said = lines[0] if lines else ""
    if check.figure in ("told", "refused"):
        spoken = lines if outcome.error or check.figure == "told" else []
        found = [line for line in spoken if re.search(check.words, line)]
        return (0.0, found[0]) if found else (1.0, said)
    if outcome.run is None or outcome.watches is None:
        return float("inf"), said
    return float(FIGURES[check.figure](case, check, outcome)), said


def _energy(case: Case, check: Check, outcome: Outcome) -> float:
    assert outcome.watches is not None
    energy = outcome.watches.ledger.energy()
    return 0.0 if energy is None else energy["relative"] or 0.0


def _momentum(case: Case, check: Check, outcome: Outcome) -> float:
    assert outcome.watches is not None
    balances = outcome.watches.ledger.momentum()
    return max((b["relative"] or 0.0 for b in (balances or {}).values()), default=float("inf"))


def _residual(case: Case, check: Check, outcome: Outcome) -> float:
    assert outcome.run is not None
    return float(outcome.run.residual.max())


def _formula(case: Case, check: Check, outcome: Outcome) -> float:
    assert outcome.run is not None
    return largest(check.formula, outcome.run.block, outcome.run.layout)


def _against(case: Case, check: Check, outcome: Outcome) -> float:
    """Largest pose difference [m, rad] to the run with another setting."""
    assert check.against is not None and outcome.run is not None
    other = run(case, check.against).run
    if other is None or len(other) != len(outcome.run):
        return float("inf")
    a, b = outcome.run.block, other.block
    shift = np.linalg.norm(a.position - b.position, axis=2).max()
    return float(max(shift, turn_between(a.orientation, b.orientation).max()))


FIGURES: dict[str, Callable[[Case, Check, Outcome], float]] = {
    "energy": _energy,
    "momentum": _momentum,
    "residual": _residual,
    "formula": _formula,
    "against": _against,
}
