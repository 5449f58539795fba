# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Local errors of fixed steps, by steps h and shorter steps r h from the same state (probes).

A symplectic method keeps the energy of an oscillation that its steps do not resolve, so no balance
shows the error. Steps of h and r h by a method of order p, however, give velocities that differ by

    (1 - r^p) |dv|,  v = (v_C, A w) of a body,  A^2 = moments / mass,

with dv the local error, and likewise attitudes. Local errors are summed over all steps; between two
probes the smaller one counts for every step. Relative to the largest velocity of the body, or in
radians, the sum is about the global error of a motion that does not amplify errors. r is the golden
section, as in the second run (accuracy/checks/second_run), so that no load has the same phase in
both. Thin bodies are measured with each A (mechanics/error_scales).

A second run compares whole runs; probes are for runs that get none: long ones, and the node.
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
    from rb_sim.mechanics.compiled import Compiled
    from rb_sim.mechanics.samples import Array
    from rb_sim.motion.motion import Motion
    from rb_sim.scene.schema import Scene

SHORTER = 0.5 * (math.sqrt(5.0) - 1.0)
"""Factor of the shorter steps, r: the golden section is farthest from all simple fractions, so that
no load has the same phase in all steps of both runs."""

STEPS = 4
"""Number of steps h of a probe."""

APART = 1000
"""Steps of the run between two probes, from step number APART on; a probe costs about 11 steps."""

ROUNDING = 1e-11
"""Rounding error of velocities and displacements in a step, relative to them; for time stepping it
is the solver's tolerance, SOLVED."""


class Missed(NamedTuple):
    """Sum of the local errors of all steps so far."""

    share: float = 0.0
    """the largest: of a body's velocity relative to its maximum, or of its attitude [rad]."""
    body: str = ""


class _Probe(NamedTuple):
    """Result of a probe."""

    speed: Array
    """largest velocity, by measure of a body, (M,)."""
    rate: Array
    """local error of a step: of velocity, (M,), then of each attitude [rad], (M + bodies,)."""
    steps: int
    """number of steps for which it counts itself; 0: only for those between probes."""


def in_shorter_steps(run: Motion, compiled: Compiled, times: int = 1) -> tuple[Motion, float]:
    """A motion of the scene with the steps of `run` times SHORTER^times, including those that end
    at the points of a table; and the share of the run's error by which the two then differ."""
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
    """Called if a trial takes a thousand times the steps of a probe: a motion without bounds may
    pass very many pieces of a guide."""
    raise SimulationError("a probe has no end")


class StepDoubling:
    """Makes probes of a run with fixed steps; none of adaptive or event-driven runs."""

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
        """steps whose local errors have been added up."""

    def look(self) -> Missed:
        """The sum of local errors so far, after a further probe at the present state if due."""
        if not self._able:
            return Missed()
        if self.run.steps >= self._due:
            with np.errstate(all="ignore"):  # the motion may diverge
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
        """Reset the trials to the start of the run."""
        for trial in self._trials:
            trial.reset()

    def _place(self) -> None:
        """Reset the trials to the present state of the run."""
        for trial in self._trials:
            trial.reset_beside(self.run, self.run.coordinates, self.run.time)
            if trial.layout.commanded:
                trial.change_law(self.run.system)

    def _probe(self, place: Callable[[], None], t: float) -> _Probe | None:
        """The probe from the state to which `place` resets the trials, at t: of STEPS steps, or of
        one if these fail or overflow; None if that fails too."""
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
        """The probe from the coordinates (n, bodies, 13) after steps h and after steps r h."""
        velocity, place = self._velocities(two), two[:, self._measures.body, :3]
        speed, far = (np.linalg.norm(of, axis=2).max(axis=0) for of in (velocity, place))
        missed = self._velocities(one) - velocity
        turn = angle_between(one[..., 3:7], two[..., 3:7])
        if self._strikes:
            # the two may place an impact in different steps, and then differ by all of it: the
            # smallest difference of all steps counts
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
        """Add the local errors of the steps from the last probe to this one, made after `at` steps,
        and those of the probe; if it failed, the last rate continues."""
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
