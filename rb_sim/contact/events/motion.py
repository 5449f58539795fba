"""Motion of bodies in contact, event by event.

The kernel carries the state to the next event at the method's full order; here the event is read,
impacts are solved, the modes that follow are chosen, and a new grid of steps begins.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from rb_sim.contact.events.complementarity import Problem
from rb_sim.contact.events.decompositions import told
from rb_sim.contact.events.dense import (
    ACCELERATE,
    BEGIN,
    NO_LINES,
    SETTLE,
    Interpreted,
    Lines,
    bring_up_to_date,
    lines_at,
    velocities,
)
from rb_sim.contact.events.grid import Stepping
from rb_sim.contact.events.impacts import strike
from rb_sim.contact.events.instant import STILL, TOUCHING, Instant
from rb_sim.contact.events.leap import leap
from rb_sim.contact.events.lying import (
    aim_under_the_load,
    aim_where_it_turns,
    letting_go,
    lying,
    rims_of,
)
from rb_sim.contact.events.modes import JammedError, Modes, choose_modes
from rb_sim.contact.events.pace import paced
from rb_sim.contact.events.rough import refuse_drag, refuse_rough, slipping_rough
from rb_sim.contact.events.routh import impulse_process
from rb_sim.contact.events.shares import share_load
from rb_sim.contact.events.steps import EVENT, kind_of, record_contacts
from rb_sim.contact.events.wrong_tool import Progress, pairs_of_solids, refuse_edges
from rb_sim.contact.grid import start_grid
from rb_sim.contact.grid_motion import GridMotion
from rb_sim.contact.sides import refuse_sunk
from rb_sim.contact.system.bodies import (
    JAMS,
    LIES_FLAT,
    LIFT_OFF,
    NEAR_JAM,
    ROLL_BEGINS,
    ROLL_ENDS,
    SLIP_BEGINS,
    SLIP_ENDS,
    SPIN_BEGINS,
    TOUCH_DOWN,
    line_of,
)
from rb_sim.contact.system.compiled import rate_of_change
from rb_sim.contact.system.laws import ContactLaws
from rb_sim.contact.system.terms import SLIDING, STUCK
from rb_sim.contact.system.touch import (
    AHEAD,
    CLOSED,
    FORCE,
    GAP,
    GAP_RATE,
    ROLL,
    SLIDE,
    SLOPES_BEFORE,
    SPIN,
    STATIC,
)
from rb_sim.engine.samples import Array, ContactEvent
from rb_sim.engine.systems.many_bodies import BODY, PUSH, WIDTH
from rb_sim.engine.traced import settings_of
from rb_sim.errors import SimulationError
from rb_sim.graph.machine import interpreted
from rb_sim.loops.record import UNFINISHED
from rb_sim.loops.rows import FLOOR, VELOCITY, WORK_ROWS
from rb_sim.scene.compiled import Compiled

ZENO_HEIGHT = 1e-11
"""Height of the next bounce, relative to the scene's length, below which a contact is closed: what
is left out of the motion is of that size, and the time of rest is known from the series."""
ZENO_BOUNCES = 3
"""Impacts in a row before one is taken to belong to an endless series."""
MOST_EVENTS = 100_000
"""That are kept at least."""
SHORT_SLIPS = 6
"""Slips over before they have moved anything, in a row, after which friction is taken to be at its
very bound."""
GRIP, FIRMER = 1e-9, 4.0
"""Part by which friction at its very bound is then taken to hold more, and what that grows by where
it is not enough: rounding must not choose between rest and slip over and over."""
EVENTS_AT_ONCE = 50
"""Changes at one instant, or within DENSE, that are taken to have no end."""
IMPACTS_AT_ONCE = 20
"""Impacts one by one at an instant, for each contact, that are taken to have no end."""
JAMS_AT_ONCE = 5
"""Times that what jams may jam again when it has been dealt with."""
HELD_DOWN = 1e-6
"""Acceleration towards the support, in natural units, with which a contact that has just been left
would be pressed again at once."""
UNPUSHED = 1e-7
"""Of the largest push, what is none."""
AIMS = 5
"""Rounds in which what lies flat finds the point that it tips over."""
DENSE, LONGEST_LEAP = 1e-6, 1e-3
"""A time too short to matter, and the longest that is leapt over; natural units."""
NOISE = 30.0
"""Slip in tolerances of an adaptive method whose direction is lost in its errors: explicit methods
turn it about where steps that keep the tolerance are too long for its stiffness."""
STOPS = {SLIP_ENDS: SLIDE, ROLL_ENDS: ROLL}
"""Events at which a motion has ended, and its mode; spin has one direction, and ends exactly."""
SHARED = (LIFT_OFF, SLIP_BEGINS, ROLL_BEGINS, SPIN_BEGINS)
"""Events at which a force reaches its bound; where others can take a share, nothing gives."""


class Snapshot(NamedTuple):
    """The modes of all contacts."""

    closed: Array
    slide: Array
    roll: Array
    spin: Array
    ahead: Array


TOLD = (
    ("slide", "slips", "sticks"),
    ("roll", "rolls", "stops rolling"),
    ("spin", "spins", "stops spinning"),
)
"""Kinds of friction and what their two modes are called in events."""


class Rest(NamedTuple):
    """When an endless series of bounces will be over [s], seen from its bounces so far."""

    last: float
    """from the last bounce."""
    best: float
    """where two bounces that follow each other agree best."""
    change: float
    """by how much they agree."""

    def seen(self, t: float) -> Rest:
        """With one more bounce, which tells t.

        Low bounces know it best where the fall changes; but rounding of the height, over their
        speed, is the larger the lower they are.
        """
        change = abs(t - self.last)
        if change <= self.change:
            return Rest(t, t, change)
        return Rest(t, self.best, self.change)


NO_REST = Rest(math.inf, math.inf, math.inf)


class ContactMotion(GridMotion):
    """As Motion; `events` tells what happened.

    Raises SimulationError where the laws of contact have no solution.
    """

    event_driven = True

    def __init__(self, compiled: Compiled, method: Any) -> None:
        self.laws = compiled.contact_laws
        self.names = compiled.layout.contacts
        self.rims = rims_of(compiled.system)
        self._pairs = pairs_of_solids(compiled.system)
        self._laws = ContactLaws(compiled.system)
        self._taken: tuple[Any, Stepping] | None = None
        super().__init__(compiled, paced(compiled, method))
        self._work = np.zeros((WORK_ROWS, len(compiled.y)))
        bodies = len(compiled.system.bodies)
        self._work[FLOOR] = 1.0
        self._work[VELOCITY, : WIDTH * bodies] = ([0.0] * 7 + [1.0] * 6) * bodies

    def reset(self, y: Any = None, time: float = 0.0) -> None:
        self.events: list[ContactEvent] = []
        self.forgotten = 0
        super().reset(y, time)
        system = self.compiled.system
        self.system = system._replace(touch=system.touch.copy(), still=self._still(system))
        self._packed: Any = None
        self._inputs = np.array([*self._laws.inputs.values(self.system, time), 0.0])
        self._due = -1
        self._pause = math.inf
        self._bounces = np.zeros(len(self.laws), dtype=int)
        self._low = 0
        self._rests = [NO_REST] * len(self.laws)
        self._at_once, self._last_event = 0, -math.inf
        self._slipped, self._short_slips, self._grip = -math.inf, 0, 0.0
        self.laws = self.compiled.contact_laws
        self._changes: deque[float] = deque(maxlen=EVENTS_AT_ONCE)
        self._leapt = (-math.inf, 0.0)
        self._progress = Progress(self.system.length / self.system.speed)
        with told(self._laws_now):
            if y is None:
                self._begin()
            else:  # a state that somebody tries, maybe a thousand of them: compiled
                self._happen(None)

    def warm(self) -> None:
        super().warm()
        lines_at(self.system, self._call, self.time, self._grid.y)
        Problem(np.eye(1), np.zeros(1), [], []).solve()

    def change_law(self, system: Any) -> None:
        self.system = system._replace(still=self._still(system))
        self._take_inputs()
        self._due = -1
        with told(self._laws_now):
            self._happen(None)

    def _laws_now(self) -> str:
        """What linear algebra is done for, and when."""
        return f"the laws of contact at t = {self.time:.9g} s"

    def _still(self, system: Any) -> float:
        return max(system.still, NOISE * getattr(self.method, "tolerance", 0.0))

    def _record(self, times: Array, stop: float, out: Array | None) -> None:
        with told(self._laws_now):
            self._advance(times, stop, out)

    def run_to(self, times: Any, out: Array | None = None) -> int:
        """As Motion; also SimulationError where a side sinks into a support unseen."""
        try:
            reached = super().run_to(times, out)
        except SimulationError:
            if np.isfinite(self._grid.y1).all():  # a side that sank in may be why
                last = [self._grid.t1], self._grid.y1[None, :]
                refuse_sunk(self.compiled.sides, *last, self.system.length)
            raise
        at, rows = (times, out) if out is not None else ([self.time], self._grid.y[None, :])
        refuse_sunk(self.compiled.sides, at, rows, self.system.length)
        return reached

    def _advance(self, times: Array, stop: float, out: Array | None) -> None:
        """One call of the kernel after the other, an event between each two."""
        done = 0
        while done < len(times):
            upto = min(stop, self._pause)
            n = int(np.searchsorted(times[done:], upto, side="right"))
            asked = times[done : done + n] if n else np.array([upto])
            rows = np.zeros((0, self.width)) if out is None else out[done : done + n]
            self._grid, status, reached, self._due = record_contacts(
                self._stepping, self._held(), self._grid, asked, upto,
                bool(n) and out is not None, rows, self._work, self._due,
            )  # fmt: skip
            if reached and n:
                self.time = float(times[done + reached - 1])
                done += reached
            if status == EVENT:
                self._event()
            elif status == UNFINISHED:
                self.watch()
            elif status:
                raise self._failure(status)
            elif not n:
                self._pass_pause()

    def _call(self, task: int, t: float, y: Array, lines: Lines = NO_LINES) -> None:
        """A task on the system's tables at (t, y), compiled."""
        bring_up_to_date(self._held(), t, y, task, *lines)

    @property
    def _stepping(self) -> Stepping:
        """The method, as the loop takes it; made anew where `method` is another one."""
        if self._taken is None or self._taken[0] is not self.method:
            step, setting = settings_of(paced(self.compiled, self.method))
            taken = Stepping(step.reference, rate_of_change.address, (*setting, 0.0))
            self._taken = self.method, taken
        return self._taken[1]

    def _take_inputs(self, onwards: bool = True) -> None:
        """Commands and tables from now on, or at this instant alone."""
        self._inputs[:-1] = self._laws.inputs.values(self.system, self.time, onwards)

    def _restart_grid(self) -> None:
        super()._restart_grid()
        self._take_inputs()

    def _held(self) -> Any:
        """The system, as the loop takes it."""
        if self._packed is None or self._packed[0] is not self.system:
            if interpreted():
                return self.system
            self._packed = self.system, *self._laws.packed(self.system, self._inputs)
        return self._packed[1]

    def _pass_pause(self) -> None:
        self._pause = math.inf
        if self._due < 0:
            self._continue_from(self._grid.t1, self._grid.y1)

    def _continue_from(self, t: float, y: Array, h: float | None = None) -> None:
        """Begin a new grid of steps at (t, y)."""
        h = self._grid.h if h is None else h
        self._steps_before += self._grid.steps
        self._rejected_before += self._grid.rejected
        self._grid = start_grid(t, y)._replace(h=h)
        self._call(BEGIN, t, y)

    def _event(self) -> None:
        self.watch()
        code = kind_of(self._due)
        self._due = -1
        t = self._grid.t1
        near = 1e-12 * max(1.0, abs(t))
        self._at_once = self._at_once + 1 if t - self._last_event <= near else 0
        self._last_event = t
        self._progress.add(t, self.names[code[0]])
        self._hold_firmer_at_the_bound(t, code[1])
        if self._at_once > EVENTS_AT_ONCE or self._too_dense(t, code[1]):
            self._leap(code[0])
        else:
            self._happen(code)

    def _hold_firmer_at_the_bound(self, t: float, kind: int) -> None:
        """Raise the coefficients at rest a little where slips begin and end without a motion."""
        if kind == SLIP_BEGINS:
            self._slipped = t
        if kind != SLIP_ENDS:
            return
        short = t - self._slipped < DENSE * self.system.length / self.system.speed
        self._short_slips = self._short_slips + 1 if short else 0
        if self._short_slips >= SHORT_SLIPS:
            self._short_slips = 0
            self._grip = FIRMER * self._grip if self._grip else GRIP
            given = self.compiled.contact_laws
            self.laws = tuple(law._replace(static=(1.0 + self._grip) * law.static) for law in given)
            self.system.touch[:, STATIC] = [law.static for law in self.laws]

    def _too_dense(self, t: float, kind: int) -> bool:
        """True where changes without impact follow each other as fast as if without end."""
        if kind == TOUCH_DOWN:
            return False
        self._changes.append(t)
        oldest = self._changes[0]
        full = len(self._changes) == self._changes.maxlen
        return full and t - oldest < DENSE * self.system.length / self.system.speed

    def _leap(self, c: int) -> None:
        """Leap from the grid's last point, and go on there."""
        t, y = self._grid.t1, np.array(self._grid.y1)
        before = self._snapshot()
        instant = Instant(self.system, self.laws, self._call, t, y)
        if not self._leapt_over(instant, c):
            raise SimulationError(
                f"the contacts find no consistent state at t = {t:.9g} s (contact {self.names[c]})"
            )
        self._go_on(instant, before, None)

    def _leapt_over(self, instant: Instant, c: int) -> bool:
        """Move the instant on by a time too short to matter, over which impulses answer the loads;
        longer if it has just been done.  False if the laws have no impulses either."""
        t, length = instant.t, DENSE * self.system.length / self.system.speed
        if t - self._leapt[0] < 10.0 * self._leapt[1]:
            length = min(4.0 * self._leapt[1], LONGEST_LEAP / DENSE * length)
        if leap(instant, length) is None:
            return False
        instant.refresh()
        self._note(t, c, "leaps")
        self._leapt = (t + length, length)
        self._changes.clear()
        self._at_once = 0
        return True

    def _begin(self) -> None:
        """The first modes; always interpreted, so that making a Motion compiles nothing."""
        call = self._call
        self._call = Interpreted(self.system)  # type: ignore[method-assign]
        try:
            self._happen(None)
        finally:
            self._call = call  # type: ignore[method-assign]

    def _happen(self, code: tuple[int, int] | None) -> None:
        """Impacts and new modes at the grid's last point; a new grid begins there."""
        t = self._grid.t1 if code is not None else self.time
        y = np.array(self._grid.y1 if code is not None else self._grid.y)
        before = self._snapshot()
        instant = Instant(self.system, self.laws, self._call, t, y)
        self._refuse_to_lie(instant, code)
        if code is not None and code[1] in SHARED:
            code = self._as_lift_off(instant, code)
            aim_under_the_load(instant, self.rims)
            if share_load(instant, recent=True):
                self._continue_from(t, y)
                return
        if code is not None and code[1] == JAMS:
            self._jam(instant, code[0])
            code = None
        self._strike(instant)
        if code is not None and code[1] in STOPS:
            self._stop(instant, code[0], STOPS[code[1]])
        self._go_on(instant, before, code)

    def _go_on(self, instant: Instant, before: Snapshot, code: tuple[int, int] | None) -> None:
        """Choose the modes that follow and begin a new grid."""
        refuse_edges(instant, self._pairs, self.names)
        modes = self._unjammed(instant, code)
        for _ in range(AIMS):
            if not aim_under_the_load(instant, self.rims):
                break
            modes = self._unjammed(instant, None)
        tipping = letting_go(instant, self.rims)
        if tipping:
            modes = choose_modes(instant, None, tipping)
        for c in modes.ambiguous:
            self._note(instant.t, c, "ambiguous")
        self._tell(instant.t, before)
        h = self._flight(instant)
        self._continue_from(instant.t, instant.y, h)
        if code is not None and code[1] == LIFT_OFF:
            self._refuse_to_be_dragged_off(instant.t, code[0])

    def _unjammed(self, instant: Instant, code: tuple[int, int] | None) -> Modes:
        """The modes that follow, once what jams or may not slip has been stopped or leapt over."""
        modes = self._found_modes(instant, code)
        for c in slipping_rough(instant):
            impact = strike(instant, frozenset(range(len(self.laws))))
            if impact is not None:
                self._note_impulses(instant, impact.impulses, "impact")
            modes = self._found_modes(instant, None)
            pushes = self.system.touch[c, CLOSED] == 1.0
            if not pushes or c in slipping_rough(instant):
                refuse_rough(instant, c, self.names)
        return modes

    def _found_modes(self, instant: Instant, code: tuple[int, int] | None) -> Modes:
        """As `_unjammed`, of what jams alone."""
        for _ in range(JAMS_AT_ONCE):
            try:
                return choose_modes(instant, code)
            except JammedError:
                self._jam(instant, None)
                self._strike(instant)
                code = None
        return choose_modes(instant, None)

    def _snapshot(self) -> Snapshot:
        touch = self.system.touch
        closed, slide, roll, spin = (touch[:, mode].copy() for mode in (CLOSED, SLIDE, ROLL, SPIN))
        return Snapshot(closed, slide, roll, spin, touch[:, AHEAD : AHEAD + 3].copy())

    def _note(self, t: float, c: int, kind: str, impulse: Array | None = None) -> None:
        x, y, z = (0.0, 0.0, 0.0) if impulse is None else impulse
        value = (float(x), float(y), float(z))
        self.events.append(ContactEvent(float(t), self.names[c], kind, value))
        if len(self.events) >= 2 * MOST_EVENTS:  # a node may run for ever
            del self.events[:MOST_EVENTS]
            self.forgotten += MOST_EVENTS

    def _tell(self, t: float, before: Snapshot) -> None:
        """Note what opened, closed, slipped and stuck."""
        now = self._snapshot()
        for c, law in enumerate(self.laws):
            if before.closed[c] != now.closed[c]:
                self._note(t, c, law.closes if now.closed[c] else law.opens)
            if not now.closed[c]:
                continue
            bounds = (law.static, law.rolling_arm, law.spinning_arm)
            for (name, moves, rests), bound in zip(TOLD, bounds, strict=True):
                was, mode = getattr(before, name)[c], getattr(now, name)[c]
                if bound > 0.0 and was != mode:
                    self._note(t, c, rests if mode == STUCK else moves)
            turned = float(before.ahead[c] @ now.ahead[c]) < 0.0
            if law.static > 0.0 and before.slide[c] == now.slide[c] == SLIDING and turned:
                self._note(t, c, "reverses")

    def _stop(self, instant: Instant, c: int, mode: int) -> None:
        """Take away what is left of a slip or a rolling that has ended; its energy is of second
        order."""
        self.system.touch[c, mode] = STUCK
        self._call(SETTLE, instant.t, instant.y)
        instant.refresh()

    def _as_lift_off(self, instant: Instant, code: tuple[int, int]) -> tuple[int, int]:
        """The event; where friction reaches its bound as the push vanishes, the end of the push."""
        self._call(ACCELERATE, instant.t, instant.y)
        push = np.abs(self.system.touch[:, FORCE])
        pushes = self.laws[code[0]].bilateral or push[code[0]] > UNPUSHED * push.max()
        return code if pushes else (code[0], LIFT_OFF)

    def _refuse_to_lie(self, instant: Instant, code: tuple[int, int] | None) -> None:
        """Raise SimulationError where a rim that touches with its lowest point alone lies flat."""
        flat = [c for c in lying(instant, self.rims) if self.rims[c].alone]
        if code is not None and code[1] == LIES_FLAT and code[0] in self.rims:
            flat = [code[0]]
        if flat:
            name = self.names[flat[0]]
            raise SimulationError(
                f"the rim of contact {name} comes to lie flat at t = {instant.t:.9g} s, where its "
                f"one point cannot hold it: set constraints.{name}.lies_flat to true"
            )

    # impacts

    def _strike(self, instant: Instant) -> None:
        """Impacts until nothing approaches; an endless series of bounces is closed."""
        single = IMPACTS_AT_ONCE * len(self.laws) if self.compiled.one_by_one else 0
        for n in range(single + EVENTS_AT_ONCE):
            aim_where_it_turns(instant, self.rims)
            resting, together = self._zeno(instant), self._rocking(instant)
            if 0 < single <= n:  # the series has no end: what it leaves is taken away together
                resting = frozenset(range(len(self.laws)))
            impact = strike(instant, resting | together, together, n < single and not together)
            if impact is None:
                return
            self._note_impulses(instant, impact.impulses, "impact")
            for c in impact.rebound:
                self._bounces[c] += 1
            for c in range(len(self.laws)):
                if c not in impact.rebound:
                    self._bounces[c], self._rests[c] = 0, NO_REST
        raise SimulationError(f"impacts without end at t = {instant.t:.9g} s")

    def _note_impulses(self, instant: Instant, impulses: Array, kind: str) -> None:
        largest = float(np.abs(impulses).max())
        for c in range(len(self.laws)):
            k = line_of(self.system, c)
            lines = impulses[k : k + 3]
            if np.abs(lines).max() > 1e-9 * largest:
                b = int(self.system.lines[k, BODY])
                force = instant.lines.J[k : k + 3, 6 * b : 6 * b + 3].T @ lines
                self._note(instant.t, c, kind, force)

    def _zeno(self, instant: Instant) -> frozenset[int]:
        """Contacts whose further bounces would all be over at once: they strike without rebound."""
        touch, closing = self.system.touch, set()
        for c in instant.touching():
            e, speed = self.laws[c].restitution, -float(touch[c, GAP_RATE])
            if not (0.0 < e < 1.0 and speed > instant.still):
                continue
            if self._bounces[c] < ZENO_BOUNCES:
                continue
            fall = -self._free_normal_acceleration(instant, c)
            if fall <= 0.0:
                continue
            rest = self._rests[c].seen(instant.t + 2.0 * e * speed / (fall * (1.0 - e)))
            self._rests[c] = rest
            if 0.5 * (e * speed) ** 2 / fall < ZENO_HEIGHT * self.system.length:
                closing.add(c)
                self._note(rest.best, c, "rests")
        return frozenset(closing)

    def _rocking(self, instant: Instant) -> frozenset[int]:
        """Contacts that strike and part in turns, too low to tell: they close together."""
        touch, touching = self.system.touch, instant.touching()
        struck = [c for c in touching if touch[c, GAP_RATE] < -instant.still]
        if not struck or len(touching) < 2:
            return frozenset()
        low = frozenset(c for c in touching if self._height(instant, c) < ZENO_HEIGHT)
        self._low = self._low + 1 if low.issuperset(struck) else 0
        if self._low <= ZENO_BOUNCES:
            return frozenset()
        for c in struck:
            self._note(instant.t, c, "rests")
        return low

    def _height(self, instant: Instant, c: int) -> float:
        """That contact c falls from or rises to, relative to the scene's length."""
        fall = -self._free_normal_acceleration(instant, c)
        if fall <= 0.0:
            return math.inf
        return 0.5 * float(self.system.touch[c, GAP_RATE]) ** 2 / fall / self.system.length

    def _free_normal_acceleration(self, instant: Instant, c: int) -> float:
        """Of the gap, with contact c open and the others as they are [m/s^2]."""
        mode = self.system.touch[c, CLOSED]
        self.system.touch[c, CLOSED] = 0.0
        self._call(ACCELERATE, instant.t, instant.y)
        u = self.system.bodies[:, PUSH : PUSH + 6].reshape(-1)
        self.system.touch[c, CLOSED] = mode
        k = line_of(self.system, c)
        instant.refresh()
        return float(instant.lines.J[k] @ u + instant.lines.bias[k])

    def _flight(self, instant: Instant) -> float:
        """First step after the instant; short flights are cut at their top, so that none is missed.

        Sets the pause.  Returns the step to try, 0 where the method is to find one.
        """
        self._pause = math.inf
        touch, near = self.system.touch, TOUCHING * self.system.length
        self._call(ACCELERATE, instant.t, instant.y)
        u = self.system.bodies[:, PUSH : PUSH + 6].reshape(-1)
        for c in range(len(self.laws)):
            if touch[c, CLOSED] == 0.0 and abs(touch[c, GAP]) <= near:
                k = line_of(self.system, c)
                fall = -float(instant.lines.J[k] @ u + instant.lines.bias[k])
                rise = float(touch[c, GAP_RATE])
                if fall > 0.0 and rise > STILL * self.system.speed:
                    self._pause = min(self._pause, instant.t + rise / fall)
                elif self.laws[c].drags and fall > HELD_DOWN * self._natural_acceleration:
                    refuse_drag(instant.t, self.names[c])
        if math.isfinite(self._pause):
            return min(self._grid.h, self._pause - instant.t)
        return self._grid.h

    def _refuse_to_be_dragged_off(self, t: float, c: int) -> None:
        """Raise SimulationError where a contact with a damper, which its drag has just lifted off,
        would push again at once: at the start of the step, apart, its event function falls."""
        touch, unit = self.system.touch, self.system.length / self.system.speed
        apart = self.laws[c].compliant and touch[c, CLOSED] == 0.0
        if apart and self.laws[c].drags and touch[c, SLOPES_BEFORE] * unit < -HELD_DOWN:
            refuse_drag(t, self.names[c])

    @property
    def _natural_acceleration(self) -> float:
        return self.system.speed**2 / self.system.length

    def _jam(self, instant: Instant, c: int | None) -> None:
        """Painleve: the slip of contact c (or of whichever jams) stops at once, in an impact."""
        for i in range(len(self.laws)) if c is None else (c,):
            touch = self.system.touch
            if touch[i, CLOSED] and instant.effective_pivot(i) < NEAR_JAM:
                x = self._process(instant, i)
                if x is None:
                    break
                self._note_impulses(instant, x, "jams")
                instant.apply(x)
                return
        rough = [i for i in instant.touching() if math.isinf(self.laws[i].static)]
        if c is None and rough:
            refuse_rough(instant, rough[0], self.names)
        hardly = c is not None and instant.slip_speed(c) <= self.system.still
        # compliant contacts that stick may find no forces either, and touch nothing rigidly
        near = instant.touching() or np.flatnonzero(self.system.touch[:, CLOSED] == 1.0).tolist()
        if (c is None or hardly) and near and self._leapt_over(instant, near[0]):
            return
        name = "" if c is None else f" of {self.names[c]}"
        raise SimulationError(
            f"Painleve's paradox at t = {instant.t:.9g} s: no force{name} keeps to Coulomb's law, "
            "nor does an impact stop the slip"
        )

    def _process(self, instant: Instant, c: int) -> Array | None:
        """Impulses of all lines for the impulse process of contact c, joints taking part."""
        k, joints = line_of(self.system, c), line_of(self.system, 0)
        J = instant.lines.J
        own = J[k : k + 3]
        A = instant.pivot_of(own, own)
        v = own @ velocities(self.system, instant.y)
        v = v - instant.lines.rate[k : k + 3]
        law = self.laws[c]
        x = impulse_process(A, v, law.kinetic, law.restitution)
        if x is None:
            return None
        out = np.zeros(len(J))
        out[k : k + 3], out[:joints] = x, -instant.taken_by_joints(own) @ x
        return out
