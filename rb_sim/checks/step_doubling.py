# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The local error of fixed steps: some steps taken beside the run, and again in shorter ones.

A symplectic method keeps the energy of an oscillation that it steps over, so no balance shows that
the motion is another one.  What shows is that steps of h and of r h tell different changes of the
velocities,

    max |v_h - v_rh| / (1 - r^p) / max |v(t + h) - v(t)|,  v = (v_C, A w) of a body,

A^2 = moments / mass, over the steps of a probe: some (w h)^p for a step that follows an oscillation
of frequency w, and of the order of one for a step that does not.  r is the golden section, that of
the second run (checks/second_run), so that no load has the same phase in the steps of both.  Where
the acceleration passes through zero just there, a step of any length misses as much as the
velocities change by; so what they changed by in other probes counts as well, and the less the
longer ago that is.  A thin body is measured with either A (mechanics/error_scales).

A step that follows the motion by itself may lose it over many, so what steps miss of the
velocities is added up, between two probes at the rate of the smaller of them.  The attitude is
compared by itself: a long way does not show it.

The run as a whole is compared by the second run; this is for what it does not reach: long runs,
the node, commands.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.base.rounding import SOLVED
from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.error_scales import measured, measures_of
from rb_sim.mechanics.methods import order_of
from rb_sim.numerics.rotations import angle_between

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array
    from rb_sim.motion.motion import Motion
    from rb_sim.scene.compiled import Compiled
    from rb_sim.scene.schema import Scene

SHORTER = 0.5 * (math.sqrt(5.0) - 1.0)
"""A shorter step over that of the run: the number that is farthest from all fractions, so that no
load is at the same phase in all steps of both."""

STEPS = 4
"""Steps of a probe; shorter ones are taken beside them."""

APART = 1000
"""Steps of the run between two probes, if there are as many before: a probe costs as much as 11."""

FADES = 0.5
"""What becomes of a change of velocities from one probe to the next."""

HARDLY = 1e-3
"""Share of its speed by which a body's velocity hardly changes in a step, so that what is missed of
that counts as little; it counts where it adds up."""

ROUNDING = 1e-11
"""Share of the velocities, and of the places over a step, that roundings reach; the solver of a
step of time stepping leaves more, SOLVED."""


class LocalError(NamedTuple):
    """The worst probes of a run so far."""

    share: float = 0.0
    """of the change of a body's velocities in a step: what the step misses of it."""
    t: float = 0.0
    """[s]."""
    body: str = ""
    grown: float = 0.0
    """what all steps so far miss of a body's velocities, over the largest of them."""
    grown_body: str = ""
    turn: float = 0.0
    """what the steps of a probe miss of a body's attitude [rad]."""
    turn_t: float = 0.0
    """[s]."""
    turn_body: str = ""


class _Probe(NamedTuple):
    """What some steps show, by measure of a body, (M,) each; turn by body."""

    t: float
    at: int
    """steps of the run up to there."""
    change: Array
    """of the velocities in a step, the largest."""
    missed: Array
    """of the velocities by all of these steps; 0 where that may be rounding."""
    rate: Array
    """the same by a step."""
    speed: Array
    turn: Array


def in_shorter_steps(run: Motion, compiled: Compiled, times: int = 1) -> tuple[Motion, float]:
    """A motion like `run`, of the compiled scene, in fixed steps that are SHORTER so many times,
    also those that end at the points of a table; and by how much of the error of the run the two
    are apart."""
    part = SHORTER**times
    finer: Any = run.method
    if compiled.breakpoints:
        ends = np.array([0.0, *compiled.breakpoints])
        for _ in range(times):
            ends = np.union1d(ends, ends[:-1] + SHORTER * np.diff(ends))
        cut = replace(compiled, breakpoints=tuple(ends[1:].tolist()))
        if "laws" in compiled.__dict__:
            cut.__dict__["laws"] = compiled.laws
        compiled = cut
    return motion_of(compiled, finer._replace(step=part * finer.step)), 1.0 - part ** order_of(
        finer
    )


def _give_up() -> None:
    """Called where a trial takes a thousand times as many steps as a probe has: pieces of a guide
    that a motion without bounds passes."""
    raise SimulationError("a probe has no end")


class StepDoubling:
    """Probes the run of a motion in fixed steps now and then; of others it tells nothing, nor in
    contact by events, whose modes a trial would have to choose anew."""

    def __init__(self, scene: Scene, run: Motion) -> None:
        self.run = run
        self._worst, self._due = LocalError(), 0
        step: float | None = getattr(run.method, "step", None)
        self._able = step is not None and not run.event_driven
        if step is None or not self._able:
            return
        self._step, self._bodies = step, tuple(scene.bodies)
        self._measures = measures_of(scene.bodies.values())
        self._names = [self._bodies[body] for body in self._measures.body]
        shorter, self._share = in_shorter_steps(run, run.compiled)
        self._trials = motion_of(run.compiled, run.method), shorter
        for trial in self._trials:
            trial.watch = _give_up
        self._strikes = bool(run.layout.contacts)
        nothing = np.zeros(len(self._names))
        self._rate, self._missed, self._size, self._usual = nothing, nothing, nothing, nothing
        self._counted = 0
        """steps up to which what is missed has been added up."""

    def look(self) -> LocalError:
        """Probe where the run is, if it is time for it, and at first at its start; the worst."""
        if not self._able or self.run.steps < self._due:
            return self._worst
        first = self._due == 0 and self.run.as_compiled
        self._due = self.run.steps + (APART if self._strikes else min(APART, self.run.steps or 1))
        probes = [self._probe(self._restart, 0.0, 0)] if first else []
        probes.append(self._probe(self._place, self.run.time, self.run.steps))
        known = [probe for probe in probes if probe is not None]
        with np.errstate(all="ignore"):  # of a motion that grows without end
            self._usual = np.fmax.reduce([FADES * self._usual, *(p.change for p in known)])
            for probe in known:
                self._judge(probe)
                self._add_up(probe)
        return self._worst

    def _restart(self) -> None:
        """Let the trials begin where the run began."""
        for trial in self._trials:
            trial.reset()

    def _place(self) -> None:
        """Let the trials begin where the run is."""
        for trial in self._trials:
            trial.reset_beside(self.run, self.run.coordinates, self.run.time)
            if trial.layout.commanded:
                trial.change_law(self.run.system)

    def _probe(self, place: Callable[[], None], t: float, at: int) -> _Probe | None:
        """What steps show from where `place` puts the trials, at t: a single one where the motion
        does not come to the end of several, or they overflow; None, and nothing is said, where it
        fails too."""
        for count in (STEPS, 1):
            place()
            times = np.array([t + self._step * k for k in range(count + 1)])
            try:
                long, short = (_sampled(trial, times) for trial in self._trials)
            except SimulationError:
                continue
            with np.errstate(all="ignore"):
                probe = self._compared(long, short, t, at)
            if np.isfinite([probe.missed, probe.change]).all():
                return probe
        return None

    def _compared(self, long: Array, short: Array, t: float, at: int) -> _Probe:
        one, two = (
            rows[:, : 13 * len(self._bodies)].reshape(len(rows), -1, 13) for rows in (long, short)
        )
        turn, velocity = angle_between(one[..., 3:7], two[..., 3:7]), self._velocities(two)
        missed, turn = (self._velocities(one) - velocity) / self._share, turn / self._share
        place = np.linalg.norm(two[:, self._measures.body, :3], axis=2).max(axis=0)
        speed = np.linalg.norm(velocity, axis=2).max(axis=0)
        if self._strikes:
            # the two see a strike a step apart, and differ for that step by all of it: what
            # counts is what every step misses
            missed, turn = np.diff(missed, axis=0), np.diff(turn, axis=0)
            figure, turn = np.linalg.norm(missed, axis=2).min(axis=0), turn.min(axis=0)
        else:
            figure, turn = np.linalg.norm(missed, axis=2).max(axis=0), turn.max(axis=0)
        noise = (SOLVED if self._strikes else ROUNDING) * (speed + place / self._step)
        figure = np.where(figure > noise, figure, 0.0)
        change = np.linalg.norm(np.diff(velocity, axis=0), axis=2).max(axis=0)
        count = 1 if self._strikes else len(long) - 1
        return _Probe(t, at, change, figure, figure / count, speed, turn)

    def _velocities(self, bodies: Array) -> Array:
        """(v_C, A w) by measure, shape (n, M, 6), of coordinates by body."""
        rows = bodies[:, self._measures.body]
        return measured(rows[..., 7:10], rows[..., 10:13], self._measures.lengths)

    def _judge(self, probe: _Probe) -> None:
        change = np.fmax(self._usual, HARDLY * probe.speed)
        share = np.nan_to_num(np.where(probe.missed > 0.0, probe.missed / change, 0.0))
        k = int(np.argmax(share))
        if share[k] > self._worst.share:
            self._worst = self._worst._replace(
                share=float(share[k]), t=probe.t, body=self._names[k]
            )
        turn = np.nan_to_num(probe.turn)
        k = int(np.argmax(turn))
        if turn[k] > self._worst.turn:
            self._worst = self._worst._replace(
                turn=float(turn[k]), turn_t=probe.t, turn_body=self._bodies[k]
            )

    def _add_up(self, probe: _Probe) -> None:
        """Add what the steps since the last probe have missed."""
        steps = max(0, probe.at - self._counted)
        self._missed = self._missed + steps * np.minimum(self._rate, probe.rate)
        self._size = np.maximum(self._size, probe.speed)
        self._rate, self._counted = probe.rate, probe.at
        grown = np.nan_to_num(self._missed / self._size)  # of what rests: 0
        k = int(np.argmax(grown))
        self._worst = self._worst._replace(grown=float(grown[k]), grown_body=self._names[k])


def _sampled(trial: Motion, times: Array) -> Array:
    """Rows of the trial at the times. Raises SimulationError."""
    out = np.zeros((len(times), trial.width))
    trial.run_to(times, out)
    return out
