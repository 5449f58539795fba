# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motion of bodies in contact, event by event.

The loop carries the state to the next event at the method's full order; here the event is read,
impacts are solved, the modes that follow are chosen, and a new grid of steps begins.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from rb_sim.base.errors import SimulationError, StepTooLargeError
from rb_sim.base.rounding import COMPUTED_ROUNDING, SOLVED
from rb_sim.catalogue.contact import ContactLaw
from rb_sim.contact.assembly import velocities
from rb_sim.contact.event_workspace import (
    AMBIGUOUS,
    LEAPS,
    Journal,
)
from rb_sim.contact.event_workspace import JAMS as JAMMED_NOTE
from rb_sim.contact.events.event_steps import (
    EVENT,
    kind_of,
    paced,
    record_contacts,
    slow_slips,
    stepping_of,
)
from rb_sim.contact.events.grid import Stepping
from rb_sim.contact.events.instant import (
    ACCELERATE,
    ARRIVE,
    AT_IMPACTS,
    BEGIN,
    DONE,
    IMPACTS,
    LEAVE,
    NOTE,
    PASS,
    SETTLE,
    STRIKE,
    WRITE_ROWS,
    Instant,
    Tasks,
    as_simulation_error,
    bring_back,
    impulses_of_jam,
    leap,
    not_finite,
    singular_values,
)
from rb_sim.contact.events.limits import (
    TOOL,
    Progress,
    aim_under_the_load,
    aim_where_it_turns,
    pairs_of_solids,
    refuse_drag,
    refuse_edges,
    refuse_rough,
    refuse_to_be_dragged_off,
    refuse_to_lie,
    rims_of,
    slipping_rough,
)
from rb_sim.contact.events.search import KEPT
from rb_sim.contact.events.shares import (
    OF,
    PARTED,
    JammedError,
    choose_modes,
    share_load,
    widest_kept,
    widest_of,
)
from rb_sim.contact.grid_motion import GridMotion, LeftOpen
from rb_sim.contact.impacts import (
    AT_ONCE,
    ENDLESS,
    GOES_ON,
    NO_IMPULSES,
    NOTHING,
    OVERFLOWN,
    Chatter,
    forget_bounces,
)
from rb_sim.contact.modes import lay_out_held
from rb_sim.contact.tunnelling import refuse_sunk, run_looking
from rb_sim.graph.machine import interpreted
from rb_sim.integrate.layout import (
    FLOOR,
    IS_VELOCITY,
    NOT_FINITE,
    SHARE_OF_WAY,
    STEP_UNDERFLOW,
    UNFINISHED,
    WORK_ROWS,
)
from rb_sim.mechanics.contact.accelerations import SLOWER
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    CLOSED,
    COMPLIANT,
    CREEPS,
    EVENT_FUNCTIONS_BEFORE,
    JAMS,
    LIES_FLAT,
    LIFT_OFF,
    NEAR_JAM,
    NORMAL_FORCE,
    RELATIVE_SPIN,
    ROLL,
    ROLL_BEGINS,
    ROLL_ENDS,
    SLIDE,
    SLIP,
    SLIP_BEGINS,
    SLIP_ENDS,
    SPIN_BEGINS,
    STATIC,
    TOUCH_DOWN,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.contact_laws import ContactLaws
from rb_sim.mechanics.error_scales import OF_SYMMETRIC, spin_lengths
from rb_sim.mechanics.samples import Array, ContactEvent
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS, WIDTH
from rb_sim.numerics.rank import JUDGED_BY_CONTACT, scaled_rows
from rb_sim.scene.compiled import Compiled

# Contacts that lift off at one instant: their normal forces vanish together, and none may be
# reported # first.
#
# Where one of several points opens, as of a box that its floor leaves, the others bear nothing any
# more.  To open one alone lets the others open and it close in turns, by rounding, without end.


def lifting(system: Any, begun: float, t: float) -> frozenset[int]:
    """Rigid contacts whose normal force has fallen in the step and is over at t, but for rounding
    of t.

    system: its forces are those at t in the modes before. begun: where the step began [s]; an event
    there has no step in which it could have fallen.
    """
    if not t > begun:
        return frozenset()
    table, unit = system.contact_table, system.mass * system.speed**2 / system.length
    rigid = (table[:, CLOSED] == 1.0) & (table[:, BILATERAL] == 0.0) & (table[:, COMPLIANT] == 0.0)
    normal_force = table[:, NORMAL_FORCE] / unit
    fallen = table[:, EVENT_FUNCTIONS_BEFORE] - normal_force
    left = normal_force * (t - begun) <= fallen * COMPUTED_ROUNDING * max(1.0, abs(t))
    return frozenset(np.flatnonzero(rigid & (fallen > 0.0) & left).tolist())


def bearing(system: Any, lifted: frozenset[int]) -> bool:
    """Whether a contact bears besides those that lift off."""
    return bool(set(np.flatnonzero(system.contact_table[:, CLOSED] == 1.0).tolist()) - lifted)


# Where a point leaves the face of another body's solid and may not.


def refuse_to_leave(
    laws: Sequence[ContactLaw], t: float, names: Sequence[str], code: tuple[int, int] | None
) -> None:
    """Raise SimulationError where a bilateral contact leads a point over the edge of the face that
    guides it; code: (contact, kind) of the event that led here."""
    if code is not None and code[1] == LIES_FLAT and laws[code[0]].bilateral:
        name = names[code[0]]
        raise SimulationError(
            f"contact {name} reaches the edge of its surface at t = {t:.9g} s: give "
            f"constraints.{name} a larger surface, or mode unilateral"
        )


# What is left of a slip or a rolling that has ended, and whether it may be taken away.
#
# Where a contact comes to rest beside others, its rows and theirs may nearly depend on each other:
# two corners of a box on compliant points are at rest along the line through both only if it
# does not tilt.  To take away a slip that has but turned then stops the tilt: by the slip over the
# sine of the lean, which is another motion.


MOVED = 10.0
"""Times what is left of a slip by which velocities of bodies may change for its end: where they
would by more, and by more than errors do, it has not ended, but turned."""

DEPENDENT = 1e-5
"""Singular value of the rows of contacts at rest, relative to the largest, below which the
pivots (squares of singular values) are too inaccurate to show whether the rows are independent."""


def stop(at: Instant, cs: list[int], mode: int, arms: Array) -> bool:
    """Take away what is left of the slip or the rolling of contacts cs, whose energy is of second
    order. False, and nothing changed, where bodies would move otherwise for it: what creeps is
    tried again when it has become slower.

    mode: SLIDE or ROLL; arms: A of each body (see mechanics.error_scales), (N, 3, 3) [m].
    """
    table, y, kept = at.system.contact_table, at.y.copy(), at.system.contact_table.copy()
    before = velocities(at.system, at.y)
    left = float(np.linalg.norm(table[cs, SLIP : SLIP + 3], axis=1).max())
    if mode != SLIDE:
        left = (
            float(np.linalg.norm(table[cs, RELATIVE_SPIN : RELATIVE_SPIN + 3], axis=1).max())
            * at.system.length
        )
    creep = table[cs, CREEPS].copy()
    table[cs, mode], table[cs, CREEPS] = STUCK, 0.0
    at.call(SETTLE, at.t, at.y)
    change = (velocities(at.system, at.y) - before).reshape(-1, 6)
    turned = np.linalg.norm(np.einsum("bij,bj->bi", arms, change[:, 3:]), axis=1)
    most = float(max(np.linalg.norm(change[:, :3], axis=1).max(), turned.max()))
    at.refresh()
    stops = most <= max(MOVED * left, at.system.velocity_tolerance)
    if not stops or (creep.any() and nearly_depend(at)):
        at.y[:] = y
        table[:] = kept
        table[cs, CREEPS] = np.where(creep > 0.0, SLOWER * left, 0.0)
        at.refresh()
        return False
    return True


def nearly_depend(at: Instant) -> bool:
    """True where rows that hold are taken to depend on each other, but do not to the last: forces
    that keep all of them at rest are none, or without bound."""
    held = at.workspace.used[: lay_out_held(at.system, at.workspace)[0]]
    rows = scaled_rows(at.rows[held] @ np.linalg.cholesky(at.inverse_mass))
    _, s, _ = singular_values(rows, "the constraint equations of contacts that come to rest")
    return bool(((s > JUDGED_BY_CONTACT * s[0]) & (s < DEPENDENT * s[0])).any())


JAMS_AT_ONCE = 5
"""Times that what jams may jam again when it has been dealt with."""
AIMS = 5
"""Rounds in which what lies flat finds the point that it tips over."""
STOPS = {SLIP_ENDS: SLIDE, ROLL_ENDS: ROLL}
"""Events at which a motion has ended, and its mode; spin has one direction, and ends exactly."""
BEGINS_ANEW = {SLIP_ENDS: SLIP_BEGINS, ROLL_ENDS: ROLL_BEGINS}
"""What they are where nothing has come to rest."""
SHARED = (LIFT_OFF, SLIP_BEGINS, ROLL_BEGINS, SPIN_BEGINS)
"""Events at which a force reaches its bound; where others can take a share, nothing gives."""


STALLED_STEPS, STALLED_SPAN = 100_000, 1e-3
"""So many steps within so short a time (natural units) are no motion any more: a whole unit of it
would take a hundred million, hours. A box on steel takes fewer for several units; the point of a
rim that comes to touch all round in a bowl takes them for 1e-4 to 6e-4."""

ROUNDING = 1e-13
"""Rounding error of the work of contacts, relative to the energy of the scene."""
IMPACTS_AT_ONCE = 20
"""Impacts one by one at an instant, for each contact, that are taken to have no end."""


class ContactMotion(GridMotion):
    """As GridMotion, stopped at each event; `events` tells what happened.

    Raises SimulationError where the laws of contact have no solution.
    """

    laws: Sequence[ContactLaw]
    event_driven = True
    _lifted: frozenset[int] = frozenset()
    """contacts that lift off at the event at hand."""
    _warm = False  # whether what `run_to` calls is compiled

    def __init__(self, compiled: Compiled, method: Any) -> None:
        self.names: tuple[str, ...] = compiled.layout.contacts
        """of the points of contact."""
        self.rims = rims_of(compiled.system)
        self._pairs = pairs_of_solids(compiled.system)
        self._laws = ContactLaws(compiled.system)
        self._taken: tuple[Any, Stepping] | None = None
        self._work = np.zeros((WORK_ROWS + 3 * len(compiled.y) + 1, len(compiled.y)))
        bodies = len(compiled.system.bodies)
        self._work[FLOOR] = self._work[SHARE_OF_WAY] = 1.0
        self._work[IS_VELOCITY, : WIDTH * bodies] = ([0.0] * 7 + [1.0] * 6) * bodies
        self._work[FLOOR, WIDTH * bodies :] = self._work_of_rounding(compiled, method)
        super().__init__(compiled, paced(compiled, method))

    @staticmethod
    def _work_of_rounding(compiled: Compiled, method: Any) -> float:
        """What errors of the contacts' work are relative to at least [J]: a step that asks for less
        than the rounding of what is exchanged would never be short enough."""
        tolerance = getattr(method, "tolerance", 0.0)
        energy = float(compiled.system.mass * compiled.system.speed**2)
        return max(1.0, ROUNDING * energy / tolerance) if tolerance > 0.0 else 1.0

    @cached_property
    def _by_laws_alone(self) -> bool:
        """True where impacts and modes are asked nothing but the laws."""
        laws = self.compiled.contact_laws
        special = self.rims or self._pairs or self.compiled.one_by_one
        return not special and not any(law.drags or math.isinf(law.static) for law in laws)

    def reset(self, y: Any = None, time: float = 0.0) -> None:
        """As Motion.reset; the modes of the contacts are chosen for the state."""
        self.laws = self.compiled.contact_laws
        self._journal = Journal(self.names, self.laws)
        super().reset(y, time)
        system = self.compiled.system
        # tables that outlast an evaluation: another motion of the scene has its own
        own = {
            name: getattr(system, name).copy()
            for name in ("contact_table", "vectors", "rows", "row_table")
        }
        self.system = system._replace(**own, **slow_slips(system, self.method))
        self._packed: Any = None
        self._made: tuple[Any, Tasks] | None = None
        self._inputs = np.array([*self._laws.inputs.values(self.system, time), 0.0])
        self._places = np.array(self._laws.inputs.kept(self.system), dtype=int)
        """of the inputs that laws keep from step to step."""
        self._due = -1
        self._pause = math.inf
        self._mark = 0, time
        self._kept = np.zeros((len(self.names), KEPT))
        moments = system.bodies[:, INERTIA + OF_SYMMETRIC]
        self._arms = np.ascontiguousarray(
            spin_lengths(moments, system.bodies[:, MASS]).reshape(-1, 9)
        )
        forget_bounces(self._call.workspace)
        self._call.workspace.undetermined[:] = 0.0
        self._lifted_off = LeftOpen()
        self._chatter = Chatter(self.system.length / self.system.speed)
        self._progress = Progress(self.system.length / self.system.speed)
        with as_simulation_error(self._laws_now):
            if y is None and not self._warm:
                self._begin()
            else:  # a state that somebody tries, or a start again, maybe a thousand times: compiled
                self._happen(None)

    @property
    def events(self) -> list[ContactEvent]:
        """What has happened, the latest last."""
        return self._journal.events

    @property
    def forgotten(self) -> int:
        """Events before these."""
        return self._journal.forgotten

    @property
    def left_open(self) -> LeftOpen:
        """The widest choice that the laws of contact have left since the start."""
        widest = widest_of(self._call.workspace, self.names)
        return max(widest, self._lifted_off, widest_kept(self._kept, self.names))

    def warm(self) -> None:
        """As Motion.warm, and what the first event needs."""
        super().warm()
        self._call(WRITE_ROWS, self.time, self._grid.y)
        self._warm = True
        importlib.import_module("rb_sim.numerics.cone_program")  # which shares of a load need

    def change_law(self, system: Any) -> None:
        """As Motion.change_law; the modes of the contacts are chosen anew."""
        self.system, self.as_compiled = system._replace(**slow_slips(system, self.method)), False
        self._take_inputs()
        self._due = -1
        with as_simulation_error(self._laws_now):
            self._happen(None)

    def _laws_now(self) -> str:
        """What linear algebra is done for, and when."""
        return f"the laws of contact at t = {self.time:.9g} s"

    @property
    def _fixed(self) -> bool:
        """True of a method whose steps have a fixed length."""
        return getattr(self.method, "tolerance", 0.0) == 0.0

    def _explain(self, status: int) -> str:
        """As Motion; also the method for a contact point that no step can follow, as on a rim that
        comes to touch all round, and which slips an implicit method may not follow."""
        table, text = self.system.contact_table, super()._explain(status)
        if status == STEP_UNDERFLOW and (table[:, COMPLIANT] == 0.0).any():
            return f"{text}; {TOOL}"
        slides_with_friction = (
            (table[:, CLOSED] == 1.0) & (table[:, SLIDE] == SLIDING) & (table[:, STATIC] > 0.0)
        )
        if status != NOT_FINITE or not self._stepping.setting[4] or not slides_with_friction.any():
            return text
        names = ", ".join(
            name for name, rub in zip(self.names, slides_with_friction, strict=True) if rub
        )
        return f"{text}: its iteration may fail at slow slips with friction ({names})"

    def _record(self, times: Array, stop: float, out: Array | None) -> None:
        with as_simulation_error(self._laws_now):
            self._advance(times, stop, out)

    def run_to(self, times: Any, out: Array | None = None) -> int:
        """As Motion; also SimulationError where a side sinks into a support unseen."""
        return run_looking(self, self._carry, self.compiled.sides, times, out)

    def _carry(self, times: Array, out: Array | None) -> int:
        """As run_to, without looks at sides on the way; where it cannot go on, one may be why."""
        try:
            return super().run_to(times, out)
        except SimulationError:
            if np.isfinite(self._grid.y1).all():
                last = [self._grid.t1], self._grid.y1[None, :]
                refuse_sunk(self.compiled.sides, *last)
            raise

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
                bool(n) and out is not None, rows, self._work, self._due, self._kept,
                self._arms,
            )  # fmt: skip
            if reached and n:
                self.time = float(times[done + reached - 1])
                done += reached
            if status == EVENT:
                self._event()
            elif status == UNFINISHED:
                self.watch()
                self._refuse_to_stall()
            elif status:
                raise self._failure(status)
            elif not n:
                self._pass_pause()

    def _event(self) -> None:
        self.watch()
        code = kind_of(self._due)
        self._due = -1
        t = self._grid.t1
        self._progress.add(t, self.names[code[0]])
        if self._chatter.is_endless(t):
            self._leap(code[0])
        else:
            self._happen(code)

    def _happen(self, code: tuple[int, int] | None) -> None:
        """Impacts and new modes at the grid's last point; a new grid begins there."""
        self._lifted = frozenset()
        t = self._grid.t1 if code is not None else self.time
        y = np.array(self._grid.y1 if code is not None else self._grid.y)
        if code is not None and code[1] == TOUCH_DOWN and self._by_laws_alone:
            done = self._call(PASS, t, y, (code[0], int(self._fixed), 0))
            if done == DONE:
                self._begin_flights(t, y)
                return
            instant = Instant(self.laws, self._call, t, y)
            self._journal.take(instant.workspace)
            if done == AT_IMPACTS:
                self._strike(instant)
            self._go_on(instant, code)
            return
        instant = self._instant(t, y)
        refuse_to_lie(instant, self.rims, self.names, code)
        refuse_to_leave(self.laws, t, self.names, code)
        if code is not None and code[1] in SHARED:
            code = self._as_lift_off(instant, code)
            bears = bearing(self.system, self._lifted)
            aim_under_the_load(instant, self.rims)
            if bears and share_load(instant, recent=True):
                self._continue_from(t, y)
                return
        if code is not None and code[1] == JAMS:
            self._jam(instant, code[0])
            code = None
        self._strike(instant)
        if code is not None and code[1] in STOPS:
            code = self._stopped(instant, code)
        self._go_on(instant, code)

    def _begin(self) -> None:
        """The first modes; interpreted, so that making a Motion compiles nothing."""
        call, plain = self._call, Tasks(self.system, None, self._call.workspace)
        self._made = self.system, plain
        try:
            self._happen(None)
        finally:
            self._made = self.system, call

    def _leap(self, c: int) -> None:
        """Leap from the grid's last point, and go on there."""
        self._lifted = frozenset()
        t, y = self._grid.t1, np.array(self._grid.y1)
        instant = self._instant(t, y)
        if not self._leapt_over(instant, c):
            raise SimulationError(
                f"no consistent contact state found at t = {t:.9g} s (contact "
                f"{self.names[c]}): {TOOL}"
            )
        self._go_on(instant, None)

    def _go_on(self, instant: Instant, code: tuple[int, int] | None) -> None:
        """Choose the modes that follow and begin a new grid."""
        refuse_edges(instant, self._pairs, self.names)
        ambiguous = self._unjammed(instant, code)
        for _ in range(AIMS):
            if not aim_under_the_load(instant, self.rims):
                break
            ambiguous = self._unjammed(instant, None)
        for c in ambiguous:
            self._journal.note(instant.t, c, AMBIGUOUS)
            self._lifted_off = LeftOpen(1.0, instant.t, self.names[c], PARTED)
        self._leave(instant)
        if code is not None and code[1] == LIFT_OFF:
            law = self.laws[code[0]]
            refuse_to_be_dragged_off(self.system, law, instant.t, code[0], self.names)

    def _leave(self, instant: Instant) -> None:
        """Tell what has changed; a new grid, in whose first step flights can be seen to end."""
        dragged = self._call(LEAVE, instant.t, instant.y, (int(self._fixed), 0, 0))
        if dragged:
            self._journal.take(instant.workspace)
            refuse_drag(instant.t, self.names[dragged - 1])
        self._begin_flights(instant.t, instant.y)

    def _begin_flights(self, t: float, y: Array) -> None:
        """A new grid from (t, y), in whose first step the flights can be seen to end."""
        call = self._call
        self._journal.take(call.workspace)
        length = call.found
        self._pause = t + length if self._fixed else math.inf
        h = self._grid.h if length == math.inf else min(self._grid.h or length, length)
        self._continue_from(t, y, h)

    def _unjammed(self, instant: Instant, code: tuple[int, int] | None) -> tuple[int, ...]:
        """Choose the modes that follow, once what jams or may not slip has been stopped or leapt
        over; returns what may as well have stayed."""
        ambiguous = self._found_modes(instant, code)
        for c in slipping_rough(instant):
            self._stop_at_once(instant)
            ambiguous = self._found_modes(instant, None)
            closed = self.system.contact_table[c, CLOSED] == 1.0
            if not closed or c in slipping_rough(instant):
                refuse_rough(instant, c, self.names)
        return ambiguous

    def _found_modes(self, instant: Instant, code: tuple[int, int] | None) -> tuple[int, ...]:
        """As `_unjammed`, of what jams alone."""
        for _ in range(JAMS_AT_ONCE):
            try:
                return choose_modes(instant, code, self._lifted)
            except JammedError:
                self._jam(instant, None)
                self._strike(instant)
                code = None
        return choose_modes(instant, None)

    def _stopped(self, instant: Instant, code: tuple[int, int]) -> tuple[int, int]:
        """The event that a slip or a rolling ends, once it has; or that it begins anew."""
        arms = self._arms.reshape(-1, 3, 3)
        creep = self.system.contact_table[:, CREEPS]
        ends = np.flatnonzero(creep).tolist() if creep[code[0]] > 0.0 else [code[0]]
        if stop(instant, ends, STOPS[code[1]], arms):
            return code
        return code[0], BEGINS_ANEW[code[1]]

    def _as_lift_off(self, instant: Instant, code: tuple[int, int]) -> tuple[int, int]:
        """The event, which may be the end of several normal forces; where friction reaches its
        bound as the normal force vanishes, the end of the latter."""
        self._call(ACCELERATE, instant.t, instant.y)
        lifted = lifting(self.system, self._grid.t0, instant.t)
        normal_force = np.abs(self.system.contact_table[:, NORMAL_FORCE])
        bears = self.laws[code[0]].bilateral or normal_force[code[0]] > SOLVED * normal_force.max()
        if not bears or code[0] in lifted:
            code = code[0], LIFT_OFF
        if code[1] == LIFT_OFF:
            self._lifted = lifted
        return code

    def _instant(self, t: float, y: Array) -> Instant:
        return Instant(self.laws, self._call, t, y, ARRIVE)

    def _strike(self, instant: Instant) -> None:
        """Impacts until nothing approaches; an endless series of bounces is closed."""
        single = IMPACTS_AT_ONCE * len(self.laws) if self.compiled.one_by_one else 0
        n, last, status = 0, single + AT_ONCE, GOES_ON
        while status != NOTHING:
            aim_where_it_turns(instant, self.rims)
            to = min(n + 1, last) if self.rims else last  # rims aim anew before each round
            status = self._call(IMPACTS, instant.t, instant.y, (n, to, single))
            n = int(self._call.found)
            self._journal.take(instant.workspace)
            self._refuse_impacts(instant, status, n >= last)

    def _refuse_impacts(self, instant: Instant, status: int, over: bool) -> None:
        """Raise SimulationError where impacts have no impulses, or no end."""
        if status == OVERFLOWN:
            raise not_finite(OF)
        if status == NO_IMPULSES:
            raise SimulationError(
                f"no impulses satisfy the laws of impact and friction at t = {instant.t:.9g} s"
            )
        if status == ENDLESS and over:
            text = f"endless impacts at t = {instant.t:.9g} s"
            if self._fixed:  # bodies may be where only a step too long can have taken them
                raise StepTooLargeError(f"{text}: step {self.method.step:g} s is too large here")
            raise SimulationError(text)

    def _stop_at_once(self, instant: Instant) -> None:
        """One impact without rebound."""
        instant.workspace.plastic[:], instant.workspace.together[:] = 1, 0
        status = self._call(STRIKE, instant.t, instant.y)
        self._journal.take(instant.workspace)
        self._refuse_impacts(instant, status, False)

    def _jam(self, instant: Instant, c: int | None) -> None:
        """Painleve: the slip of contact c (or of whichever jams) stops at once, in an impact."""
        for i in range(len(self.laws)) if c is None else (c,):
            table = self.system.contact_table
            if table[i, CLOSED] and instant.effective_pivot(i) < NEAR_JAM:
                x = impulses_of_jam(instant, i)
                if x is None:
                    break
                instant.apply(x)
                self._call(NOTE, instant.t, instant.y, (JAMMED_NOTE, 0, 0))
                self._journal.take(instant.workspace)
                return
        rough = [i for i in instant.touching() if math.isinf(self.laws[i].static)]
        if c is None and rough:
            refuse_rough(instant, rough[0], self.names)
        hardly = c is not None and instant.slip_speed(c) <= self.system.velocity_tolerance
        # compliant contacts that stick may find no forces either, and touch nothing rigidly
        near = (
            instant.touching()
            or np.flatnonzero(self.system.contact_table[:, CLOSED] == 1.0).tolist()
        )
        if (c is None or hardly) and near and self._leapt_over(instant, near[0]):
            return
        if c is None and near and not instant.touching():
            raise SimulationError(
                f"no friction forces found for compliant contacts ({self.names[near[0]]} and "
                "others) "
                f"that hardly slip at t = {instant.t:.9g} s: {TOOL}"
            )
        name = "" if c is None else f" of {self.names[c]}"
        raise SimulationError(
            f"Painleve's paradox at t = {instant.t:.9g} s: no force{name} satisfies the friction "
            "law, and no impact stops the slip"
        )

    def _leapt_over(self, instant: Instant, c: int) -> bool:
        """Move the instant on by a time too short to matter, over which impulses answer the loads;
        longer if it has just been done.  False if the laws have no impulses either."""
        t = instant.t
        length = leap(instant, self._chatter.length_of_leap(t))
        if length is None:
            return False
        bring_back(instant)
        self._journal.note(t, c, LEAPS)
        self._chatter.leapt(t + length, length)
        return True

    def _refuse_to_stall(self) -> None:
        """Raise SimulationError where time hardly goes on, as where friction turns slips to and fro
        that are slower than steps can follow."""
        (before, since), steps, t = self._mark, self.steps, self._grid.t1
        if steps - before < STALLED_STEPS:
            return
        self._mark, span = (steps, t), t - since
        if span * self.system.speed >= STALLED_SPAN * self.system.length:
            return
        text = f"{steps - before} steps in the last {span:.2g} s at t = {t:.9g} s"
        if self._fixed:
            raise StepTooLargeError(f"{text}: step {self.method.step:g} s is too large here")
        raise SimulationError(f"{text}: {TOOL}")

    @property
    def _stepping(self) -> Stepping:
        """The method, as the loop takes it; made anew where `method` is another one."""
        if self._taken is None or self._taken[0] is not self.method:
            table = self.system.contact_table
            compliant_friction = bool(
                ((table[:, STATIC] > 0.0) & (table[:, COMPLIANT] == 1.0)).any()
            )
            taken = stepping_of(self.compiled, self.method, compliant_friction)
            self._taken = self.method, taken
        return self._taken[1]

    def _take_inputs(self, onwards: bool = True) -> None:
        """Commands and tables from now on, or at this instant alone."""
        kept = self.kept
        self._inputs[:-1] = self._laws.inputs.values(self.system, self.time, onwards)
        self.kept = kept

    @property
    def kept(self) -> Array:
        """As Motion.kept: those inputs of the laws that are kept from step to step."""
        return self._inputs[self._places]

    @kept.setter
    def kept(self, values: Array) -> None:
        self._inputs[self._places] = values

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

    @property
    def _call(self) -> Tasks:
        """What is done between the calls of the loop, compiled."""
        if self._made is None or self._made[0] is not self.system:
            workspace = None if self._made is None else self._made[1].workspace
            self._made = self.system, Tasks(self.system, self._held(), workspace)
        return self._made[1]

    def _pass_pause(self) -> None:
        self._pause = math.inf
        if self._due < 0:
            self._continue_from(self._grid.t1, self._grid.y1)

    def _continue_from(self, t: float, y: Array, h: float | None = None) -> None:
        """Begin a new grid of steps at (t, y)."""
        self._begin_grid(t, y, self._grid.h if h is None else h)
        self._call(BEGIN, t, y, c=self._grid.c1)
