"""Bounds of the errors of a run, from two runs of other methods that are refined until they agree.

    |run - truth| <= |run - sharp| + |sharp - checker| + |one ulp|

at every instant: the sharp run is nearer to the truth than to its checker unless the two err alike,
which methods of different families on different grids do only in what both take from the scene, its
constants and its start as doubles, and at impacts, which are the same for both; the growth of one
ulp, from the start and from every impact on, covers that.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rb_sim.accuracy.certify.certificate import Certificate
from rb_sim.accuracy.certify.growth import growth_of
from rb_sim.accuracy.certify.impacts import rounded_at_impacts
from rb_sim.accuracy.certify.quantities import (
    NAMES,
    POSITION,
    ROTATION,
    differences,
    sizes,
)
from rb_sim.accuracy.certify.two_runs import reach, two_runs
from rb_sim.accuracy.checked import CheckedRun
from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.counted import CountedRunner
from rb_sim.accuracy.perturbed import one_ulp_apart, sizes_of
from rb_sim.accuracy.runs import sample_times
from rb_sim.engine.samples import Array
from rb_sim.motion import nothing
from rb_sim.scene.compiled import Compiled
from rb_sim.scene.schema import SimulationOptions

LEAST_TIME = 2.0
"""Counted time that a certificate may take in any case [s]."""

RUNS = 30.0
"""Runs such as the one to be certified that it may take beyond."""

MARGIN = 1.25
"""For what is between the instants, and for signs that cancel at all of them."""

TRIALS = 2
"""Starts one ulp apart."""

UNMOVED = 1e-12
"""Way, relative to where the bodies are, below which they do not move: rounding."""


def certify(
    compiled: Compiled,
    setting: Setting,
    options: SimulationOptions,
    times: Array | None = None,
    look: Callable[[], None] = nothing,
) -> Certificate:
    """The certificate of the run of a scene under the setting; options: its duration and rate.

    times: instants at which the runs are compared, increasing from 0 [s]; None: some hundreds.
    look: called now and then; what it raises ends the search.
    Its cost is counted, not timed, so the same scene gets the same certificate on every machine.
    """
    times = sample_times(options) if times is None else times
    runner = CountedRunner(compiled, options.duration, times, look)
    rows, _ = runner.sampled(setting)
    spent = runner.spent
    ended = int(np.isfinite(rows).all(axis=1).sum())
    if ended < len(times):  # a motion that ends before, or a method that fails
        runner.times = times[: max(ended, 2)]
        rows = rows[: max(ended, 2)]
        runner.forget()
    budget = max(LEAST_TIME, RUNS * spent)
    runner.limit = budget
    true = two_runs(runner, setting, rows, budget)
    ulp = ulp_apart(runner, true)
    return stated(runner, setting, rows, true, ulp, float(times[-1]))


def ulp_apart(runner: CountedRunner, true: CheckedRun) -> Array:
    """How far starts one ulp apart come from the sharp run, (n, 6)."""
    random = np.random.default_rng(0)
    worst = np.zeros((len(runner.times), len(NAMES)))
    rows, _ = runner.sampled(true.setting)
    sizes = sizes_of(rows, runner.compiled)
    for _ in range(TRIALS):
        y = one_ulp_apart(runner.compiled.y, random, sizes)
        moved, _ = runner.sampled(true.setting, y=y)
        worst = np.maximum(worst, differences(moved, rows, runner.compiled.layout))
    return worst


def stated(
    runner: CountedRunner,
    setting: Setting,
    rows: Array,
    true: CheckedRun,
    ulp: Array,
    duration: float,
) -> Certificate:
    """The certificate from what the runs gave."""
    layout, times = runner.compiled.layout, runner.times
    size = sizes(true.rows, layout)
    rounded = ulp + rounded_at_impacts(times, ulp, runner.impacts(true.setting))
    doubt = differences(true.other, true.rows, layout) + rounded
    error = MARGIN * (differences(rows, true.rows, layout) + doubt)
    known, by_ulp = (
        reach(shares(each, size, true.rows, runner)) for each in (doubt, MARGIN * rounded)
    )
    follows = reach(shares(error, size, true.rows, runner))
    upto = slice(0, max(known, 1))
    growth = growth_of(times, shares(ulp, size, true.rows, runner))
    ends = [float(times[max(k - 1, 0)]) for k in (known, follows)]
    if not ends[0] > 0.0:
        error[:], doubt[:] = math.inf, math.inf
    return Certificate(
        setting=str(setting),
        checked_by=(str(true.setting), str(true.checker)),
        errors=largest(error[upto]),
        doubt=largest(doubt[upto]),
        one_ulp=largest(ulp[upto]),
        duration=duration,
        known_until=ends[0],
        rounding=by_ulp < len(times) and by_ulp <= 1.2 * known,
        follows_until=min(ends),
        growth=growth.factor,
        lyapunov_time=growth.lyapunov_time,
        runs=runner.runs,
    )


def largest(errors: Array) -> tuple[float, ...]:
    """Of each quantity."""
    return tuple(float(value) for value in errors.max(axis=0))


def shares(errors: Array, size: Array, rows: Array, runner: CountedRunner) -> Array:
    """The error of the pose at each instant [rad], or as a share of the way of the bodies, (n,)."""
    bodies = len(runner.compiled.layout.bodies)
    places = rows[:, : 13 * bodies].reshape(len(rows), bodies, 13)[:, :, 0:3]
    still = UNMOVED * float(np.nan_to_num(np.abs(places)).max(initial=0.0))
    way = size[POSITION] if size[POSITION] > still else math.inf
    with np.errstate(invalid="ignore"):  # infinite errors of a motion that no run has told
        return np.maximum(errors[:, POSITION] / way, errors[:, ROTATION])
