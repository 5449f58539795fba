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
from rb_sim.motion import Motion
from rb_sim.scene.compiled import Compiled

SPELL = 1e-3
"""CPU time of one measurement, about [s]; the least of REPEATS counts."""

REPEATS = 4

ROUNDS = 31
"""Interleaved measurements of all variants; their medians count."""

FEWEST_STEPS = 500
"""Steps of one run at least, so that starting it does not count."""

EDGE = 0.1
"""Share of the time between two events that is kept clear of either."""


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
class Stretch:
    """The longest time without an event, in which steps of bodies in contact are measured."""

    start: float
    """[s]."""
    length: float
    """[s]."""
    y: np.ndarray
    """coordinates at the start."""


def longest_stretch(compiled: Compiled, setting: Setting, duration: float) -> Stretch | None:
    """Where no contact changes for longest; None for motions without events."""
    motion = motion_of(compiled, setting.build(duration))
    if not isinstance(motion, ContactMotion):
        return None
    motion.run_to([duration])
    marks = [0.0, *instants(motion), duration]
    gaps = np.diff(marks)
    i = int(np.argmax(gaps))
    start = marks[i] + EDGE * float(gaps[i])
    motion.reset()
    motion.run_to([start])
    return Stretch(start, (1.0 - 2.0 * EDGE) * float(gaps[i]), np.array(motion.coordinates))


def instants(motion: ContactMotion) -> list[float]:
    """Times after the start at which contacts have changed, in their order [s]."""
    return sorted({event.t for event in motion.events if event.t > 0.0})


def typical_step(
    compiled: Compiled, setting: Setting, duration: float, stretch: Stretch | None
) -> float:
    """The step, or the mean one of an adaptive run; short enough for FEWEST_STEPS in a run [s]."""
    step = setting.step
    if step is None:
        motion = motion_of(compiled, setting.build(duration))
        motion.run_to([duration])
        step = duration / max(1, motion.steps)
    span = duration if stretch is None else stretch.length
    return dividing(min(step, span / FEWEST_STEPS), span)


def begin(motion: Motion, stretch: Stretch | None) -> None:
    """Go to where the measurement starts: the start of the scene, or of the stretch."""
    if stretch is not None and isinstance(motion, ContactMotion):
        motion.reset(stretch.y, stretch.start)
    else:  # also what has no contact left, and so other coordinates
        motion.reset()


def interleaved(
    motions: Sequence[Motion | None], step: float, stretch: Stretch | None
) -> list[np.ndarray | None]:
    """Nanoseconds per step of each variant, one per round; rounds go through all variants."""
    results = [None if motion is None else np.zeros(ROUNDS) for motion in motions]
    for turn in range(ROUNDS):
        for motion, result in zip(motions, results, strict=True):
            if motion is not None and result is not None:
                span = FEWEST_STEPS * step
                result[turn] = min(nanoseconds(motion, span, stretch) for _ in range(REPEATS))
    return results


def nanoseconds(motion: Motion, span: float, stretch: Stretch | None = None) -> float:
    """CPU time of one step, from runs over `span` [s] that fill a SPELL [ns].

    A method that only adapts its step may take another number of them without a part; what counts
    is the time that the same span takes.
    """
    total, steps = 0.0, 0
    while total < SPELL:
        begin(motion, stretch)
        end = motion.time + span
        start = time.process_time()
        motion.run_to([end])
        total += time.process_time() - start
        steps += FEWEST_STEPS
    return 1e9 * total / steps


def cost_of_events(
    compiled: Compiled, setting: Setting, duration: float, step: float
) -> Events | None:
    """What a whole run takes beside its steps; step: what one of them takes [ns]."""
    motion = motion_of(compiled, setting.build(duration))
    if not isinstance(motion, ContactMotion):
        return None
    spent = []
    for _ in range(REPEATS):
        motion.reset()
        start = time.process_time()
        motion.run_to([duration])
        spent.append(1e9 * (time.process_time() - start))
    count = len(instants(motion))
    beside = min(spent) - step * (motion.steps + motion.rejected_steps)
    return Events(count, max(beside, 0.0) / count if count else 0.0)


def cost_of(samples: np.ndarray) -> Cost:
    low, middle, high = np.percentile(samples, [25.0, 50.0, 75.0])
    return Cost(float(middle), 0.5 * float(high - low))
