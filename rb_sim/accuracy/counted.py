"""Runs whose time is counted, not measured: the same scene, the same figures, on any machine."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.prices import EVENT, evaluations, seconds_of_evaluation
from rb_sim.accuracy.runs import Runner
from rb_sim.engine.samples import Array
from rb_sim.errors import SimulationError
from rb_sim.motion import Motion, nothing
from rb_sim.scene.compiled import Compiled


class CountedRunner(Runner):
    """As Runner, but `spent`, `limit` and `cost` are in counted seconds: work at written prices.

    No setting is run twice from the same start; what it gave is kept.
    look: called now and then during a run; what it raises but SimulationError ends all.
    """

    def __init__(
        self,
        compiled: Compiled,
        duration: float,
        times: Array,
        look: Callable[[], None] = nothing,
    ) -> None:
        super().__init__(compiled, duration, times)
        self._look = look
        self.runs = 0
        """runs made so far."""
        self._unit = seconds_of_evaluation(compiled)
        self._costs: dict[Setting, float] = {}
        self._rows: dict[Setting, tuple[Array, int]] = {}
        self.broken_off = False
        """whether the last run ended at `limit`."""
        self._current: tuple[Setting, Motion] | None = None

    def motion(self, setting: Setting) -> Motion:
        motion = super().motion(setting)
        self._current = setting, motion
        motion.watch = self._in_time
        return motion

    def sampled(self, setting: Setting, y: Any = None) -> tuple[Array, int]:
        if y is None and setting in self._rows:
            return self._rows[setting]
        before, self.broken_off = self.spent, False
        rows, steps = super().sampled(setting, y)
        self.runs += 1
        motion = self.motion_of(setting)
        if y is None and not self.broken_off:
            self._rows[setting] = rows, steps
        stepping = self._counted(setting, motion)
        ended = bool(np.isfinite(rows[-1]).all())
        self._costs[setting] = stepping / self.duration if ended else math.inf
        # a sample between two steps is a step of its own
        looking = len(self.times) * self._unit * self._evaluations(setting)
        self.spent = before + stepping + looking
        return rows, steps

    def forget(self) -> None:
        """Drop the rows that are kept: `times` are others from now on."""
        self._rows.clear()

    def motion_of(self, setting: Setting) -> Motion:
        """The motion that ran last, of this setting."""
        assert self._current is not None and self._current[0] == setting
        return self._current[1]

    def cost(self, setting: Setting, budget: float = 0.0) -> float:
        """Counted seconds per simulated second of stepping alone; runs a setting not yet seen."""
        if setting not in self._costs:
            self.sampled(setting)
        return self._costs[setting]

    def _counted(self, setting: Setting, motion: Motion) -> float:
        """What the steps, and events, of the motion so far are worth [s]."""
        attempts = motion.steps + motion.rejected_steps
        worth = attempts * self._unit * self._evaluations(setting)
        return worth + EVENT * len(motion.events)

    def _evaluations(self, setting: Setting) -> float:
        """Right sides that a step is worth."""
        return evaluations(setting.name, setting.tolerance, self.compiled)

    def _in_time(self) -> None:
        self._look()
        assert self._current is not None
        if self._counted(*self._current) > self.limit:
            self.broken_off = True
            raise SimulationError(f"broken off after {self.limit:.3g} counted seconds")
