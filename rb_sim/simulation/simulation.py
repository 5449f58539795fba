# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulation: runs of a scene, with the outer loop over blocks of samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rb_sim.accuracy.checks.check_list import CheckedSamples
from rb_sim.accuracy.checks.singular_configuration import rows_between, singular_end
from rb_sim.accuracy.checks.step_doubling import Missed, StepDoubling
from rb_sim.accuracy.checks.step_search import forecast_for
from rb_sim.base.errors import RbSimError, SimulationError, StepTooLargeError
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.io.sink import Sink
from rb_sim.mechanics.compiled import family_of
from rb_sim.mechanics.inputs import with_kept
from rb_sim.mechanics.samples import Array, Input, SampleBlock, SampleLayout
from rb_sim.motion.motion import (
    NO_LIMITS,
    Limits,
    Watch,
    Watcher,
    instants_at_rate,
    instants_beside,
    instants_given,
    is_finite,
    samples_at_rate,
)
from rb_sim.numerics.kernels import on_compilation, own_time
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.schema import MOST_RATE
from rb_sim.simulation.scene_in_motion import MOST_INPUTS, SceneInMotion, compiling
from rb_sim.simulation.state_override import placement
from rb_sim.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from rb_sim.equilibrium.state_space import LinearModel
    from rb_sim.scene.schema import Scene


# Compilation of a scene before its first step, with a note if it is not in the cache.


Say = Callable[[str], None]

ATTEMPTS = 8
"""Most attempts: more than there are kernels, each of which may fail to be stored once."""


def compiled(scene: Scene, say: Say) -> Simulation:
    """The simulation of a scene, compiled and ready to step.

    say: gets a line if something is compiled, or cannot be stored.
    """
    lines: list[str] = []

    def say_once(line: str) -> None:
        if line not in lines:
            lines.append(line)
            say(line)

    def announce() -> None:
        say_once(compiling(scene.name))

    if scene.simulation.method == "auto":
        say_once(
            f"choosing the cheapest method for a global error of {scene.simulation.tolerance:g}"
        )
    with on_compilation(announce):
        for attempt in range(ATTEMPTS):
            try:
                simulation = Simulation(scene, announce=None)
                simulation.warm()
                return simulation
            except OSError as error:  # compiled, but there is no room to store the code
                if attempt == ATTEMPTS - 1:
                    raise
                say_once(f"note: the compiled code is not kept: {error.strerror}")
    raise AssertionError("the loop returns or raises")


# Commands, resets and states of one simulation, applied to another one.


def give(simulation: Simulation, inputs: list[Input]) -> None:
    """Apply inputs of one instant, in order, to a simulation that is at that instant."""
    k = 0
    while k < len(inputs):
        given = inputs[k]
        k += max(1, given.together)
        if given.state:
            group = {one.body: one.state for one in inputs[k - given.together : k]}
            simulation.set_state(
                {body: placement(state) for body, state in group.items()}, project=given.project
            )
        elif given.body:
            simulation.apply_wrench(given.body, given.force, given.torque, given.frame)
        else:
            simulation.reset()


BLOCK = 2048
"""Samples per block, the unit of work of the sinks."""

Progress = Callable[[float, float], None]


class Simulation(SceneInMotion):
    """A scene with its present time and state, which `run` and `advance` integrate.

    Args:
        scene: Loaded scene, or anything that `load_scene` takes; its `simulation` section gives
            method, step or tolerance.
        coordinates: "auto" takes reduced coordinates for one body with at most one joint; "maximal"
            takes the general formulation always.
        announce: Called with a line of text before machine code is compiled, which takes seconds;
            by default the line goes to standard error.
        family: Laws shared by scenes that differ in numbers only; None: its own laws.
        overrides: Those of `load_scene`, such as `method`, unless the scene is loaded already.

    Raises:
        SceneError: The scene cannot be simulated.
    """

    _is_trial = False
    """whether this is an auxiliary simulation: its runs have no accuracy checks, and their failures
    suggest no step."""

    def _start_anew(self) -> None:
        super()._start_anew()
        self._doubling: StepDoubling | None = None

    @property
    def missed(self) -> Missed:
        """Part of the motion that fixed steps miss, by step doubling at some steps; empty for an
        adaptive method."""
        if self._doubling is None or self._doubling.run is not self._motion:
            self._doubling = StepDoubling(self.scene, self._motion)
        return self._doubling.look()

    def between(self, t: float, y: Array, times: Array) -> Array | None:
        """The motion at the times, starting from one of its states (see `rows_between`)."""
        return rows_between(self._motion, t, y, times)

    def linearize(self, axes: str = "world", turning: float = 0.0) -> LinearModel:
        """Linear model of small deviations from the motion, about the present state.

        Args:
            axes: Axes of states, poses, twists and inputs: "world", or "body" (they turn with each
                body).
            turning: Rate at which the world's axes turn about z [rad/s], for a motion that is
                steady as seen from there (a disk that rolls in a circle).

        Raises:
            RbSimError: The scene has contacts, or an argument is not allowed.
            SimulationError: A law has no derivative at the present state.
        """
        from rb_sim.equilibrium.linearize import linearize  # imports scipy, when used

        if axes not in ("world", "body"):
            raise RbSimError(f"axes: got {axes!r}; must be 'world' or 'body'")
        if not is_finite(turning) or (turning and axes == "body"):
            raise RbSimError(f"turning: got {turning!r}; must be finite, and 0 for axes 'body'")
        check_smooth(self.layout)
        compiled = compile_scene(self.scene, coordinates="maximal")
        system = self._commands.in_law(compiled.system, compiled.commands)
        system = with_kept(system, self._motion.kept.tolist())
        block = self.sample().block
        columns = (
            block.position,
            block.orientation,
            block.linear_velocity,
            block.angular_velocity,
        )
        y = np.concatenate([column[0] for column in columns], axis=1).ravel()
        return linearize(
            system, self.layout, self.time, y, compiled.commands, cast(Any, axes), turning
        )

    def run(
        self,
        duration: float | None = None,
        rate: float | None = None,
        sinks: Iterable[Sink] = (),
        progress: Progress | None = None,
        *,
        at: Sequence[float] | Array | None = None,
        events: bool = False,
        checks: bool = True,
        check: bool | None = None,
    ) -> Trajectory:
        """Integrate from the present time and sample, both ends included.

        An estimate of more than ten minutes of wall-clock time is reported to `announce`; a run
        that would take more than a year is stopped.

        Args:
            duration: Simulated time [s]; None: the scene's.
            rate: Samples per simulated second [Hz]; None: the scene's.
            sinks: Logs that get every block of samples; they are opened here, the caller closes
                them.
            progress: Called after each block with the time reached and the end [s].
            at: Instants to sample at [s] instead, increasing, from the present time on.
            events: Also sample just before and just after each event of a contact, for
                `Trajectory.at_events`. The motion since the start is computed a second time for it.
            checks: Run the accuracy checks; each that fails is an AccuracyWarning and among
                `Trajectory.findings`.
            check: Measure `Trajectory.global_error` by a second run at 0.62 of the step or a tenth
                of the tolerance (fixed steps with contacts: of dopri853 by events). None: if
                `checks`; of runs above about 1 s of CPU time first a coarser one, above 20 s only
                of the beginning.

        Raises:
            SimulationError: The integration cannot go on, or was stopped; the samples so far are
                in the sinks.
        """
        times = self._instants(duration, rate, at)
        if events:
            times = self._with_events(times)
        end = float(times[-1])
        outlets = list(sinks)
        for sink in outlets:
            sink.open(self.scene, self.layout)
        blocks: list[SampleBlock] = []
        made = self._blocks_at(times)
        checks = checks and not self._is_trial
        checked = None
        if checks or check:
            checked = CheckedSamples(self, made, second=check is not False)
        error = None
        try:
            for block in checked or made:
                blocks.append(block)
                for sink in outlets:
                    sink.write(block)
                if progress is not None:
                    progress(float(block.t[-1]), end)
            if checked is not None:
                error = checked.compare_again(check)
        finally:
            if checked is not None and checks:
                checked.warn()
        findings = checked.findings if checked is not None and checks else ()
        return self._trajectory(blocks, findings, error)

    def _instants(
        self, duration: float | None, rate: float | None, at: Sequence[float] | Array | None
    ) -> Array:
        """Sample times of `run`. Raises RbSimError."""
        if at is None:
            return instants_at_rate(self.time, *self._span(duration, rate))
        if duration is None and rate is None:
            return instants_given(at, self.time)
        raise RbSimError("at: it gives the instants; must be without duration and rate")

    def _span(self, duration: float | None, rate: float | None) -> tuple[float, float]:
        """Duration [s] and rate [Hz] of a run, by default the scene's. Raises RbSimError."""
        options = self.scene.simulation
        duration = options.duration if duration is None else duration
        rate = options.rate if rate is None else rate
        for name, value in (("duration", duration), ("rate", rate)):
            if not (is_finite(value) and value > 0.0):
                raise RbSimError(f"{name}: got {value!r}; must be a finite number > 0")
        if rate > MOST_RATE:
            raise RbSimError(f"rate: got {rate!r}; must be a number <= {MOST_RATE:g}")
        return duration, rate

    def _blocks_at(self, times: Array) -> Iterator[SampleBlock]:
        start, duration = self.time, float(times[-1]) - self.time
        forecast = forecast_for(self.scene, duration, self._tell)

        def goes_on(t: float) -> bool:
            return forecast.goes_on(t - start)

        watcher = Watcher(self._motion, goes_on, duration, in_pieces=False)
        for first in range(0, len(times), BLOCK):
            yield from self._sampled(times[first : first + BLOCK], watcher)
            if not goes_on(self.time):
                raise SimulationError(forecast.given_up)

    def _with_events(self, times: Array) -> Array:
        """The sample times and those beside events, which a second simulation finds."""
        twin = self._twin()
        with suppress(SimulationError):  # the run itself will report the error
            twin._run_to(float(times[-1]))
        found = [event.t for event in twin.events if event.t > self.time]
        return np.union1d(times, instants_beside(found, self.time, float(times[-1])))

    def _twin(self) -> Simulation:
        """A second simulation advanced to the current time with the same steps and inputs."""
        if len(self._history) == MOST_INPUTS:
            raise RbSimError(
                f"events=True: got {MOST_INPUTS} or more commands since the start; must be fewer "
                "(reset)"
            )
        twin = Simulation(self.scene, announce=None, **self._made_with)
        for t, inputs in groupby(self._history, lambda given: given.t):
            twin._run_to(t)
            give(twin, list(inputs))
        twin._run_to(self.time)
        return twin

    def _run_to(self, t: float) -> None:
        """Integrate up to the time t [s] without sampling, if it is later than now.

        Raises SimulationError if the integration cannot continue.
        """
        if t > self.time:
            with self._announced:
                self._motion.run_to([t])

    def blocks(
        self,
        duration: float,
        rate: float,
        watch: Watch | None = None,
        limits: Limits = NO_LIMITS,
    ) -> Iterator[SampleBlock]:
        """Integrate and sample block by block, so that memory does not grow with the run.

        No accuracy check is made.

        Args:
            duration: Simulated time [s].
            rate: Samples per simulated second [Hz].
            watch: Called about every 50 ms; if it returns False the run ends with the samples so
                far.
            limits: Largest number of steps and wall-clock time between two samples.

        Yields:
            Up to 2048 samples each.

        Raises:
            SimulationError: The integration cannot go on, or exceeds `limits`; the samples before
                were yielded.
        """
        start, end = self.time, self.time + duration
        count = samples_at_rate(duration, rate)
        watcher = Watcher(self._motion, watch, duration, limits)
        for first in range(0, count, BLOCK):
            index = np.arange(first, min(first + BLOCK, count))
            yield from self._sampled(np.minimum(start + index / rate, end), watcher)
            if watcher.stopped:
                return
        last = start + (count - 1) / rate
        if end - last > COMPUTED_ROUNDING / rate:
            yield from self._sampled(np.array([end]), watcher)

    def _sampled(self, times: Array, watcher: Watcher) -> Iterator[SampleBlock]:
        """Integrate to the times and sample there, as far as possible."""
        out = np.zeros((len(times), self._motion.width))
        failure = None
        self._motion.take_worst()
        began = own_time()
        try:
            with self._announced:
                watcher.carry(times, out)
        except SimulationError as error:
            failure = error
        self.stepping_time += own_time() - began
        reached = int(np.searchsorted(times, self.time, side="right"))
        if reached:
            block, worst = self._block(times[:reached], out[:reached]), self._motion.take_worst()
            residual = None if worst is None else (block.residual, worst)
            events, inputs = self.take_events(), self.take_inputs()
            yield replace(block, events=events, inputs=inputs, worst=residual)
        if failure is not None:
            singular = (
                singular_end(self, times[:reached], out[:reached]) if not self._is_trial else None
            )
            if singular is not None:
                raise SimulationError(singular.refusal) from failure
            raise self._advised(failure, float(times[-1]), watcher)

    def _advised(self, error: SimulationError, end: float, watcher: Watcher) -> SimulationError:
        """The error with a suggested step, if it is a StepTooLargeError."""
        if not isinstance(error, StepTooLargeError) or self._commands.any or self._is_trial:
            return error
        from rb_sim.accuracy.checks.step_search import step_that_runs

        advice = step_that_runs(self, self.time, end, watcher.may_continue)
        return StepTooLargeError(f"{error}; {advice}")

    def with_step(self, step: float) -> Simulation:
        """A new simulation of the same scene from its start with another fixed step [s]."""
        scene = self.scene.with_options(method=self.setting.name, step=step, tolerance=None)
        if self._made_with["family"] is None:  # trials need not trace the same laws again
            self._made_with["family"] = family_of([self.compiled])
        trial = Simulation(scene, announce=None, **self._made_with)
        trial._is_trial = True
        return trial


def check_smooth(layout: SampleLayout) -> None:
    """Raise RbSimError for a scene that cannot be linearised about its motion."""
    if layout.contacts:
        raise RbSimError(
            "linearize: the scene has contacts, which open and slip; must have joints only "
            "(a body that rolls: constraint rolling)"
        )
