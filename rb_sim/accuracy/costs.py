# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The parts of a scene and the cost of each per step, measured by a run without the part.

With contacts, steps are measured between events, and the cost of an event separately.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.auto import remembered_choice
from rb_sim.accuracy.choice import Choice, Setting, dividing
from rb_sim.accuracy.runs import cpu_time, samples_of
from rb_sim.base.errors import RbSimError, SimulationError
from rb_sim.catalogue.constraints import SPECS as CONSTRAINTS
from rb_sim.catalogue.constraints.rows import COUNT
from rb_sim.catalogue.contact import contact_rows
from rb_sim.catalogue.effects import SPECS as EFFECTS
from rb_sim.contact.choose_motion import motion_of
from rb_sim.contact.events.event_motion import ContactMotion
from rb_sim.contact.events.shares import undetermined_at_start
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.methods import METHODS
from rb_sim.motion.motion import Motion, nothing
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene

# The cost of a step of several motions, measured in turn, and the cost of an event.


SPELL = 1e-3
"""Approximate CPU time of one measurement [s]."""

REPEATS = 4
"""Number of spells of which the shortest time counts."""

ROUNDS = 31
"""Maximum number of rounds; each measures all variants, and the median over the rounds counts."""

FEWEST_STEPS = 500
"""Minimum number of steps of one measurement, so that the start of a run does not matter."""

FEW_STEPS = 20
"""The same for steps that take longer than SPELL / FEWEST_STEPS."""

FIRST_RUN = 0.2
"""Maximum CPU time of the first run of the scene without a part [s]."""

LONGEST_RUN = 5.0
"""Maximum CPU time of a survey run [s]."""

MEASURING = 10.0
"""Maximum CPU time of the rounds after the first FEWEST_ROUNDS [s]."""

FEWEST_ROUNDS = 5
"""Minimum number of rounds, for a median and its spread."""

EDGE = 0.1
"""Share of the time between two events that measurements keep away from each of them."""


@dataclass(frozen=True)
class Cost:
    """Nanoseconds per step: median and half the interquartile range of interleaved runs."""

    nanoseconds: float
    spread: float


@dataclass(frozen=True)
class Events:
    """Number and cost of the instants at which contacts change."""

    count: int
    """over the scene's duration, without those at the start."""
    nanoseconds: float
    """CPU time of one event [ns], in addition to the steps."""


@dataclass(frozen=True)
class RunCost:
    """CPU time of the whole run with its samples [s]."""

    unchecked: float
    checked: float
    """with all checks, including the second run."""


@dataclass(frozen=True)
class Survey:
    """Steps and events of one run of the scene."""

    reached: float
    """the scene's duration, or the time at which the run failed or was stopped [s]."""
    steps: int
    rejected: int
    events: tuple[float, ...] | None
    """instants after the start at which contacts changed [s]; None without contacts."""
    seconds: float
    """CPU time of the run [s]."""


@dataclass(frozen=True)
class Stretch:
    """The longest interval without an event, in which steps are measured."""

    start: float
    """[s]."""
    length: float
    """[s]."""
    y: np.ndarray
    """coordinates at the start."""


class _OutOfTimeError(Exception):
    """A run has exceeded its time."""


def comes_to(motion: Motion, end: float, seconds: float) -> bool:
    """Carry the motion to `end` [s]; False if it is not there after so much CPU time [s]."""
    began = time.process_time()

    def look() -> None:
        if time.process_time() - began > seconds:
            raise _OutOfTimeError

    motion.watch = look
    try:
        motion.run_to([end])
    except _OutOfTimeError:
        return False
    finally:
        motion.watch = nothing
    return True


def survey(compiled: Compiled, setting: Setting, duration: float) -> Survey:
    """Run the scene once, within LONGEST_RUN. Raises SimulationError if it fails at its start."""
    motion = motion_of(compiled, setting.build(duration))
    motion.warm()
    began = time.process_time()
    try:
        comes_to(motion, duration, LONGEST_RUN)
    except SimulationError:
        if not motion.frontier[0] > 0.0:
            raise
    seconds = time.process_time() - began
    reached = min(motion.frontier[0], duration)
    events = tuple(instants(motion)) if isinstance(motion, ContactMotion) else None
    return Survey(reached, motion.steps, motion.rejected_steps, events, seconds)


def longest_stretch(
    compiled: Compiled, setting: Setting, duration: float, seen: Survey
) -> Stretch | None:
    """The longest interval without an event; None for motions without events."""
    if seen.events is None:
        return None
    motion = motion_of(compiled, setting.build(duration))
    marks = [0.0, *seen.events, seen.reached]
    gaps = np.diff(marks)
    i = int(np.argmax(gaps))
    start = marks[i] + EDGE * float(gaps[i])
    motion.run_to([start])
    return Stretch(start, (1.0 - 2.0 * EDGE) * float(gaps[i]), np.array(motion.coordinates))


def instants(motion: ContactMotion) -> list[float]:
    """Times after the start at which contacts changed, increasing [s]."""
    return sorted({event.t for event in motion.events if event.t > 0.0})


def steps_of_a_run(seen: Survey) -> int:
    """Number of steps of one measurement."""
    spells = max(seen.seconds / SPELL, 1e-9)  # a coarse clock may give 0 for a short run
    return int(min(max((seen.steps + seen.rejected) / spells, FEW_STEPS), FEWEST_STEPS))


def typical_step(setting: Setting, seen: Survey, stretch: Stretch | None) -> float:
    """The fixed step, or the mean step of an adaptive run [s], reduced if the measured interval is
    too short for it."""
    step = seen.reached / max(1, seen.steps) if setting.step is None else setting.step
    span = (1.0 - EDGE) * seen.reached if stretch is None else stretch.length
    return dividing(min(step, span / steps_of_a_run(seen)), span)


def begin(motion: Motion, stretch: Stretch | None) -> None:
    """Reset the motion to the start of the measurement: of the stretch, or of the scene."""
    if stretch is not None and isinstance(motion, ContactMotion):
        motion.reset(stretch.y, stretch.start)
    else:  # without its contacts a scene may have other coordinates
        motion.reset()


def interleaved(
    motions: Sequence[Motion | None], step: float, count: int, stretch: Stretch | None
) -> list[np.ndarray | None]:
    """Nanoseconds per step of each variant, one value per round; a round measures all variants.

    count: number of steps of one measurement.
    """
    results: list[list[float]] = [[] for _ in motions]
    began = time.process_time()
    for turn in range(ROUNDS):
        late = time.process_time() - began > MEASURING
        if late and turn >= FEWEST_ROUNDS:
            break
        for motion, result in zip(motions, results, strict=True):
            if motion is not None:
                spell = SPELL if late else REPEATS * SPELL
                result.append(nanoseconds(motion, step, count, stretch, spell))
    return [np.array(result) if result else None for result in results]


def nanoseconds(
    motion: Motion,
    step: float,
    count: int,
    stretch: Stretch | None = None,
    spell: float = SPELL,
) -> float:
    """Shortest CPU time of one step [ns], from runs over `count` steps [s] within `spell` [s].

    An adaptive method may take another number of steps without the part; the time for the same
    interval counts.
    """

    def run() -> None:
        motion.run_to([motion.time + count * step])

    return 1e9 * cpu_time(run, spell, lambda: begin(motion, stretch)) / count


def cost_of_events(
    compiled: Compiled, setting: Setting, duration: float, step: float, seen: Survey
) -> Events | None:
    """CPU time of a whole run in addition to its steps; step: CPU time of one step [ns]."""
    if seen.events is None:
        return None
    motion = motion_of(compiled, setting.build(duration))
    spell = min(REPEATS * seen.seconds, LONGEST_RUN - seen.seconds)
    shortest = seen.seconds
    if spell > seen.seconds:
        again = cpu_time(lambda: motion.run_to([seen.reached]), spell, motion.reset)
        shortest = min(shortest, again)
    count = len(seen.events)
    beside = 1e9 * shortest - step * (seen.steps + seen.rejected)
    return Events(count, max(beside, 0.0) / count if count else 0.0)


def cost_of(samples: np.ndarray) -> Cost:
    """Median of the samples, and half the distance between their quartiles."""
    low, middle, high = np.percentile(samples, [25.0, 50.0, 75.0])
    return Cost(float(middle), 0.5 * float(high - low))


NOISE = 3.0
"""A part whose cost is negative by up to this number of spreads counts as 0."""

PREPARING = 30.0
"""CPU time of compiling the scene without its parts [s], after which no other part is measured."""

LATE = "no measuring time left after the parts before it"

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Item:
    """One constraint or effect of the scene."""

    name: str
    type: str
    on: str
    """the bodies it acts on."""
    rows: int
    """rows of the constraint Jacobian; 0 for an effect."""
    cost: Cost | None
    """additional cost of a step because of it; None if it cannot be measured."""
    reason: str = ""
    """why it cannot be measured."""


Costs = dict[tuple[str, str], tuple[Cost | None, str]]
"""(section, name) of a part -> its cost, or None and the reason."""


class Measure(NamedTuple):
    """A measurement: `count` steps from the start of the stretch, or of the scene."""

    step: float
    """[s]."""
    count: int
    stretch: Stretch | None


@dataclass(frozen=True)
class Explanation:
    """The parts of a scene, how it is simulated, and the cost of each part."""

    scene: str
    bodies: tuple[tuple[str, float], ...]
    """(name, mass [kg])."""
    constraints: tuple[Item, ...]
    effects: tuple[Item, ...]
    rows: int
    degrees_of_freedom: int
    indeterminate: tuple[str, ...]
    """reactions that are not unique with the contacts at the start."""
    coordinates: str
    method: str
    choice: Choice | None
    """of `method: auto`."""
    step: Cost
    """the whole step."""
    step_length: float
    """of the measurement [s]."""
    measured_from: float
    """time at which the measurement begins [s]."""
    seen_until: float
    """end of the survey run: the scene's duration, unless the run takes too long or fails [s]."""
    duration: float
    """of the scene [s]."""
    events: Events | None
    """None without contacts or with a method without events."""
    run: RunCost | None
    """None if the run fails or takes too long."""
    absent_constraints: tuple[str, ...]
    absent_effects: tuple[str, ...]


def explain(
    scene: Scene,
    progress: Progress | None = None,
    run_cost: Callable[[Scene], RunCost] | None = None,
) -> Explanation:
    """Compile the scene with and without each of its parts, and time their steps in turn.

    run_cost: times a whole run without and with its checks.

    Raises SceneError if the scene cannot be simulated.
    """
    tell = progress or (lambda what, share: None)
    compiled, options = compile_scene(scene), scene.simulation
    choice = remembered_choice(scene, compiled) if options.method == "auto" else None
    setting = choice.setting if choice else Setting(options.method, options.step, options.tolerance)
    seen = survey(compiled, setting, options.duration)
    stretch = longest_stretch(compiled, setting, options.duration, seen)
    measure = Measure(typical_step(setting, seen, stretch), steps_of_a_run(seen), stretch)
    whole, costs = costs_of_parts(scene, setting, measure, tell)
    events = cost_of_events(compiled, setting, options.duration, whole.nanoseconds, seen)
    whole_run = seen.reached == options.duration and seen.seconds < LONGEST_RUN
    run = run_cost(scene) if run_cost is not None and whole_run else None
    tell("done", 1.0)
    place = InitialPlace(scene)
    constraints: dict[str, Any] = dict(scene.constraints)
    return Explanation(
        scene=scene.name,
        bodies=tuple((name, body.mass) for name, body in scene.bodies.items()),
        constraints=tuple(
            item(name, spec, *costs["constraints", name], rows=lines_of(spec.parts(place)))
            for name, spec in constraints.items()
        ),
        effects=tuple(
            item(name, spec, *costs["effects", name]) for name, spec in scene.effects.items()
        ),
        rows=compiled.rows,
        degrees_of_freedom=compiled.degrees_of_freedom,
        indeterminate=undetermined_at_start(compiled),
        coordinates=coordinates_of(compiled),
        method=str(setting),
        choice=choice,
        step=whole,
        step_length=measure.step,
        measured_from=0.0 if stretch is None else stretch.start,
        seen_until=seen.reached,
        duration=options.duration,
        events=events,
        run=run,
        absent_constraints=absent(CONSTRAINTS, scene.constraints.values()),
        absent_effects=absent(EFFECTS, scene.effects.values()),
    )


def costs_of_parts(
    scene: Scene, setting: Setting, measure: Measure, tell: Progress
) -> tuple[Cost, Costs]:
    """The cost of a step, and the additional cost of each part."""
    parts = [("constraints", name) for name in scene.constraints]
    parts += [("effects", name) for name in scene.effects]
    motions: list[Motion | None] = []
    reasons: dict[tuple[str, str], str] = {}
    began = time.process_time()
    for i, part in enumerate([None, *parts]):
        tell(f"compiling without {part[1]}" if part else "compiling", i / (len(parts) + 2))
        late = part is not None and time.process_time() - began > PREPARING
        made = LATE if late else variant(scene, part, setting, measure)
        if isinstance(made, str):
            if part is None:
                raise SimulationError(f"a step cannot be measured: {made}")
            reasons[part] = made
        motions.append(None if isinstance(made, str) else made)
    tell("measuring", (len(parts) + 1) / (len(parts) + 2))
    whole, *without = interleaved(motions, measure.step, measure.count, measure.stretch)
    for k, motion in enumerate(motions[1:]):
        if without[k] is not None and parts[k][0] == "effects" and parted(motions[0], motion):
            without[k] = None
            reasons[parts[k]] = "the contacts change without it"
    assert whole is not None
    costs: Costs = {}
    for part, rest in zip(parts, without, strict=True):
        costs[part] = (None, reasons[part]) if rest is None else priced(cost_of(whole - rest))
    return cost_of(whole), costs


def lines_of(parts: Sequence[Any]) -> int:
    """Number of constraint rows of these parts of joints or contacts."""
    rows = [part.row for part in parts]
    return sum(COUNT[type(r)] if type(r) in COUNT else contact_rows(r) for r in rows)


def priced(cost: Cost) -> tuple[Cost | None, str]:
    """The cost and "", or None and the reason: a cost that is clearly negative has no meaning."""
    if cost.nanoseconds >= 0.0:
        return cost, ""
    if -cost.nanoseconds <= NOISE * cost.spread:
        return Cost(0.0, cost.spread), ""
    return None, "the scene is slower without it (other coordinates or contacts)"


def item(name: str, spec: Any, cost: Cost | None, reason: str = "", rows: int = 0) -> Item:
    """The entry of a constraint or an effect; cost None: not measured, for this reason."""
    on = getattr(spec, "body", None) or ", ".join(getattr(spec, "bodies", None) or ("all bodies",))
    parent = getattr(spec, "parent", None)
    return Item(name, spec.type, f"{on} by {parent}" if parent else on, rows, cost, reason)


def absent(catalogue: Any, used: Any) -> tuple[str, ...]:
    """Types of the catalogue that the scene does not use."""
    named = {spec.type for spec in used}
    return tuple(kind for kind in catalogue if kind not in named)


def coordinates_of(compiled: Compiled) -> str:
    """The coordinates, from the docstring of the system."""
    if not compiled.reduced:
        return f"maximal: {len(compiled.y)} coordinates, multipliers, projection after each step"
    text = (type(compiled.system).__doc__ or "").strip().split("\n")[0].rstrip(".")
    return f"reduced ({type(compiled.system).__name__}): {text}"


def variant(
    scene: Scene, part: tuple[str, str] | None, setting: Setting, measure: Measure
) -> Motion | str:
    """The motion of the scene without one part, with fixed steps if its method has them.

    The reason as a phrase if that cannot be compared: the scene does not run without the part, or
    its contacts change.
    """
    without = "" if part is None else " without it"
    if part is not None:
        section, name = part
        rest = {k: spec for k, spec in getattr(scene, section).items() if k != name}
        scene = scene.model_copy(update={section: rest})
    try:
        compiled = replace(compile_scene(scene), breakpoints=())
        if not METHODS[setting.name].suits(compiled.system):
            return f"{setting.name} does not integrate the scene{without}"
        fixed = METHODS[setting.name].fixed
        form = setting if fixed is None else Setting(setting.name, step=measure.step)
        motion = motion_of(compiled, form.build(scene.simulation.duration))
        motion.warm()
        begin(motion, measure.stretch)
        start = motion.time
        limit = math.inf if part is None else FIRST_RUN
        if not comes_to(motion, start + measure.count * measure.step, limit):
            return "the same steps take too long without it"
        if isinstance(motion, ContactMotion) and any(t > start for t in instants(motion)):
            return f"contacts open or close{without} during the measurement"
    except RbSimError:
        return f"the scene does not run{without}"
    return motion


def parted(motion: Motion | None, other: Motion | None) -> bool:
    """Whether two variants with the same contacts end with different states of these."""
    if not isinstance(motion, ContactMotion) or not isinstance(other, ContactMotion):
        return False
    one, two = (samples_of(m.sample()[0][None], m.layout).contact_state for m in (motion, other))
    return not np.array_equal(one, two)
