"""What the errors of a ladder are measured against, and where round-off or chaos ends it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rb_sim.accuracy.checked import CheckedRun, checked_run
from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.closed_forms import closed_form
from rb_sim.accuracy.errors import Errors, compare
from rb_sim.accuracy.perturbed import EPS, ulp_growth
from rb_sim.accuracy.runs import Runner, dividing
from rb_sim.engine.samples import Array

GRIDS = (0.93, 0.83)
"""Shares of the step, or of the tolerance, with which a run in contact is made once more: what it
decides at events too close to tell then falls out differently."""

TELLING = 100.0
"""Factor by which the grid of steps must matter more than rounding does, to be named."""

NO_ERRORS = Errors(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Reference:
    """The motion to compare with, at the runner's instants."""

    rows: Array
    kind: str
    """the closed form's name and source, or the setting of the run."""
    check: str
    """the independent setting it was compared with."""
    agreement: Errors
    """largest differences of the two."""
    ulp_growth: Errors
    """differences that one ulp in the initial state grows to."""
    mean_step: float
    """of an adaptive run, a measure of how fast the scene moves [s]."""
    scatter: Errors = NO_ERRORS
    """differences from the same run on other grids of steps; only of scenes in contact."""

    @property
    def floors(self) -> Errors:
        """Errors below which figures say nothing: what round-off and chaos leave of agreement."""
        return Errors(*np.max([self.agreement, self.scatter, [EPS] * 3], axis=0).tolist())

    @property
    def floor(self) -> float:
        """That of the pose [rad, m]."""
        return self.floors.pose

    @property
    def words(self) -> str:
        """What ends the ladder, in one line."""
        if not np.isfinite(self.floor):
            return f"nothing to measure by: {self.kind} and {self.check} do not both reach the end"
        grown = f"one ulp in the initial state grows to {self.ulp_growth.pose:.1e} over the run"
        if self.floor > TELLING * max(self.agreement.pose, self.ulp_growth.pose, EPS):
            return (
                f"events too close to tell end the ladder at {self.floor:.1e}, which {self.kind} "
                f"changes by on another grid of steps; {self.check} agrees to "
                f"{self.agreement.pose:.1e}; {grown}"
            )
        what = "chaos or an instability" if self.floor > 1e-6 else "round-off"
        return (
            f"{what} ends the ladder at {self.floor:.1e}, to which {self.kind} and {self.check} "
            f"agree; {grown}"
        )


def reference(runner: Runner, budget: float) -> Reference:
    """Closed form where the scene has one, else the tightest run; checked by another method.

    budget: time of the runner for it [s].
    """
    run = checked_run(runner, 4.0 * EPS, 0.6 * budget)
    layout = runner.compiled.layout
    growth = ulp_growth(runner, run.setting, budget=budget - runner.spent)
    exact = closed_form(runner.compiled)
    if exact is None:
        gap = compare(run.other, run.rows, layout)
        spread = scatter(runner, run) if runner.compiled.contact_laws else NO_ERRORS
        return Reference(
            run.rows, str(run.setting), str(run.checker), gap, growth, run.mean_step, spread
        )
    rows = rows_of(runner, run.setting, exact.coordinates(runner.times))
    name = f"the closed form ({exact.name})"
    sides = [
        Reference(rows, name, str(setting), compare(own, rows, layout), growth, run.mean_step)
        for own, setting in ((run.rows, run.setting), (run.other, run.checker))
    ]
    return min(sides, key=lambda side: side.agreement.pose)


def scatter(runner: Runner, run: CheckedRun) -> Errors:
    """Largest differences from the run, of the same run on other grids of steps."""
    found = []
    for share in GRIDS:
        knob = share * run.setting.knob
        if run.setting.step is not None:
            knob = dividing(knob, runner.duration)
        rows, _ = runner.sampled(run.setting.with_knob(knob))
        found.append(compare(rows, run.rows, runner.compiled.layout))
    return Errors(*np.max(found, axis=0).tolist())


def rows_of(runner: Runner, setting: Setting, coordinates: Array) -> Array:
    """Samples at the runner's times in the states with these coordinates, (n, len y)."""
    motion = runner.motion(setting)
    rows = np.zeros((len(coordinates), motion.width))
    for i, (t, y) in enumerate(zip(runner.times, coordinates, strict=True)):
        motion.reset(tuple(float(v) for v in y), float(t))
        rows[i] = motion.sample()[0]
    return rows
