"""Runs of a compiled scene under any setting: sampled for its error, or timed for its cost."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.differences import Errors, compare
from rb_sim.base.errors import SimulationError
from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.system import CONFIGURATION
from rb_sim.motion.motion import Motion
from rb_sim.scene.compiled import Compiled
from rb_sim.scene.schema import SimulationOptions

FEWEST, MOST = 400, 2000
"""Instants at which the errors of a run are taken."""

EXPENSIVE = 1e-3
"""[s] of CPU: a run shorter than this is timed in batches."""


def sample_times(options: SimulationOptions) -> Array:
    """Instants of the scene's duration at which runs are compared, both ends included [s]."""
    count = int(min(max(options.duration * options.rate, FEWEST), MOST))
    return options.duration * np.arange(count + 1) / count


def dividing(step: float, duration: float) -> float:
    """The largest step <= `step` that divides the duration [s]."""
    return duration / max(1, math.ceil(duration / step * (1.0 - 1e-9)))


class Runner:
    """One compiled scene over one span of time.

    compiled: the scene. duration: length of every run [s]. times: instants to compare at [s].
    clock: what `spent` is read from [s]: CPU time, or the wall's for a user who waits.
    """

    def __init__(
        self,
        compiled: Compiled,
        duration: float,
        times: Array,
        clock: Callable[[], float] = time.process_time,
    ) -> None:
        self.compiled = compiled
        self.duration = duration
        self.times = times
        self.spent = 0.0
        """Time of all runs so far, compilation left out [s]."""
        self.limit = math.inf
        """Time after which a run from event to event is broken off [s]: too coarse a method may
        take a block that rocks for one that rattles."""
        self._clock, self._begun = clock, 0.0
        self._motions: dict[type, Motion] = {}

    def motion(self, setting: Setting) -> Motion:
        """The scene under the setting, at its start and compiled."""
        method = setting.build(self.duration)
        motion = self._motions.get(type(method))
        if motion is None:
            motion = motion_of(self.compiled, method)
            motion.warm()
            if motion.event_driven:
                motion.watch = self._in_time
            self._motions[type(method)] = motion
        motion.method = method
        motion.reset()
        return motion

    def sampled(self, setting: Setting, y: Any = None) -> tuple[Array, int]:
        """(rows at self.times, steps taken), started at the coordinates y if they are given.

        Rows after the instant where the run could not go on are NaN.
        """
        motion = self.motion(setting)
        start = self._begun = self._clock()
        motion.reset(y)
        rows = np.full((len(self.times), motion.width), np.nan)
        try:
            self._carry(motion, rows)
        except SimulationError:
            rows[-1] = np.nan
        self.spent += self._clock() - start
        return rows, motion.steps

    def _carry(self, motion: Motion, rows: Array, done: int = 0) -> None:
        """Carry the motion from instant to instant; done: rows that are there already."""
        motion.run_to(self.times[done:], rows[done:])

    def cost(self, setting: Setting, budget: float = 0.02) -> float:
        """CPU seconds per simulated second of stepping alone, the best of several runs.

        budget: CPU time to spend on the measurement [s]; one run is made at least.
        """
        motion = self.motion(setting)
        best, total, batch = math.inf, 0.0, 1
        while True:
            cpu = sum(self._one(motion) for _ in range(batch)) / batch
            best, total = min(best, cpu), total + cpu * batch
            if total >= budget or not math.isfinite(cpu):
                break
            batch = max(1, min(1000, int(EXPENSIVE / max(cpu, 1e-7))))
        self.spent += total if math.isfinite(total) else 0.0
        return best / self.duration

    def beyond(self, setting: Setting) -> bool:
        """Whether a run of the setting would take more than is left, as far as that is known."""
        return False

    def known_cost(self, setting: Setting) -> float:
        """Time of a run of the setting that need not be made again [s]; 0 where that is nothing."""
        return 0.0

    def _one(self, motion: Motion) -> float:
        """CPU time of one run without samples [s]; infinite if it cannot go on."""
        motion.reset()
        self._begun, start = self._clock(), time.process_time()
        try:
            motion.run_to([self.duration])
        except SimulationError:
            return math.inf
        return time.process_time() - start

    def _in_time(self) -> None:
        if self._clock() - self._begun > self.limit:
            raise SimulationError(f"stopped after {self.limit:.3g} s")


# How much the scene itself magnifies one rounding: runs from initial states one ulp apart.


EPS = float(np.finfo(float).eps)

BODY, PLACES = 13, 7
"""Coordinates of a body that nothing holds, and of many: position, quaternion, velocity, spin; and
how many of them tell where it is."""


def ulp_growth(
    runner: Runner, setting: Setting, trials: int = 3, budget: float = math.inf
) -> Errors:
    """Largest differences that initial coordinates one ulp apart make.

    budget: time of the runner after which no further trial begins [s].
    """
    layout, start = runner.compiled.layout, runner.spent
    base, _ = runner.sampled(setting)
    random = np.random.default_rng(0)
    growths = []
    for trial in range(trials):
        if trial and runner.spent - start > budget:
            break
        moved, _ = runner.sampled(setting, y=one_ulp_apart(runner.compiled.y, random))
        growths.append(compare(moved, base, layout))
    return Errors(*np.max(growths, axis=0).tolist())


def one_ulp_apart(y: Any, random: np.random.Generator, sizes: Array | None = None) -> Any:
    """The coordinates, each moved to the next double up or down; of the same kind as y.

    Zeros move by half an ulp of their size: they come out of sums of terms that large. sizes: of
    each coordinate, (n,); None: 1.
    """
    values = np.array(y, dtype=float)
    sides = np.where(random.integers(0, 2, len(values)) > 0, 1.0, -1.0)
    least = 0.5 * EPS * (1.0 if sizes is None else sizes)
    moved = np.where(values == 0.0, least * sides, np.nextafter(values, np.inf * sides))
    return moved if isinstance(y, np.ndarray) else tuple(float(v) for v in moved)


def sizes_of(rows: Array, compiled: Compiled) -> Array:
    """How large each coordinate becomes in a run, its places, velocities and spins by their norms;
    1 for a quaternion, for what stays zero, and in coordinates that are none of these.

    rows: samples of the run. What swings by a nanometre has no terms of a metre.
    """
    n, bodies = len(compiled.y), len(compiled.layout.bodies)
    sizes = np.ones(n)
    if compiled.reduced and (n != BODY or CONFIGURATION.get(type(compiled.system)) != PLACES):
        return sizes
    states = rows[:, : BODY * bodies].reshape(len(rows), bodies, BODY)
    for part in (slice(0, 3), slice(7, 10), slice(10, 13)):
        with np.errstate(all="ignore"):
            largest = np.nan_to_num(np.linalg.norm(states[:, :, part], axis=2)).max(axis=0)
        for i in np.flatnonzero(largest):
            sizes[BODY * i + part.start : BODY * i + part.stop] = largest[i]
    return sizes
