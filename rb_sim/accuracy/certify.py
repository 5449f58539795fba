# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The error of one run, certified by runs of another method and on another grid of steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.checked import (
    CheckedRun,
    Excess,
    checked_run,
    correlated,
    pair,
    pilot,
    sharpest,
)
from rb_sim.accuracy.choice import QUANTITIES as NAMES
from rb_sim.accuracy.choice import TIGHTEST, Setting, listed
from rb_sim.accuracy.runs import (
    EPS,
    FORCE,
    POSITION,
    ROTATION,
    Runner,
    distances,
    from_one_ulp_apart,
    parts,
    pose_difference,
    sample_times,
    samples_of,
    sizes_of,
)
from rb_sim.base.plain_data import finite
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.samples import Array, SampleLayout
from rb_sim.motion.motion import nothing
from rb_sim.scene.schema import SimulationOptions

# The size of each of the six quantities, and the rounding errors of impacts.


def sizes(rows: Array, layout: SampleLayout) -> Array:
    """Size of each quantity in a run, (6,): largest displacement, 1 rad, and largest velocities,
    force and torque."""
    of = parts(rows, layout)
    found = np.ones(len(NAMES))
    of[POSITION] = of[POSITION] - of[POSITION][:1]
    for k, values in enumerate(of):
        if k != ROTATION:
            found[k] = np.linalg.norm(values, axis=2).max(initial=0.0)
    return found


def rounded_at_impacts(times: Array, ulp: Array, impacts: Array) -> Array:
    """Errors that the rounding of all impacts before each instant may add up to, (n, 6).

    Each impact rounds its time and all velocities anew, and these roundings grow as one ulp of the
    start does: the sum over the impacts of ulp(t - t_impact). Two runs that are compared round the
    same states alike, so that their difference does not contain it. times: of the samples, from 0,
    (n,) [s]; ulp: growth of one ulp in every coordinate of the start, (n, 6); impacts: times [s].
    """
    total = np.zeros_like(ulp)
    worst = np.maximum.accumulate(ulp, axis=0)
    # impacts between two samples count from the earlier sample on
    first = np.searchsorted(times, impacts, side="right") - 1
    for i, count in zip(*np.unique(first, return_counts=True), strict=True):
        after = times[i:] - times[i]
        for k in range(ulp.shape[1]):
            total[i:, k] += count * np.interp(after, times, worst[:, k])
    return total


# The growth of one ulp of the start: as a power of the time, or exponentially.


CHAOTIC = 1e4
"""Growth over the run below which its law cannot be determined."""

SATURATED = 1e-2
"""Difference between two runs, relative to the motion, above which it no longer grows
exponentially."""

FEWEST = 20
"""Minimum number of instants of a fit."""


class Growth(NamedTuple):
    """Growth of one ulp in every coordinate of the start."""

    factor: float
    """largest difference over the run, relative to that after the first hundredth of it."""
    lyapunov_time: float
    """time of growth by a factor of e [s]; infinite if it grows no faster than a power of time."""


def growth_of(times: Array, apart: Array) -> Growth:
    """The growth of a difference, relative to the motion, given at the times; both (n,)."""
    so_far = np.maximum.accumulate(apart)
    first = max(1, len(times) // 100)
    if not len(times) or not so_far[-1] > 0.0:
        return Growth(1.0, math.inf)
    start = max(float(so_far[min(first, len(so_far) - 1)]), 1e-17)
    factor = float(so_far[-1]) / start
    used = (so_far <= SATURATED) & (so_far > 0.0) & (times > 0.0)
    if factor < CHAOTIC or used.sum() < FEWEST:
        return Growth(factor, math.inf)
    t, grown = times[used], np.log(so_far[used])
    rate, rest = fitted(t, grown)
    _, rest_of_power = fitted(np.log(t), grown)
    exponential = rest < rest_of_power and rate > 0.0
    return Growth(factor, 1.0 / rate if exponential else math.inf)


def fitted(x: Array, y: Array) -> tuple[float, float]:
    """(slope, sum of squared residuals) of the straight line through the points."""
    (slope, start), *_ = np.linalg.lstsq(np.stack([x, np.ones_like(x)], axis=1), y, rcond=None)
    left = y - slope * x - start
    return float(slope), float(left @ left)


# The reference of a certificate.


SHARPER = 0.1
"""Fraction of the run's error to which the two runs of the reference should agree."""

FIRST = 0.25
"""Share of the budget for the first run of the reference; the rest is needed to refine it."""

LAST_BITS = 4.0 * EPS
"""Difference, relative to the largest value of a quantity, that is rounding: agreement below it is
not sought."""


def two_runs(runner: Runner, setting: Setting, rows: Array, budget: float) -> CheckedRun:
    """A reference that agrees to SHARPER of the error of the run with these rows, or as far as
    rounding and the budget allow; by the run's own method if no other one reaches the end."""
    tolerance = max(min(1e-9, 0.01 * (setting.tolerance or 1.0)), TIGHTEST)
    if setting.name != "time_stepping":
        sharp = pilot(runner, tolerance, FIRST * budget)
        runner.limit = budget
        if sharp is not None:
            best = checked_run(runner, sharp, within_error_of(rows, runner), budget)
            if math.isfinite(best.agreement):
                return best
        return of_its_own(runner, setting)
    own = of_its_own(runner, setting)
    if runner.compiled.between is not None:  # other methods do not know its pairs
        return own
    sharp = pilot(runner, tolerance, FIRST * budget)
    return as_far_as_events_go(runner, sharp or sharpest(runner, tolerance), own)


def within_error_of(rows: Array, runner: Runner) -> Excess:
    """Difference of two runs relative to SHARPER of the error of the run with these rows, or to
    rounding; the largest of the poses' and the velocities'.

    Velocities may be wrong by far more than poses: by a million times if something decays within a
    microsecond.
    """
    layout = runner.compiled.layout

    def excess(run: CheckedRun) -> float:
        apart, error = (
            distances(each, run.rows, layout).max(axis=0)[:FORCE] for each in (run.other, rows)
        )
        values = [np.abs(part).max(initial=0.0) for part in parts(run.rows, layout)]
        enough = np.maximum(SHARPER * error, LAST_BITS * np.array(values)[:FORCE])
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(apart > 0.0, apart / enough, 0.0)
        return float(np.nan_to_num(share, nan=math.inf, posinf=math.inf).max())

    return excess


def of_its_own(runner: Runner, setting: Setting) -> CheckedRun:
    """A reference by the same method: a quarter and half of the step, or 1e-4 and 1e-2 times the
    tolerance.

    With a method of order 1 the errors of the three runs are as 4 : 2 : 1, so that the sum of the
    two differences is the error of the first.
    """
    factors = (0.25, 0.5)
    if setting.tolerance is not None:  # not both the tightest
        factors = (1e-4, max(1e-2, 10.0 * TIGHTEST / setting.tolerance))
    finest, finer = (setting.scaled(factor, runner.duration) for factor in factors)
    return pair(runner, finest, finer)


def as_far_as_events_go(runner: Runner, sharp: Setting, own: CheckedRun) -> CheckedRun:
    """The reference of a time-stepping run: event-driven up to where that fails, then `own`.

    Fixed steps of any length may agree on a wrong motion, e.g. if the contact point of a rim runs
    round it within a step. A heap, however, may have too many events to follow.
    """
    rows, _ = runner.sampled(sharp)
    resolved = np.isfinite(rows).all(axis=1, keepdims=True)
    true, other = np.where(resolved, rows, own.rows), np.where(resolved, own.rows, own.other)
    gaps = pose_difference(other, true, runner.compiled.layout)
    if np.count_nonzero(resolved) < 2 or gaps.max() <= own.agreement:
        return own  # all reactions by one method, since shares of a load may not be unique
    return own._replace(rows=true, other=other, checker=sharp, gaps=gaps)


# A certificate: the largest errors of a run, their causes, and the time up to which they hold.


@dataclass(frozen=True)
class Certificate:
    """Upper bounds of the errors of a run."""

    setting: str
    """how it was integrated."""
    checked_by: tuple[str, str]
    """settings of the two runs that it was compared with."""
    errors: tuple[float, ...]
    """largest error of each of NAMES up to `known_until`, in UNITS; infinite if that is 0."""
    uncertainty: tuple[float, ...]
    """the part of it that is the reference's: difference of its two runs, and growth of one ulp."""
    one_ulp: tuple[float, ...]
    """growth of one ulp in every coordinate of the start up to then."""
    duration: float
    """of the run [s]."""
    known_until: float
    """time up to which the reference is known to a tenth of the motion [s]."""
    follows_until: float
    """time up to which the run is within a tenth of the motion [s]."""
    rounding: bool
    """whether growth of one ulp, not the budget of the search, limits `known_until`."""
    growth: float
    """factor by which one ulp grows over the run."""
    lyapunov_time: float
    """[s]; infinite if errors do not grow exponentially."""
    runs: int
    """number of runs made, including the run itself."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values; None in place of infinite ones."""
        chaotic = math.isfinite(self.lyapunov_time)
        return {
            "setting": self.setting,
            "checked_by": list(self.checked_by),
            "errors": by_name(self.errors),
            "uncertainty": by_name(self.uncertainty),
            "one_ulp": dict(zip(NAMES, self.one_ulp, strict=True)),
            "duration": self.duration,
            "known_until": self.known_until,
            "follows_until": self.follows_until,
            "rounding": self.rounding,
            "growth": self.growth,
            "lyapunov_time": self.lyapunov_time if chaotic else None,
            "runs": self.runs,
            "text": self.lines(),
        }

    def lines(self) -> list[str]:
        """The text of the certificate, line by line."""
        first, second = self.checked_by
        if not self.known_until > 0.0:
            return [f"not certified: {first} and {second} give different motions"]
        upto = "" if self.known_until >= self.duration else f" up to t = {self.known_until:.4g} s"
        ulp = max(self.one_ulp[:2])
        text = [
            f"global error{upto} at most: {listed(self.errors)}",
            f"by second runs ({first}; {second}), uncertain by "
            f"{max(self.uncertainty[:2]):.1e} (m, rad); "
            f"growth of a 1-ulp perturbation: {ulp:.1e} (m, rad)",
        ]
        if math.isfinite(self.lyapunov_time):
            text.append(f"errors grow by a factor of e in {self.lyapunov_time:.3g} s (chaos or an "
                        "instability)")  # fmt: skip
        if self.follows_until < self.duration:
            text.append(
                f"beyond t = {self.follows_until:.4g} s the positions of the run are not reliable"
                f"{self._remedy()}"
            )
        return text

    def _remedy(self) -> str:
        if self.follows_until < self.known_until:
            return "; use a smaller step or tolerance"
        return "; no run in double precision is" if self.rounding else ""


def by_name(errors: tuple[float, ...]) -> dict[str, float | None]:
    """Errors by name; None if infinite."""
    return finite(dict(zip(NAMES, errors, strict=True)))


# Bounds of the errors of a run, from a reference of two runs by other methods:
#
#     |run - truth| <= |run - sharp| + |sharp - checker| + |one ulp|
#
# at every instant. The sharp run is nearer to the truth than to its checker unless the two make the
# same error. Methods of different families on different grids share only the rounding of the
# scene's constants and start, and that of impacts; the growth of one ulp, from the start and from
# every impact on, covers it.


LEAST_TIME = 2.0
"""Counted time that every certificate may take [s]."""

RUNS = 30.0
"""A certificate may also take as long as this number of runs like the one to be certified."""

MARGIN = 1.25
"""Factor for errors between the instants, and for differences that cancel at them."""

TRIALS = 2
"""Number of runs from starts one ulp apart."""


def certify(
    compiled: Compiled,
    setting: Setting,
    options: SimulationOptions,
    times: Array | None = None,
    look: Callable[[], None] = nothing,
) -> Certificate:
    """The certificate of the run of a scene under the setting; options: its duration and rate.

    times: instants at which the runs are compared, increasing from 0 [s]; None: `sample_times`.
    look: called regularly; an exception that it raises ends the search. Costs are counted, so that
    a scene gets the same certificate on every machine.
    """
    times = sample_times(options) if times is None else times
    runner = Runner(compiled, options.duration, times, look)
    rows, _ = runner.sampled(setting)
    spent = runner.spent
    ended = int(np.isfinite(rows).all(axis=1).sum())
    if ended < len(times):  # the motion ends before, or the method fails
        runner.times = times[: max(ended, 2)]
        rows = rows[: max(ended, 2)]
        runner.forget()
    budget = max(LEAST_TIME, RUNS * spent)
    runner.limit = budget
    true = two_runs(runner, setting, rows, budget)
    ulp = ulp_apart(runner, true)
    return stated(runner, setting, rows, true, ulp, float(times[-1]))


def ulp_apart(runner: Runner, true: CheckedRun) -> Array:
    """Differences of runs from starts one ulp apart from the sharp run, (n, 6)."""
    rows, _ = runner.sampled(true.setting)
    sizes = sizes_of(rows, runner.compiled)
    moved = from_one_ulp_apart(runner, true.setting, TRIALS, sizes=sizes)
    return np.max([distances(each, rows, runner.compiled.layout) for each in moved], axis=0)


def stated(
    runner: Runner,
    setting: Setting,
    rows: Array,
    true: CheckedRun,
    ulp: Array,
    duration: float,
) -> Certificate:
    """The certificate from the results of all runs."""
    layout, times = runner.compiled.layout, runner.times
    size = sizes(true.rows, layout)
    rounded = ulp + rounded_at_impacts(times, ulp, runner.impacts(true.setting))
    uncertainty = distances(true.other, true.rows, layout) + rounded
    error = MARGIN * (distances(rows, true.rows, layout) + uncertainty)
    known, by_ulp = (
        correlated(shares(each, size, true.rows, runner))
        for each in (uncertainty, MARGIN * rounded)
    )
    follows = correlated(shares(error, size, true.rows, runner))
    upto = slice(0, max(known, 1))
    growth = growth_of(times, shares(ulp, size, true.rows, runner))
    ends = [float(times[max(k - 1, 0)]) for k in (known, follows)]
    if not ends[0] > 0.0:
        error[:], uncertainty[:] = math.inf, math.inf
    return Certificate(
        setting=str(setting),
        checked_by=(str(true.setting), str(true.checker)),
        errors=largest(error[upto]),
        uncertainty=largest(uncertainty[upto]),
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
    """Largest error of each quantity."""
    return tuple(float(value) for value in errors.max(axis=0))


def shares(errors: Array, size: Array, rows: Array, runner: Runner) -> Array:
    """Error of the pose at each instant [rad, or relative to the displacement], (n,)."""
    places = samples_of(rows, runner.compiled.layout).position
    still = COMPUTED_ROUNDING * float(np.nan_to_num(np.abs(places)).max(initial=0.0))
    way = size[POSITION] if size[POSITION] > still else math.inf
    with np.errstate(invalid="ignore"):  # infinite errors of a motion that no run has resolved
        return np.maximum(errors[:, POSITION] / way, errors[:, ROTATION])
