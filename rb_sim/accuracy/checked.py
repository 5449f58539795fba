# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The reference run that errors are measured against, confirmed by a run of another method.

`method: auto`, `rb_sim accuracy` and `--certify` use the same reference. It is made by the first
adaptive method that reaches the end of the run, the sharp run. The second run, the checker, has
another method and another grid of steps. The two are refined in turn until they agree as well as
needed, or until refinement no longer helps. Both share the rounding of the scene's constants and
start, which runs from starts one ulp apart measure.
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
"""Maximum number of refinements."""

STALLED = 3
"""Number of refinements without a closer agreement after which no more are made."""

DECORRELATED = 0.1
"""Difference [rad, m, or relative to the motion] above which two runs are uncorrelated. Its changes
there say nothing about either run, and both are refined further."""

DEARER = 4.0
"""Approximate cost of a step of the checker relative to one of the sharp run."""


class CheckedRun(NamedTuple):
    """The sharper of two independent runs, and its difference from the other one."""

    rows: Array
    other: Array
    """rows of the checker."""
    setting: Setting
    checker: Setting
    gaps: Array
    """pose difference of the two at each instant [rad, m]."""
    mean_step: float
    """of the sharper run [s]."""
    out_of_time: bool = False
    """whether the budget ended the refinement."""

    @property
    def agreement(self) -> float:
        """Largest pose difference of the two [rad, m]."""
        return float(self.gaps.max())


def correlated(gaps: Array) -> int:
    """Number of instants before the first at which two runs are uncorrelated.

    gaps: difference at each instant [rad, m, or relative to the motion].
    """
    lost = np.flatnonzero(~(gaps <= DECORRELATED))
    return int(lost[0]) if len(lost) else len(gaps)


def pair(runner: Runner, setting: Setting, checker: Setting) -> CheckedRun:
    """The runs of two settings, and their difference."""
    (rows, steps), (other, _) = runner.sampled(setting), runner.sampled(checker)
    gaps = pose_difference(other, rows, runner.compiled.layout)
    return CheckedRun(rows, other, setting, checker, gaps, runner.duration / max(1, steps))


Excess = Callable[[CheckedRun], float]
"""Difference between the two runs relative to the one that suffices."""


def pose_within(target: float) -> Excess:
    """The pose difference relative to a target [rad, m]."""
    return lambda run: run.agreement / target


def local_tolerance(target: float) -> float:
    """The local tolerance of the first sharp run; target: global error of the pose [rad, m]."""
    return min(max(0.01 * target, TIGHTEST), 1e-6)


# The first run of a method that adapts its step to a tolerance.


FIRST_PILOT, PATIENCE, LONGEST_PILOT = 0.05, 2.0, 4000.0
"""Counted time of the first run of each method [s], its factor of growth as long as no run reaches
the end, and its maximum. The search ends earlier if every method would need longer than ENDLESS."""

OUTRUN = 3.0
"""A run is not continued while another one is expected to take less than 1/OUTRUN of its time."""


def pilot(runner: Runner, tolerance: float, longest: float = LONGEST_PILOT) -> Setting | None:
    """The first adaptive method that reaches the end of the run; None if none does.

    The methods take turns: each runs until the counted time FIRST_PILOT, then from there until
    twice that time, and so on up to `longest` [s]. A method for which the scene is too stiff thus
    costs little. A method that fails is dropped (a fall from rest through quadratic drag has no
    Taylor series); if all fail, the first of them is returned, since the motion itself may end.
    """
    reached: dict[str, float] = {}
    left = dict.fromkeys(by_order(runner.compiled.system), 0.0)
    """expected counted time from here to the end, by method [s]."""
    ended: Setting | None = None
    runner.limit = FIRST_PILOT
    while left and runner.limit < longest:
        soonest = min(left.values())
        for name in [name for name in left if left[name] <= OUTRUN * soonest]:
            setting = Setting(name, tolerance=tolerance)
            rows, _ = runner.continued(setting)
            if np.isfinite(rows[-1]).all():
                return setting
            if not runner.stopped:
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
    """The adaptive method of highest order, with this tolerance."""
    return Setting(by_order(runner.compiled.system)[0], tolerance=tolerance)


def by_order(system: Any) -> list[str]:
    """The adaptive methods, by falling order."""
    able = [n for n, e in tried(system).items() if e.adaptive is not None]
    return sorted(able, key=lambda name: -METHODS[name].order)


def time_left(runner: Runner, now: float, before: float) -> float:
    """Expected counted time to the end of a run that the limit stopped [s].

    now, before: simulated time reached at this limit and at the one before, PATIENCE times lower
    [s]. The faster of the mean and the latest pace counts.
    """
    limit = runner.limit
    pace = max(now / limit, (now - before) / (limit * (1.0 - 1.0 / PATIENCE)))
    return (runner.duration - now) / pace if pace > 0.0 else math.inf


# The checker, and the refinement of both runs.


def checked_run(runner: Runner, sharp: Setting, excess: Excess, budget: float) -> CheckedRun:
    """Two runs by different methods, refined until their excess is at most 1, or no longer falls.

    sharp: setting of the sharp run. budget: counted time of the runner [s] that no refinement may
    exceed.
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
        if left < 2.0 or runner.exceeds_limits(finer):
            return best._replace(out_of_time=True)
        if checker_next:
            checker = finer
            _, checker_cost = timed(runner, checker)
        else:
            sharp = finer
            _, sharp_cost = timed(runner, sharp)
        latest = pair(runner, sharp, checker)
        now = excess(latest)
        if (correlated(latest.gaps), -now) > (correlated(best.gaps), -least):
            best, least = latest, now
        if now < 0.5 * before:
            stalled = 0
        else:  # refine the other one next
            stalled += 1
            checker_next = not checker_next
        before = now
    return best


def first_to_end(
    runner: Runner, sharp: Setting, step: float, budget: float
) -> tuple[Setting, float]:
    """(setting, counted time [s]) of the first possible checker that reaches the end, or of the
    last one tried.

    budget: counted time of the runner after which no further fixed step is tried [s].
    """
    others = list(independent_of(sharp, step, runner.compiled.system))
    setting, rows, cost = others[0], np.zeros(0), 0.0
    for each in [one for one in others if not runner.exceeds_limits(one)] or others[-1:]:
        if len(rows) and each.step is not None and runner.spent > budget:
            continue
        setting, ((rows, _), cost) = each, timed(runner, each)
        if np.isfinite(rows[-1]).all():
            break
    return setting, cost


def independent_of(sharp: Setting, step: float, system: Any) -> Iterator[Setting]:
    """Possible checkers of a run, best first.

    Fixed steps come first: of other families before its own, by falling order, orders below 4 last.
    Adaptive methods of other families follow, for stiff scenes, where all fixed steps would have to
    be as short as the fastest decay.
    """
    family, able = METHODS[sharp.name].family, tried(system)
    fixed = [n for n, e in able.items() if e.fixed is not None and n != sharp.name]
    fixed.sort(key=lambda n: (METHODS[n].order < 4, METHODS[n].family == family, -METHODS[n].order))
    yield from (Setting(name, step=step) for name in fixed)
    for name, entry in able.items():
        if entry.adaptive is not None and METHODS[name].family != family:
            yield sharp._replace(name=name)


def timed(runner: Runner, setting: Setting) -> tuple[tuple[Array, int], float]:
    """(rows, steps) of a run, and its counted time [s] even if the run had been made before."""
    before = runner.spent
    result = runner.sampled(setting)
    return result, max(runner.spent - before, runner.known_cost(setting), 1e-9)


def sharper(sharp: Setting, mean_step: float, duration: float) -> Setting:
    """The setting with a hundredth of its tolerance; beyond TIGHTEST with fixed steps instead."""
    if sharp.tolerance is not None and sharp.tolerance > TIGHTEST:
        return sharp.scaled(0.01, duration)
    if METHODS[sharp.name].fixed is None:
        return sharp
    return Setting(sharp.name, step=dividing(0.5 * mean_step, duration))


def refined(checker: Setting, excess: float, duration: float, least: float) -> Setting:
    """The checker with the smaller step that its order predicts, or a hundredth of its tolerance.

    least: smallest factor of the step that the budget allows.
    """
    if checker.tolerance is not None:
        return checker.scaled(0.01, duration)
    shrink = (0.1 / excess) ** (1.0 / checker.order) if np.isfinite(excess) else 0.25
    return checker.scaled(min(0.5, max(0.15, least, shrink)), duration)
