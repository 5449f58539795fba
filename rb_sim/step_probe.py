"""Whether a fixed step follows the motion: some steps taken beside the run, whole and in halves.

A symplectic method keeps the energy of an oscillation that it steps over, so no balance shows that
the motion is another one.  What shows is that a step and its two halves tell different changes of
the velocities:

    max |v_h - v_h/2| / max |v(t + h) - v(t)|,  v = (v_C, A w) of a body (see engine.velocities),

over the steps of a probe; a thin body is measured with either A.  It is some (w h)^p for a step
that follows an oscillation of frequency w, and of the order of one for a step that does not.  Where
the acceleration passes through zero just there, a step of any length misses as much as the
velocities change by: so what they changed by in the probes before counts as well, and the less the
longer ago that is.

A step that follows the motion by itself may lose it over many: what the steps miss adds up,

    sum over steps of |v_h - v_h/2| / max |v|,

between two probes at the rate of the smaller of them, so that a start that dies out counts little.
A short run is taken again as a whole, and of a long one the beginning (see half_steps).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rb_sim.contact.motion import motion_of
from rb_sim.engine.velocities import measures_of
from rb_sim.errors import SimulationError
from rb_sim.half_steps import (
    Coarseness,
    Probe,
    by_measure,
    rows_from,
    steps_again,
    taken_again,
    velocities_of,
)
from rb_sim.motion import Motion

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array
    from rb_sim.scene.schema import Scene

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

ROUNDING, SOLVED = 1e-11, 1e-9
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
        """What the loop has added up by itself: a probe would have to choose the modes anew."""
        run = cast(Any, self.run)
        if run.steps >= self._due:
            self._due = 2 * run.steps
            self._take_again(None)
        grown, (worst, share, t) = run.missed_by_steps, run.worst_step
        most = int(np.argmax(grown))
        names, strayed = self._bodies, self._worst.strayed
        return Coarseness(share, t, names[worst], float(grown[most]), names[most], True, strayed)

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
            return np.linalg.norm(whole - half, axis=2).max(axis=0), ROUNDING
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
