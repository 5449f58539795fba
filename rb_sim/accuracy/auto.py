# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`method: auto`: the cheapest setting that keeps a global error of the pose over the run.

Every candidate is run over the whole duration and measured against one checked run (see
`checked`); the predicted error is therefore that of the very steps the simulation will take, since
the grid of steps does not depend on the samples.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.checked import (
    CheckedRun,
    checked_run,
    local_tolerance,
    pilot,
    pose_within,
    sharper,
    sharpest,
)
from rb_sim.accuracy.choice import TIGHTEST, Choice, Setting, dividing, evaluations
from rb_sim.accuracy.runs import (
    Runner,
    affordable_times,
    distances,
    from_one_ulp_apart,
    pose_difference,
)
from rb_sim.compiler import shipped
from rb_sim.graph import store
from rb_sim.graph.taylor_series import NoSeriesError
from rb_sim.mechanics.methods import METHODS
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.table_laws import BODIES
from rb_sim.scene.compiled import Compiled
from rb_sim.scene.schema import Scene, SimulationOptions

# Whether `auto` makes a run of a method that is seldom the cheapest: a run of it is a wait for its
# machine code, too, so its price is asked first.


STRETCH, GROWTH = 0.25, 1.0 / 8.0
"""A step along a series is hardly longer than max(1, STRETCH tolerance^-GROWTH) steps of dopri853,
which fall with their tolerance: it is 1.3, 2.3 and 4 of them at 1e-5, 1e-9 and 1e-12 on chains."""


def worth_a_run(setting: Setting, compiled: Compiled) -> bool:
    """Whether the method may come within WORTH times what dopri853 costs with its tolerance.

    Asked only of methods with which `auto` does not begin (`weighed` of the registry).
    """
    entry, tolerance = METHODS[setting.name], setting.tolerance
    if entry.weighed(compiled.system) or tolerance is None:
        return True
    longer = max(1.0, STRETCH * tolerance**-GROWTH)
    dearer = evaluations(setting.name, tolerance, compiled)
    dearer /= evaluations("dopri853", tolerance, compiled)
    return dearer <= WORTH * longer and (entry.family != "taylor" or expands(compiled))


def expands(compiled: Compiled) -> bool:
    """Whether the laws have a Taylor series that is not longer to make than any run takes.

    From BODIES bodies on the laws are made kind by kind, but their series from the whole graph.
    """
    if len(compiled.layout.bodies) >= BODIES:
        return False
    laws: object = compiled.laws
    try:
        return getattr(laws, "series", None) is not None
    except NoSeriesError:
        return False


SAFETY = 0.7
"""Share of the target that the measured error may use."""

CHECK = 0.1
"""Share of the target within which two methods must agree on the checked run."""

CONSTANTS = 0.1
"""The constants of the system are rounded too, which no comparison of two runs shows; this share
of what one ulp in every initial coordinate does has covered it wherever the truth is known."""

LOOSEST = 0.3
"""[rad, m]; a target above it is kept as if it were this: beyond it no error law holds."""

MAGNIFIED = 1e-4
"""Growth of one ulp over the gap of two methods, from which on it is the motion that magnifies:
both started with errors of some ulps in every step."""

MAGNIFYING = 1e-12
"""Growth of a 1-ulp perturbation of the start over the run [rad, m] above which the motion
counts as sensitive: errors are magnified about ten thousand times."""

LOOKS = 7
"""Runs of one candidate at most."""

WORTH = 1.5
"""A candidate is followed while its predicted cost is below this factor of the best so far."""

LOW_ORDER_FROM = {1: 5e-2, 4: 1e-3}
"""Order -> smallest target [rad, m] at which such a method has been near the cheapest (the ladders
of the six shipped scenes); below it the method is not even compiled."""

ONE_SECOND = 0.92
"""Counted time that a search may take in any case [s]: one, less what is taken before a run is seen
to be over its limit."""

RUNS = 4.9
"""Runs such as the pilot that it may take where that is more: five, less what is taken before a run
is seen to be over its limit."""

DEAR_CHECK = 0.35
"""As CHECK, where runs are dear: one that is sharp enough to be chosen itself."""


class Found(NamedTuple):
    """A setting that keeps the limit."""

    setting: Setting
    error: float
    """[rad, m]."""


@np.errstate(all="ignore")  # of settings too coarse for the scene the motion may grow without end
def choose(compiled: Compiled, options: SimulationOptions) -> Choice:
    """The cheapest setting that keeps the pose within options.tolerance [rad, m] to the end.

    compiled: the scene. options: its tolerance (the global error), duration and rate.
    Costs are counted work at written prices, so the same scene gets the same setting on every
    machine.  The search costs no more than ONE_SECOND, or RUNS runs such as the first that came to
    the end.
    """
    assert options.tolerance is not None  # the schema sees to it for method auto
    target = float(options.tolerance)
    aim = min(target, LOOSEST)
    runner = Runner(compiled, options.duration, affordable_times(compiled, options))
    first = pilot(runner, local_tolerance(CHECK * aim))
    if first is None:
        return given_up(runner, target)
    one = runner.known_cost(first)
    budget = max(ONE_SECOND, RUNS * one)
    dear = budget > ONE_SECOND
    runner.limit = runner.purse = budget
    share = DEAR_CHECK if dear else CHECK
    enough = pose_within(share * aim)
    true = checked_run(runner, first, enough, budget - one if dear else 0.6 * budget)
    left = 0.5 * (budget - runner.spent)  # a second trial that is broken off would tell nothing
    moved = from_one_ulp_apart(runner, true.setting, 1 if dear else 2, left)
    growth = max(apart(rows, true.rows, runner) for rows in moved)
    noise = max(true.agreement, CONSTANTS * growth, by_chance(runner, true, growth))
    limit = SAFETY * aim - noise
    reached = limit > 0.0
    found = [Found(true.setting, 0.0)]
    if reached:
        if true.checker.tolerance is not None and true.agreement <= limit:
            found.append(Found(true.checker, true.agreement))
        found += search(runner, true, aim, limit, budget)
    costs = [runner.cost(each.setting) for each in found]
    best = int(np.argmin(costs))
    error = found[best].error + noise
    setting = found[best].setting
    words = (
        reason(runner, true, target, error, len({each.setting.name for each in found}))
        if reached
        else shortfall(runner, true, target, noise, growth)
    )
    return Choice(
        setting.name, setting.step, setting.tolerance, target, error, costs[best], reached, words,
        errors_of(runner, setting, true),
    )  # fmt: skip


def apart(rows: Array, others: Array, runner: Runner) -> float:
    """Largest difference of the pose of two runs [rad, m]."""
    return float(pose_difference(rows, others, runner.compiled.layout).max())


def by_chance(runner: Runner, true: CheckedRun, growth: float) -> float:
    """How far the checked run moves when it is made sharper [rad, m], where that says more than its
    checker; else 0.

    A motion that magnifies errors makes those of all methods point one way, in which two of them
    may lie side by side and far from the truth. growth: what one ulp at the start makes [rad, m].
    """
    if growth < MAGNIFYING or not math.isfinite(true.agreement):
        return 0.0
    setting = sharper(true.setting, true.mean_step, runner.duration)
    moved = apart(runner.sampled(setting)[0], true.rows, runner)
    return moved if math.isfinite(moved) else 0.0


def errors_of(runner: Runner, setting: Setting, true: CheckedRun) -> tuple[float, ...]:
    """Largest errors of pose, twist and reactions, the uncertainty of the checked run added."""
    layout = runner.compiled.layout
    rows, _ = runner.sampled(setting)
    uncertainty = distances(true.other, true.rows, layout)
    errors = distances(rows, true.rows, layout) + uncertainty
    return tuple(errors.max(axis=0).tolist())


def given_up(runner: Runner, target: float) -> Choice:
    """What is said where no method comes to the end: the sharpest there is, as it is."""
    setting = sharpest(runner, local_tolerance(target))
    words = (
        f"an error of {target:g} (rad, m) cannot be assured over {runner.duration:g} s: no method "
        f"reached the end within {runner.limit:g} counted seconds; the scene is too stiff or "
        "too long"
    )
    infinite = math.inf, math.inf
    return Choice(setting.name, None, setting.tolerance, target, *infinite, False, words)


def search(
    runner: Runner, true: CheckedRun, aim: float, limit: float, budget: float
) -> list[Found]:
    """The coarsest setting within the limit of every method that may be the cheapest."""
    found: list[Found] = []
    best = runner.cost(true.setting)
    for first in candidates(runner, true, aim):
        if runner.spent > budget:
            break
        result = coarsest(runner, first, true, limit, best, budget)
        if result is not None:
            found.append(result)
            best = min(best, runner.cost(result.setting))
    return found


def candidates(runner: Runner, true: CheckedRun, aim: float) -> list[Setting]:
    """Where to begin with each: those of highest order first, those that are mostly dear last.

    A body that takes commands gets methods that adapt their step: what will be commanded is not
    known yet.
    """
    commanded = bool(runner.compiled.layout.commanded)
    settings: list[Setting] = []
    system = runner.compiled.system
    able = [(n, e) for n, e in METHODS.items() if e.suits(system)]
    for name, entry in sorted(able, key=lambda item: (not item[1].weighed(system), -item[1].order)):
        if aim < LOW_ORDER_FROM.get(entry.order, 0.0):
            continue
        if entry.adaptive is not None:
            setting = Setting(name, tolerance=max(min(0.1 * aim, 1e-3), TIGHTEST))
            if worth_a_run(setting, runner.compiled):
                settings.append(setting)
        if entry.fixed is not None and not (commanded and settings):
            step = true.mean_step * min(1.0, entry.order / 8.0)
            settings.append(Setting(name, step=dividing(step, runner.duration)))
    return settings


def coarsest(
    runner: Runner,
    setting: Setting,
    true: CheckedRun,
    limit: float,
    best: float,
    budget: float,
) -> Found | None:
    """The coarsest knob of this method whose pose error keeps the limit; None if not worth it.

    best: cost of the cheapest setting so far [counted s per simulated s]. budget: of the runner.
    """
    close = 1.15 if setting.step is not None else 8.0
    passing: Found | None = None
    failing = math.inf
    for _ in range(LOOKS):
        rows, _ = runner.sampled(setting)
        error = apart(rows, true.rows, runner)
        if error <= limit:
            if passing is None or setting.knob > passing.setting.knob:
                passing = Found(setting, error)
        else:
            failing = min(failing, setting.knob)
        following = next_setting(setting, error, limit, passing, failing, runner.duration)
        knob = following.knob
        if passing is None and math.isfinite(best):
            growth = (setting.knob / knob) ** (1.0 if setting.step is not None else 1.0 / 8.0)
            if runner.cost(setting) * growth > WORTH * best:
                break
        if passing is not None and knob < close * passing.setting.knob:
            break
        if knob == setting.knob or runner.spent > budget:
            break
        setting = following
    return passing


def next_setting(
    setting: Setting,
    error: float,
    limit: float,
    passing: Found | None,
    failing: float,
    duration: float,
) -> Setting:
    """The setting at which the error law error ~ knob^power puts the error within the limit."""
    if not math.isfinite(error) or error > 0.5:
        factor = 0.5 if setting.step is not None else 0.01
    else:
        factor = (0.8 * limit / max(error, 1e-4 * limit)) ** (1.0 / setting.power)
    if setting.step is not None:
        factor = min(max(factor, 1.0 / 32.0), 8.0)
    if passing is not None and math.isfinite(failing):
        inside = passing.setting.knob < factor * setting.knob < failing
        factor = factor if inside else math.sqrt(passing.setting.knob * failing) / setting.knob
    return setting.scaled(factor, duration)


def reason(runner: Runner, true: CheckedRun, target: float, error: float, count: int) -> str:
    """The sentence that says why a setting was chosen: method, bound, error, and what confirms
    it."""
    others = f"cheapest of {count} methods within" if count > 1 else "within"
    return (
        f"{others} {target:g} (rad, m) over {runner.duration:g} s; global error {error:.1e}, "
        f"by a second run ({true.setting}), confirmed by {true.checker} to {true.agreement:.1e}"
    )


def shortfall(runner: Runner, true: CheckedRun, target: float, noise: float, growth: float) -> str:
    """Why the target cannot be kept; growth: what one ulp at the start makes [rad, m]."""
    if not math.isfinite(noise):
        return (
            f"an error of {target:g} (rad, m) cannot be assured over {runner.duration:g} s: no "
            f"reference, since {true.setting} and {true.checker} do not both reach the end"
        )
    if growth < (target if true.out_of_time else MAGNIFIED * noise):
        return (
            f"an error of {target:g} (rad, m) cannot be assured over {runner.duration:g} s: after "
            f"{runner.spent:.2g} counted seconds of search {true.setting} and {true.checker} "
            "differ "
            f"by {true.agreement:.1e}; set a method and its tolerance instead of auto"
        )
    why = "chaos or an instability" if noise > 1e-6 else "round-off"
    verb = "kept" if noise > target else "assured"
    over = np.flatnonzero(true.gaps > 0.5 * target)
    until = f" (by half of it from t = {runner.times[over[0]]:.4g} s on)" if len(over) else ""
    return (
        f"an error of {target:g} (rad, m) cannot be {verb} over {runner.duration:g} s: {why} "
        "causes "
        f"one of {noise:.1e}; two independent methods differ by {true.agreement:.1e}{until}; "
        "the most accurate setting was used"
    )


# Choices of `method: auto` kept on disk by the scene's hash: the search is made once.


FOLDER = "auto"


def remembered_choice(scene: Scene, compiled: Compiled) -> Choice:
    """The choice for this scene, from disk if it was made before with these sources."""
    path = place_of(scene, compiled)
    known = read(path)
    if known is not None:
        return known
    choice = choose(compiled, scene.simulation)
    write(path, choice)
    return choice


def place_of(scene: Scene, compiled: Compiled) -> Path | None:
    """The file of the choice: named after what the motion depends on, in a folder named after the
    sources; None where nothing can be kept."""
    text = scene.model_dump_json(exclude={"description"}, warnings=False)
    digest = hashlib.sha256(f"{compiled.reduced} {text}".encode())
    folder = store.version_folder(FOLDER, shipped.digest())
    return None if folder is None else folder / f"{digest.hexdigest()[:32]}.json"


def read(path: Path | None) -> Choice | None:
    """The choice in the file; None if there is none, or none that can be read."""
    if path is None:
        return None
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        known: dict[str, Any] = {field.name: values[field.name] for field in fields(Choice)}
        known["errors"] = tuple(known["errors"])
        return Choice(**known)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def write(path: Path | None, choice: Choice) -> None:
    """Keep the choice; where the folder cannot be written it is made again next time."""
    if path is None:
        return
    part = path.with_name(f"{path.name}.{id(choice)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(json.dumps(choice.as_dict()), encoding="utf-8")
        part.replace(path)  # another process may write the same
    except OSError:
        return
