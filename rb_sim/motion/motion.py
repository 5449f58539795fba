# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motion: a compiled scene under one method, carried from instant to instant by a loop.

What `Simulation` owns and what the accuracy tools time: no sinks, no commands, no YAML.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rb_sim.base.errors import SimulationError, StepTooLargeError
from rb_sim.integrate.layout import LEFT_DOMAIN, NOT_FINITE, STEP_UNDERFLOW
from rb_sim.integrate.methods.taylor import AdaptiveTaylor
from rb_sim.mechanics.samples import Array, ContactEvent, SampleLayout, row_width
from rb_sim.scene.compiled import Compiled


class Motion(ABC):
    """The state of a compiled scene and the grid of steps on which it moves.

    compiled: system, initial coordinates, layout and breakpoints.
    method: a class of rb_sim.integrate.methods with its step or tolerance.
    watch: called every PIECE_STEPS steps and at each event; what it raises ends the run, which can
    go on later as if it had not ended.
    """

    def __init__(self, compiled: Compiled, method: Any) -> None:
        self.watch: Callable[[], None] = nothing
        self.compiled = compiled
        self.method = method
        self.layout: SampleLayout = compiled.layout
        self.width = row_width(self.layout)
        self.system = compiled.system
        self.time = 0.0
        """simulated time [s]."""
        self.reset()

    as_compiled = True
    """whether all so far follows from the scene: from its start, and under no command."""
    held: frozenset[str] = frozenset()
    """bodies whose errors are relative to their own motion, not to what the scene has."""
    event_driven = False
    """whether events of contacts cut the run into pieces."""
    events: Sequence[ContactEvent] = ()
    """what happened to the contacts since the start."""
    forgotten = 0
    """events before those of `events`."""
    unsolved_steps: Any = 0
    solver_residual: Any = 0.0
    solver_give: Any = 0.0
    circling_steps: Any = 0
    restruck_energy: Any = 0.0
    made_energy: Any = 0.0
    paradox_steps: Any = 0
    slipping_steps: Any = 0
    astray: Any = (0.0, 0.0, 0)
    """what time stepping counts; see SteppedContacts."""
    left_open: Any = None
    """the widest choice that laws of contact have left, see LeftOpen."""

    def take(self, method: Any) -> Any:
        """Go on with another setting of the method, which is returned."""
        self.method = method
        return method

    @abstractmethod
    def reset(self, y: Any = None, time: float = 0.0) -> None:
        """Back to the start: the scene's initial coordinates, or y (of the same kind) at `time`."""

    kept: Any = np.zeros(0)
    """what laws keep from step to step beside the coordinates: turns of torsion springs."""

    looks: Any = None
    """of contacts with sides: time, coordinates, and when to look at them next
    (contact/tunnelling)."""

    def reset_beside(self, run: Motion, y: Any, time: float) -> None:
        """As reset, with what laws keep from step to step as another motion of the scene has it."""
        self.reset(y, time)
        self.kept = run.kept

    @property
    @abstractmethod
    def steps(self) -> int:
        """Steps taken since the start, those not needed for a sample included."""

    @property
    @abstractmethod
    def rejected_steps(self) -> int:
        """Attempts that an adaptive method gave up since the start."""

    @property
    def cut_steps(self) -> int:
        """Of these the ones within the tolerance, which only went beyond the end of a piece of a
        spline."""
        return 0

    @property
    @abstractmethod
    def frontier(self) -> tuple[float, float]:
        """End of the last step, and its length [s]; samples may lie before it."""

    @property
    @abstractmethod
    def coordinates(self) -> Any:
        """y at `time`, to which `reset` can go back."""

    def warm(self) -> None:
        """Compile everything that `run_to` will call."""
        self._record(np.array([self.time]), self.time, np.zeros((1, self.width)))

    def sample(self) -> Array:
        """The row of a sample at the present time, shape (1, width)."""
        out = np.zeros((1, self.width))
        self._record(np.array([self.time]), math.inf, out)
        return out

    def take_worst(self) -> float | None:
        """The worst residual of the samples since this was last asked for; None: look at them."""
        return None

    def change_law(self, system: Any) -> None:
        """Go on with other constants (a command); a new grid of steps begins here."""
        self.system, self.as_compiled = system, False
        self._restart_grid()

    def keep(self) -> Any:
        """What `back_to` takes to come back here, to the last bit; None: there is no way back."""
        return None

    def back_to(self, kept: Any) -> None:
        """The motion as it was when this was kept; it can be kept for several ways back."""
        raise NotImplementedError

    @abstractmethod
    def run_to(self, times: Sequence[float] | Array, out: Array | None = None) -> int:
        """Integrate to the times in turn, sampling there into the rows of `out` if it is given.

        The grid of steps stops at every breakpoint between them.  Returns how many were reached.
        Raises SimulationError where the integration cannot go on.
        """

    @abstractmethod
    def _restart_grid(self) -> None:
        """Begin a new grid of steps at the present state: the law changes here."""

    @abstractmethod
    def _record(self, times: Array, stop: float, out: Array | None) -> None:
        """Carry the motion to the times, no step beyond `stop`; SimulationError where it ends."""

    def _failure(self, status: int) -> SimulationError:
        """The error for a status of the loop."""
        if status == NOT_FINITE and getattr(self.method, "step", None) is not None:
            return StepTooLargeError(self._explain(status))
        return SimulationError(self._explain(status))

    def _explain(self, status: int) -> str:
        """What a status of the loop means, in one line."""
        t = self.frontier[0]
        step = getattr(self.method, "step", None)
        if status == NOT_FINITE and step is not None:
            return (
                f"the state is no longer finite at t = {t:.9g} s: step {step:g} s is too large for "
                f"{type(self.method).__name__.lower()} on this scene"
            )
        if status == STEP_UNDERFLOW and isinstance(self.method, AdaptiveTaylor):
            return (
                f"the motion has no Taylor series at t = {t:.9g} s (for example quadratic drag at "
                "zero speed); use method dopri853"
            )
        if status in (NOT_FINITE, STEP_UNDERFLOW):
            return (
                f"no step is small enough at t = {t:.9g} s: the equations are singular there or a "
                "force is too large"
            )
        if status == LEFT_DOMAIN:
            return f"the body passed the end of its guide at t = {t:.9g} s"
        return f"the integration ended at t = {t:.9g} s (status {status})"


def nothing() -> None:
    """Watches over nothing."""
