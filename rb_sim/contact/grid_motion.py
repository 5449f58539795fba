# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motion of bodies in contact on a grid of steps whose states are arrays: what both kinds share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.mechanics.samples import Array
from rb_sim.motion.motion import Motion

OTHERS = (
    "the contact problem has several solutions; the minimum-norm one was used, or the one that "
    "separates"
)
"""What to know where no setting would decide: of choices of the laws."""
OPEN_SHARES = "relative difference between the accelerations that the contact laws allow"


class LeftOpen(NamedTuple):
    """The widest choice that the laws left in a run."""

    figure: float = 0.0
    """how far two motions that both obey them are apart, relative to the largest of its kind."""
    t: float = 0.0
    """[s]."""
    contact: str = ""
    what: str = ""
    """what differs by the figure."""
    by_setting: bool = False
    """whether it is the step or the tolerance that leaves it open."""
    advice: str = OTHERS
    """what to try, or to know, where it is not."""


# The grid of steps of bodies in contact: where an integration stands.


class Grid(NamedTuple):
    """Where the integration stands: the last step goes from t0 to t1; states are arrays."""

    origin: float
    """time at which the grid starts [s]."""
    steps: int
    rejected: int
    t0: float
    y0: Any
    c0: Any
    """what compensated summation has still to add to y0."""
    t1: float
    y1: Any
    c1: Any
    h: float
    """adaptive methods: step to try next, 0 before the first [s]."""
    y: Any
    """state at the time last asked for."""
    c: Any


def start_grid(t: float, y: Any, c: Any = None) -> Grid:
    """A grid that starts at (t, y); c: the low digits of y, left out: none."""
    c = np.zeros_like(y) if c is None else c
    return Grid(t, 0, 0, t, y.copy(), c.copy(), t, y.copy(), c.copy(), 0.0, y.copy(), c.copy())


class GridMotion(Motion):
    """As Motion; a subclass says how the loop carries the grid (`_record`)."""

    def reset(self, y: Any = None, time: float = 0.0) -> None:
        """As Motion.reset, with a new grid of steps."""
        self.system = self.compiled.system
        self.time, self.as_compiled = time, y is None
        self._grid = start_grid(time, self.compiled.y if y is None else y)
        self._steps_before = self._rejected_before = 0

    @property
    def steps(self) -> int:
        """As Motion.steps, over all grids since the last reset."""
        return self._steps_before + self._grid.steps

    @property
    def rejected_steps(self) -> int:
        """As Motion.rejected_steps, over all grids since the last reset."""
        return self._rejected_before + self._grid.rejected

    @property
    def frontier(self) -> tuple[float, float]:
        """As Motion.frontier."""
        return self._grid.t1, self._grid.t1 - self._grid.t0

    @property
    def step_end(self) -> tuple[float, Array]:
        """The time and the state to which the step at hand goes."""
        return self._grid.t1, np.asarray(self._grid.y1)

    @property
    def coordinates(self) -> Any:
        """As Motion.coordinates: an array."""
        return self._grid.y

    def run_to(self, times: Sequence[float] | Array, out: Array | None = None) -> int:
        """As Motion.run_to; a grid ends at each breakpoint and a new one begins."""
        times = np.asarray(times, dtype=float)
        done = 0
        while done < len(times):
            stop = next((b for b in self.compiled.breakpoints if b > self.time), math.inf)
            upto = int(np.searchsorted(times, stop, side="right"))
            if upto > done:
                part = times[done:upto]
                self._record(part, stop, None if out is None else out[done:upto])
                done = upto
            else:
                self._record(np.array([stop]), stop, None)
            if self.time >= stop:
                self._restart_grid()
        return done

    def _restart_grid(self) -> None:
        self._begin_grid(self.time, self._grid.y, self._grid.h)

    def _begin_grid(self, t: float, y: Any, h: float) -> None:
        """Go on from (t, y) on a new grid of steps, the first of size h."""
        self._steps_before += self._grid.steps
        self._rejected_before += self._grid.rejected
        # what the event has left as it was keeps its low digits
        c = np.where(y == self._grid.y1, self._grid.c1, 0.0)
        self._grid = start_grid(t, y, c)._replace(h=h)
