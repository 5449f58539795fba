"""Motion of bodies in contact, event by event.

The kernel carries the state to the next event at the method's full order; here the event is read,
impacts are solved, the modes that follow are chosen, and a new grid of steps begins.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rb_sim.contact.events.bounces import Bounces
from rb_sim.contact.events.chatter import EVENTS_AT_ONCE, Chatter
from rb_sim.contact.events.complementarity import Problem
from rb_sim.contact.events.decompositions import told
from rb_sim.contact.events.dense import (
    ACCELERATE,
    BEGIN,
    LINES,
    NO_DIGITS,
    NO_LINES,
    SETTLE,
    Interpreted,
    Lines,
    bring_up_to_date,
    inverse_mass,
    room_for_lines,
)
from rb_sim.contact.events.grid import Stepping
from rb_sim.contact.events.impacts import strike
from rb_sim.contact.events.instant import STILL, TOUCHING, Instant
from rb_sim.contact.events.jams import impulses_of_jam, least_lifted
from rb_sim.contact.events.journal import Journal, Snapshot, snapshot_of
from rb_sim.contact.events.leap import bring_back, leap
from rb_sim.contact.events.lying import (
    aim_under_the_load,
    aim_where_it_turns,
    letting_go,
    refuse_to_lie,
    rims_of,
)
from rb_sim.contact.events.modes import JammedError, Modes, choose_modes
from rb_sim.contact.events.pace import paced
from rb_sim.contact.events.rough import refuse_drag, refuse_rough, slipping_rough
from rb_sim.contact.events.shares import share_load
from rb_sim.contact.events.steps import EVENT, kind_of, record_contacts
from rb_sim.contact.events.wrong_tool import Progress, pairs_of_solids, refuse_edges
from rb_sim.contact.grid_motion import GridMotion
from rb_sim.contact.sides import refuse_sunk
from rb_sim.contact.system.bodies import (
    JAMS,
    LIFT_OFF,
    NEAR_JAM,
    ROLL_BEGINS,
    ROLL_ENDS,
    SLIP_BEGINS,
    SLIP_ENDS,
    SPIN_BEGINS,
    line_of,
)
from rb_sim.contact.system.compiled import rate_of_change
from rb_sim.contact.system.laws import ContactLaws
from rb_sim.contact.system.terms import STUCK
from rb_sim.contact.system.touch import (
    CLOSED,
    FORCE,
    GAP,
    GAP_RATE,
    ROLL,
    SLIDE,
    SLOPES_BEFORE,
    STATIC,
)
from rb_sim.engine.samples import Array, ContactEvent
from rb_sim.engine.systems.many_bodies import PUSH, WIDTH
from rb_sim.engine.traced import settings_of
from rb_sim.errors import SimulationError
from rb_sim.graph.machine import interpreted
from rb_sim.loops.record import UNFINISHED
from rb_sim.loops.rows import FLOOR, VELOCITY, WORK_ROWS
from rb_sim.scene.compiled import Compiled

IMPACTS_AT_ONCE = 20
"""Impacts one by one at an instant, for each contact, that are taken to have no end."""
JAMS_AT_ONCE = 5
"""Times that what jams may jam again when it has been dealt with."""
HELD_DOWN = 1e-6
"""Acceleration towards the support, in natural units, with which a contact that has just been left
would be pressed again at once."""
UNPUSHED = 1e-7
"""Of the largest push, what is none."""
LANDED = 2.4
"""Times to the top of a flight after which it is over, also where its fall changes a little."""
LOW = 1e-10
"""Height of a flight, relative to the scene's length, which rounding of the gap may hide."""
AIMS = 5
"""Rounds in which what lies flat finds the point that it tips over."""
NOISE = 30.0
"""Slip in tolerances of an adaptive method whose direction is lost in its errors: explicit methods
turn it about where steps that keep the tolerance are too long for its stiffness."""
STOPS = {SLIP_ENDS: SLIDE, ROLL_ENDS: ROLL}
"""Events at which a motion has ended, and its mode; spin has one direction, and ends exactly."""
SHARED = (LIFT_OFF, SLIP_BEGINS, ROLL_BEGINS, SPIN_BEGINS)
"""Events at which a force reaches its bound; where others can take a share, nothing gives."""


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
        self._journal = Journal(self.names)
        super().reset(y, time)
        system = self.compiled.system
        # tables that outlast an evaluation: another motion of the scene has its own
        own = {name: getattr(system, name).copy() for name in ("touch", "vectors", "rows")}
        self.system = system._replace(**own, still=self._still(system))
        self._inverse_mass = inverse_mass(self.system)
        self._packed: Any = None
        self._inputs = np.array([*self._laws.inputs.values(self.system, time), 0.0])
        self._due = -1
        self._pause = math.inf
        self._bounces = Bounces(len(self.laws))
        self._chatter = Chatter(self.system.length / self.system.speed)
        self.laws = self.compiled.contact_laws
        self._progress = Progress(self.system.length / self.system.speed)
        with told(self._laws_now):
            if y is None:
                self._begin()
            else:  # a state that somebody tries, maybe a thousand of them: compiled
                self._happen(None)

    @property
    def events(self) -> list[ContactEvent]:
        """What has happened, the latest last."""
        return self._journal.events

    @property
    def forgotten(self) -> int:
        """Events before these."""
        return self._journal.forgotten

    def warm(self) -> None:
        super().warm()
        self._call(LINES, self.time, self._grid.y, room_for_lines(self.system))
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

    def _call(
        self, task: int, t: float, y: Array, lines: Lines = NO_LINES, c: Array = NO_DIGITS
    ) -> None:
        """A task on the system's tables at (t, y), compiled."""
        bring_up_to_date(self._held(), t, y, c, task, *lines)

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
        self._begin_grid(t, y, self._grid.h if h is None else h)
        self._call(BEGIN, t, y, c=self._grid.c1)

    def _event(self) -> None:
        self.watch()
        code = kind_of(self._due)
        self._due = -1
        t = self._grid.t1
        self._progress.add(t, self.names[code[0]])
        at_once = self._chatter.at_once(t)
        self._hold_firmer(t, code[1])
        if at_once or self._chatter.is_dense(t, code[1]):
            self._leap(code[0])
        else:
            self._happen(code)

    def _instant(self, t: float, y: Array) -> Instant:
        return Instant(self.system, self.laws, self._call, t, y, self._inverse_mass)

    def _hold_firmer(self, t: float, kind: int) -> None:
        """Let friction at its very bound hold a little more where slips end as they begin."""
        if self._chatter.holds_firmer(t, kind):
            given, more = self.compiled.contact_laws, 1.0 + self._chatter.grip
            self.laws = tuple(law._replace(static=more * law.static) for law in given)
            self.system.touch[:, STATIC] = [law.static for law in self.laws]

    def _leap(self, c: int) -> None:
        """Leap from the grid's last point, and go on there."""
        t, y = self._grid.t1, np.array(self._grid.y1)
        before = snapshot_of(self.system.touch)
        instant = self._instant(t, y)
        if not self._leapt_over(instant, c):
            raise SimulationError(
                f"the contacts find no consistent state at t = {t:.9g} s (contact {self.names[c]})"
            )
        self._go_on(instant, before, None)

    def _leapt_over(self, instant: Instant, c: int) -> bool:
        """Move the instant on by a time too short to matter, over which impulses answer the loads;
        longer if it has just been done.  False if the laws have no impulses either."""
        t, length = instant.t, self._chatter.length_of_leap(instant.t)
        if leap(instant, length) is None:
            return False
        bring_back(instant)
        self._journal.note(t, c, "leaps")
        self._chatter.leapt(t + length, length)
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
        before = snapshot_of(self.system.touch)
        instant = self._instant(t, y)
        refuse_to_lie(instant, self.rims, self.names, code)
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
            self._journal.note(instant.t, c, "ambiguous")
        self._journal.tell(instant.t, self.laws, before, snapshot_of(self.system.touch))
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
                self._journal.note_impulses(instant, impact.impulses, "impact")
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

    # impacts

    def _strike(self, instant: Instant) -> None:
        """Impacts until nothing approaches; an endless series of bounces is closed."""
        single = IMPACTS_AT_ONCE * len(self.laws) if self.compiled.one_by_one else 0
        for n in range(single + EVENTS_AT_ONCE):
            aim_where_it_turns(instant, self.rims)
            note = self._journal.note
            resting = self._bounces.over(instant, note)
            together = self._bounces.rocking(instant, note)
            if 0 < single <= n:  # the series has no end: what it leaves is taken away together
                resting = frozenset(range(len(self.laws)))
            impact = strike(instant, resting | together, together, n < single and not together)
            if impact is None:
                return
            self._journal.note_impulses(instant, impact.impulses, "impact")
            self._bounces.struck(impact.rebound)
        raise SimulationError(f"impacts without end at t = {instant.t:.9g} s")

    def _flight(self, instant: Instant) -> float:
        """The step to try after the instant, 0 where the method is to find one.

        A flight is to end within it.  One that is so low that rounding may hide it has to be cut at
        its top, as any where steps are fixed; that sets the pause.
        """
        self._pause = math.inf
        touch, near, length = self.system.touch, TOUCHING * self.system.length, math.inf
        fixed = getattr(self.method, "tolerance", 0.0) == 0.0
        self._call(ACCELERATE, instant.t, instant.y)
        u = self.system.bodies[:, PUSH : PUSH + 6].reshape(-1)
        for c in range(len(self.laws)):
            if touch[c, CLOSED] == 0.0 and abs(touch[c, GAP]) <= near:
                k = line_of(self.system, c)
                fall = -float(instant.lines.J[k] @ u + instant.lines.bias[k])
                rise = float(touch[c, GAP_RATE])
                if fall > 0.0 and rise > STILL * self.system.speed:
                    hidden = fixed or 0.5 * rise * rise < LOW * fall * self.system.length
                    length = min(length, (1.0 if hidden else LANDED) * rise / fall)
                elif self.laws[c].drags and fall > HELD_DOWN * self._natural_acceleration:
                    refuse_drag(instant.t, self.names[c])
        if fixed:
            self._pause = instant.t + length
        return self._grid.h if length == math.inf else min(self._grid.h or length, length)

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
                x = impulses_of_jam(instant, i)
                if x is None:
                    break
                self._journal.note_impulses(instant, x, "jams")
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
        c = least_lifted(instant) if c is None else c
        name = "" if c is None else f" of {self.names[c]}"
        raise SimulationError(
            f"Painleve's paradox at t = {instant.t:.9g} s: no force{name} keeps to its law of "
            "friction, nor does an impact stop the slip"
        )
