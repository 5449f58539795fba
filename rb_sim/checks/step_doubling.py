# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What fixed steps miss: some steps taken beside the run, and again in shorter ones.

A symplectic method keeps the energy of an oscillation that it steps over, so no balance shows that
the motion is another one.  What shows is that steps of h and of r h tell different velocities and
attitudes after the same time, by

    (1 - r^p) |dv|,  v = (v_C, A w) of a body,  A^2 = moments / mass,

and as much of their turns.  What a step misses of either is added up over all steps, in the probes
as they are and between two probes at the smaller rate of theirs: over the largest velocity of the
body, or in radians, it is about the global error of a motion that magnifies nothing.  r is
the golden section, that of the second run (checks/second_run), so that no load has the same phase
in the steps of both.  A thin body is measured with either A (mechanics/error_scales).

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

ROUNDING = 1e-11
"""Rounding error of velocities and of displacements in a step, relative to them; the solver of
time stepping leaves more, SOLVED."""


class Missed(NamedTuple):
    """What all steps of a run so far miss, added up."""

    share: float = 0.0
    """of a body's velocities, over the largest of them; or of its attitude [rad]."""
    body: str = ""


class _Probe(NamedTuple):
    """What some steps show."""

    speed: Array
    """largest velocity by measure of a body, (M,)."""
    rate: Array
    """velocity, (M,), and attitude of each body [rad] that a step misses, (M + bodies,)."""
    steps: int
    """that count by themselves."""


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
        self._due = 0
        step: float | None = getattr(run.method, "step", None)
        self._able = step is not None and not run.event_driven
        if step is None or not self._able:
            return
        self._step, self._bodies = step, tuple(scene.bodies)
        self._measures = measures_of(scene.bodies.values())
        shorter, self._share = in_shorter_steps(run, run.compiled)
        self._trials = motion_of(run.compiled, run.method), shorter
        for trial in self._trials:
            trial.watch = _give_up
        self._strikes = bool(run.layout.contacts)
        measures = len(self._measures.body)
        self._largest = np.zeros(measures)
        self._rate, self._missed = np.zeros((2, measures + len(self._bodies)))
        self._counted = 0
        """steps up to which what is missed has been added up."""

    def look(self) -> Missed:
        """Probe where the run is, if it is time for it, and at first at its start."""
        if not self._able:
            return Missed()
        if self.run.steps >= self._due:
            with np.errstate(all="ignore"):  # of a motion that grows without end
                if self._due == 0 and self.run.as_compiled:
                    self._add(self._probe(self._restart, 0.0), 0)
                self._add(self._probe(self._place, self.run.time), self.run.steps)
            apart = APART if self._strikes else min(APART, self.run.steps or 1)
            self._due = self.run.steps + apart
        scale = np.append(self._largest, np.ones(len(self._bodies)))
        share = np.divide(self._missed, scale, out=np.zeros(len(scale)), where=scale > 0.0)
        k = int(np.argmax(share))
        body = (*self._measures.body.tolist(), *range(len(self._bodies)))[k]
        return Missed(float(share[k]), self._bodies[body])

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

    def _probe(self, place: Callable[[], None], t: float) -> _Probe | None:
        """What steps show from where `place` puts the trials, at t: a single one where the motion
        does not come to the end of several, or they overflow; None where it fails too."""
        for count in (STEPS, 1):
            place()
            times = np.array([t + self._step * k for k in range(count + 1)])
            try:
                long, short = (self._sampled(trial, times) for trial in self._trials)
            except SimulationError:
                continue
            probe = self._compared(long, short)
            if np.isfinite(np.append(probe.rate, probe.speed)).all():
                return probe
        return None

    def _compared(self, one: Array, two: Array) -> _Probe:
        """Of the steps of the run and of shorter ones, coordinates (n, bodies, 13)."""
        velocity, place = self._velocities(two), two[:, self._measures.body, :3]
        speed, far = (np.linalg.norm(of, axis=2).max(axis=0) for of in (velocity, place))
        missed = self._velocities(one) - velocity
        turn = angle_between(one[..., 3:7], two[..., 3:7])
        if self._strikes:
            # the two see a strike a step apart, and differ for that step by all of it: what
            # counts is what every step misses, and what two probes do
            missed, turn = np.diff(missed, axis=0), np.diff(turn, axis=0)
            figure, turn = np.linalg.norm(missed, axis=2).min(axis=0), turn.min(axis=0)
        else:
            figure, turn = np.linalg.norm(missed, axis=2).max(axis=0), turn.max(axis=0)
            figure, turn = figure / (len(one) - 1), turn / (len(one) - 1)
        noise = (SOLVED if self._strikes else ROUNDING) * (speed + far / self._step)
        figure = np.where(figure > noise, figure, 0.0)
        rate = np.append(figure, np.maximum(turn, 0.0)) / self._share
        return _Probe(speed, rate, 0 if self._strikes else len(one) - 1)

    def _velocities(self, bodies: Array) -> Array:
        """(v_C, A w) by measure, shape (n, M, 6), of coordinates by body."""
        rows = bodies[:, self._measures.body]
        return measured(rows[..., 7:10], rows[..., 10:13], self._measures.lengths)

    def _add(self, probe: _Probe | None, at: int) -> None:
        """Add what the steps from the last probe to this one, after so many of the run, have
        missed, where it fails as before, and its own."""
        rate, steps = self._rate, at - self._counted
        if probe is not None:
            rate, self._rate = np.minimum(rate, probe.rate), probe.rate
            self._largest = np.maximum(self._largest, probe.speed)
            self._missed = self._missed + probe.steps * probe.rate
            steps -= probe.steps
        self._missed = self._missed + max(0, steps) * rate
        self._counted = at

    def _sampled(self, trial: Motion, times: Array) -> Array:
        """Coordinates of the trial at the times, (n, bodies, 13). Raises SimulationError."""
        out = np.zeros((len(times), trial.width))
        trial.run_to(times, out)
        return out[:, : 13 * len(self._bodies)].reshape(len(times), -1, 13)
