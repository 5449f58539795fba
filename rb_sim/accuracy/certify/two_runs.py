"""Two runs of other methods than that to be certified, refined until they agree."""

from __future__ import annotations

import math

import numpy as np

from rb_sim.accuracy.certify.quantities import FORCE, differences, parts
from rb_sim.accuracy.checked import TIGHTEST, CheckedRun, by_order, checked_run
from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.counted import CountedRunner
from rb_sim.accuracy.perturbed import EPS
from rb_sim.accuracy.runs import dividing
from rb_sim.engine.methods.registry import METHODS
from rb_sim.engine.samples import Array, SampleLayout

SHARPER = 0.1
"""Share of a run's error to which the two runs that it is measured by should agree."""

LOST = 0.1
"""Error, in rad or as a share of the way of the bodies, that says nothing about where they are."""

HALVINGS = 6
"""Of the step of a checker, where chaos parts it from the sharp run."""

AGREED = 1e-9
"""Agreement of the pose to which the first two runs are brought [m, rad]."""

FIRST = 0.25
"""Share of the budget that the first run of a method may take: one that needs more for it, as an
explicit method does where something dies out fast, has nothing left to be refined with."""

CHEAPER = 0.25
"""Share of the cost of one sharp method for which another of lower order is taken instead."""

LAST_BITS = 4.0 * EPS
"""Share of the largest value of a quantity below which two runs differ by rounding: they are not
refined until they agree better."""


def two_runs(runner: CountedRunner, setting: Setting, rows: Array, budget: float) -> CheckedRun:
    """Two runs that agree to a tenth of the run's error, or as far as doubles and time go."""
    if setting.name == "time_stepping":
        own = of_its_own(runner, setting)
        if runner.compiled.between is not None:  # other methods do not know its pairs
            return own
        return as_far_as_events_go(runner, setting, own, budget)
    best = checked_run(runner, AGREED, budget, first_sharp(runner, setting, budget))
    layout = runner.compiled.layout
    for _ in range(3):
        enough = agreement_enough(best, rows, layout)
        excess = most_of(apart(best, layout), enough)
        if excess <= 1.0 or runner.spent > budget:
            break
        target = best.agreement / excess if math.isfinite(excess) else AGREED
        true = checked_run(runner, target, budget, best.setting)
        if not most_of(apart(true, layout), enough) < excess:
            break
        best = true
    if LOST < best.agreement < math.inf:
        best = tell_longest(runner, best, budget)
    if is_alone(best, setting):
        best = max(best, of_its_own(runner, setting), key=lambda each: reach(each.gaps))
    return best


def is_alone(best: CheckedRun, setting: Setting) -> bool:
    """Whether nothing but the method of the run itself comes to the end: no other at all, or, where
    what dies out at once takes an L-stable method, none that agrees with it."""
    if setting.step is not None:
        return not math.isfinite(best.agreement)
    stable = METHODS[setting.name].family == "radau" and best.setting.name == setting.name
    return stable and not best.agreement <= LOST


def first_sharp(runner: CountedRunner, setting: Setting, budget: float) -> Setting:
    """The method of highest order that comes to the end within a share of the budget, with a
    tolerance below that of the setting; another where it is much cheaper, an L-stable one where
    what has died out keeps the steps of the others short."""
    tolerance = max(min(1e-9, 0.01 * (setting.tolerance or 1.0)), TIGHTEST)
    able = [Setting(name, tolerance=tolerance) for name in by_order(runner.compiled.system)]
    found, limit, most = able[0], runner.limit, FIRST * budget
    for each in able if len(able) > 1 else ():
        runner.limit = most
        if np.isfinite(runner.sampled(each)[0][-1]).all():
            found, most = each, min(most, CHEAPER * runner.known_cost(each))
    runner.limit = limit
    return found


def agreement_enough(run: CheckedRun, rows: Array, layout: SampleLayout) -> Array:
    """How closely the two should agree in pose and velocities, (4,): a tenth of the error of the
    run of these rows, or what rounding leaves.

    Velocities count for themselves: of what dies out within a microsecond they are wrong by a
    million times the error of the pose.
    """
    error = differences(rows, run.rows, layout).max(axis=0)
    values = [np.abs(part).max(initial=0.0) for part in parts(run.rows, layout)]
    return np.maximum(SHARPER * error, LAST_BITS * np.array(values))[:FORCE]


def apart(run: CheckedRun, layout: SampleLayout) -> Array:
    """How far the two are apart in pose and velocities, (4,)."""
    return differences(run.other, run.rows, layout).max(axis=0)[:FORCE]


def most_of(apart: Array, enough: Array) -> float:
    """The largest share of what is enough; infinite where a run does not come to the end."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(apart > 0.0, apart / enough, 0.0)
    return float(np.nan_to_num(share, nan=math.inf, posinf=math.inf).max())


def tell_longest(runner: CountedRunner, best: CheckedRun, budget: float) -> CheckedRun:
    """Of runs that part before the end, those that part last, as sharp as time allows."""
    layout, longest = runner.compiled.layout, reach(best.gaps)
    sharp, checker = best.setting, best.checker
    if sharp.tolerance is not None:
        sharp = sharp.with_knob(TIGHTEST)
    rows, steps = runner.sampled(sharp)
    for _ in range(HALVINGS):
        other, _ = runner.sampled(checker)
        gaps = differences(other, rows, layout)[:, :2].max(axis=1)
        if reach(gaps) > longest:
            longest = reach(gaps)
            mean = runner.duration / max(1, steps)
            best = CheckedRun(rows, other, sharp, checker, gaps, mean)
        if checker.step is None or runner.spent > budget:
            break
        checker = checker.with_knob(dividing(0.5 * checker.step, runner.duration))
    return best


def of_its_own(runner: CountedRunner, setting: Setting) -> CheckedRun:
    """The same method at half and a quarter of the step, or with a hundredth and a ten-thousandth
    of the tolerance, where no other comes to the end.

    Of a method of order 1 the three errors are as 4 : 2 : 1, so that the sum of the two differences
    is the error of the first.
    """
    if setting.tolerance is not None:
        finer = [
            setting.with_knob(max(setting.tolerance / k, least))
            for k, least in ((1e2, 10.0 * TIGHTEST), (1e4, TIGHTEST))
        ]
    else:
        finer = [setting.with_knob(dividing(setting.knob / k, runner.duration)) for k in (2.0, 4.0)]
    (other, _), (rows, steps) = (runner.sampled(each) for each in finer)
    layout = runner.compiled.layout
    gaps = differences(other, rows, layout)[:, :2].max(axis=1)
    mean = runner.duration / max(1, steps)
    return CheckedRun(rows, other, finer[1], finer[0], gaps, mean)


def as_far_as_events_go(
    runner: CountedRunner, setting: Setting, own: CheckedRun, budget: float
) -> CheckedRun:
    """A run from event to event beside the finest of steps alone, up to where it ends.

    Steps of any length may agree on what none of them tells, as with the impact of a rim whose low
    point runs round it in less than a step. A heap, though, may have no events that one can follow.
    """
    sharp = first_sharp(runner, setting, budget)
    limit, runner.limit = runner.limit, FIRST * budget
    rows, _ = runner.sampled(sharp)
    runner.limit = limit
    told = np.isfinite(rows).all(axis=1, keepdims=True)
    if np.count_nonzero(told) < 2:
        return own
    true, other = np.where(told, rows, own.rows), np.where(told, own.rows, own.other)
    gaps = differences(other, true, runner.compiled.layout)[:, :2].max(axis=1)
    if gaps.max() <= own.agreement:  # reactions stay those of one method: shares may be open
        return own
    return own._replace(rows=true, other=other, checker=sharp, gaps=gaps)


def reach(lost: Array) -> int:
    """Number of instants before the first at which the pose is lost."""
    beyond = np.flatnonzero(~(lost <= LOST))
    return int(beyond[0]) if len(beyond) else len(lost)
