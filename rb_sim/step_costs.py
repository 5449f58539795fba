"""What steps of several motions cost, measured in turns, and what an event costs beside them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.runs import dividing
from rb_sim.contact.events.motion import ContactMotion
from rb_sim.contact.motion import motion_of
from rb_sim.errors import SimulationError
from rb_sim.motion import Motion, nothing
from rb_sim.scene.compiled import Compiled

SPELL = 1e-3
"""CPU time of one measurement, about [s]; the least of REPEATS counts."""

REPEATS = 4

ROUNDS = 31
"""Interleaved measurements of all variants; their medians count."""

FEWEST_STEPS = 500
"""Steps of one run at least, so that starting it does not count."""

FEW_STEPS = 20
"""The same of steps so dear that they fill a SPELL before: each takes much longer than starting."""

FIRST_RUN = 0.2
"""CPU time after which the first run of the scene without a part is broken off [s]."""

LONGEST_RUN = 5.0
"""CPU time after which a run that is only looked at is broken off [s]."""

MEASURING = 10.0
"""CPU time of the rounds [s]: after it no other begins, but for FEWEST_ROUNDS."""

FEWEST_ROUNDS = 5
"""Of which a median and its spread can be told."""

EDGE = 0.1
"""Share of the time between two events that is kept clear of either, and of the end of a run."""


@dataclass(frozen=True)
class Cost:
    """Nanoseconds per step: median and half the interquartile range of interleaved runs."""

    nanoseconds: float
    spread: float


@dataclass(frozen=True)
class Events:
    """Instants at which contacts change: located, and answered with impacts and new modes."""

    count: int
    """over the scene's duration, the start left out."""
    nanoseconds: float
    """CPU time of one, beside the steps between them."""


@dataclass(frozen=True)
class Survey:
    """What a run of the scene has shown, as far as it came."""

    reached: float
    """the scene's duration, or where the run ended or was broken off [s]."""
    steps: int
    rejected: int
    events: tuple[float, ...] | None
    """instants after the start at which contacts have changed [s]; None where there are none."""
    seconds: float
    """CPU time of it [s]."""


@dataclass(frozen=True)
class Stretch:
    """The longest time without an event, in which steps of bodies in contact are measured."""

    start: float
    """[s]."""
    length: float
    """[s]."""
    y: np.ndarray
    """coordinates at the start."""


class _OutOfTimeError(Exception):
    """A run is not at its end when its time is over."""


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
    """Run the scene once, within LONGEST_RUN. Raises SimulationError if it cannot even begin."""
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
    """Where no contact changes for longest; None for motions without events."""
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
    """Times after the start at which contacts have changed, in their order [s]."""
    return sorted({event.t for event in motion.events if event.t > 0.0})


def steps_of_a_run(seen: Survey) -> int:
    """Steps that one measurement takes."""
    spells = max(seen.seconds / SPELL, 1e-9)  # some clocks tell nothing of a short run
    return int(min(max((seen.steps + seen.rejected) / spells, FEW_STEPS), FEWEST_STEPS))


def typical_step(setting: Setting, seen: Survey, stretch: Stretch | None) -> float:
    """The step, or the mean one of an adaptive run; short enough for a measurement [s]."""
    step = seen.reached / max(1, seen.steps) if setting.step is None else setting.step
    span = (1.0 - EDGE) * seen.reached if stretch is None else stretch.length
    return dividing(min(step, span / steps_of_a_run(seen)), span)


def begin(motion: Motion, stretch: Stretch | None) -> None:
    """Go to where the measurement starts: the start of the scene, or of the stretch."""
    if stretch is not None and isinstance(motion, ContactMotion):
        motion.reset(stretch.y, stretch.start)
    else:  # also what has no contact left, and so other coordinates
        motion.reset()


def interleaved(
    motions: Sequence[Motion | None], step: float, count: int, stretch: Stretch | None
) -> list[np.ndarray | None]:
    """Nanoseconds per step of each variant, one per round; rounds go through all variants.

    count: steps of one measurement. No round begins after MEASURING, but for FEWEST_ROUNDS.
    """
    results: list[list[float]] = [[] for _ in motions]
    began = time.process_time()
    for turn in range(ROUNDS):
        late = time.process_time() - began > MEASURING
        if late and turn >= FEWEST_ROUNDS:
            break
        for motion, result in zip(motions, results, strict=True):
            if motion is not None:
                repeats = 1 if late else REPEATS
                result.append(
                    min(nanoseconds(motion, step, count, stretch) for _ in range(repeats))
                )
    return [np.array(result) if result else None for result in results]


def nanoseconds(motion: Motion, step: float, count: int, stretch: Stretch | None = None) -> float:
    """CPU time of one step [s], from runs of `count` of them that fill a SPELL [ns].

    A method that only adapts its step may take another number of them without a part; what counts
    is the time that the same span takes.
    """
    total, steps = 0.0, 0
    while total < SPELL:
        begin(motion, stretch)
        end = motion.time + count * step
        start = time.process_time()
        motion.run_to([end])
        total += time.process_time() - start
        steps += count
    return 1e9 * total / steps


def cost_of_events(
    compiled: Compiled, setting: Setting, duration: float, step: float, seen: Survey
) -> Events | None:
    """What a whole run takes beside its steps; step: what one of them takes [ns]."""
    if seen.events is None:
        return None
    motion = motion_of(compiled, setting.build(duration))
    spent = [seen.seconds]
    while len(spent) < REPEATS and sum(spent) < LONGEST_RUN:
        motion.reset()
        start = time.process_time()
        motion.run_to([seen.reached])
        spent.append(time.process_time() - start)
    count = len(seen.events)
    beside = 1e9 * min(spent) - step * (seen.steps + seen.rejected)
    return Events(count, max(beside, 0.0) / count if count else 0.0)


def cost_of(samples: np.ndarray) -> Cost:
    low, middle, high = np.percentile(samples, [25.0, 50.0, 75.0])
    return Cost(float(middle), 0.5 * float(high - low))
