"""Whether a short run in fixed steps follows the motion: all of it is taken again in half steps.

A run of some steps can be wrong by a third where no step of it looks bad: Euler's way under a
constant load, whose velocities are exact, is short by the share 1/n after n steps.  Two runs of
order p in steps h and h/2 are apart by 1 - 2^-p of the error of the first, so that a difference is
an error, whatever made it:

    max |x_h - x_h/2| / way,   max |v_h - v_h/2| / max |v|,

of a body, with x = (x_C, A turn) and v = (v_C, A w), of a thin one by either A (see
engine.velocities).  Where bodies strike, the two runs do it a little apart: what velocities differ
by for one sample only is that.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.accuracy.prices import evaluations, seconds_of_evaluation
from rb_sim.contact.motion import motion_of
from rb_sim.engine.methods.registry import name_of
from rb_sim.engine.velocities import by_lengths, measured
from rb_sim.errors import SimulationError
from rb_sim.loops.places import PIECE_STEPS
from rb_sim.maths.vectors import conjugate, quaternion_product

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array
    from rb_sim.engine.velocities import Measures
    from rb_sim.motion import Motion

FEW_STEPS = 1000
"""Steps, times bodies, of a run that are taken again whatever they cost, three for each of it."""

MOST_TIME = 1e-3
"""CPU time of these steps of the run [s] up to which there may be more of them, by what steps are
said to cost (accuracy.prices): with the three for each one some hundredth of what a command takes
to start."""

ROWS = 1000
"""Instants, about, at which the two runs are compared, evenly over all: each costs as much as ten
steps of a small scene."""

SAME_STEP = 1e-9
"""Share of its steps by which a run is no longer than these steps."""

FEW_EVENTS = 8
"""Events of contacts before whose next one a run in contact is taken again: each costs as much as
hundreds of steps, and bounces that follow each other closely magnify what no step is at fault
for."""

PATIENCE = 8
"""Times that a trial may report, PIECE_STEPS steps or pieces of a guide apart, or at an event,
beyond those of its own steps."""

ROUNDING = 1e-9
"""Share of places, and of velocities and places over a step, within which two runs are one."""

UNMOVED = 1e-13
"""The same, of the radius of gyration of a body, which may lie in the origin and not move."""


class Strayed(NamedTuple):
    """Where a run is farthest from the same in half steps."""

    share: float = 0.0
    """of a body's way or largest velocity; of the time, where the run in half steps ends early."""
    t: float = 0.0
    """[s]."""
    body: str = ""
    of: str = ""
    """what it is a share of."""
    upto: float = 0.0
    """the time up to which the two were compared [s]."""
    turn: float = 0.0
    """the largest angle between the attitudes of a body in the two [rad], and of which: a share of
    a long way does not show it."""
    turned: str = ""


class Probe(NamedTuple):
    """What some steps show, by measure of a body; shapes (M,), speed (n, M)."""

    t: float
    at: int
    """steps of the run up to there."""
    change: Array
    """of the velocities in a step, the largest."""
    missed: Array
    """of the velocities, by all of these steps; 0 where that may be rounding."""
    rate: Array
    """the same by a step."""
    speed: Array


class Coarseness(NamedTuple):
    """The worst probe of a run so far."""

    share: float = 0.0
    """of the change of a body's velocities in a step: what the step misses of it."""
    t: float = 0.0
    """[s]."""
    body: str = ""
    grown: float = 0.0
    """what all steps so far miss of a body's velocities, over the largest of them."""
    grown_body: str = ""
    in_contact: bool = False
    """whether it was found between the events of contacts, which magnify what steps miss."""
    strayed: Strayed = Strayed()
    """how far the run is from the same in half steps, as far as it was taken again."""


def taken_again(
    run: Motion,
    steps: int,
    trials: tuple[Motion, Motion] | None,
    measures: Measures,
    bodies: tuple[str, ...],
    early: Array,
) -> Strayed:
    """How far the run is from the same in half steps, of so many of its steps from its start on.

    trials: motions beside it, with its step and with half of it; None: they are made. early: what
    is known already of the one with its step, the samples at its start and after each step.
    """
    step = run.method.step
    if trials is None:
        half = run.method._replace(step=0.5 * step)
        trials = motion_of(run.compiled, run.method), motion_of(run.compiled, half)
    stride = ceil(steps / ROWS)
    at = np.append(np.arange(0, steps, stride), steps)
    times = np.minimum(step * at, run.time)
    whole = step * steps <= run.time * (1.0 + SAME_STEP)
    known = early[at] if whole and len(early) > steps else None
    return strayed(trials, times, measures, bodies, known)


def steps_again(run: Motion) -> int:
    """How many steps of the run, from its start on, are taken again; the last may be a part of one.

    None of a run with which somebody interfered.
    """
    if not run.as_compiled or run.forgotten or not run.steps > 0:
        return 0
    step, compiled, bodies = run.method.step, run.compiled, len(run.layout.bodies)
    most, name = FEW_STEPS // bodies, name_of(type(run.method))
    if name and not run.event_driven:
        price = evaluations(name, None, compiled) * seconds_of_evaluation(compiled)
        most = max(most, int(MOST_TIME / price))
    steps = ceil(run.time / step * (1.0 - SAME_STEP))
    if len(run.events) > FEW_EVENTS:
        steps = min(steps, int(run.events[FEW_EVENTS].t / step * (1.0 - SAME_STEP)))
    return min(steps, most)


def strayed(
    trials: tuple[Motion, Motion],
    times: Array,
    measures: Measures,
    bodies: tuple[str, ...],
    known: Array | None = None,
) -> Strayed:
    """How far the run is from the same in half steps, from its start on.

    trials: motions beside the run, with its step and with half of it; times: the ends of its steps
    [s], the first is 0; measures: of the bodies; known: samples of the first trial at the times.
    """
    whole = _from_start(trials[0], times) if known is None else known
    half = _from_start(trials[1], times)
    count = min(len(whole), len(half))
    found = Strayed()
    if count > 1:
        rows = whole[:count], half[:count]
        found = _apart(*rows, times[:count], measures, bodies, trials[0].event_driven)
    if len(half) < len(whole):
        t = float(times[len(half) - 1]) if len(half) else 0.0
        early = Strayed(1.0 - t / float(times[len(whole) - 1]), t, "", "time")
        found = max(found, early)
    return found._replace(upto=float(times[len(whole) - 1]) if len(whole) else 0.0)


def _from_start(trial: Motion, times: Array) -> Array:
    """The samples of the trial at the times that it reaches."""
    patience = PATIENCE + (2 * FEW_EVENTS if trial.event_driven else 0)
    patience += int(times[-1] / trial.method.step / PIECE_STEPS)

    def wait() -> None:
        nonlocal patience
        patience -= 1
        if patience < 0:
            raise SimulationError("a trial has no end")

    if not trial.event_driven:  # those are made for it, and to begin costs more than some steps
        trial.reset()
    out, before, trial.watch = np.zeros((len(times), trial.width)), trial.watch, wait
    try:
        trial.run_to(times, out)
    except SimulationError:
        return out[: int(np.searchsorted(times, trial.time, side="right"))]
    finally:
        trial.watch = before
    return out


def _apart(
    whole: Array,
    half: Array,
    times: Array,
    measures: Measures,
    bodies: tuple[str, ...],
    strikes: bool = False,
) -> Strayed:
    """The largest share by which two runs with the same times part.

    strikes: whether velocities may jump, in the two a little apart.
    """
    one, two = (by_measure(rows, measures, len(bodies)) for rows in (whole, half))
    lengths, names = measures.lengths, [bodies[body] for body in measures.body]
    steps = np.diff(times)[:, None]
    with np.errstate(all="ignore"):  # of a motion that grows without end
        place = np.linalg.norm(one[..., :3] - two[..., :3], axis=2)
        turned = _turn_between(one, two)
        turn, angle = (
            np.linalg.norm(vectors, axis=2) for vectors in (by_lengths(lengths, turned), turned)
        )
        velocity, other = velocities_of(one, lengths), velocities_of(two, lengths)
        speed = np.linalg.norm(other, axis=2)
        way = (0.5 * (speed[1:] + speed[:-1]) * steps).sum(axis=0)
        size = np.linalg.norm(two[..., :3], axis=2).max(axis=0)
        fastest, length = speed.max(axis=0), steps.mean()
        none = ROUNDING * size + UNMOVED * np.linalg.norm(lengths, 2, axis=(1, 2))
        off = np.hypot(place, turn)
        off = np.where(off > none, off, 0.0) / way
        missed = np.linalg.norm(velocity - other, axis=2)
        if strikes:
            missed[1:] = np.minimum(missed[1:], missed[:-1])
        missed = np.where(missed > ROUNDING * fastest + none / length, missed, 0.0) / fastest
    most = _worst(np.where(angle > ROUNDING, angle, 0.0), times, names, "turn")
    worst = max(_worst(off, times, names, "way"), _worst(missed, times, names, "largest velocity"))
    return worst._replace(turn=2.0 * float(np.arcsin(min(1.0, 0.5 * most.share))), turned=most.body)


def rows_from(trial: Motion, t: float, step: float, count: int) -> Array | None:
    """Samples of the trial, which is at t, there and after each of so many steps; None, and nothing
    is said, where one fails: as the run itself will say."""
    times = np.array([t + step * k for k in range(count + 1)])
    out = np.zeros((len(times), trial.width))
    try:
        trial.run_to(times, out)
    except SimulationError:
        return None
    return out


def by_measure(rows: Array, measures: Measures, bodies: int) -> Array:
    """Coordinates of the body of each measure, shape (n, M, 13), of the rows of samples."""
    return rows[:, : 13 * bodies].reshape(len(rows), -1, 13)[:, measures.body]


def velocities_of(rows: Array, lengths: Array) -> Array:
    """(v_C, A w) by measure, shape (n, M, 6), of coordinates by measure."""
    return measured(rows[..., 7:10], rows[..., 10:13], lengths)


def _turn_between(one: Array, two: Array) -> Array:
    """The turns from the other to the one as vectors in body axes (n, M, 3), twice the sine of half
    the angle long."""
    first, second = (tuple(np.moveaxis(rows[..., 3:7], -1, 0)) for rows in (one, two))
    return 2.0 * np.stack(quaternion_product(conjugate(second), first)[:3], axis=-1)


def _worst(shares: Array, times: Array, bodies: list[str], of: str) -> Strayed:
    """The largest of the shares (n, M); what is not finite has grown without end, or rests."""
    finite = np.nan_to_num(shares, nan=0.0, posinf=0.0)
    i, body = np.unravel_index(int(np.argmax(finite)), finite.shape)
    return Strayed(float(finite[i, body]), float(times[i]), bodies[int(body)], of)
