# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Several runs at once: motions of one body that differ only in numbers, in SIMD lanes.

Each run takes the same steps and gets the same numbers as alone, bit by bit for laws without sine
and cosine (see rb_sim.compiler.graph.vector_code).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rb_sim.compiler.graph.machine import Law
from rb_sim.compiler.graph.symbols import Graph, maximum, minimum, sqrt, where
from rb_sim.compiler.graph.vector_code import LANES, compile_lanes
from rb_sim.integrate import lane_loops
from rb_sim.mechanics.laws import ReducedLaws
from rb_sim.mechanics.methods import loop_of
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.system import inside, project, sample
from rb_sim.mechanics.systems.one_body import rate
from rb_sim.numerics.kernels import Step

PIECE = 4096
"""Calls of the law between two calls of `goes_on`."""

LARGEST_FLOAT = 1.7976931348623157e308


class Runs(NamedTuple):
    """Results of runs in lanes."""

    samples: Array
    """the columns of samples, (runs, times, columns); overwritten by the next call."""
    statuses: np.ndarray
    """status of rb_sim.integrate.loop; OPEN for an unfinished run."""
    steps: np.ndarray


class Lanes:
    """Laws of one body for several runs at once, under one method.

    laws: of the family; method: rk4, euler or dopri853; columns: required columns of a sample
    (None: all); only what they need is computed.
    """

    def __init__(
        self, laws: ReducedLaws, method: Any, columns: Sequence[int] | None = None
    ) -> None:
        self.laws, self.method, self.n = laws, method, laws.n
        self.columns = list(range(laws.width)) if columns is None else list(columns)
        self._workspace: dict[str, np.ndarray] = {}
        self.adaptive = not hasattr(method, "step")
        self._given = len(laws.inputs.values(laws.system, 0.0))

    @cached_property
    def step(self) -> Law | None:
        """One step as a law in lanes; None if runs of this method cannot be combined."""
        found = loop_of(type(self.method))
        if found is None or found[0].traced is None or (self.adaptive and found[1] != 8.0):
            return None
        if self.laws.whole(found[0]) is None:  # the step is too long
            return None
        outputs = self._attempt(found[0]) if self.adaptive else self._fixed(found[0])
        return compile_lanes(outputs, self._given + lane_loops.TIME)

    @cached_property
    def sample(self) -> Law | None:
        """The sample at one instant as a law in lanes."""

        def outputs(system: Any, t: Any, y: Any) -> list[Any]:
            out: list[Any] = [0.0] * self.laws.width
            sample(system, t, y, out)
            return [out[i] for i in self.columns]

        return compile_lanes(self.laws.traced(outputs), self._given + lane_loops.TIME)

    @property
    def possible(self) -> bool:
        """Whether the runs can be combined; otherwise they have to run one by one."""
        if self.laws.carried:  # lanes carry nothing from step to step
            return False
        return self.step is not None and self.sample is not None

    def _moved(
        self, step: Step, system: Any, t: Any, h: Any, row: Sequence[Any]
    ) -> tuple[list[Any], Any, Any, Any]:
        """(coordinates and carry after a step, error, sum of y, 1 if inside the domain else 0)."""
        y, carry = tuple(row[: self.n]), row[self.n :]
        assert step.traced is not None
        dy, error = step.traced(lambda t, y: rate(system, t, y), t, y, h, self.laws.velocities)
        change = [a + b for a, b in zip(dy, carry, strict=True)]
        moved = tuple(a + b for a, b in zip(y, change, strict=True))
        rest = [c - (b - a) for a, b, c in zip(y, moved, change, strict=True)]
        projected = project(system, t + h, moved)
        within = inside(system, projected)
        within = 1.0 if within is True else where(within, 1.0, 0.0)
        return [*projected, *rest], error, sum(projected[1:], projected[0]), within

    def _fixed(self, step: Step) -> list[Any]:
        """Outputs of the law of a fixed step, see `integrate.lane_loops`."""
        graph = Graph()
        system = self.laws.inputs.symbolic(self.laws.system, graph)
        t, h = graph.input("t"), graph.input("p", self._given + lane_loops.STEP)
        row, _, total, within = self._moved(step, system, t, h, graph.vector("y", 2 * self.n))
        return [*row, total, within]

    def _attempt(self, step: Step) -> list[Any]:
        """Outputs of the law of an adaptive step, see `integrate.lane_loops`."""
        graph = Graph()
        system = self.laws.inputs.symbolic(self.laws.system, graph)
        t, first = graph.input("t"), self._given

        def given(place: int) -> Any:
            return graph.input("p", first + place)

        size = 2 * self.n
        old, new = graph.vector("y", size), graph.vector("y", size, size)
        sampling, h = given(lane_loops.SAMPLING) > 0.5, given(lane_loops.STEP)
        start = where(sampling, old, new)
        tried, error, total, within = self._moved(step, system, t, h, start)
        relative = error / given(lane_loops.TOLERANCE)
        good = (relative <= 1.0) | (given(lane_loops.FORCED) > 0.5)
        accepted = good & ~sampling
        after = [
            *where(accepted, new, old),
            *where(accepted, tuple(tried), new),
            *tried,
            relative,
            where(accepted, 1.0, 0.0),
            _following(h, relative, given(lane_loops.LARGEST)),
            within,
            total,
        ]
        return after

    def run(
        self,
        starts: Array,
        given: Array,
        times: Array,
        goes_on: Callable[[], bool] = lambda: True,
    ) -> Runs:
        """Run from the coordinates `starts` (runs, n) with the inputs `given` (runs, m).

        times: instants of the samples, increasing from 0 [s]. goes_on: called repeatedly; if it
        returns False, unfinished runs stay OPEN.
        """
        starts, given, times = (
            np.ascontiguousarray(x, dtype=float) for x in (starts, given, times)
        )
        count = len(starts)  # loops read the arrays by address
        path = self._reused("path", (count, len(times), self.n))
        statuses, steps = np.full(count, lane_loops.OPEN), np.zeros(count, dtype=np.int64)
        carry = self._run_adaptive if self.adaptive else self._run_fixed
        carry(starts, given, times, path, statuses, steps, goes_on)
        return Runs(self._samples(path, given, times), statuses, steps)

    def _reused(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """An array with arbitrary content; memory used by an earlier call causes no page faults."""
        size = int(np.prod(shape))
        if name not in self._workspace or len(self._workspace[name]) < size:
            self._workspace[name] = np.zeros(size)
        return self._workspace[name][:size].reshape(shape)

    def _inputs(self) -> np.ndarray:
        return np.zeros((self._given + lane_loops.EXTRA_INPUTS, LANES))

    def _run_adaptive(
        self,
        starts: Array,
        given: Array,
        times: Array,
        path: Array,
        statuses: np.ndarray,
        steps: np.ndarray,
        goes_on: Callable[[], bool],
    ) -> None:
        inputs = self._inputs()
        inputs[self._given + lane_loops.TOLERANCE] = self.method.tolerance
        inputs[self._given + lane_loops.LARGEST] = self.method.largest_step
        lanes = np.zeros((lane_loops.PLACES, LANES))
        buffer = np.zeros((2, (6 * self.n + lane_loops.ADAPTIVE_EXTRA) * LANES))
        queue = np.zeros(lane_loops.QUEUE)
        queue[[lane_loops.RUNS, lane_loops.TIMES, lane_loops.GIVEN]] = (
            len(starts),
            len(times),
            self._given,
        )
        results = np.zeros((len(starts), 2))
        results[:, 0] = lane_loops.OPEN
        assert self.step is not None
        while not lane_loops.adaptive(
            self.step.address, self.n, lanes, buffer, inputs, (starts, given), queue, times, PIECE,
            path, results,
        ):  # fmt: skip
            if not goes_on():
                break
        statuses[:], steps[:] = results.T

    def _run_fixed(
        self,
        starts: Array,
        given: Array,
        times: Array,
        path: Array,
        statuses: np.ndarray,
        steps: np.ndarray,
        goes_on: Callable[[], bool],
    ) -> None:
        n, inputs = self.n, self._inputs()
        for first in range(0, len(starts), LANES):
            chosen = np.minimum(np.arange(first, first + LANES), len(starts) - 1)
            inputs[: self._given] = given[chosen].T
            buffer = np.zeros((3, 2 * n + lane_loops.FIXED_EXTRA, LANES))
            buffer[:, :n] = starts[chosen].T
            count, clock = np.zeros(3, dtype=np.int64), np.zeros(2)
            out, ended = np.zeros((LANES, len(times), n)), np.full(LANES, lane_loops.OPEN)
            assert self.step is not None
            while (ended == lane_loops.OPEN).any() and goes_on():
                lane_loops.fixed(
                    self.step.address, self.method.step, n, clock, count, buffer, inputs, times,
                    PIECE, out, ended,
                )  # fmt: skip
            here = len(starts[first : first + LANES])
            path[first : first + here] = out[:here]
            statuses[first : first + here] = ended[:here]
            steps[first : first + here] = count[0]

    def _samples(self, path: Array, given: Array, times: Array) -> Array:
        width, count = len(self.columns), len(path)
        rows = self._reused("rows", (count + LANES, len(times), width))
        inputs, buffer = self._inputs(), np.zeros((self.n, LANES))
        at = np.zeros((width, LANES))
        assert self.sample is not None
        for first in range(0, count, LANES):
            lane_loops.samples(
                self.sample.address, self.n, first, path, given, times, inputs, buffer, at,
                rows[first : first + LANES],
            )  # fmt: skip
        return rows[:count]


def _following(h: Any, error: Any, largest: Any) -> Any:
    """Length of the next step after one of length h with this relative error, as in
    rb_sim.integrate.loop."""
    root = sqrt(sqrt(sqrt(error)))
    factor = minimum(6.0, maximum(0.2, 0.9 / root))
    next_one = minimum(factor * h, largest)
    return where(abs(error) <= LARGEST_FLOAT, next_one, 0.2 * h)
