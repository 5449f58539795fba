# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Error against cost of every method on a scene, over a ladder of steps or tolerances."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from rb_sim.accuracy.checked import CheckedRun, checked_run, pilot, pose_within, sharpest
from rb_sim.accuracy.choice import TIGHTEST, Setting, dividing
from rb_sim.accuracy.closed_forms import closed_form
from rb_sim.accuracy.runs import (
    EPS,
    Errors,
    Runner,
    compare,
    from_one_ulp_apart,
    largest_errors,
    sample_times,
)
from rb_sim.mechanics.methods import METHODS
from rb_sim.mechanics.samples import Array, SampleLayout
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.schema import Scene

# The reference of a ladder, and the smallest error that can be measured with it.


GRIDS = (0.93, 0.83)
"""Factors of the step or tolerance with which the reference of a scene with contacts is repeated:
the order of events too close to separate may then change."""

TELLING = 100.0
"""Factor by which the grid of steps must matter more than rounding to be given as the reason."""

TRIALS = 3
"""Number of runs from starts one ulp apart."""

NO_ERRORS = Errors(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Reference:
    """The motion to compare with, at the runner's instants."""

    rows: Array
    kind: str
    """the closed form's name and source, or the setting of the run."""
    check: str
    """the independent setting that it was compared with."""
    agreement: Errors
    """largest differences of the two."""
    ulp_growth: Errors
    """growth of one ulp of the initial state."""
    mean_step: float
    """mean step of an adaptive run [s]."""
    scatter: Errors = NO_ERRORS
    """differences from the same run on other grids of steps; only with contacts."""

    @property
    def floors(self) -> Errors:
        """The smallest errors that can be measured."""
        return Errors(*np.max([self.agreement, self.scatter, [EPS] * 3], axis=0).tolist())

    @property
    def floor(self) -> float:
        """The smallest error of the pose that can be measured [rad, m]."""
        return self.floors.pose

    @property
    def words(self) -> str:
        """The floor and its cause, in one line."""
        if not np.isfinite(self.floor):
            return f"no reference: {self.kind} and {self.check} do not both reach the end"
        grown = f"a 1-ulp perturbation of the start grows to {self.ulp_growth.pose:.1e}"
        if self.floor > TELLING * max(self.agreement.pose, self.ulp_growth.pose, EPS):
            return (
                f"errors below {self.floor:.1e} cannot be measured: events too close to separate "
                f"change {self.kind} by this much on another grid of steps; {self.check} agrees to "
                f"{self.agreement.pose:.1e}; {grown}"
            )
        what = "chaos or an instability" if self.floor > 1e-6 else "round-off"
        return (
            f"errors below {self.floor:.1e} cannot be measured ({what}): {self.kind} and "
            f"{self.check} "
            f"agree to this; {grown}"
        )


def reference(runner: Runner, budget: float) -> Reference:
    """The closed form if the scene has one, else the most accurate run; checked by another method.

    budget: time of the runner [s].
    """
    first = pilot(runner, TIGHTEST, budget) or sharpest(runner, TIGHTEST)
    runner.limit = math.inf
    run = checked_run(runner, first, pose_within(4.0 * EPS), 0.6 * budget)
    layout = runner.compiled.layout
    moved = from_one_ulp_apart(runner, run.setting, TRIALS, budget - runner.spent)
    growth = largest_errors(moved, run.rows, layout)
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
    """Largest differences of the reference from itself on other grids of steps."""
    others = (runner.sampled(run.setting.scaled(share, runner.duration))[0] for share in GRIDS)
    return largest_errors(others, run.rows, runner.compiled.layout)


def rows_of(runner: Runner, setting: Setting, coordinates: Array) -> Array:
    """Rows of samples at the runner's times from given coordinates, (n, len y)."""
    motion = runner.motion(setting)
    rows = np.zeros((len(coordinates), motion.width))
    for i, (t, y) in enumerate(zip(runner.times, coordinates, strict=True)):
        motion.reset(np.array(y, dtype=float), float(t))
        rows[i] = motion.sample()[0]
    return rows


COARSE = 0.3
"""Global error [rad, m] at which a ladder begins."""

NEAR_FLOOR = 2.0
"""A ladder ends when its error is within this factor of the floor, or no longer falls."""

STALLED, FAR, STALLED_FAR = 3, 1e3, 9
"""A ladder ends after STALLED rungs without a smaller error, or STALLED_FAR while the error is FAR
times the floor: an implicit method may fail at a corner until its steps are short."""

HOPELESS = 100.0
"""A ladder ends when it costs this factor of another method with a smaller error."""

LONGEST = 0.5
"""Share of a ladder's time that one run may take."""

OUT_OF_TIME = "its time is used up (--budget)"

Progress = Callable[[str, float], None]
"""progress(current work, share of the work done)."""


@dataclass(frozen=True)
class Rung:
    """One setting, its errors and its cost."""

    setting: Setting
    steps: int
    errors: Errors
    cost: float
    """CPU seconds per simulated second, without samples."""


@dataclass(frozen=True)
class Ladder:
    """All rungs of one method in one form (fixed step or adaptive), coarse to fine."""

    name: str
    rungs: tuple[Rung, ...]
    end: str
    """why it ends there."""


@dataclass(frozen=True)
class Accuracy:
    """The work-precision diagram of one scene."""

    scene: str
    duration: float
    """[s]."""
    layout: SampleLayout
    reference: Reference
    ladders: tuple[Ladder, ...]
    spent: float
    """wall time of the runs [s]."""

    @property
    def rungs(self) -> list[Rung]:
        """The rungs of all ladders."""
        return [rung for ladder in self.ladders for rung in ladder.rungs]


@dataclass
class Clock:
    """Wall-clock time that is left of a budget [s]."""

    budget: float
    start: float = field(default_factory=time.perf_counter)

    @property
    def left(self) -> float:
        """Wall-clock time that is left [s]; negative once it is used up."""
        return self.budget - (time.perf_counter() - self.start)


def climb(
    scene: Scene,
    budget: float = 60.0,
    target: float | None = None,
    progress: Progress | None = None,
) -> Accuracy:
    """Run the scene with every method, from coarse steps down to the floor of the reference.

    budget: wall time of the runs [s], without the compilation of a new kind of scene, which happens
    once on a machine. target: global error [rad, m] at which a ladder may end.
    """
    tell = progress or (lambda what, share: None)
    options = scene.simulation
    times = sample_times(options)
    runner = Runner(compile_scene(scene), options.duration, times)
    forms = settings_of(runner)
    for i, setting in enumerate(forms):
        tell(f"compiling {setting.name}", 0.3 * i / len(forms))
        runner.motion(setting)
    clock = Clock(budget)
    tell("reference", 0.3)
    runner.wall = 0.3 * budget
    true = reference(runner, 0.3 * budget)
    ladders: list[Ladder] = []
    for i, setting in enumerate(forms):
        tell(ladder_name(setting), 0.4 + 0.6 * i / len(forms))
        share = clock.left / (len(forms) - i)
        rivals = [rung for ladder in ladders for rung in ladder.rungs]
        ladders.append(one_ladder(runner, setting, true, share, target, rivals))
    tell("done", 1.0)
    spent = budget - clock.left
    return Accuracy(
        scene.name, options.duration, runner.compiled.layout, true, tuple(ladders), spent
    )


def settings_of(runner: Runner) -> list[Setting]:
    """One setting for each method and form (fixed, adaptive) that suits the scene, high orders
    first; its step or tolerance is still to be chosen."""
    settings = []
    for name, entry in sorted(METHODS.items(), key=lambda item: -item[1].order):
        if entry.suits(runner.compiled.system):
            if entry.fixed is not None:
                settings.append(Setting(name, step=runner.duration))
            if entry.adaptive is not None:
                settings.append(Setting(name, tolerance=1e-1))
    return settings


def one_ladder(
    runner: Runner,
    form: Setting,
    true: Reference,
    seconds: float,
    target: float | None,
    rivals: Sequence[Rung],
) -> Ladder:
    """Refine from the coarsest useful setting until the floor, the target or the time is reached.

    rivals: rungs of other methods; the ladder ends if it costs far more than these.
    """
    clock = Clock(seconds)
    runner.wall = LONGEST * seconds
    ratio = 0.1 if form.step is None else 1.0 / min(2.0, 10.0 ** (1.0 / form.order))
    seen = from_coarsest(runner, form, true, ratio, clock)
    known, setting = list(seen), next(iter(seen), form)
    rungs: list[Rung] = []
    used = 0.0
    best, stalled, end = float("inf"), 0, OUT_OF_TIME
    goal = NEAR_FLOOR * true.floor if target is None else max(0.1 * target, true.floor)
    while clock.left > used * (1.0 if setting.step is None else 1.2 / ratio):
        left = clock.left
        rung = measured(runner, setting, true, seen)
        used = left - clock.left
        rungs.append(rung)
        stalled = 0 if rung.errors.pose < 0.9 * best else stalled + 1
        best = min(best, rung.errors.pose)
        if best <= goal and (stalled or target is not None):
            end = "round-off or chaos" if target is None else "the target is reached"
            break
        if any(
            HOPELESS * r.cost < rung.cost < math.inf and r.errors.pose <= rung.errors.pose
            for r in rivals
        ):
            end = f"over {HOPELESS:g}x slower than another method of the same error"
            break
        if stalled >= (STALLED if best < FAR * true.floor else STALLED_FAR) and best < COARSE:
            end = "the error no longer falls"
            break
        if setting.step is None and setting.knob <= TIGHTEST:
            end = "round-off or chaos"
            break
        following = known[len(rungs) : len(rungs) + 1]
        setting = following[0] if following else setting.scaled(ratio, runner.duration)
    return Ladder(ladder_name(form), tuple(rungs), end)


def ladder_name(setting: Setting) -> str:
    """The method, with its form if it has two."""
    entry = METHODS[setting.name]
    if entry.fixed is None or entry.adaptive is None:
        return setting.name
    return f"{setting.name} {'fixed' if setting.step is not None else 'adaptive'}"


Seen = dict[Setting, tuple[int, Errors]]
"""Settings that have been run: steps taken, and errors."""


def from_coarsest(
    runner: Runner, form: Setting, true: Reference, ratio: float, clock: Clock
) -> Seen:
    """The first rungs of a ladder of fixed steps, from an error of COARSE to a typical step.

    Empty for an adaptive method, which begins with the tolerance of its form. clock: of the ladder;
    these rungs may take half of its time.
    """
    if form.step is None:
        return {}
    duration = runner.duration
    setting = form.with_knob(dividing(true.mean_step, duration))
    seen: Seen = {}
    for _ in range(24):
        steps, errors = tried(runner, setting, true)
        if seen and not math.isfinite(errors.pose):
            break
        seen[setting] = steps, errors
        coarse = errors.pose > COARSE or setting.knob >= duration
        if coarse or clock.left < 0.5 * clock.budget:
            break
        count = round(duration / setting.knob)
        setting = setting.with_knob(duration / max(1, min(count - 1, round(count * ratio))))
    return dict(reversed(seen.items()))


def measured(runner: Runner, setting: Setting, true: Reference, seen: Seen) -> Rung:
    """The rung of a setting; its run is made unless it is among `seen`."""
    steps, errors = seen.get(setting) or tried(runner, setting, true)
    return Rung(setting, steps, errors, runner.measured_cost(setting))


def tried(runner: Runner, setting: Setting, true: Reference) -> tuple[int, Errors]:
    """Steps and errors of a setting; its rows are not kept."""
    rows, steps = runner.sampled(setting)
    runner.forget()
    return steps, compare(rows, true.rows, runner.compiled.layout)
