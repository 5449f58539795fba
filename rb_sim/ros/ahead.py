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
QUIET = 4
"""Samples of a go from which on it is made before one is due: no command has come for some time,
and one in 32 samples would be late by what the go takes."""


class Ahead:
    """Hands out the samples of a simulation, at k / rate in its own time; takes commands."""

    def __init__(self, simulation: Simulation, rate: float) -> None:
        self._simulation, self._rate = simulation, rate
        self._rows: list[SampleRow] = []
        self._fresh: list[SampleRow] = []
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
            self._hold(rows, shift)
        self._taken += 1
        return self._rows[self._taken - 1]

    @property
    def is_due(self) -> bool:
        """Whether `fill` would compute some: none are left, and no command has come for a while."""
        return self._taken == len(self._rows) and self._most >= QUIET

    def fill(self, k: int, shift: float, watch: Watch | None, limits: Limits) -> None:
        """Compute samples from k on, the one behind the last, before k is due.

        None where some are left, where commands come often, or where the motion ends: `next` tells.
        """
        if self.is_due:
            self._hold(self._several(k, watch, limits) or [], shift)

    def take_fresh(self) -> list[SampleRow]:
        """Samples that were computed together since the last call; none where it was only one."""
        rows, self._fresh = self._fresh, []
        return rows

    def _hold(self, rows: list[SampleRow], shift: float) -> None:
        """Keep the rows, stamped, to be handed out one by one."""
        self._rows = [one._replace(t=one.t + shift) for one in rows] if shift else rows
        self._fresh = self._rows if len(rows) > 1 else []
        self._taken = 0

    def _computed(self, k: int, watch: Watch | None, limits: Limits) -> list[SampleRow]:
        """As many samples from k on as are worth it; none where the watch ended it."""
        rows = self._several(k, watch, limits) if self._most > 1 else None
        return self._go(k, watch, limits) if rows is None else rows

    def _several(self, k: int, watch: Watch | None, limits: Limits) -> list[SampleRow] | None:
        """Samples from k on; none, and the state as it was, where the watch ended it.

        None where they have to come one by one: without a way back, and before an error.
        """
        self._kept, rows = self._simulation.keep(), None
        if self._kept is not None:
            try:
                rows = self._go(k, watch, limits)
            except SimulationError:  # it is told where it belongs
                pass
            if not rows:
                self._simulation.back_to(self._kept)
        if rows is None:
            self._most = 1
        return rows

    def _go(self, k: int, watch: Watch | None, limits: Limits) -> list[SampleRow]:
        """Samples from k on in one call of the kernel, and how many the next one may compute."""
        began = time.perf_counter()
        self._times = self._own_times(k)
        rows = self._simulation.step_rows(self._times, watch, limits)
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
