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
from rb_sim.compiler.graph.machine import interpreted
from rb_sim.contact.assembly import velocities
from rb_sim.contact.event_workspace import (
    AMBIGUOUS,
    LEAPS,
    Journal,
)
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
    JAM,
    LEAVE,
    PASS,
    SETTLE,
    STRIKE,
    WRITE_ROWS,
    Instant,
    Tasks,
    as_simulation_error,
    bring_back,
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
    STRUCK,
    Chatter,
    forget_bounces,
)
from rb_sim.contact.modes import lay_out_held
from rb_sim.contact.tunnelling import refuse_sunk, run_looking
from rb_sim.integrate.layout import (
    FLOOR,
    IS_VELOCITY,
    NOT_FINITE,
    SHARE_OF_WAY,
    STEP_UNDERFLOW,
    UNFINISHED,
    WORK_ROWS,
)
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.contact.accelerations import SLOWER, slides_with_friction
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
from rb_sim.mechanics.contact.contact_kinematics import STUCK
from rb_sim.mechanics.contact.contact_laws import ContactLaws
from rb_sim.mechanics.error_scales import OF_SYMMETRIC, spin_lengths
from rb_sim.mechanics.samples import Array, ContactEvent
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS, WIDTH
from rb_sim.numerics.rank import JUDGED_BY_CONTACT, scaled_rows

# Contacts that open together: if the normal forces of several points vanish at the same instant, as
# of a box whose floor moves away, opening one alone would let them open and close in turn, by
# rounding, without end.


def lifting(system: Any, begun: float, t: float) -> frozenset[int]:
    """Rigid contacts whose normal force has fallen in the step and vanishes at t, within rounding.

    system: with the forces at t in the modes before. begun: start of the step [s]; an event there
    has no step in which a force could have fallen.
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
    """Whether any contact other than those that lift off is closed."""
    return bool(set(np.flatnonzero(system.contact_table[:, CLOSED] == 1.0).tolist()) - lifted)


def refuse_to_leave(
    laws: Sequence[ContactLaw], t: float, names: Sequence[str], code: tuple[int, int] | None
) -> None:
    """Raise SimulationError if a bilateral contact point reaches the edge of its face; code:
    (contact, kind) of the event that led here."""
    if code is not None and code[1] == LIES_FLAT and laws[code[0]].bilateral:
        name = names[code[0]]
        raise SimulationError(
            f"contact {name} reaches the edge of its surface at t = {t:.9g} s: give "
            f"constraints.{name} a larger surface, or mode unilateral"
        )


# The end of a slip or rolling: its remaining velocity is removed.
#
# The rows of a contact that comes to rest may be nearly dependent on those of others: two corners
# of a box on compliant points are at rest along their connecting line only if the box does not
# tilt. If the slip has not ended but only changed its direction, removing it would stop the tilt, a
# change of velocity by the slip over the sine of the tilt, which is another motion.


MOVED = 10.0
"""Largest change of the bodies' velocities at the end of a slip, relative to its remaining
velocity; if they would change by more, the slip has not ended, but turned."""

DEPENDENT = 1e-5
"""Singular value of the rows of contacts at rest, relative to the largest, below which the
pivots (squares of singular values) are too inaccurate to show whether the rows are independent."""


def stop(at: Instant, cs: list[int], mode: int, arms: Array) -> bool:
    """Remove the remaining slip or rolling of contacts cs, whose energy is of second order.

    Returns False, without any change, if that would change the motion of the bodies; contacts that
    creep are tried again when they are slower. mode: SLIDE or ROLL; arms: A of each body
    (mechanics/error_scales), (N, 3, 3) [m].
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
    """Whether the active rows are nearly dependent, so that the forces that keep them all at rest
    are very large."""
    held = at.workspace.used[: lay_out_held(at.system, at.workspace)[0]]
    rows = scaled_rows(at.rows[held] @ np.linalg.cholesky(at.inverse_mass))
    _, s, _ = singular_values(rows, "the constraint equations of contacts that come to rest")
    return bool(((s > JUDGED_BY_CONTACT * s[0]) & (s < DEPENDENT * s[0])).any())


JAMS_AT_ONCE = 5
"""Maximum number of jams at one instant."""
AIMS = 5
"""Maximum number of rounds in which a flat rim gets the contact point that it tips over."""
STOPS = {SLIP_ENDS: SLIDE, ROLL_ENDS: ROLL}
"""Events at which a motion has ended, and its mode; spinning has one direction, and ends
exactly."""
BEGINS_ANEW = {SLIP_ENDS: SLIP_BEGINS, ROLL_ENDS: ROLL_BEGINS}
"""Events in place of these if the motion has not ended."""
SHARED = (LIFT_OFF, SLIP_BEGINS, ROLL_BEGINS, SPIN_BEGINS)
"""Events at which a force reaches its bound; nothing changes if other contacts can take the
load."""


STALLED_STEPS, STALLED_SPAN = 100_000, 1e-3
"""A run has stalled if it takes this number of steps for this time (natural units). A box on steel
takes fewer for several units; a rim that comes to touch a bowl all round takes them for 1e-4 to
6e-4."""

ROUNDING = 1e-13
"""Rounding error of the work of contacts, relative to the energy of the scene."""
IMPACTS_AT_ONCE = 20
"""Maximum number of single impacts at an instant per contact."""


class ContactMotion(GridMotion):
    """As GridMotion, with a stop at each event; `events` lists them.

    Raises SimulationError if the contact laws have no solution.
    """

    laws: Sequence[ContactLaw]
    event_driven = True
    _lifted: frozenset[int] = frozenset()
    """contacts that lift off at the present event."""
    _warm = False  # whether the functions of `run_to` are compiled

    def __init__(self, compiled: Compiled, method: Any) -> None:
        self.names: tuple[str, ...] = compiled.layout.contacts
        """names of the contact points."""
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
        """Lower limit of the error scale of the contacts' work [J]: a tolerance below its rounding
        could not be met by any step."""
        tolerance = getattr(method, "tolerance", 0.0)
        energy = float(compiled.system.mass * compiled.system.speed**2)
        return max(1.0, ROUNDING * energy / tolerance) if tolerance > 0.0 else 1.0

    @cached_property
    def _by_laws_alone(self) -> bool:
        """Whether impacts and modes depend on the laws alone."""
        laws = self.compiled.contact_laws
        special = self.rims or self._pairs or self.compiled.one_by_one
        return not special and not any(law.drags or math.isinf(law.static) for law in laws)

    def reset(self, y: Any = None, time: float = 0.0) -> None:
        """As Motion.reset; the modes of the contacts are chosen for the state."""
        self.laws = self.compiled.contact_laws
        self._journal = Journal(self.names, self.laws)
        super().reset(y, time)
        system = self.compiled.system
        # tables with state: another motion of the scene has its own
        own = {
            name: getattr(system, name).copy()
            for name in ("contact_table", "vectors", "rows", "row_table")
        }
        self.system = system._replace(**own, **slow_slips(system, self.method))
        self._packed: Any = None
        self._made: tuple[Any, Tasks] | None = None
        self._inputs = np.array([*self._laws.inputs.values(self.system, time), 0.0])
        self._places = np.array(self._laws.inputs.kept(self.system), dtype=int)
        """indices of the inputs that laws carry from step to step."""
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
            else:  # a given state, or a restart, which may happen often: compiled
                self._happen(None)

    @property
    def events(self) -> list[ContactEvent]:
        """Contact events so far by time; of very many the latest."""
        return self._journal.events

    @property
    def forgotten(self) -> int:
        """Number of events before those in `events`."""
        return self._journal.forgotten

    @property
    def left_open(self) -> LeftOpen:
        """The largest non-uniqueness of the contact laws since the start."""
        widest = widest_of(self._call.workspace, self.names)
        return max(widest, self._lifted_off, widest_kept(self._kept, self.names))

    def warm(self) -> None:
        """As Motion.warm, including the functions for the first event."""
        super().warm()
        self._call(WRITE_ROWS, self.time, self._grid.y)
        self._warm = True
        importlib.import_module("rb_sim.numerics.cone_program")  # for shares of a load

    def change_law(self, system: Any) -> None:
        """As Motion.change_law; the modes of the contacts are chosen anew."""
        self.system, self.as_compiled = system._replace(**slow_slips(system, self.method)), False
        self._take_inputs()
        self._due = -1
        with as_simulation_error(self._laws_now):
            self._happen(None)

    def _laws_now(self) -> str:
        """Text for errors of linear algebra."""
        return f"the laws of contact at t = {self.time:.9g} s"

    @property
    def _fixed(self) -> bool:
        """Whether the method has fixed steps."""
        return getattr(self.method, "tolerance", 0.0) == 0.0

    def _explain(self, status: int) -> str:
        """As Motion; also names time stepping for a contact point that no step follows (a rim that
        comes to touch all round), and slips at which an implicit method may fail."""
        table, text = self.system.contact_table, super()._explain(status)
        if status == STEP_UNDERFLOW and (table[:, COMPLIANT] == 0.0).any():
            return f"{text}; {TOOL}"
        names = [name for c, name in enumerate(self.names) if slides_with_friction(table, c)]
        if status != NOT_FINITE or not self._stepping.setting[4] or not names:
            return text
        return f"{text}: its iteration may fail at slow slips with friction ({', '.join(names)})"

    def _record(self, times: Array, stop: float, out: Array | None) -> None:
        with as_simulation_error(self._laws_now):
            self._advance(times, stop, out)

    def run_to(self, times: Any, out: Array | None = None) -> int:
        """As Motion; also raises SimulationError if a side sinks into a support."""
        return run_looking(self, self._carry, self.compiled.sides, times, out)

    def _carry(self, times: Array, out: Array | None) -> int:
        """As run_to, with a check of the sides only if it fails."""
        try:
            return super().run_to(times, out)
        except SimulationError:
            if np.isfinite(self._grid.y1).all():
                last = [self._grid.t1], self._grid.y1[None, :]
                refuse_sunk(self.compiled.sides, *last)
            raise

    def _advance(self, times: Array, stop: float, out: Array | None) -> None:
        """Call the loop, handle the event that it stops at, and repeat."""
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
        """Handle the event `code`, or choose the first modes (None): impacts, new modes, new
        grid."""
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
        """Choose the first modes, interpreted, so that a new Motion compiles nothing."""
        call, plain = self._call, Tasks(self.system, None, self._call.workspace)
        self._made = self.system, plain
        try:
            self._happen(None)
        finally:
            self._made = self.system, call

    def _leap(self, c: int) -> None:
        """Leap from the last grid point, and continue from there."""
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
        """Choose the next modes and begin a new grid."""
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
        """Report the changes; begin a new grid, whose first step shows the end of flights."""
        dragged = self._call(LEAVE, instant.t, instant.y, (int(self._fixed), 0, 0))
        if dragged:
            self._journal.take(instant.workspace)
            refuse_drag(instant.t, self.names[dragged - 1])
        self._begin_flights(instant.t, instant.y)

    def _begin_flights(self, t: float, y: Array) -> None:
        """Begin a new grid from (t, y), whose first step is short enough to show the end of
        flights."""
        call = self._call
        self._journal.take(call.workspace)
        length = call.found
        self._pause = t + length if self._fixed else math.inf
        h = self._grid.h if length == math.inf else min(self._grid.h or length, length)
        self._continue_from(t, y, h)

    def _unjammed(self, instant: Instant, code: tuple[int, int] | None) -> tuple[int, ...]:
        """Choose the next modes, after impacts or leaps that stop jams and slips of perfectly rough
        contacts; returns contacts that could as well have stayed closed."""
        ambiguous = self._found_modes(instant, code)
        for c in slipping_rough(instant):
            self._stop_at_once(instant)
            ambiguous = self._found_modes(instant, None)
            closed = self.system.contact_table[c, CLOSED] == 1.0
            if not closed or c in slipping_rough(instant):
                refuse_rough(instant, c, self.names)
        return ambiguous

    def _found_modes(self, instant: Instant, code: tuple[int, int] | None) -> tuple[int, ...]:
        """As `_unjammed`, for jams alone."""
        for _ in range(JAMS_AT_ONCE):
            try:
                return choose_modes(instant, code, self._lifted)
            except JammedError:
                self._jam(instant, None)
                self._strike(instant)
                code = None
        return choose_modes(instant, None)

    def _stopped(self, instant: Instant, code: tuple[int, int]) -> tuple[int, int]:
        """The event `code`, the end of a slip or rolling; its start if the motion has not ended."""
        arms = self._arms.reshape(-1, 3, 3)
        creep = self.system.contact_table[:, CREEPS]
        ends = np.flatnonzero(creep).tolist() if creep[code[0]] > 0.0 else [code[0]]
        if stop(instant, ends, STOPS[code[1]], arms):
            return code
        return code[0], BEGINS_ANEW[code[1]]

    def _as_lift_off(self, instant: Instant, code: tuple[int, int]) -> tuple[int, int]:
        """The event `code`, or the lift-off if friction reaches its bound because the normal force
        vanishes; it also finds other contacts that lift off."""
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
        """Impacts until no contact approaches; endless bounces are closed."""
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
        """Raise SimulationError if impacts have no solution or no end."""
        if status == OVERFLOWN:
            raise not_finite(OF)
        if status == NO_IMPULSES:
            raise SimulationError(
                f"no impulses satisfy the laws of impact and friction at t = {instant.t:.9g} s"
            )
        if status == ENDLESS and over:
            text = f"endless impacts at t = {instant.t:.9g} s"
            if self._fixed:  # a step that is too long may have caused this state
                raise StepTooLargeError(f"{text}: step {self.method.step:g} s is too large here")
            raise SimulationError(text)

    def _stop_at_once(self, instant: Instant) -> None:
        """One impact without rebound."""
        instant.workspace.plastic[:], instant.workspace.together[:] = 1, 0
        status = self._call(STRIKE, instant.t, instant.y)
        self._journal.take(instant.workspace)
        self._refuse_impacts(instant, status, False)

    def _jam(self, instant: Instant, c: int | None) -> None:
        """Painleve: stop the slip of contact c (None: of the first one that jams) by an impact."""
        for i in range(len(self.laws)) if c is None else (c,):
            table = self.system.contact_table
            if table[i, CLOSED] and instant.effective_pivot(i) < NEAR_JAM:
                status = self._call(JAM, instant.t, instant.y, (i, 0, 0))
                self._journal.take(instant.workspace)
                if status == STRUCK:
                    return
                break
        rough = [i for i in instant.touching() if math.isinf(self.laws[i].static)]
        if c is None and rough:
            refuse_rough(instant, rough[0], self.names)
        hardly = c is not None and instant.slip_speed(c) <= self.system.velocity_tolerance
        # sticking compliant contacts may have no forces either
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
        """Leap by a negligible time, longer if one has just been made; returns False if the laws
        have no impulses either."""
        t = instant.t
        length = leap(instant, self._chatter.length_of_leap(t))
        if length is None:
            return False
        bring_back(instant)
        self._journal.note(t, c, LEAPS)
        self._chatter.leapt(t + length, length)
        return True

    def _refuse_to_stall(self) -> None:
        """Raise SimulationError if the run has stalled (STALLED_STEPS), e.g. by slips too slow to
        be followed."""
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
        """The method for the loop; made again if `method` has changed."""
        if self._taken is None or self._taken[0] is not self.method:
            table = self.system.contact_table
            compliant_friction = bool(
                ((table[:, STATIC] > 0.0) & (table[:, COMPLIANT] == 1.0)).any()
            )
            taken = stepping_of(self.compiled, self.method, compliant_friction)
            self._taken = self.method, taken
        return self._taken[1]

    def _take_inputs(self, onwards: bool = True) -> None:
        """Update the inputs of the laws, from now on or at this instant alone."""
        kept = self.kept
        self._inputs[:-1] = self._laws.inputs.values(self.system, self.time, onwards)
        self.kept = kept

    @property
    def kept(self) -> Array:
        """As Motion.kept: inputs of the laws that are carried from step to step."""
        return self._inputs[self._places]

    @kept.setter
    def kept(self, values: Array) -> None:
        self._inputs[self._places] = values

    def _restart_grid(self) -> None:
        super()._restart_grid()
        self._take_inputs()

    def _held(self) -> Any:
        """The packed system for the loop."""
        if self._packed is None or self._packed[0] is not self.system:
            if interpreted():
                return self.system
            self._packed = self.system, *self._laws.packed(self.system, self._inputs)
        return self._packed[1]

    @property
    def _call(self) -> Tasks:
        """The compiled tasks."""
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
