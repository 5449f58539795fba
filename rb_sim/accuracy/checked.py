# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A run good enough to measure others by: tight, and confirmed by a method of another family."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.choice import TIGHTEST, Setting, dividing
from rb_sim.accuracy.runs import Runner, pose_difference
from rb_sim.mechanics.methods import METHODS, tried
from rb_sim.mechanics.samples import Array

REFINEMENTS = 14

STALLED = 3
"""Refinements in turns that do not bring two runs closer: they no longer can."""

DECORRELATED = 0.1
"""Gap [rad, m] above which two runs know nothing of each other; how much it changes there says
nothing about either, so that both are refined on."""

DEARER = 4.0
"""What a step of the checker costs over one of the sharp run, about."""


class CheckedRun(NamedTuple):
    """Rows of the sharper of two independent runs, and how far the two agree."""

    rows: Array
    other: Array
    """rows of the checker."""
    setting: Setting
    checker: Setting
    gaps: Array
    """pose difference of the two at each instant [rad, m]."""
    mean_step: float
    """of the run [s]."""
    out_of_time: bool = False
    """whether the two were no longer refined for the budget's sake, not because it brought nothing
    more."""

    @property
    def agreement(self) -> float:
        """Largest pose difference of the two [rad, m]."""
        return float(self.gaps.max())


def sharpest_adaptive(system: Any) -> str:
    """The method of highest order that adapts its step to a tolerance."""
    return by_order(system)[0]


def by_order(system: Any) -> list[str]:
    """The methods that adapt their step to a tolerance, of falling order."""
    able = [n for n, e in tried(system).items() if e.adaptive is not None]
    return sorted(able, key=lambda name: -METHODS[name].order)


def independent_of(name: str, system: Any) -> list[str]:
    """Fixed-step methods to check `name` by: of other families, then of its own; by falling order.

    Of low order only where there is nothing else.
    """
    able = [n for n, e in tried(system).items() if e.fixed is not None and n != name]
    family = METHODS[name].family
    able.sort(key=lambda n: (METHODS[n].order < 4, METHODS[n].family == family, -METHODS[n].order))
    return able


def adaptive_beside(sharp: Setting, system: Any) -> list[Setting]:
    """Other families' methods at the same tolerance: a check of a motion whose fixed steps would
    all have to be as short as its fastest decay."""
    family = METHODS[sharp.name].family
    able = [n for n, e in tried(system).items() if e.adaptive is not None]
    return [sharp._replace(name=n) for n in able if METHODS[n].family != family]


def local_tolerance(target: float) -> float:
    """The local tolerance with which a run to be checked begins; target: pose [rad, m]."""
    return min(max(0.01 * target, TIGHTEST), 1e-6)


def checked_run(
    runner: Runner, target: float, budget: float, first: Setting | None = None
) -> CheckedRun:
    """Refine two runs by different methods until they agree within `target`, or no longer improve.

    target: pose [rad, m]. first: the adaptive setting to begin with, else the sharpest there is.
    budget: time of the runner [s]; no refinement begins that would go beyond it.
    """
    system, layout = runner.compiled.system, runner.compiled.layout
    tolerance = local_tolerance(target)
    sharp = first or Setting(sharpest_adaptive(system), tolerance=tolerance)
    sharp, (rows, steps), sharp_cost = sharp_to_end(runner, sharp)
    mean_step = runner.duration / max(1, steps)
    left = max(budget - runner.spent, sharp_cost)
    step = dividing(min(max(DEARER * sharp_cost / left, 0.25), 1.0) * mean_step, runner.duration)
    checker, other, checker_cost = first_to_end(
        runner, [Setting(name, step=step) for name in independent_of(sharp.name, system)], budget
    )
    if not np.isfinite(other[-1]).all():
        for adaptive in adaptive_beside(sharp, system):
            if runner.beyond(adaptive):
                break
            (found, _), cost = timed(runner, adaptive)
            if np.isfinite(found[-1]).all():
                checker, other, checker_cost = adaptive, found, cost
                break
    gaps = pose_difference(other, rows, layout)
    best = CheckedRun(rows, other, sharp, checker, gaps, mean_step)
    checker_next, stalled = True, 0
    for _ in range(REFINEMENTS):
        left = (budget - runner.spent) / (checker_cost if checker_next else sharp_cost)
        patience = STALLED if best.agreement < DECORRELATED else REFINEMENTS
        if best.agreement <= target or stalled >= patience:
            break
        if checker_next:
            gap = float(gaps.max())
            finer = finer_step(checker, target, gap, runner.duration, 1.0 / left)
        else:
            finer = sharper(sharp, runner.duration / max(1, steps), runner.duration)
        if left < 2.0 or runner.beyond(finer):
            return best._replace(out_of_time=True)
        if checker_next:
            checker = finer
            (other, _), checker_cost = timed(runner, checker)
        else:
            sharp = finer
            (rows, steps), sharp_cost = timed(runner, sharp)
        before, gaps = float(gaps.max()), pose_difference(other, rows, layout)
        if gaps.max() < best.agreement:
            best = CheckedRun(rows, other, sharp, checker, gaps, mean_step)
        if gaps.max() < 0.5 * before:
            stalled = 0
        else:  # the other one is at fault, or nothing is
            stalled += 1
            checker_next = not checker_next
    return best


def sharp_to_end(runner: Runner, sharp: Setting) -> tuple[Setting, tuple[Array, int], float]:
    """(setting, (rows, steps), time [s]) of the sharp run, or of the first other that comes to the
    end where it does not: a fall from rest through quadratic drag has no Taylor series."""
    first = timed(runner, sharp)
    if np.isfinite(first[0][0][-1]).all() or sharp.tolerance is None:
        return sharp, *first
    for name in by_order(runner.compiled.system):
        other = sharp._replace(name=name)
        if name == sharp.name or runner.beyond(other):
            continue
        found = timed(runner, other)
        if np.isfinite(found[0][0][-1]).all():
            return other, *found
    return sharp, *first


def first_to_end(
    runner: Runner, settings: Sequence[Setting], budget: float
) -> tuple[Setting, Array, float]:
    """(setting, rows, time [s]) of the first run that does not break off, or of the last tried.

    budget: of the runner, after which no further is tried [s].
    """
    within = [setting for setting in settings if not runner.beyond(setting)] or settings[-1:]
    for last, setting in enumerate(within, start=1 - len(within)):
        (rows, _), cost = timed(runner, setting)
        if np.isfinite(rows[-1]).all() or last == 0 or runner.spent > budget:
            return setting, rows, cost
    raise AssertionError("a system is suited by more than one method")


def timed(runner: Runner, setting: Setting) -> tuple[tuple[Array, int], float]:
    """(rows, steps) of a run and its time [s], also where it had been made before."""
    before = runner.spent
    result = runner.sampled(setting)
    return result, max(runner.spent - before, runner.known_cost(setting), 1e-9)


def sharper(sharp: Setting, mean_step: float, duration: float) -> Setting:
    """A hundredth of the tolerance; from the tightest on the same method with fixed steps."""
    if sharp.tolerance is not None and sharp.tolerance > TIGHTEST:
        return sharp.scaled(0.01, duration)
    if METHODS[sharp.name].fixed is None:
        return sharp
    return Setting(sharp.name, step=dividing(0.5 * mean_step, duration))


def finer_step(
    checker: Setting, target: float, gap: float, duration: float, least: float
) -> Setting:
    """The checker with the step that its order says is needed, within bounds; an adaptive one with
    a hundredth of its tolerance.

    least: factor below which the time does not suffice.
    """
    if checker.tolerance is not None:
        return checker.scaled(0.01, duration)
    shrink = (0.1 * target / gap) ** (1.0 / checker.order) if np.isfinite(gap) else 0.25
    return checker.scaled(min(0.5, max(0.15, least, shrink)), duration)
