"""Motion on traced laws: what every scene takes whose system can be traced and has loops."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.engine.samples import Array
from rb_sim.engine.small_motions import Small, small_motions
from rb_sim.engine.system import started
from rb_sim.engine.traced import TracedStepper
from rb_sim.errors import SimulationError
from rb_sim.loops.places import PIECE_STEPS, UNFINISHED
from rb_sim.motion import Motion
from rb_sim.scene.compiled import Compiled

MOST_ROUNDS = 512
"""Calls of the loop, of PIECE_STEPS pieces of a guide each, that one step of fixed length may take:
a motion that blows up on a guide passes them without end."""


class TracedMotion(Motion):
    """As Motion; the laws are compiled in milliseconds, the loops once for all scenes."""

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
        """As of Motion; bodies that are not held keep the tolerance that they had."""
        before, after = (getattr(m, "tolerance", 1.0) for m in (self.method, method))
        if self._stepper.small is not None:
            self._stepper.small.hold_others(before / after)
        return super().take(method)

    def reset(self, y: Any = None, time: float = 0.0) -> None:
        compiled = self.compiled
        self.system = compiled.system if y is None else started(compiled.system, y)
        self.time, self.as_compiled = time, y is None
        self._stepper.start(time, compiled.y if y is None else y, self.system)
        self._steps_before = self._rejected_before = self._cut_before = 0

    @property
    def steps(self) -> int:
        return self._steps_before + self._stepper.steps

    @property
    def rejected_steps(self) -> int:
        return self._rejected_before + self._stepper.rejected

    @property
    def cut_steps(self) -> int:
        return self._cut_before + self._stepper.cut

    @property
    def frontier(self) -> tuple[float, float]:
        begin, end = self._stepper.last_step
        return end, end - begin

    @property
    def coordinates(self) -> Any:
        y = self._stepper.y
        return tuple(y.tolist()) if self.compiled.reduced else y

    def keep(self) -> tuple[Any, ...]:
        before = self._steps_before, self._rejected_before, self._cut_before
        return (self.time, self.system, before, self._stepper.keep())

    def back_to(self, kept: tuple[Any, ...]) -> None:
        self.time, self.system, before, grid = kept
        self._steps_before, self._rejected_before, self._cut_before = before
        self._stepper.back_to(grid)

    def run_to(self, times: Sequence[float] | Array, out: Array | None = None) -> int:
        times = np.asarray(times, dtype=float)
        if not self.compiled.breakpoints:  # a loop that asks for one instant at a time is quick
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
        return self._stepper.take_worst()

    def sample(self) -> Array:
        out = np.zeros((1, self.width))
        self._sample_now(out)
        return out

    def _sample_now(self, out: Array) -> None:
        """Rows of the present instant; where a table ends, it still counts."""
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
        stepper.start(self.time, stepper.y, self.system, h)

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
        """What has happened where one step has passed pieces of a guide over and over."""
        t, passed = self.frontier[1], MOST_ROUNDS * PIECE_STEPS
        return (
            f"one step has passed {passed} pieces of a guide by t = {t:.9g} s: step "
            f"{self.method.step:g} s is too large for {type(self.method).__name__.lower()} on this "
            "scene, or the body is that fast"
        )

    def _reached(self, times: Array, count: int) -> int:
        """So many of the times have been reached."""
        if count:
            self.time = float(times[count - 1])
        return count


def small_of(compiled: Compiled, method: Any) -> Small | None:
    """The bodies that move by little from the scene's start; a fixed step needs none of it."""
    if not getattr(method, "tolerance", 0.0) or compiled.layout.commanded or compiled.breakpoints:
        return None
    laws: Any = compiled.laws
    inputs = np.array([*laws.inputs.values(compiled.system, 0.0), 0.0])
    return small_motions(compiled.system, laws, np.array(compiled.y, dtype=float), inputs)
