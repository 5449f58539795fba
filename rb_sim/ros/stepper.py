"""From one sample instant to the next: take commands, advance, hand the sample to the sinks."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rb_sim.engine.samples import SampleRow
from rb_sim.instants import samples_at_rate
from rb_sim.ros.ahead import Ahead
from rb_sim.ros.command import Commands
from rb_sim.watch import NO_LIMITS, Watch

if TYPE_CHECKING:
    from rb_sim.engine.samples import ContactEvent, SampleBlock
    from rb_sim.placing import Placement
    from rb_sim.simulation import Simulation
    from rb_sim.sinks.sink import Sink

MOST_RECENT = 10_000
"""Events that are kept for an answer; it says how many it lacks."""


class Stepper:
    """Owns the count of samples; stamps are k times the sample period, whatever is reset.

    A command taken at t_k acts from t_k on; so the sample at t_(k+1) shows it, with the reactions
    and accelerations that go with it, as applied over (t_k, t_(k+1)].
    """

    def __init__(
        self, simulation: Simulation, commands: Commands, sinks: Sequence[Sink], rate: float
    ) -> None:
        self.period = 1.0 / rate
        self.limits = NO_LIMITS
        self.watch: Watch | None = None
        """asked while a sample takes long, whether to go on."""
        self.samples = 0
        self.last_row: SampleRow | None = None
        """the last sample; None before the first."""
        self._events: deque[ContactEvent] = deque(maxlen=MOST_RECENT)
        """of contacts, which nobody has taken yet."""
        self._forgotten = 0
        """events that nobody took before MOST_RECENT others came."""
        self.busy = 0.0
        self.longest = 0.0
        """wall time spent in steps, and in the longest one, since the last `take_times` [s]."""
        self.counted = 0
        self.ahead = Ahead(simulation, rate)
        """what commands are given to."""
        self._simulation = simulation
        self._commands = commands
        self._take = [self._taker(sink) for sink in sinks]
        prepared = (getattr(sink, "prepare", None) for sink in sinks)
        self._prepare = [prepare for prepare in prepared if prepare is not None]
        self._rate = rate
        self._started_at = 0
        """sample at which the simulation's own time was zero."""
        self._steps_before = 0
        """steps before the simulation was reset or set last: it counts anew from there."""

    def _taker(self, sink: Sink) -> Callable[[SampleRow], None]:
        """How the sink takes a sample: as the kernel leaves it, or as a block."""
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
        """Steps of the method since the start, resets or not."""
        return self._steps_before + self._simulation.steps

    @property
    def origin(self) -> str:
        """From where the simulation counts its own time, in words; "" while that is zero."""
        if not self._started_at:
            return ""
        return f" (times of the motion from t = {self._started_at / self._rate:.9g} s on)"

    def is_over(self, duration: float) -> bool:
        """Whether the next sample would lie beyond `duration` [s]; 0: none does."""
        return duration > 0.0 and self.samples + 1 >= samples_at_rate(duration, self._rate)

    def emit(self, row: SampleRow | None = None) -> None:
        """Hand the present state to the sinks, as the sample at `t`. row: that state, if known."""
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
        """The last sample by name; None before the first."""
        return None if self.last_row is None else self.last_row.block(self._simulation.layout)

    def step(self, wrench_timeout: float) -> bool:
        """One sample period. False: the watch ended it; the state is still that of `t`.

        SimulationError: the integration cannot go on.
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
        """While no sample is due: compute and pack what comes next, unless that is done."""
        shift, k = self._started_at / self._rate, self.samples + 1 - self._started_at
        self.ahead.fill(k, shift, self.watch, self.limits)
        self._pack()

    def _pack(self) -> None:
        """Have the sinks prepare for samples that were computed together, if any were."""
        rows = self.ahead.take_fresh()
        for prepare in self._prepare if rows else ():
            prepare(rows)

    def settle(self) -> None:
        """Put the simulation at the last sample, for who is to look at it or change it."""
        self.ahead.settle()

    def reset(self) -> None:
        """The initial state, without commands, as the next sample; stamps go on."""
        self.settle()
        self._steps_before = self.steps
        self._simulation.reset()
        self._commands.forget()
        self.samples += 1
        self._started_at = self.samples
        self.emit()

    def set_state(self, bodies: Mapping[str, Placement], *, project: bool) -> None:
        """The state as the next sample, one period on; commands go on, and so do stamps.

        RbSimError: it cannot be taken, and nothing has changed.
        """
        self.settle()
        steps = self.steps
        self._simulation.set_state(bodies, project=project)
        self._steps_before = steps
        self.samples += 1
        self._started_at += 1  # own time stands still for a period
        self.emit()

    def take_events(self) -> tuple[list[ContactEvent], int]:
        """Events of contacts since the last call, the last MOST_RECENT of them, and how many more
        there were before those."""
        events, forgotten = list(self._events), self._forgotten
        self._events.clear()
        self._forgotten = 0
        return events, forgotten

    def take_times(self) -> tuple[float, float]:
        """Mean and longest wall time of a step since the last call [s]."""
        mean = self.busy / self.counted if self.counted else 0.0
        longest = self.longest
        self.busy = self.longest = 0.0
        self.counted = 0
        return mean, longest
