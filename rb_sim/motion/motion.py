# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motion: a compiled scene integrated by one method from instant to instant.

`Simulation` owns one and the accuracy tools time one: no sinks, commands or YAML. A run is cut into
kernel calls short enough that signals and progress are handled in between.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import RbSimError, SimulationError, StepTooLargeError
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.integrate.layout import LEFT_DOMAIN, NOT_FINITE, STEP_UNDERFLOW
from rb_sim.integrate.methods.taylor import AdaptiveTaylor
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.samples import Array, ContactEvent, SampleLayout, row_width
from rb_sim.numerics.kernels import own_time

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array


class Motion(ABC):
    """The state of a compiled scene and its grid of steps.

    compiled: system, initial coordinates, layout and breakpoints.
    method: a class of rb_sim.integrate.methods with its step or tolerance.
    watch: called every PIECE_STEPS steps and at each event; an exception that it raises ends the
    run, which can be continued later.
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
    """whether the motion so far follows from the scene: from its start, without commands."""
    held: frozenset[str] = frozenset()
    """bodies whose errors are relative to their own motion, not to the size of the scene."""
    event_driven = False
    """whether contact events interrupt the run."""
    events: Sequence[ContactEvent] = ()
    """contact events since the start."""
    forgotten = 0
    """number of events before those in `events`."""
    unsolved_steps: Any = 0
    solver_residual: Any = 0.0
    solver_give: Any = 0.0
    circling_steps: Any = 0
    restruck_energy: Any = 0.0
    made_energy: Any = 0.0
    paradox_steps: Any = 0
    slipping_steps: Any = 0
    astray: Any = (0.0, 0.0, 0)
    """counters and sums of time stepping, from `unsolved_steps` on; see SteppedContacts."""
    left_open: Any = None
    """largest non-uniqueness of the contact laws so far, see LeftOpen; None without one."""

    def take(self, method: Any) -> Any:
        """Continue with another setting of the method; returns it."""
        self.method = method
        return method

    @abstractmethod
    def reset(self, y: Any = None, time: float = 0.0) -> None:
        """Reset to the scene's initial coordinates, or to y (of the same kind) at `time` [s]."""

    kept: Any = np.zeros(0)
    """quantities that laws carry from step to step besides the coordinates: turns of torsion
    springs."""

    looks: Any = None
    """state of the tunnelling check for contacts with edges: time, coordinates, time of the next
    check (contact/tunnelling)."""

    def reset_beside(self, run: Motion, y: Any, time: float) -> None:
        """As reset, with the carried quantities of another motion of the scene."""
        self.reset(y, time)
        self.kept = run.kept

    @property
    @abstractmethod
    def steps(self) -> int:
        """Number of steps since the start, including those beyond the last sample."""

    @property
    @abstractmethod
    def rejected_steps(self) -> int:
        """Number of rejected attempts of an adaptive method since the start."""

    @property
    def cut_steps(self) -> int:
        """Number of rejected attempts within the tolerance, which only crossed the end of a spline
        piece."""
        return 0

    @property
    @abstractmethod
    def frontier(self) -> tuple[float, float]:
        """(end of the last step, its length) [s]; samples may lie before it."""

    @property
    @abstractmethod
    def coordinates(self) -> Any:
        """y at `time`, as `reset` takes it."""

    def warm(self) -> None:
        """Compile everything that `run_to` calls."""
        self._record(np.array([self.time]), self.time, np.zeros((1, self.width)))

    def sample(self) -> Array:
        """The row of a sample at the present time, shape (1, width)."""
        out = np.zeros((1, self.width))
        self._record(np.array([self.time]), math.inf, out)
        return out

    def take_worst(self) -> float | None:
        """Largest residual of the samples since the last call; None if it is not tracked."""
        return None

    def change_law(self, system: Any) -> None:
        """Continue with other constants (a command); a new grid of steps begins."""
        self.system, self.as_compiled = system, False
        self._restart_grid()

    def keep(self) -> Any:
        """State for `back_to`, exact to the last bit; None if that is not supported."""
        return None

    def back_to(self, kept: Any) -> None:
        """Restore a state from `keep`; it can be used several times."""
        raise NotImplementedError

    @abstractmethod
    def run_to(self, times: Sequence[float] | Array, out: Array | None = None) -> int:
        """Integrate to the times in order; samples go into the rows of `out` if it is given.

        The grid of steps stops at every breakpoint between them. Returns the number of times
        reached. Raises SimulationError if the integration cannot continue.
        """

    @abstractmethod
    def _restart_grid(self) -> None:
        """Start a new grid of steps at the current state: the law changes here."""

    @abstractmethod
    def _record(self, times: Array, stop: float, out: Array | None) -> None:
        """Advance the motion to the times, no step beyond `stop` [s]. Raises SimulationError if it
        fails."""

    def _failure(self, status: int) -> SimulationError:
        """The error for a status of the loop."""
        if status == NOT_FINITE and getattr(self.method, "step", None) is not None:
            return StepTooLargeError(self._explain(status))
        return SimulationError(self._explain(status))

    def _explain(self, status: int) -> str:
        """One line that explains a status of the loop."""
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
    """Watch that does nothing."""


# Sample times of a run.


MOST_SAMPLES = 2**53
"""Largest number of samples of a run: more have no distinct times."""

BESIDE = 64.0
"""Distance of the samples before and after an event, in roundings of the run's end."""


def is_finite(value: Any) -> bool:
    """Whether the value is a finite number; False for other types."""
    try:
        return math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def samples_at_rate(duration: float, rate: float) -> int:
    """Number of samples at `rate` [Hz] within `duration` [s], including the start.

    Raises RbSimError if their times are not distinct.
    """
    if not duration * rate < MOST_SAMPLES:
        raise RbSimError(f"got {duration:g} s at {rate:g} Hz; must be fewer than 2^53 samples")
    return math.floor(duration * rate * (1.0 + COMPUTED_ROUNDING) + COMPUTED_ROUNDING) + 1


def instants_at_rate(start: float, duration: float, rate: float) -> Array:
    """Sample times: every 1/rate [s] from `start` on, and the end."""
    count, end = samples_at_rate(duration, rate), start + duration
    times = np.minimum(start + np.arange(count) / rate, end)
    if end - (start + (count - 1) / rate) > COMPUTED_ROUNDING / rate:
        times = np.append(times, end)
    return times


def instants_given(at: Sequence[float] | Array, now: float) -> Array:
    """Sample times given by a caller, validated. now: current time [s]. Raises RbSimError."""
    allowed = f"at: must be increasing finite numbers, from the present time {now:g} s on"
    try:
        times: Any = np.array(at, dtype=float)
    except (TypeError, ValueError):
        raise RbSimError(f"{allowed}; got {at!r}") from None
    if times.ndim != 1 or not len(times):
        raise RbSimError(f"{allowed}; got {'none' if times.size == 0 else 'no list of numbers'}")
    if not np.isfinite(times).all():
        raise RbSimError(f"{allowed}; got {times[~np.isfinite(times)][0]}")
    wrong = np.flatnonzero(np.diff(times, prepend=np.nextafter(now, -np.inf)) <= 0.0)
    if len(wrong):
        before = f" after {times[wrong[0] - 1]:g}" if wrong[0] else ""
        raise RbSimError(f"{allowed}; got {times[wrong[0]]:g}{before}")
    return times


def instants_beside(events: Sequence[float], start: float, end: float) -> Array:
    """Sample times just before and just after each event, between `start` and `end` [s]."""
    if not events:
        return np.empty(0)
    apart = BESIDE * np.spacing(end)
    found = np.array(events)
    beside = np.concatenate([found - apart, found + apart])
    return np.unique(beside[(beside > start) & (beside < end)])


# Estimate of the remaining time of a run: reported if long, the run is ended if endless.
#
# A run with a stiff initial transient is slow only at first, and one whose body later rolls at 1e9
# rad/s is fast only at first. So the estimate uses the fastest of the recent paces, and a run is
# ended only if it stays endless for some time. The first pace is not used alone: it includes
# tracing of laws and loading of loops.


EFFORT = 5.0
"""Time between estimates [s]."""

LONG = 600.0
"""Estimated remaining time from which on it is reported [s]."""

ENDLESS = 365.25 * 86400.0
"""Estimated remaining time from which on a run is ended [s]: one year."""

PATIENCE = 3
"""Number of estimates that must agree before a run is ended; also the number of paces kept."""

ADVICE = "try a larger step or tolerance, a lower rate, or a shorter duration"

UNITS = ((86400.0 * 365.25, "years"), (86400.0, "days"), (3600.0, "hours"), (60.0, "minutes"))


class Forecast:
    """Estimate of the remaining time of a run of `duration` [s].

    tell: called once, with one line, for a run that takes long. effort, most: replace EFFORT and
    ENDLESS. wall: wall-clock time after which the run is ended in any case [s]. clock: function
    that returns the elapsed time [s]; None: wall-clock time, where compiling counts for `wall`
    only.
    """

    def __init__(
        self,
        duration: float,
        tell: Callable[[str], None] | None = None,
        *,
        effort: float | None = None,
        most: float = ENDLESS,
        wall: float = math.inf,
        clock: Callable[[], float] | None = None,
        advice: str = ADVICE,
    ) -> None:
        self.given_up = ""
        """reason why the run was ended, in one line; "" while it may continue."""
        self._advice = advice
        self._duration, self._tell, self._most = duration, tell, most
        self._clock, self._wall_clock = clock or own_time, clock or time.monotonic
        self._wall_began, self._wall = self._wall_clock(), wall
        self._effort = EFFORT if effort is None else effort
        self._began = self._looked = self._clock()
        self._reached = 0.0
        self._paces: deque[float] = deque(maxlen=PATIENCE)

    def goes_on(self, t: float) -> bool:
        """Whether to continue; called repeatedly with the simulated time since the start [s]."""
        now = self._clock()
        spent = now - self._began
        waited = self._wall_clock() - self._wall_began
        over = waited >= self._wall
        if self.given_up or (now - self._looked < self._effort and not over):
            return not self.given_up
        self._paces.append((t - self._reached) / max(now - self._looked, 1e-9))
        pace = max(self._paces)
        left = (self._duration - t) / pace if pace > 0.0 else math.inf
        self._looked, self._reached = now, t
        if over:
            self.given_up = (
                f"ended after {waited:.3g} s of wall-clock time: {self._progress(t, left)}"
            )
            return False
        if left > LONG and self._tell is not None and len(self._paces) > 1:
            self._tell(self._progress(t, left))
            self._tell = None
        if left > self._most and spent >= PATIENCE * self._effort:
            self.given_up = f"given up after {spent:.0f} s: {self._progress(t, left)}"
        return not self.given_up

    def _progress(self, t: float, left: float) -> str:
        return (
            f"the run is at t = {t:.3g} s of {self._duration:.6g} s and would take "
            f"{in_words(left)} more at this pace; {self._advice}"
        )


def in_words(seconds: float) -> str:
    """A time in the largest unit of which it has at least one."""
    if not math.isfinite(seconds):
        return "infinite time"
    for size, unit in UNITS:
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.0f} seconds"


PIECE = 0.05
"""Approximate wall-clock time of a piece of a run [s]."""

FIRST_PIECE = 1e-6
"""First piece relative to the duration, as the cost of a simulated second is not known yet."""

MOST_GROWTH = 8.0
"""Largest ratio of consecutive pieces."""

NONE = np.empty(0)

Watch = Callable[[float], bool]
"""Function of the simulated time [s] that returns whether to continue the run."""


@dataclass(frozen=True)
class Limits:
    """Largest cost between two samples; beyond it SimulationError reports that the motion
    stalls."""

    steps: float = math.inf
    """steps between two samples."""
    wall_time: float = math.inf
    """wall-clock time between two samples [s], without compiling."""


NO_LIMITS = Limits()


class WatchEndedError(Exception):
    """Raised after the watch has asked to stop; the motion can continue from its last sample."""


class Watcher:
    """Runs a motion in pieces and calls `watch` between them; raises if the motion stalls.

    It adapts the simulated time of a piece to PIECE; no sample may cost more than `limits`.
    """

    def __init__(
        self,
        motion: Motion,
        watch: Watch | None,
        duration: float,
        limits: Limits = NO_LIMITS,
        *,
        in_pieces: bool = True,
    ) -> None:
        """duration: simulated time of the whole run [s], which determines the first piece.

        in_pieces: end kernel calls for the watch; else it is called only where they end anyway.
        """
        self._motion, self._watch, self._limits = motion, watch, limits
        step = getattr(motion.method, "step", None) or 0.0
        self._span = self._shortest = max(FIRST_PIECE * duration, step)
        self._began = self._asked = time.perf_counter()
        self._since = own_time()
        self._times, self._reached, self._steps = NONE, 0, 0
        self.stopped = False
        self.in_pieces = in_pieces and watch is not None
        """whether kernel calls end for the watch."""

    def carry(self, times: Array, out: Array | None) -> bool:
        """Advance the motion to the times and sample into the rows of `out`; False if the watch
        stopped it.

        Raises SimulationError if the motion cannot continue, or costs more than the limits.
        """
        motion = self._motion
        self._times, self._reached, self._steps = times, 0, motion.steps
        self._since = own_time()
        motion.watch = self.look
        try:
            if self.in_pieces and out is not None:
                self._carry_in_pieces(times, out)
            else:
                motion.run_to(times, out)
        except WatchEndedError:
            return False
        finally:
            motion.watch = nothing
        return not self.stopped

    def _carry_in_pieces(self, times: Array, out: Array) -> None:
        """As Motion.run_to, until the watch stops it; the steps are the same."""
        motion, done = self._motion, 0
        while done < len(times):
            self._began = time.perf_counter()
            # not within a step that has been taken: to stand there costs as much as a step, and
            # where steps take longer than a piece the run would come no further
            target = max(motion.time + self._span, motion.frontier[0])
            upto = int(np.searchsorted(times, target, side="right"))
            if upto > done:
                motion.run_to(times[done:upto], out[done:upto])
                done = upto
            else:
                motion.run_to([target])
            if not self._goes_on(motion.time):
                break

    def _goes_on(self, now: float) -> bool:
        """Called at the end of a piece: adapts the next one; returns whether to continue."""
        self._asked = time.perf_counter()
        took = max(self._asked - self._began, 1e-9)
        self._span = max(self._shortest, self._span * min(MOST_GROWTH, PIECE / took))
        self.stopped = self._watch is not None and not self._watch(now)
        return not self.stopped

    def may_continue(self) -> bool:
        """Whether the watch allows to continue, for attempts after a run has failed."""
        return self._watch is None or self._watch(self._motion.time)

    def look(self) -> None:
        """Called within a piece, between kernel calls and at events.

        Raises WatchEndedError if the watch stops the run, SimulationError beyond a limit.
        """
        motion, now = self._motion, own_time()
        reached = int(np.searchsorted(self._times, motion.time, side="right"))
        if reached != self._reached:
            self._reached, self._steps, self._since = reached, motion.steps, now
        steps, waited = motion.steps - self._steps, now - self._since
        if steps > self._limits.steps or waited > self._limits.wall_time:
            raise SimulationError(stalled(motion, steps, waited))
        now = time.perf_counter()
        if self._watch is not None and now - self._asked >= PIECE:
            self._asked = now
            if not self._watch(motion.frontier[0]):
                self.stopped = True
                raise WatchEndedError


def stalled(motion: Motion, steps: int, waited: float) -> str:
    """One line that explains why a stalled motion is ended."""
    t, h = motion.frontier
    return (
        f"the motion no longer advances: {steps} steps ({waited:.1f} s) from t = "
        f"{motion.time:.9g} s reached t = {t:.9g} s; the step is {h:.2g} s"
    )
