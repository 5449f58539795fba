"""The local error of fixed steps by step doubling: steps taken again in halves."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.accuracy.choice import evaluations, seconds_of_evaluation
from rb_sim.base.errors import SimulationError
from rb_sim.contact.choose_motion import motion_of
from rb_sim.integrate.layout import PIECE_STEPS
from rb_sim.mechanics.error_scales import by_lengths, measured, measures_of
from rb_sim.mechanics.methods import name_of
from rb_sim.motion.motion import Motion
from rb_sim.numerics.vectors import conjugate, quaternion_product

if TYPE_CHECKING:
    from rb_sim.mechanics.error_scales import Measures
    from rb_sim.mechanics.samples import Array
    from rb_sim.scene.schema import Scene


# Whether a short run in fixed steps follows the motion: all of it is taken again in half steps.
#
# A run of some steps can be wrong by a third where no step of it looks bad: Euler's way under a
# constant load, whose velocities are exact, is short by the share 1/n after n steps.  Two runs of
# order p in steps h and h/2 are apart by 1 - 2^-p of the error of the first, so that a difference
# is an error, whatever made it:
#
#     max |x_h - x_h/2| / way,   max |v_h - v_h/2| / max |v|,
#
# of a body, with x = (x_C, A turn) and v = (v_C, A w), of a thin one by either A (see
# mechanics.error_scales).  Where bodies strike, the two runs do it a little apart: what velocities
# differ by for one sample only is that.


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
        early = Strayed(1.0 - t / float(times[len(whole) - 1]), t, "", "duration")
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
    worst = max(
        _worst(off, times, names, "distance moved"),
        _worst(missed, times, names, "largest velocity"),
    )
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


# Whether a fixed step follows the motion: some steps taken beside the run, whole and in halves.
#
# A symplectic method keeps the energy of an oscillation that it steps over, so no balance shows
# that the motion is another one.  What shows is that a step and its two halves tell different
# changes of the velocities:
#
#     max |v_h - v_h/2| / max |v(t + h) - v(t)|,  v = (v_C, A w) of a body (see above),
#
# over the steps of a probe; a thin body is measured with either A.  It is some (w h)^p for a step
# that follows an oscillation of frequency w, and of the order of one for a step that does not.
# Where the acceleration passes through zero just there, a step of any length misses as much as the
# velocities change by: so what they changed by in the probes before counts as well, and the less
# the longer ago that is.
#
# A step that follows the motion by itself may lose it over many: what the steps miss adds up,
#
#     sum over steps of |v_h - v_h/2| / max |v|,
#
# between two probes at the rate of the smaller of them, so that a start that dies out counts
# little. A short run is taken again as a whole, and of a long one the beginning (`taken_again`).


STEPS = 4
"""Steps of a probe; twice as many halves are taken beside them."""

EARLY = 1000
"""Steps from the start on that are all looked at: in a run of few steps some may go wrong, and what
comes after them may look as well as what was before."""

OF_MANY = 2500
"""The same, times bodies, where that is less: they are taken once more, to see which those are."""

SUSPECTS = 4
"""Probes among these steps, at most: where accelerations change most."""

APART = 1000
"""Steps of the run between two probes, if there are as many before: a probe costs as much as 12."""

FADES = 0.5
"""What becomes of a change of velocities from one probe to the next."""

AGAIN = 2
"""Times as many steps as before after which a run is taken again from its start: twice its cost in
all, then."""

HARDLY = 1e-3
"""Share of its speed by which a body's velocity hardly changes in a step, so that what is missed of
that counts as little; it counts where it adds up."""

PROBE_ROUNDING, SOLVED = 1e-11, 1e-9
"""Share of the velocities, and of the places over a step, that roundings reach, and the solver of a
step of time stepping."""


def _give_up() -> None:
    """Called where a trial takes a thousand times as many steps as a probe has: pieces of a guide
    that a motion without bounds passes."""
    raise SimulationError("a probe has no end")


class StepProbe:
    """Probes the run of a motion with a fixed step now and then; others it lets pass."""

    def __init__(self, scene: Scene, run: Motion) -> None:
        self.run = run
        self._worst, self._due, self._again = Coarseness(), 0, 0
        self._early = np.zeros((0, 0))
        """samples of the first steps, one after each, until they are judged."""
        step: float | None = getattr(run.method, "step", None)
        self._able, self._bodies = step is not None and not run.event_driven, tuple(scene.bodies)
        if step is None:
            return
        self._measures = measures_of(scene.bodies.values())
        self._names = [self._bodies[body] for body in self._measures.body]
        if not self._able:
            return
        half = run.method._replace(step=0.5 * step)
        self._step = step
        # of coordinates of bodies in turn, which a sample begins with: a motion can go on from it
        self._goes_on_from_samples = isinstance(run.coordinates, np.ndarray)
        self._trials = motion_of(run.compiled, run.method), motion_of(run.compiled, half)
        for trial in self._trials:
            trial.watch = _give_up
        self._strikes = bool(run.layout.contacts)
        nothing = np.zeros(len(self._names))
        self._rate, self._missed, self._size, self._usual = nothing, nothing, nothing, nothing
        self._counted = 0
        """steps up to which what is missed has been added up."""

    def look(self) -> Coarseness:
        """Probe where the run is, if it is time for it, and at first at its start; the worst."""
        if self.run.event_driven and getattr(self.run.method, "step", None) is not None:
            return self._in_contact()
        if not self._able or self.run.steps < self._due:
            return self._worst
        if not self._due:
            self._look_at_first_steps()
        apart = APART if self._strikes else min(APART, max(self.run.steps, 1))
        self._due = self.run.steps + apart
        self._usual = FADES * self._usual
        if not self._strikes:
            self._take_again(self._trials)
        now = self._probe(self._place, self.run.time, self.run.steps)
        if now is not None:
            self._judge(now)
            self._add_up(now)
        return self._worst

    def _take_again(self, trials: tuple[Motion, Motion] | None) -> None:
        steps, before = steps_again(self.run), self._worst.strayed
        if steps >= AGAIN * self._again and steps:
            self._again = steps
            early, self._early = self._early, self._early[:0]
            found = taken_again(self.run, steps, trials, self._measures, self._bodies, early)
            turn = max((found.turn, found.turned), (before.turn, before.turned))
            worst = max(found, before)._replace(
                upto=max(found.upto, before.upto), turn=turn[0], turned=turn[1]
            )
            self._worst = self._worst._replace(strayed=worst)

    def _in_contact(self) -> Coarseness:
        """The whole run again alone: a probe would have to choose the modes anew."""
        if self.run.steps >= self._due:
            self._due = 2 * self.run.steps
            self._take_again(None)
        return self._worst

    def _look_at_first_steps(self) -> None:
        """Probe the start, and what looks worst of the run, where it began as the scene says and
        nobody has commanded it since."""
        start = self._probe(self._reset, 0.0, 0) if self.run.as_compiled else None
        if start is None:
            return
        last = min(self.run.steps, EARLY, OF_MANY // len(self._bodies))
        # where bodies strike, accelerations change most at the strikes, which no step follows
        suspects = self._suspects(last) if last > STEPS and not self._strikes else []
        if suspects and not self._goes_on_from_samples:
            self._trials[0].reset()
        probes = [probe for first in sorted(suspects) if (probe := self._suspected(first, last))]
        self._usual = np.max([probe.change for probe in [start, *probes]], axis=0)
        self._judge(start)
        self._add_up(start)
        for probe in probes:
            self._judge(probe)

    def _suspects(self, last: int) -> list[int]:
        """The steps after which accelerations change most, of any body, over what its velocity
        changes by in a step; STEPS apart."""
        whole = self._trials[0]
        whole.reset()
        rows = np.zeros((last + 1, whole.width))
        try:
            whole.run_to(np.asarray(self._step * np.arange(last + 1), float), rows)
        except SimulationError:
            return []
        self._early = rows
        with np.errstate(all="ignore"):
            by_step = np.diff(self._velocities(rows)[1], axis=0)
            most = np.linalg.norm(by_step, axis=2).max(axis=0)
            bends = np.linalg.norm(np.diff(by_step, axis=0), axis=2) / np.where(most > 0, most, 1.0)
        worst = np.nan_to_num(bends).max(axis=1)
        found: list[int] = []
        while len(found) < SUSPECTS and (most := float(worst.max(initial=0.0))) > 0.0:
            k = int(np.argmax(worst == most))
            found.append(max(0, k + 1 - STEPS // 2))
            worst[max(0, k - STEPS) : k + STEPS + 1] = 0.0
        return found

    def _suspected(self, first: int, last: int) -> Probe | None:
        """What the steps show from the run's step `first` on."""
        whole, half = self._trials
        t, count = self._step * first, min(STEPS, last - first)
        if not self._goes_on_from_samples:
            return self._after(t, count, first)
        rows = self._early[first : first + count + 1]
        half.reset_beside(self.run, rows[0, : 13 * len(self._bodies)].copy(), t)
        halves = rows_from(half, t, self._step, count)
        return None if halves is None else self._compared(rows, halves, t, first)

    def _after(self, t: float, count: int, at: int) -> Probe | None:
        """The same where coordinates are not among the samples: the trial goes on up to there."""
        whole, half = self._trials
        if whole.time > t + 0.5 * self._step:
            whole.reset()
        try:
            whole.run_to(np.array([t]))
        except SimulationError:
            return None
        half.reset_beside(whole, whole.coordinates, whole.time)
        return self._taken(whole.time, count, at)

    def _reset(self) -> None:
        """Let the trials begin where the run began."""
        for trial in self._trials:
            trial.reset()

    def _place(self) -> None:
        """Let the trials begin where the run is."""
        for trial in self._trials:
            trial.reset_beside(self.run, self.run.coordinates, self.run.time)
            if trial.layout.commanded:
                trial.change_law(self.run.system)

    def _probe(self, place: Callable[[], None], t: float, at: int) -> Probe | None:
        """What steps show from where `place` puts the trials, at t; a single one where the motion
        does not come to the end of several."""
        for count in (STEPS, 1):
            place()
            probe = self._taken(t, count, at)
            if probe is not None:
                return probe
        return None

    def _taken(self, t: float, count: int, at: int) -> Probe | None:
        """What `count` steps show from where the trials are, at t; None, and nothing is said, where
        one fails."""
        whole, half = (rows_from(trial, t, self._step, count) for trial in self._trials)
        return None if whole is None or half is None else self._compared(whole, half, t, at)

    def _velocities(self, out: Array) -> tuple[Array, Array]:
        """Places (n, M, 3) and (v, A w) (n, M, 6) by measure."""
        body = by_measure(out, self._measures, len(self._bodies))
        return body[:, :, :3], velocities_of(body, self._measures.lengths)

    def _compared(self, whole: Array, half: Array, t: float, at: int) -> Probe:
        place, velocity = self._velocities(half)
        with np.errstate(all="ignore"):  # of a motion that grows without end
            change = np.linalg.norm(np.diff(velocity, axis=0), axis=2).max(axis=0)
            missed, rounding = self._missed_by(self._velocities(whole)[1], velocity)
            speed = np.linalg.norm(velocity, axis=2)
            noise = speed + np.linalg.norm(place, axis=2) / self._step
            missed = np.where(missed > rounding * noise.max(axis=0), missed, 0.0)
            count = 1 if self._strikes else len(place) - 1
        return Probe(t, at, change, missed, missed / count, speed)

    def _judge(self, probe: Probe) -> None:
        with np.errstate(all="ignore"):
            self._usual = np.fmax(probe.change, self._usual)
            change = np.fmax(self._usual, HARDLY * probe.speed.max(axis=0))
            share = np.where(probe.missed > 0.0, probe.missed / change, 0.0)
            worst = int(np.argmax(np.nan_to_num(share)))
            if share[worst] > self._worst.share:
                self._worst = self._worst._replace(
                    share=float(share[worst]), t=probe.t, body=self._names[worst]
                )

    def _missed_by(self, whole: Array, half: Array) -> tuple[Array, float]:
        """What a step misses of the velocities of each body, (M,), and the share that is rounding.

        Where bodies strike, the two see it a step apart and differ for that step by all of it; so
        what counts there is what every step misses.
        """
        if not self._strikes:
            return np.linalg.norm(whole - half, axis=2).max(axis=0), PROBE_ROUNDING
        by_step = np.linalg.norm(np.diff(whole - half, axis=0), axis=2)
        return by_step.min(axis=0), SOLVED

    def _add_up(self, probe: Probe) -> None:
        """Add what the steps since the last probe have missed."""
        with np.errstate(all="ignore"):
            steps = max(0, probe.at - self._counted)
            self._missed = self._missed + steps * np.minimum(self._rate, probe.rate)
            self._size = np.maximum(self._size, probe.speed.max(axis=0))
            grown = np.nan_to_num(self._missed / self._size)  # of what rests: 0
        self._rate, self._counted = probe.rate, probe.at
        most = int(np.argmax(grown))
        self._worst = self._worst._replace(grown=float(grown[most]), grown_body=self._names[most])
