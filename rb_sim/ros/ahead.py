"""Samples computed before they are due: what a call of the kernel costs is shared by many.

A command acts at a definite sample, so what was computed beyond it is given back when one comes:
the motion goes back to where it was kept and comes forward again to the sample that was handed out
last. Both ways are the same to the last bit, so nobody can tell from the samples.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.errors import SimulationError
from rb_sim.watch import Limits, Watch

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleRow
    from rb_sim.simulation import Simulation

MOST = 32
"""Samples computed in one go."""
BUDGET = 2e-4
"""[s] of wall time that computing ahead may take in one go: a command waits for that."""


class Ahead:
    """Hands out the samples of a simulation, at k / rate in its own time; takes commands."""

    def __init__(self, simulation: Simulation, rate: float) -> None:
        self._simulation, self._rate = simulation, rate
        self._rows: list[SampleRow] = []
        self._times = np.empty(0)
        """of the rows, in the simulation's own time [s]."""
        self._taken = 0
        """of the rows."""
        self._kept: Any = None
        """the way back to where the rows begin."""
        self._most = 1
        """as many as may be computed in one go: the more, the longer no command has come."""

    def apply_wrench(
        self, body: str, force: Sequence[float], torque: Sequence[float], frame: str = "world"
    ) -> None:
        """As Simulation.apply_wrench, at the sample that was handed out last."""
        self.settle()
        self._simulation.apply_wrench(body, force, torque, frame)

    def settle(self) -> None:
        """Put the simulation at the sample that was handed out last."""
        if self._taken < len(self._rows):
            self._simulation.back_to(self._kept)
            if self._taken:
                self._simulation.step_rows(self._times[: self._taken])
        self._rows, self._taken, self._most = [], 0, 1

    def next(self, k: int, shift: float, watch: Watch | None, limits: Limits) -> SampleRow | None:
        """Sample k, the one behind the last. None: the watch ended it, the last is still the last.

        shift: of stamps against own time [s]. SimulationError: the integration cannot go on.
        """
        if self._taken == len(self._rows):
            rows = self._computed(k, watch, limits)
            if not rows:
                return None
            self._rows = [one._replace(t=one.t + shift) for one in rows] if shift else rows
            self._taken = 0
        self._taken += 1
        return self._rows[self._taken - 1]

    @property
    def fresh(self) -> list[SampleRow]:
        """The rows, where only the first of several has been handed out; otherwise none."""
        return self._rows if self._taken == 1 < len(self._rows) else []

    def _computed(self, k: int, watch: Watch | None, limits: Limits) -> list[SampleRow]:
        """As many samples from k on as are worth it; none where the watch ended it."""
        began, simulation = time.perf_counter(), self._simulation
        self._kept = simulation.keep() if self._most > 1 else None
        if self._kept is None:
            self._most = 1
        self._times = self._own_times(k)
        try:
            rows = simulation.step_rows(self._times, watch, limits)
        except SimulationError:
            if self._kept is None:
                raise
            simulation.back_to(self._kept)  # it is told where it belongs
            self._most = 1
            return self._computed(k, watch, limits)
        if not rows and self._kept is not None:
            simulation.back_to(self._kept)
        each = (time.perf_counter() - began) / self._most
        self._most = max(1, min(2 * self._most, MOST, int(BUDGET / each)))
        return rows

    def _own_times(self, k: int) -> Any:
        """Of the samples from k on, each as a step from the one before reaches it [s]."""
        times, now = [], self._simulation.time
        for one in range(k, k + self._most):
            now = now + (one / self._rate - now)
            times.append(now)
        return np.array(times)
