# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`method: auto`: the cheapest setting that keeps a global error of the pose over the run.

Every candidate is run over the whole duration and compared with the reference (see `checked`). The
predicted error is that of the steps that the simulation will take, since the grid of steps does not
depend on the samples.
"""

from __future__ import annotations

import hashlib
import json
import math
from typing import NamedTuple

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
from rb_sim.compiler.graph import store
from rb_sim.compiler.graph.taylor_series import NoSeriesError
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.methods import METHODS
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.table_laws import BODIES
from rb_sim.scene.schema import Scene, SimulationOptions

# Whether a method that is seldom the cheapest is tried: its machine code takes long to compile, so
# its cost is estimated first.


STRETCH, GROWTH = 0.25, 1.0 / 8.0
"""A step of the Taylor method is at most about max(1, STRETCH tolerance^-GROWTH) as long as one of
dopri853: 1.3, 2.3 and 4 times at the tolerances 1e-5, 1e-9 and 1e-12 on chains."""


def worth_a_run(setting: Setting, compiled: Compiled) -> bool:
    """Whether the method may cost less than WORTH times dopri853 at the same tolerance.

    True for the methods that are always tried (`weighed` in the registry).
    """
    entry, tolerance = METHODS[setting.name], setting.tolerance
    if entry.weighed(compiled.system) or tolerance is None:
        return True
    longer = max(1.0, STRETCH * tolerance**-GROWTH)
    dearer = evaluations(setting.name, tolerance, compiled)
    dearer /= evaluations("dopri853", tolerance, compiled)
    return dearer <= WORTH * longer and (entry.family != "taylor" or has_series(compiled))


def has_series(compiled: Compiled) -> bool:
    """Whether the laws have a Taylor series that can be generated in less time than runs take: only
    with fewer than BODIES bodies, since the series is generated from the graph of all of them."""
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
"""Share of the target to which the two runs of the reference must agree."""

CONSTANTS = 0.1
"""The rounding of the system's constants is common to both runs of the reference. This share of the
growth of one ulp in every initial coordinate has covered it wherever the exact motion is known."""

LOOSEST = 0.3
"""Largest global error that is searched for [rad, m]; larger targets are treated as this one, since
no error law holds above it."""

MAGNIFIED = 1e-4
"""Growth of one ulp, relative to the difference between the two runs of the reference, above which
the motion itself amplifies errors: each step of both makes errors of some ulps."""

MAGNIFYING = 1e-12
"""Growth of one ulp of the start over the run [rad, m] above which the motion counts as sensitive:
it amplifies errors about ten thousand times."""

LOOKS = 7
"""Maximum number of runs of one candidate."""

WORTH = 1.5
"""A candidate is pursued while its expected cost is below this factor of the cheapest so far."""

LOW_ORDER_FROM = {1: 5e-2, 4: 1e-3}
"""Order -> smallest target [rad, m] for which methods of this order are tried: below it none has
been near the cheapest on the shipped scenes."""

ONE_SECOND = 0.92
"""Counted time that every search may take [s]: one second, less the delay in stopping a run."""

RUNS = 4.9
"""The search may also take as long as this number of pilot runs: five, less the delay in stopping a
run."""

DEAR_CHECK = 0.35
"""As CHECK, for scenes whose search takes longer than ONE_SECOND."""


class Found(NamedTuple):
    """A setting whose error is within the limit."""

    setting: Setting
    error: float
    """[rad, m]."""


@np.errstate(all="ignore")  # of settings too coarse for the scene the motion may grow without end
def choose(compiled: Compiled, options: SimulationOptions) -> Choice:
    """The cheapest setting that keeps the pose within options.tolerance [rad, m] to the end.

    compiled: the scene. options: its tolerance (the global error), duration and rate. Costs are
    counted, not measured, so that a scene gets the same setting on every machine. The search costs
    at most ONE_SECOND, or RUNS times the first run that reached the end.
    """
    assert options.tolerance is not None  # the schema requires it with method auto
    target = float(options.tolerance)
    aim = min(target, LOOSEST)
    runner = Runner(compiled, options.duration, affordable_times(compiled, options))
    first = pilot(runner, local_tolerance(CHECK * aim))
    if first is None:
        return given_up(runner, target)
    one = runner.known_cost(first)
    budget = max(ONE_SECOND, RUNS * one)
    dear = budget > ONE_SECOND
    runner.limit = runner.total_limit = budget
    share = DEAR_CHECK if dear else CHECK
    enough = pose_within(share * aim)
    true = checked_run(runner, first, enough, budget - one if dear else 0.6 * budget)
    left = 0.5 * (budget - runner.spent)  # a second trial that is stopped would show nothing
    moved = from_one_ulp_apart(runner, true.setting, 1 if dear else 2, left)
    growth = max(apart(rows, true.rows, runner) for rows in moved)
    noise = max(true.agreement, CONSTANTS * growth, change_when_sharper(runner, true, growth))
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
    """Largest difference between the poses of two runs [rad, m]."""
    return float(pose_difference(rows, others, runner.compiled.layout).max())


def change_when_sharper(runner: Runner, true: CheckedRun, growth: float) -> float:
    """Change of the reference if refined once more [rad, m]; 0 unless the motion is sensitive.

    A motion that amplifies errors turns those of all methods in the same direction, so that two
    methods may agree by chance and both be far from the truth. growth: of one ulp of the start
    [rad, m].
    """
    if growth < MAGNIFYING or not math.isfinite(true.agreement):
        return 0.0
    setting = sharper(true.setting, true.mean_step, runner.duration)
    moved = apart(runner.sampled(setting)[0], true.rows, runner)
    return moved if math.isfinite(moved) else 0.0


def errors_of(runner: Runner, setting: Setting, true: CheckedRun) -> tuple[float, ...]:
    """Largest errors of pose, twist and reactions, including the uncertainty of the reference."""
    layout = runner.compiled.layout
    rows, _ = runner.sampled(setting)
    uncertainty = distances(true.other, true.rows, layout)
    errors = distances(rows, true.rows, layout) + uncertainty
    return tuple(errors.max(axis=0).tolist())


def given_up(runner: Runner, target: float) -> Choice:
    """The choice if no method reaches the end: the sharpest setting, with an infinite error."""
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
    """The coarsest setting within the limit, for each method that may be the cheapest."""
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
    """The first setting of each method: high orders first, methods that are mostly expensive last.

    With commanded bodies adaptive methods are preferred, since the commands are not yet known.
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
    """The coarsest setting of this method within the limit; None if it costs too much.

    best: cost of the cheapest setting so far [counted s per simulated s]. budget: of the runner
    [s].
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
    """The setting whose error is within the limit if error ~ knob^power."""
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
    """The reason of the choice: methods, bound, error, and the runs that confirm it."""
    others = f"cheapest of {count} methods within" if count > 1 else "within"
    return (
        f"{others} {target:g} (rad, m) over {runner.duration:g} s; global error {error:.1e}, "
        f"by a second run ({true.setting}), confirmed by {true.checker} to {true.agreement:.1e}"
    )


def shortfall(runner: Runner, true: CheckedRun, target: float, noise: float, growth: float) -> str:
    """Why the target cannot be kept; growth: of one ulp of the start [rad, m]."""
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


# Choices of `method: auto` are kept on disk, so that the search is made once for a scene.


FOLDER = "auto"


def remembered_choice(scene: Scene, compiled: Compiled) -> Choice:
    """The choice for this scene, from disk if it was made before with the same sources."""
    text = scene.model_dump_json(exclude={"description"}, warnings=False)
    name = hashlib.sha256(f"{compiled.reduced} {text}".encode()).hexdigest()[:32]
    folder = store.version_folder(FOLDER, shipped.digest())
    choice = choice_in(store.read(folder, name))
    if choice is None:
        choice = choose(compiled, scene.simulation)
        store.write(folder, name, json.dumps(choice.as_dict()).encode())
    return choice


def choice_in(data: bytes | None) -> Choice | None:
    """The choice in a file; None if there is none or it cannot be read."""
    try:
        values = json.loads(data or b"")
        return Choice(**values | {"errors": tuple(values["errors"])})
    except (ValueError, KeyError, TypeError):
        return None
