# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Advance from one sample to the next: take commands, integrate, pass the sample to the sinks."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.mechanics.samples import SampleRow
from rb_sim.motion.motion import NO_LIMITS, Limits, Watch, samples_at_rate
from rb_sim.ros.topics.command import Commands

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import ContactEvent, SampleBlock
    from rb_sim.simulation.simulation import Simulation
    from rb_sim.simulation.state_override import Placement


# Prefetch: several samples are computed per kernel call, before they are due.
#
# A command acts at a definite sample, so samples computed beyond it are discarded: the motion
# returns to a saved state and is integrated again to the last sample handed out. The result is the
# same to the last bit.


MOST = 32
"""Maximum number of samples per kernel call."""
BUDGET = 2e-4
"""[s] of wall-clock time for one call, since a command has to wait for it."""
QUIET = 4
"""Minimum number of samples per call for computing before a sample is due: no command has come for
some time then, and one in 32 samples would be late by the duration of a call."""


class Ahead:
    """Hands out the samples of a simulation, at k / rate in its own time; takes commands."""

    def __init__(self, simulation: Simulation, rate: float) -> None:
        self._simulation, self._rate = simulation, rate
        self._rows: list[SampleRow] = []
        self._fresh: list[SampleRow] = []
        self._times = np.empty(0)
        """of the rows, in the simulation's own time [s]."""
        self._taken = 0
        """number of rows handed out."""
        self._kept: Any = None
        """saved state at the start of the rows."""
        self._most = 1
        """number of samples for the next call; it grows while no command comes."""

    def apply_wrench(
        self, body: str, force: Sequence[float], torque: Sequence[float], frame: str = "world"
    ) -> None:
        """As Simulation.apply_wrench, at the last sample handed out."""
        self.rewind()
        self._simulation.apply_wrench(body, force, torque, frame)

    def rewind(self) -> None:
        """Return the simulation to the last sample handed out."""
        if self._taken < len(self._rows):
            self._simulation.back_to(self._kept)
            if self._taken:
                self._simulation.step_rows(self._times[: self._taken])
        self._rows, self._taken, self._most = [], 0, 1

    def next(self, k: int, shift: float, watch: Watch | None, limits: Limits) -> SampleRow | None:
        """Sample k, the one after the last; None if the watch ended it before.

        shift: stamp minus own time [s]. Raises SimulationError if the integration cannot continue.
        """
        if self._taken == len(self._rows):
            several = self._several(k, watch, limits) if self._most > 1 else None
            rows = self._go(k, watch, limits) if several is None else several
            if not rows:
                return None
            self._hold(rows, shift)
        self._taken += 1
        return self._rows[self._taken - 1]

    @property
    def is_due(self) -> bool:
        """Whether `fill` would compute samples: none are left, and no recent command."""
        return self._taken == len(self._rows) and self._most >= QUIET

    def fill(self, k: int, shift: float, watch: Watch | None, limits: Limits) -> None:
        """Compute samples from k on (the one after the last) before k is due.

        Does nothing if samples are left, commands come often, or the motion ends (reported by
        `next`).
        """
        if self.is_due:
            self._hold(self._several(k, watch, limits) or [], shift)

    def take_fresh(self) -> list[SampleRow]:
        """Samples computed together since the last call; empty if it was only one."""
        rows, self._fresh = self._fresh, []
        return rows

    def _hold(self, rows: list[SampleRow], shift: float) -> None:
        """Keep the rows, stamped, to be handed out one by one."""
        self._rows = [one._replace(t=one.t + shift) for one in rows] if shift else rows
        self._fresh = self._rows if len(rows) > 1 else []
        self._taken = 0

    def _several(self, k: int, watch: Watch | None, limits: Limits) -> list[SampleRow] | None:
        """Samples from k on; empty, with the state restored, if the watch ended it.

        None if they must be computed one by one: the state cannot be saved, or an error occurred.
        """
        self._kept, rows = self._simulation.keep(), None
        if self._kept is not None:
            try:
                rows = self._go(k, watch, limits)
            except SimulationError:  # raised again at the sample where it occurs
                pass
            if not rows:
                self._simulation.back_to(self._kept)
        if rows is None:
            self._most = 1
        return rows

    def _go(self, k: int, watch: Watch | None, limits: Limits) -> list[SampleRow]:
        """Samples from k on in one kernel call; also sets the number for the next call."""
        began = time.perf_counter()
        times, now = [], self._simulation.time
        for one in range(k, k + self._most):  # each as reached by a step from the one before
            now = now + (one / self._rate - now)
            times.append(now)
        self._times = np.array(times)
        rows = self._simulation.step_rows(self._times, watch, limits)
        each = (time.perf_counter() - began) / self._most
        self._most = max(1, min(2 * self._most, MOST, int(BUDGET / each)))
        return rows


MOST_RECENT = 10_000
"""Maximum number of events kept for an answer, which reports how many are missing."""


class Stepper:
    """Counts the samples; stamps are multiples of the sample period, also across resets.

    A command taken at t_k acts from t_k on; the sample at t_(k+1) contains it, with the
    corresponding reactions and accelerations, as applied over (t_k, t_(k+1)].

    sinks: each takes samples as rows (`write_row`) or as blocks (`write`).
    """

    def __init__(
        self, simulation: Simulation, commands: Commands, sinks: Sequence[Any], rate: float
    ) -> None:
        self.period = 1.0 / rate
        self.limits = NO_LIMITS
        self.watch: Watch | None = None
        """called while a sample takes long; returns whether to continue."""
        self.samples = 0
        self.last_row: SampleRow | None = None
        """the last sample; None before the first."""
        self._events: deque[ContactEvent] = deque(maxlen=MOST_RECENT)
        """contact events since the last `take_events`."""
        self._forgotten = 0
        """number of older events dropped."""
        self.busy = 0.0
        self.longest = 0.0
        """wall-clock time in steps, and in the longest one, since the last `take_times` [s]."""
        self.counted = 0
        self.ahead = Ahead(simulation, rate)
        """receives the commands."""
        self._simulation = simulation
        self._commands = commands
        self._take = [self._taker(sink) for sink in sinks]
        prepared = (getattr(sink, "prepare", None) for sink in sinks)
        self._prepare = [prepare for prepare in prepared if prepare is not None]
        self._rate = rate
        self._started_at = 0
        """sample at which the simulation's own time was zero."""
        self._steps_before = 0
        """steps before the last reset or set state, at which the simulation's count restarts."""

    def _taker(self, sink: Any) -> Callable[[SampleRow], None]:
        """The sink's function for a sample: as a kernel row if supported, else as a block."""
        by_row = getattr(sink, "write_row", None)
        return by_row or (lambda row: sink.write(row.block(self._simulation.layout)))

    @property
    def t(self) -> float:
        """Stamp of the last sample [s]."""
        return self.samples / self._rate

    @property
    def t_next(self) -> float:
        """Stamp of the next sample [s]."""
        return (self.samples + 1) / self._rate

    @property
    def steps(self) -> int:
        """Number of integration steps since the start, across resets."""
        return self._steps_before + self._simulation.steps

    @property
    def origin(self) -> str:
        """Text with the stamp at which the simulation's own time is zero; "" if that is 0."""
        if not self._started_at:
            return ""
        return f" (times of the motion from t = {self._started_at / self._rate:.9g} s on)"

    def is_over(self, duration: float) -> bool:
        """Whether the next sample would be beyond `duration` [s]; 0: unlimited."""
        return duration > 0.0 and self.samples + 1 >= samples_at_rate(duration, self._rate)

    def emit(self, row: SampleRow | None = None) -> None:
        """Pass the present state to the sinks as the sample at `t`. row: that state, if known."""
        simulation = self._simulation
        shift = self._started_at / self._rate
        if row is None:
            row = simulation.sample_row()
            row = row._replace(t=row.t + shift)
        events, inputs = simulation.take_events(), simulation.take_inputs()
        if events or inputs:
            events = tuple(replace(event, t=event.t + shift) for event in events)
            inputs = tuple(given._replace(t=given.t + shift) for given in inputs)
            row = row._replace(events=events, inputs=inputs)
            self._forgotten += max(0, len(self._events) + len(events) - MOST_RECENT)
            self._events.extend(events)
        for take in self._take:
            take(row)
        self.last_row = row

    @property
    def last(self) -> SampleBlock | None:
        """The last sample as a block; None before the first."""
        return None if self.last_row is None else self.last_row.block(self._simulation.layout)

    def step(self, wrench_timeout: float) -> bool:
        """Advance one sample period. False if the watch ended it; the state remains that of `t`.

        Raises SimulationError if the integration cannot continue.
        """
        begun = time.perf_counter()
        self._commands.apply(self.ahead, self.samples / self._rate, wrench_timeout)
        shift, k = self._started_at / self._rate, self.samples + 1 - self._started_at
        row = self.ahead.next(k, shift, self.watch, self.limits)
        if row is None:
            return False
        self._pack()
        self.samples += 1
        self.emit(row)
        spent = time.perf_counter() - begun
        self.busy += spent
        self.longest = max(self.longest, spent)
        self.counted += 1
        return True

    def look_ahead(self) -> None:
        """Compute and pack the next samples while none is due, unless already done."""
        shift, k = self._started_at / self._rate, self.samples + 1 - self._started_at
        self.ahead.fill(k, shift, self.watch, self.limits)
        self._pack()

    def _pack(self) -> None:
        """Let the sinks prepare samples that were computed together, if any."""
        rows = self.ahead.take_fresh()
        for prepare in self._prepare if rows else ():
            prepare(rows)

    def rewind(self) -> None:
        """Return the simulation to the last sample, before it is inspected or changed."""
        self.ahead.rewind()

    def reset(self) -> None:
        """Make the initial state, without commands, the next sample; stamps continue."""
        self.rewind()
        self._steps_before = self.steps
        self._simulation.reset()
        self._commands.forget()
        self.samples += 1
        self._started_at = self.samples
        self.emit()

    def set_state(self, bodies: Mapping[str, Placement], *, project: bool) -> None:
        """Make this state the next sample, one period later; commands and stamps continue.

        Raises RbSimError if the state is invalid; nothing has changed then.
        """
        self.rewind()
        steps = self.steps
        self._simulation.set_state(bodies, project=project)
        self._steps_before = steps
        self.samples += 1
        self._started_at += 1  # own time does not advance in this period
        self.emit()

    def take_events(self) -> tuple[list[ContactEvent], int]:
        """Contact events since the last call, at most MOST_RECENT; number of older ones dropped."""
        events, forgotten = list(self._events), self._forgotten
        self._events.clear()
        self._forgotten = 0
        return events, forgotten

    def take_times(self) -> tuple[float, float]:
        """Mean and longest wall-clock time of a step since the last call [s]."""
        mean = self.busy / self.counted if self.counted else 0.0
        longest = self.longest
        self.busy = self.longest = 0.0
        self.counted = 0
        return mean, longest
