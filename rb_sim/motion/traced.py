# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motions on traced laws: the state that loops advance from instant to instant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.compiler.graph.machine import evaluate_rows, interpreted
from rb_sim.integrate import layout as place
from rb_sim.integrate import loop as loops
from rb_sim.integrate.layout import (
    FLOOR,
    IS_VELOCITY,
    PIECE_STEPS,
    SHARE_OF_WAY,
    START,
    UNFINISHED,
    WORK_ROWS,
)
from rb_sim.integrate.methods.taylor import SERIES_SIZES
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.error_scales import Small, small_motions
from rb_sim.mechanics.laws import reference
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.system import started
from rb_sim.motion.motion import Motion
from rb_sim.numerics.kernels import Step

Kept = tuple[Array, Any, Array, Array, dict[int, Array]]
"""Saved grid of steps: clock, counts, state, inputs and series."""
Reached = tuple[int, int]
"""(status, number of times reached)."""


class TracedStepper:
    """The grid of steps of a system, on laws that are called by address.

    laws: rate, project, sample ... of the system (mechanics.laws). length: of the scene [m]. small:
    error scales of bodies with small motions. Laws are compiled on first use.
    """

    def __init__(self, laws: Any, length: float = 1.0, small: Small | None = None) -> None:
        self.laws, self.length = laws, length
        n = laws.n
        self._clock = np.zeros(place.CLOCKS)
        self._count = np.zeros(place.COUNTS, dtype=np.int64)
        self._state = np.zeros((place.STATES, 2 * n + place.EXTRA))
        self._work = np.zeros((WORK_ROWS, n))
        self._work[IS_VELOCITY] = laws.velocities
        self._work[FLOOR] = self._work[SHARE_OF_WAY] = 1.0
        self.small = small
        self._carried = laws.carried
        self._kept = np.array(laws.inputs.kept(laws.system), dtype=int)
        """indices of the inputs that laws carry from step to step."""
        self._inputs = np.zeros(0)
        self._workspaces: dict[int, Array] = {}
        self._calls: dict[tuple[int, bool], tuple[Any, ...]] = {}

    def start(self, t: float, y: Any, system: Any, h: float = 0.0, *, fresh: bool = True) -> None:
        """Start a new grid of steps at (t, y); h: step to try first [s], 0 for none.

        fresh: reset the quantities that laws carry from step to step.
        """
        y = np.array(y, dtype=float)
        self._state[:] = 0.0
        self._state[:, : self.laws.n] = y
        for workspace in self._workspaces.values():
            workspace[1:] = 0.0  # an infinite series must not enter sums
        self._clock[:] = (t, t, t, h)
        self._count[:] = 0
        kept = None if fresh else self.kept
        self._inputs[:] = self._values(system, t)
        if kept is not None:
            self.kept = kept
        if self._carried:
            self._choose(t, y)

    @property
    def kept(self) -> Array:
        """The quantities that laws carry from step to step."""
        return self._inputs[self._kept]

    @kept.setter
    def kept(self, values: Array) -> None:
        self._inputs[self._kept] = values

    def _choose(self, t: float, y: Array) -> None:
        """Set the inputs of the first step as the loop does for later ones."""
        found = np.zeros((1, self._carried + 2))
        evaluate_rows(self.laws.choice, np.array([t]), y[None], self._inputs, found)
        self._inputs[-1 - self._carried : -1] = found[0, : self._carried]

    def change(self, system: Any, t: float, onwards: bool = True) -> None:
        """Take the inputs of the laws from the system at t; carried quantities and chosen rows are
        kept."""
        lines = len(getattr(self.laws, "changing", ()))
        kept, chosen = self.kept, self._inputs[-1 - lines : -1].copy()
        self._inputs[:] = self._values(system, t, onwards)
        self.kept, self._inputs[-1 - lines : -1] = kept, chosen

    def _values(self, system: Any, t: float, onwards: bool = True) -> list[float]:
        """Inputs for steps from t on (`onwards`), or for the instant t alone, and a place for the
        step's length."""
        values = [*self.laws.inputs.values(system, t, onwards), 0.0]
        if len(values) != len(self._inputs):
            self._inputs = np.zeros(len(values))
            self._calls.clear()  # they hold the old address
        return values

    def keep(self) -> Kept:
        """State of the grid from which `back_to` continues, exact to the last bit."""
        workspaces = {order: workspace.copy() for order, workspace in self._workspaces.items()}
        grid = self._clock.copy(), self._count.copy(), self._state.copy()
        return (*grid, self._inputs.copy(), workspaces)

    def back_to(self, kept: Kept) -> None:
        """Restore a state from `keep`; it can be used several times."""
        self._clock[:], self._count[:], self._state[:] = kept[:3]
        self._inputs[:] = kept[3]
        for order, workspace in kept[4].items():
            self._workspaces[order][:] = workspace

    @property
    def steps(self) -> int:
        """Number of steps since the start of the grid."""
        return int(self._count[place.TAKEN])

    @property
    def rejected(self) -> int:
        """Number of rejected attempts since the start of the grid."""
        return int(self._count[place.REJECTED])

    @property
    def cut(self) -> int:
        """Number of rejected attempts that only crossed the end of a piece."""
        return int(self._count[place.CUT])

    @property
    def last_step(self) -> tuple[float, float]:
        """Start and end of the last step [s]."""
        return float(self._clock[place.T0]), float(self._clock[place.T1])

    @property
    def next_length(self) -> float:
        """Length that the adaptive control proposes for the next step [s]."""
        return float(self._clock[place.NEXT])

    @property
    def y(self) -> Array:
        """The state at the time requested last."""
        return self._state[place.NOW, : self.laws.n].copy()

    def record(self, method: Any, times: Array, stop: float, out: Array | None) -> Reached:
        """Advance the state to the times, and sample into the rows of out."""
        known = self._calls.get((id(method), out is not None))
        places, setting = (known or self._called_by(method, out is not None))[:2]
        if self.small is not None:
            self._size(self.small, setting[place.TOLERANCE])
        return loops.record(places, times, stop, out)

    def take_worst(self) -> float:
        """Largest residual of the samples since the last call."""
        found = [call[0].take_worst() for (_, sampling), call in self._calls.items() if sampling]
        return found[0] if len(found) == 1 else float(np.max(found, initial=0.0))

    def _called_by(self, method: Any, sampling: bool) -> tuple[Any, ...]:
        """Arguments and settings of a call of the loop, with all objects that must stay alive; made
        once."""
        laws, (step, setting) = self.laws, settings_of(method)
        small = self.small is not None and setting[place.TOLERANCE] > 0.0
        if small and step.series is not None and getattr(laws, "variables", None) is not None:
            setting = self._of_variables(setting)
        used = (
            laws.rate,
            laws.project,
            getattr(laws, "gap", None),
            getattr(laws, "position", None),
            getattr(laws, "velocity", None),
            laws.inside,
            laws.sample if sampling else None,
            # errors of a step as one law are relative to max(1, |y|)
            None if small else laws.whole(step, estimated=setting[place.TOLERANCE] > 0.0),
            laws.jacobian if laws.n <= step.implicit else None,
            getattr(laws, "back", None),
            laws.along,
            laws.share,
            getattr(laws, "choice", None),
        )
        series, sizes, table = self._series(step, setting[place.ORDER])
        if laws.n <= step.implicit and len(self._work) == WORK_ROWS:
            self._work = np.vstack([self._work, np.zeros((3 * laws.n, laws.n))])
            self._calls.clear()  # they hold the old address
        called: Any = [*map(reference, (*used, *series)), step.reference]
        if not interpreted():
            called = np.array(called, dtype=np.int64)
        settings = np.array([*setting, self.length, float(laws.splines), float(self._carried)])
        state = self._clock, self._count, self._state, self._inputs, self._work
        arrays = called, settings, sizes, *state, table
        width = laws.width if sampling else 0
        places = loops.Places(arrays, laws.n, len(self._inputs), width)
        # keeps the method, whose id is the key, and the arrays behind addresses alive
        call = places, settings, method, arrays
        self._calls[id(method), sampling] = call
        return call

    def _of_variables(self, setting: tuple[float, ...]) -> tuple[float, ...]:
        """The setting for a series in other variables than coordinates, whose error scales are not
        known."""
        assert self.small is not None
        tolerance = setting[place.TOLERANCE]
        scaled = tolerance * float(self.small.within(tolerance).min())
        return (*setting[: place.TOLERANCE], scaled, *setting[place.TOLERANCE + 1 :])

    def _series(self, step: Step, order: float) -> tuple[Any, ...]:
        """Laws of the series, their sizes, and a workspace; empty for methods without a series."""
        if step.series is None:
            return (None,) * 5, np.zeros(SERIES_SIZES, np.int64), np.zeros(1)
        laws, own = self.laws.series, getattr(self.laws, "variables", None)
        key = int(order)
        if key not in self._workspaces:
            beside = 0 if own is None else self.laws.n + 2 * laws.n
            self._workspaces[key] = np.zeros(laws.size(key) + beside)
            self._workspaces[key][0] = order
        sizes = [key, laws.first, laws.width, laws.events, laws.events_at, laws.n, laws.size(key)]
        sizes.append(laws.roots)
        used = (self.laws.rate, None, None) if own is None else (own.rate, own.begin, own.end)
        return (laws.expand, laws.add, *used), np.array(sizes), self._workspaces[key]

    def _size(self, small: Small, tolerance: float) -> None:
        """Set the error scales of the coordinates; rounding at their start values does not
        count."""
        self._work[FLOOR], self._work[START] = small.within(tolerance), small.starts
        self._work[SHARE_OF_WAY] = small.shares(tolerance)


def settings_of(method: Any) -> tuple[Step, tuple[float, float, float, float]]:
    """The step that loops call, and (STEP_LENGTH, TOLERANCE, LARGEST, ORDER)."""
    from rb_sim.mechanics.methods import loop_of

    found = loop_of(type(method))
    if found is None:
        raise TypeError(f"{type(method).__name__} has no step on traced laws")
    step, order = found
    if hasattr(method, "step"):
        return step, (method.step, 0.0, 0.0, 1.0)
    if step.series is not None:
        order = float(step.series(method.tolerance))
    return step, (0.0, method.tolerance, method.largest_step, order)


# Motion on traced laws, for every scene whose system can be traced.


MOST_ROUNDS = 512
"""Most calls of the loop, each of PIECE_STEPS pieces of a guide, for one fixed step: a diverging
motion on a guide crosses pieces without end."""


class TracedMotion(Motion):
    """Motion by traced laws, compiled in milliseconds, and loops compiled once for all scenes."""

    def __init__(self, compiled: Compiled, method: Any) -> None:
        length = getattr(compiled.system, "length", 1.0)
        self._stepper = TracedStepper(compiled.laws, length, small_of(compiled, method))
        small = self._stepper.small
        self.held = (
            frozenset()
            if small is None
            else frozenset(compiled.layout.bodies[body] for body in small.bodies)
        )
        super().__init__(compiled, method)

    def take(self, method: Any) -> Any:
        """As Motion.take; bodies whose errors are not relative to their motion keep their
        tolerance."""
        before, after = (getattr(m, "tolerance", 1.0) for m in (self.method, method))
        if self._stepper.small is not None:
            self._stepper.small.hold_others(before / after)
        return super().take(method)

    def reset(self, y: Any = None, time: float = 0.0) -> None:
        """As Motion.reset; the counts of steps begin at zero."""
        compiled = self.compiled
        self.system = compiled.system if y is None else started(compiled.system, y)
        self.time, self.as_compiled = time, y is None
        self._stepper.start(time, compiled.y if y is None else y, self.system)
        self._steps_before = self._rejected_before = self._cut_before = 0

    @property
    def steps(self) -> int:
        """As Motion.steps, over all grids since the last reset."""
        return self._steps_before + self._stepper.steps

    @property
    def rejected_steps(self) -> int:
        """As Motion.rejected_steps, over all grids since the last reset."""
        return self._rejected_before + self._stepper.rejected

    @property
    def cut_steps(self) -> int:
        """As Motion.cut_steps, over all grids since the last reset."""
        return self._cut_before + self._stepper.cut

    @property
    def kept(self) -> Array:
        """As Motion.kept."""
        return self._stepper.kept

    @kept.setter
    def kept(self, values: Array) -> None:
        self._stepper.kept = values

    @property
    def frontier(self) -> tuple[float, float]:
        """As Motion.frontier."""
        begin, end = self._stepper.last_step
        return end, end - begin

    @property
    def coordinates(self) -> Any:
        """As Motion.coordinates: a tuple in reduced coordinates, else an array."""
        y = self._stepper.y
        return tuple(y.tolist()) if self.compiled.reduced else y

    def keep(self) -> tuple[Any, ...]:
        """As Motion.keep: time, system, counts and the grid of steps."""
        before = self._steps_before, self._rejected_before, self._cut_before
        return (self.time, self.system, before, self._stepper.keep())

    def back_to(self, kept: tuple[Any, ...]) -> None:
        """As Motion.back_to."""
        self.time, self.system, before, grid = kept
        self._steps_before, self._rejected_before, self._cut_before = before
        self._stepper.back_to(grid)

    def run_to(self, times: Sequence[float] | Array, out: Array | None = None) -> int:
        """As Motion.run_to; a grid ends at each breakpoint and a new one begins."""
        times = np.asarray(times, dtype=float)
        if not self.compiled.breakpoints:  # fast path: a loop may request one instant at a time
            self._record(times, math.inf, out)
            return len(times)
        done = 0
        while done < len(times):
            stop = next((b for b in self.compiled.breakpoints if b > self.time), math.inf)
            before = int(np.searchsorted(times, stop, side="left"))
            if before > done:
                self._record(times[done:before], stop, None if out is None else out[done:before])
            if before < len(times):
                self._record(np.array([stop]), stop, None)
                self._restart_grid()
            done = int(np.searchsorted(times, stop, side="right"))
            if out is not None and done > before:
                self._sample_now(out[before:done])
        return done

    def take_worst(self) -> float:
        """As Motion.take_worst; the loop tracks it."""
        return self._stepper.take_worst()

    def sample(self) -> Array:
        """As Motion.sample; at the last instant of a table its last value holds."""
        out = np.zeros((1, self.width))
        self._sample_now(out)
        return out

    def _sample_now(self, out: Array) -> None:
        """Sample the current instant; at the last instant of a table its last value holds."""
        self._stepper.change(self.system, self.time, onwards=False)
        try:
            self._record(np.full(len(out), self.time), math.inf, out)
        finally:
            self._stepper.change(self.system, self.time)

    def _restart_grid(self) -> None:
        stepper = self._stepper
        h = stepper.next_length
        self._steps_before += stepper.steps
        self._rejected_before += stepper.rejected
        self._cut_before += stepper.cut
        stepper.start(self.time, stepper.y, self.system, h, fresh=False)

    def _record(self, times: Array, stop: float, out: Array | None) -> None:
        record, method, done = self._stepper.record, self.method, 0
        status, reached = record(method, times, stop, out)
        steps, rounds = self._stepper.steps, 0
        while status == UNFINISHED:
            done = self._reached(times, done + reached)
            self.watch()
            rounds = rounds + 1 if self._stepper.steps == steps else 0
            if rounds >= MOST_ROUNDS:
                raise SimulationError(self._without_end())
            steps = self._stepper.steps
            rest = None if out is None else out[done:]
            status, reached = record(method, times[done:], stop, rest)
        self._reached(times, done + reached)
        if status:
            raise self._failure(status)

    def _without_end(self) -> str:
        """One line about a step that has crossed pieces of a guide without end."""
        t, passed = self.frontier[1], MOST_ROUNDS * PIECE_STEPS
        return (
            f"one step has passed {passed} pieces of a guide by t = {t:.9g} s: step "
            f"{self.method.step:g} s is too large for {type(self.method).__name__.lower()}, or the "
            "body is too fast"
        )

    def _reached(self, times: Array, count: int) -> int:
        """Set the time after `count` of the times were reached; returns count."""
        if count:
            self.time = float(times[count - 1])
        return count


def small_of(compiled: Compiled, method: Any) -> Small | None:
    """Error scales for small motions from the scene's start, and absolute tolerances of the scene.

    None for a fixed step.
    """
    if not getattr(method, "tolerance", 0.0):
        return None
    found, y = None, np.array(compiled.y, dtype=float)
    if not (compiled.layout.commanded or compiled.breakpoints):
        laws: Any = compiled.laws
        inputs = np.array([*laws.inputs.values(compiled.system, 0.0), 0.0])
        found = small_motions(compiled.system, laws, y, inputs)
    if compiled.absolute:
        found = found or Small(len(y))
        each = np.array([value or 0.0 for value in compiled.absolute])
        found.absolute[:] = np.repeat(each, len(y) // len(each))  # 13 per body, or all of one
    return found
