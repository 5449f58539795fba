# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The reference that runs are measured against: a sharp run, confirmed by one of another method.

`method: auto`, `rb_sim accuracy` and `--certify` make it in the same way.  Of the methods that
adapt their step to a tolerance the first to come to the end makes the sharp run; the other run has
another method and another grid of steps.  The two are refined in turns until they agree as well as
is needed, or no longer can.  They err alike only in what both take from the scene, its constants
and its start as doubles: how far runs from starts one ulp apart part tells that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.choice import TIGHTEST, Setting, dividing
from rb_sim.accuracy.runs import Runner, pose_difference
from rb_sim.mechanics.methods import METHODS, tried
from rb_sim.mechanics.samples import Array
from rb_sim.motion.motion import ENDLESS

REFINEMENTS = 14

STALLED = 3
"""Refinements in turns that do not bring two runs closer: they no longer can."""

DECORRELATED = 0.1
"""Gap, in rad, in m or as a share of the way of the bodies, above which two runs know nothing of
each other; how much it changes there says nothing about either, so that both are refined on."""

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


def reach(gaps: Array) -> int:
    """Number of instants before the first at which two runs know nothing of each other.

    gaps: at each instant [rad], or [m], or as a share of the way of the bodies.
    """
    lost = np.flatnonzero(~(gaps <= DECORRELATED))
    return int(lost[0]) if len(lost) else len(gaps)


def pair(runner: Runner, setting: Setting, checker: Setting) -> CheckedRun:
    """The runs of two settings, and how far they agree."""
    (rows, steps), (other, _) = runner.sampled(setting), runner.sampled(checker)
    gaps = pose_difference(other, rows, runner.compiled.layout)
    return CheckedRun(rows, other, setting, checker, gaps, runner.duration / max(1, steps))


Excess = Callable[[CheckedRun], float]
"""How far the two runs are apart, over what is enough."""


def pose_within(target: float) -> Excess:
    """The excess of the pose over a target [rad, m]."""
    return lambda run: run.agreement / target


def local_tolerance(target: float) -> float:
    """The local tolerance with which a run to be checked begins; target: pose [rad, m]."""
    return min(max(0.01 * target, TIGHTEST), 1e-6)


# The first run of a method that adapts its step to a tolerance.


FIRST_PILOT, PATIENCE, LONGEST_PILOT = 0.05, 2.0, 4000.0
"""Counted time after which a first run is broken off, the factor by which it grows when none came
to its end, and where it is given up [s]; before that where all would need ENDLESS at their pace."""

OUTRUN = 3.0
"""A first run is not gone on with while its pace promises an end this factor later than another's.
"""


def pilot(runner: Runner, tolerance: float, longest: float = LONGEST_PILOT) -> Setting | None:
    """The first adaptive setting to come to the end, with the least limit at which one does.

    A scene too stiff for one method is left early, and another gets its turn; each goes on where it
    was broken off, the slow ones only while none promises an end much before theirs.  One that
    cannot go on is left, too: a fall from rest through quadratic drag has no Taylor series; where
    none can, the motion itself has an end.  None beyond a limit of `longest` [s], or where no run
    grows quick enough to come to its end within ENDLESS.
    """
    reached: dict[str, float] = {}
    left = dict.fromkeys(by_order(runner.compiled.system), 0.0)
    """counted time to the end of each, as far as its pace tells [s]."""
    ended: Setting | None = None
    runner.limit = FIRST_PILOT
    while left and runner.limit < longest:
        soonest = min(left.values())
        for name in [name for name in left if left[name] <= OUTRUN * soonest]:
            setting = Setting(name, tolerance=tolerance)
            rows, _ = runner.carried_on(setting)
            if np.isfinite(rows[-1]).all():
                return setting
            if not runner.broken_off:
                ended = ended or setting
                del left[name]
                continue
            now = runner.motion_of(setting).frontier[0]
            left[name] = time_left(runner, now, reached.get(name, 0.0))
            reached[name] = now
        if runner.limit > FIRST_PILOT and min(left.values(), default=0.0) > ENDLESS:
            return ended
        runner.limit *= PATIENCE
    return ended


def sharpest(runner: Runner, tolerance: float) -> Setting:
    """The method of highest order that adapts its step, with this tolerance."""
    return Setting(by_order(runner.compiled.system)[0], tolerance=tolerance)


def by_order(system: Any) -> list[str]:
    """The methods that adapt their step to a tolerance, of falling order."""
    able = [n for n, e in tried(system).items() if e.adaptive is not None]
    return sorted(able, key=lambda name: -METHODS[name].order)


def time_left(runner: Runner, now: float, before: float) -> float:
    """Counted time that a run broken off at the limit still needs [s], at the faster of two paces.

    now: simulated time that it has reached; before: the same with a limit PATIENCE times lower.
    """
    limit = runner.limit
    pace = max(now / limit, (now - before) / (limit * (1.0 - 1.0 / PATIENCE)))
    return (runner.duration - now) / pace if pace > 0.0 else math.inf


# The run that confirms it, and the refinement of both.


def checked_run(runner: Runner, sharp: Setting, excess: Excess, budget: float) -> CheckedRun:
    """Refine two runs by different methods until their excess is at most 1, or no longer falls.

    sharp: the setting of the first. budget: counted time of the runner [s]; no refinement begins
    that would go beyond it.
    """
    duration = runner.duration
    (_, steps), sharp_cost = timed(runner, sharp)
    mean_step = duration / max(1, steps)
    left = max(budget - runner.spent, sharp_cost)
    step = min(max(DEARER * sharp_cost / left, 0.25), 1.0) * mean_step
    checker, checker_cost = first_to_end(runner, sharp, dividing(step, duration), budget)

    latest = best = pair(runner, sharp, checker)
    least = before = excess(best)
    checker_next, stalled = True, 0
    for _ in range(REFINEMENTS):
        left = (budget - runner.spent) / (checker_cost if checker_next else sharp_cost)
        patience = STALLED if best.agreement < DECORRELATED else REFINEMENTS
        if least <= 1.0 or stalled >= patience:
            break
        if checker_next:
            finer = refined(checker, before, duration, 1.0 / left)
        else:
            finer = sharper(sharp, latest.mean_step, duration)
        if left < 2.0 or runner.beyond(finer):
            return best._replace(out_of_time=True)
        if checker_next:
            checker = finer
            _, checker_cost = timed(runner, checker)
        else:
            sharp = finer
            _, sharp_cost = timed(runner, sharp)
        latest = pair(runner, sharp, checker)
        now = excess(latest)
        if (reach(latest.gaps), -now) > (reach(best.gaps), -least):
            best, least = latest, now
        if now < 0.5 * before:
            stalled = 0
        else:  # the other one is at fault, or nothing is
            stalled += 1
            checker_next = not checker_next
        before = now
    return best


def first_to_end(
    runner: Runner, sharp: Setting, step: float, budget: float
) -> tuple[Setting, float]:
    """(setting, counted time [s]) of the first run that may confirm another and comes to the
    end, or of the last tried.

    budget: of the runner, after which no further fixed step is tried [s].
    """
    others = list(independent_of(sharp, step, runner.compiled.system))
    setting, rows, cost = others[0], np.zeros(0), 0.0
    for each in [one for one in others if not runner.beyond(one)] or others[-1:]:
        if len(rows) and each.step is not None and runner.spent > budget:
            continue
        setting, ((rows, _), cost) = each, timed(runner, each)
        if np.isfinite(rows[-1]).all():
            break
    return setting, cost


def independent_of(sharp: Setting, step: float, system: Any) -> Iterator[Setting]:
    """Settings to confirm a run by: fixed steps of other families, then of its own, by falling
    order, of low order only where there is nothing else; then other families' methods at the same
    tolerance, for a motion whose fixed steps would all have to be as short as its fastest decay."""
    family, able = METHODS[sharp.name].family, tried(system)
    fixed = [n for n, e in able.items() if e.fixed is not None and n != sharp.name]
    fixed.sort(key=lambda n: (METHODS[n].order < 4, METHODS[n].family == family, -METHODS[n].order))
    yield from (Setting(name, step=step) for name in fixed)
    for name, entry in able.items():
        if entry.adaptive is not None and METHODS[name].family != family:
            yield sharp._replace(name=name)


def timed(runner: Runner, setting: Setting) -> tuple[tuple[Array, int], float]:
    """(rows, steps) of a run and its counted time [s], also where it had been made before."""
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


def refined(checker: Setting, excess: float, duration: float, least: float) -> Setting:
    """The checker with the step that its order says is needed, within bounds; an adaptive one with
    a hundredth of its tolerance.

    least: factor below which the time does not suffice.
    """
    if checker.tolerance is not None:
        return checker.scaled(0.01, duration)
    shrink = (0.1 / excess) ** (1.0 / checker.order) if np.isfinite(excess) else 0.25
    return checker.scaled(min(0.5, max(0.15, least, shrink)), duration)
