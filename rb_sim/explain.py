"""What a scene calls for, and what each part of it costs per step, measured by leaving it out.

Steps of bodies in contact are measured between events, and what an event costs apart from them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.choice import Choice, Setting
from rb_sim.accuracy.errors import BALANCE
from rb_sim.accuracy.remembered import remembered_choice
from rb_sim.catalogue.constraints import SPECS as CONSTRAINTS
from rb_sim.catalogue.constraints.rows import COUNT
from rb_sim.catalogue.effects import SPECS as EFFECTS
from rb_sim.contact.events.motion import ContactMotion
from rb_sim.contact.events.redundant import undetermined_at_start
from rb_sim.contact.motion import motion_of
from rb_sim.contact.scene.touching import contact_lines
from rb_sim.engine.methods.registry import METHODS
from rb_sim.errors import RbSimError, SimulationError
from rb_sim.motion import Motion
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.compiled import Compiled
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene
from rb_sim.step_costs import (
    FIRST_RUN,
    Cost,
    Events,
    Stretch,
    begin,
    comes_to,
    cost_of,
    cost_of_events,
    instants,
    interleaved,
    longest_stretch,
    steps_of_a_run,
    survey,
    typical_step,
)

NOISE = 3.0
"""Half interquartile ranges below zero up to which a part is taken to cost nothing."""

PREPARING = 30.0
"""CPU time of compiling the scene without its parts [s]: after it no other is left out."""

LATE = "the time for measuring is spent on the parts before it"

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Item:
    """One constraint or effect of the scene."""

    name: str
    type: str
    on: str
    """the bodies it acts on."""
    rows: int
    """lines of the constraint Jacobian; 0 for an effect."""
    cost: Cost | None
    """what a step costs more because of it; None where that has no meaning."""
    reason: str = ""
    """why it has none."""


Costs = dict[tuple[str, str], tuple[Cost | None, str]]
"""(section, name) of a part -> what it costs, or None and the reason."""


class Measure(NamedTuple):
    """What is timed: `count` steps from the start of the stretch, or of the scene."""

    step: float
    """[s]."""
    count: int
    stretch: Stretch | None


@dataclass(frozen=True)
class Explanation:
    """What is simulated and how."""

    scene: str
    bodies: tuple[tuple[str, float], ...]
    """(name, mass [kg])."""
    constraints: tuple[Item, ...]
    effects: tuple[Item, ...]
    rows: int
    degrees_of_freedom: int
    indeterminate: tuple[str, ...]
    """reactions that statics alone does not determine, contacts as they are at the start."""
    coordinates: str
    method: str
    choice: Choice | None
    """where the scene says `method: auto`."""
    step: Cost
    """the whole step."""
    step_length: float
    """of the measurement [s]."""
    measured_from: float
    """time of the scene at which the measurement begins [s]."""
    seen_until: float
    """up to which the scene was run for it: its duration, unless that takes too long [s]."""
    duration: float
    """of the scene [s]."""
    events: Events | None
    """None without contacts, and with a method that knows no events."""
    absent_constraints: tuple[str, ...]
    absent_effects: tuple[str, ...]


def explain(scene: Scene, progress: Progress | None = None) -> Explanation:
    """Compile the scene and the scene without each of its parts, and time their steps in turn.

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
        absent_constraints=absent(CONSTRAINTS, scene.constraints.values()),
        absent_effects=absent(EFFECTS, scene.effects.values()),
    )


def costs_of_parts(
    scene: Scene, setting: Setting, measure: Measure, tell: Progress
) -> tuple[Cost, Costs]:
    """The cost of a step, and by how much each part adds to it."""
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
            reasons[parts[k]] = "contacts are others without it"
    assert whole is not None
    costs: Costs = {}
    for part, rest in zip(parts, without, strict=True):
        costs[part] = (None, reasons[part]) if rest is None else priced(cost_of(whole - rest))
    return cost_of(whole), costs


def lines_of(parts: Sequence[Any]) -> int:
    """Constraint lines of these parts, joints' or contacts'."""
    rows = [part.row for part in parts]
    return sum(COUNT[type(r)] if type(r) in COUNT else contact_lines(r) for r in rows)


def priced(cost: Cost) -> tuple[Cost | None, str]:
    """The cost and "", or None and why it is none: a part has no negative price."""
    if cost.nanoseconds >= 0.0:
        return cost, ""
    if -cost.nanoseconds <= NOISE * cost.spread:
        return Cost(0.0, cost.spread), ""
    return None, "the scene takes more time without it, in other coordinates or contacts"


def item(name: str, spec: Any, cost: Cost | None, reason: str = "", rows: int = 0) -> Item:
    on = getattr(spec, "body", None) or ", ".join(getattr(spec, "bodies", None) or ("all bodies",))
    parent = getattr(spec, "parent", None)
    return Item(name, spec.type, f"{on} by {parent}" if parent else on, rows, cost, reason)


def absent(catalogue: Any, used: Any) -> tuple[str, ...]:
    """Kinds of the catalogue that the scene does not name."""
    named = {spec.type for spec in used}
    return tuple(kind for kind in catalogue if kind not in named)


def coordinates_of(compiled: Compiled) -> str:
    """The coordinates y, as the system's own documentation names them."""
    if not compiled.reduced:
        return f"maximal: {len(compiled.y)} coordinates, multipliers, projection after each step"
    text = (type(compiled.system).__doc__ or "").strip().split("\n")[0].rstrip(".")
    return f"reduced ({type(compiled.system).__name__}): {text}"


def variant(
    scene: Scene, part: tuple[str, str] | None, setting: Setting, measure: Measure
) -> Motion | str:
    """The scene without one part, compiled, in fixed steps of its method if it has them.

    A phrase where that has no meaning: the scene cannot be simulated without the part, or its
    contacts change.
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
            return "without it the same steps take too long to be measured"
        if isinstance(motion, ContactMotion) and any(t > start for t in instants(motion)):
            return f"contacts change{without} while it is measured"
    except RbSimError:
        return f"the scene does not run{without}"
    return motion


def parted(motion: Motion | None, other: Motion | None) -> bool:
    """Whether two variants with the same contacts hold them otherwise at the end of their runs."""
    if not isinstance(motion, ContactMotion) or not isinstance(other, ContactMotion):
        return False
    states = 13 * len(motion.layout.bodies) + 9 * len(motion.layout.reactions) + BALANCE + 1
    return not np.array_equal(motion.sample()[0][states:], other.sample()[0][states:])
