# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The contacts of a system at one instant: tasks between calls of the loop, jams, short steps."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.contact import ContactLaw
from rb_sim.compiler.graph.machine import interpreted
from rb_sim.compiler.program import address_of
from rb_sim.contact.assembly import (
    CANDIDATE,
    PRESSED,
    SOLVED,
    answer_over,
    inverse_mass,
    set_velocities,
    spread,
    velocities,
    write_all_rows,
)
from rb_sim.contact.event_workspace import (
    CHANGES,
    IMPACT,
    WORKSPACE_LAYOUT,
    Workspace,
    note_changes,
    note_impulses,
    slip_speed,
    spin_tolerance_of,
    take_before,
    touches,
    turning,
    velocity_tolerance_of,
    workspace_for,
    workspace_left,
)
from rb_sim.contact.events.search import begin_step
from rb_sim.contact.impacts import (
    AT_ONCE,
    NOTHING,
    STRUCK,
    stop_jam,
    strike,
    strike_in_rounds,
    time_of_flights,
)
from rb_sim.contact.modes import WHOLE, choose, may_share
from rb_sim.integrate.layout import held_at
from rb_sim.mechanics.contact.accelerations import contact_accelerations, power_of_contacts
from rb_sim.mechanics.contact.contact_bodies import (
    CLOSED,
    GAP,
    PIVOT,
    ROLL,
    SLIDE,
    SPIN,
    TOUCH_DOWN,
    ContactBodies,
)
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.system import project
from rb_sim.mechanics.systems.many_bodies import MULTIPLIERS, WIDTH
from rb_sim.mechanics.systems.multibody import write_rows
from rb_sim.numerics.kernels import for_python, pointer_to, view, where
from rb_sim.numerics.vectors import norm, quaternion_rate

# Tasks: compiled functions that are called between calls of the loop, compiled once for all scenes.
#
# They work on the tables of a system and the workspace of events, and are called by one address,
# since each argument of a call from Python takes time.


(
    WRITE, WRITE_ROWS, ACCELERATE, SETTLE, BEGIN, ARRIVE, IMPACTS, STRIKE, JAM, CHOOSE, LEAVE, PASS,
    OVER,
) = range(13)  # fmt: skip
"""Tasks: write the rows of closed contacts, or all rows; compute multipliers and accelerations;
project y onto the manifold; begin a step; arrive at an event (store the modes before it, write all
rows); rounds of impacts, or one impact; stop the slip of a contact that jams; choose the modes;
leave an event (note the changes, compute the time within which flights end); pass an event as a
whole, if only the laws decide; impulses over a short time."""
DONE, AT_IMPACTS, AT_MODES = range(3)
"""Result of PASS: done, or stopped before impacts or modes that the laws alone do not decide."""

SYSTEM, WORKSPACE, NUMBERS, STATE, DIGITS, LENGTH, TASK, FIRST, SECOND, THIRD, PLACES = range(11)
"""Arguments of a task: addresses of system, workspace, numbers, y and its low digits; length of y;
the task and its three integers."""
TIME, FOUND, MORE = range(3)
"""Numbers: t; results of a task: a number, and whether the laws leave the reactions open."""
NO_DIGITS = np.zeros(0)


def pass_through(system, workspace, t, y, contact, fixed):
    """The task PASS after the touch-down of a contact: (result, time within which the flights that
    begin here end [s])."""
    take_before(system, workspace)
    write_all_rows(system, t, y, workspace)
    status, _ = strike_in_rounds(system, workspace, t, y, 0, AT_ONCE, 0)
    if status != NOTHING:
        return AT_IMPACTS, math.inf
    if choose(system, workspace, t, y, (contact, TOUCH_DOWN)) != WHOLE or may_share(
        system, workspace
    ):
        return AT_MODES, math.inf
    contacts = workspace.parted.shape[0]
    for c in range(contacts):
        if workspace.parted[c] == 1:
            return AT_MODES, math.inf
    if workspace_left(workspace) < CHANGES * contacts:
        return AT_MODES, math.inf
    note_changes(system, workspace, t)
    length, _ = time_of_flights(system, workspace, t, y, fixed)
    return DONE, length


@for_python
def do_task(places):
    """Execute a task at (t, y); returns its status."""
    system, workspace = held_at(places, SYSTEM), held_at(places, WORKSPACE)
    numbers, task = pointer_to(places, NUMBERS), places[TASK]
    t, y = numbers[TIME], view(pointer_to(places, STATE), 0, places[LENGTH])
    first, second, third = places[FIRST], places[SECOND], places[THIRD]
    status = 0
    if task == WRITE:
        write_rows(system, t, y)
    elif task == WRITE_ROWS:
        write_all_rows(system, t, y, workspace)
    elif task == ACCELERATE:
        contact_accelerations(system, t, y)
    elif task == SETTLE:
        write_rows(system, t, y)  # so that the rows of contacts that are now open are zero
        project(system, t, y)
    elif task == BEGIN:
        begin_step(system, t, y, view(pointer_to(places, DIGITS), 0, places[LENGTH]))
    elif task == ARRIVE:
        take_before(system, workspace)
        write_all_rows(system, t, y, workspace)
    elif task == IMPACTS:
        status, n = strike_in_rounds(system, workspace, t, y, first, second, third)
        numbers[FOUND] = n
    elif task == STRIKE:
        status = strike(system, workspace, t, y, False)
        if status == STRUCK:
            note_impulses(system, workspace, t, IMPACT)
    elif task == JAM:
        status = stop_jam(system, workspace, t, y, first)
    elif task == CHOOSE:
        status = choose(system, workspace, t, y, (first, second))
        numbers[MORE] = 1.0 if status == 0 and may_share(system, workspace) else 0.0
    elif task == LEAVE:
        note_changes(system, workspace, t)
        numbers[FOUND], status = time_of_flights(system, workspace, t, y, first == 1)
    elif task == PASS:
        status, numbers[FOUND] = pass_through(system, workspace, t, y, first, second == 1)
    else:
        status = answer_over(system, workspace, y, numbers[FOUND])
    return status


CALL = struct.Struct("=7q")
"""Arguments from STATE on."""


class Tasks:
    """Tasks on the tables of a system, which must not move in memory.

    packed: the packed system of the loop; None: tasks run as plain Python without compilation.
    """

    def __init__(
        self, system: ContactBodies, packed: Any = None, workspace: Workspace | None = None
    ) -> None:
        """workspace: a previous one for the same contacts, with its memory."""
        self.system = system
        self.workspace = workspace_for(system) if workspace is None else workspace
        self._numbers = np.zeros(3)
        self._plain = packed is None or interpreted()
        if packed is None or self._plain:
            self._places: Any = [system, self.workspace, self._numbers] + [0] * (PLACES - 3)
            return
        self._kept = packed, WORKSPACE_LAYOUT.pack(self.workspace._asdict())
        self._table = np.zeros(PLACES, np.int64)
        self._table[:STATE] = [address_of(a) for a in (*self._kept, self._numbers)]
        self._arguments = memoryview(self._table.data).cast("B")[8 * STATE :]
        self._places = where(self._table)

    def __call__(
        self,
        task: int,
        t: float,
        y: Array,
        numbers: tuple[int, int, int] = (0, 0, 0),
        c: Array = NO_DIGITS,
    ) -> int:
        """Execute the task at (t, y), which may change y in place; c: low digits of y, for BEGIN.
        Returns its status."""
        self._numbers[TIME] = t
        if self._plain:
            self._places[STATE:] = [y, c, len(y), task, *numbers]
            return do_task.function(self._places)
        at = address_of(y), address_of(c) if task == BEGIN else 0
        CALL.pack_into(self._arguments, 0, *at, len(y), task, *numbers)
        return do_task(self._places)

    def over(self, t: float, y: Array, duration: float) -> int:
        """Impulses over a short time, see `assembly.answer_over`."""
        self._numbers[FOUND] = duration
        return self(OVER, t, y)

    @property
    def found(self) -> float:
        """The number that the last task returned."""
        return float(self._numbers[FOUND])

    @property
    def undecided(self) -> bool:
        """Whether the reactions of contacts at rest are not unique."""
        return bool(self._numbers[MORE])


# Matrix decompositions that raise SimulationError instead of a LinAlgError, which LAPACK raises for
# entries that are not finite, and rarely for finite ones.


def singular_values(A: Array, of: str) -> tuple[Array, Array, Array]:
    """u, s, v^T of A = u diag(s) v^T.

    of: meaning of A, for the text of the SimulationError.
    """
    require_finite(of, A)
    with as_simulation_error(lambda: of):
        u, s, vt = np.linalg.svd(A)
    return u, s, vt


def eigenvalues(A: Array, of: str) -> tuple[Array, Array]:
    """Eigenvalues, ascending, and eigenvectors of the symmetric A; errors as `singular_values`."""
    require_finite(of, A)
    with as_simulation_error(lambda: of):
        values, vectors = np.linalg.eigh(A)
    return values, vectors


def require_finite(of: str, *arrays: Array) -> None:
    """Raise SimulationError unless all entries are finite."""
    for array in arrays:
        numbers = array.reshape(-1)
        # the sum of squares, in one call, is finite unless entries are very large
        if not math.isfinite(np.dot(numbers, numbers)) and not np.isfinite(numbers).all():
            raise not_finite(of)


def not_finite(of: str) -> SimulationError:
    """The error for numbers that are not finite."""
    return SimulationError(
        f"{of} have no solution: the state or the loads are not finite, or overflow; try a "
        "smaller step or tolerance"
    )


@contextmanager
def as_simulation_error(of: Callable[[], str]) -> Iterator[None]:
    """Raises a LinAlgError from inside as SimulationError; of: returns the meaning of the
    matrix."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise SimulationError(f"{of()} have no solution: {error}") from error


class Instant:
    """The contacts of a system at (t, y); y and the table of contacts are changed in place.

    Only one instance is used at a time, since they share the workspace of the tasks. Raises
    SimulationError if no modes or impulses satisfy the laws.
    """

    def __init__(
        self, laws: Sequence[ContactLaw], call: Tasks, t: float, y: Array, task: int = WRITE_ROWS
    ) -> None:
        """task: that writes the rows."""
        self.system, self.laws, self.t, self.y = call.system, laws, t, y
        self.call, self.workspace = call, call.workspace
        self.velocity_tolerance = velocity_tolerance_of(self.system)
        """speed that counts as zero [m/s]."""
        self.first: list[int] = self.system.first_row[self.system.joints :].tolist()
        """first row of each contact; rows before that of contact 0 are those of joints."""
        call(task, t, y)

    def refresh(self) -> None:
        """Write the rows again, after y or the modes have changed."""
        self.call(WRITE_ROWS, self.t, self.y)

    @property
    def rows(self) -> Array:
        """Rows of constraints and contacts, all closed and stuck, (n, 6N)."""
        return spread(self.system, self.workspace.all_rows)

    @property
    def pushes(self) -> Array:
        """Force directions of all rows, (n, 6N)."""
        return spread(self.system, self.workspace.all_pushes)

    @cached_property
    def inverse_mass(self) -> Array:
        """M^-1, (6N, 6N)."""
        return inverse_mass(self.system)

    def touching(self) -> list[int]:
        """Rigid contacts whose surfaces touch."""
        return [c for c in range(len(self.laws)) if touches(self.system, c)]

    def slip_speed(self, c: int) -> float:
        """Slip speed of contact c [m/s]."""
        return float(slip_speed(self.system, c))

    def effective_pivot(self, c: int) -> float:
        """n . M^-1 (n + T/N) relative to n . M^-1 n, with the joints, at the slip of contact c."""
        if self.slip_speed(c) <= self.velocity_tolerance or math.isinf(self.laws[c].kinetic):
            return 1.0
        table = self.system.contact_table
        kept = table.copy()
        table[c, CLOSED], table[c, SLIDE] = 1.0, SLIDING
        self.call(ACCELERATE, self.t, self.y)
        pivot = float(table[c, PIVOT])
        table[:] = kept
        self.refresh()
        return pivot


# Leaps: short steps by impulses where the laws between forces and accelerations have no solution.
#
# Some motions change their contacts at every instant (corners that slip about a moving point, a
# slip whose direction turns faster than it grows, a rod for which Painleve's paradox leaves no
# force). The laws between velocities and impulses always have a solution (Stewart and Trinkle
# 1996): over a negligible time the loads act as one impulse, and contacts respond with theirs.


GAINED = 1e-4
"""Largest energy gained in contacts by a leap, relative to the scene's. The motion of a point on a
curve gains far less in a negligible time, far more if its direction turns within that time."""
SHORTER = 0.25
"""Factor of the duration of a leap that would gain more."""


def leap(at: Instant, duration: float) -> float | None:
    """Advance by `duration` [s] or less (see GAINED) with impulses; returns the time passed [s].

    y becomes the state after it, off the manifold by the square of the duration, and the table has
    its modes. Impulses and contact forces work on the mean velocity. None if these laws have no
    solution either.
    """
    touching, table = at.touching(), at.system.contact_table
    pressed = [c for c, law in enumerate(at.laws) if law.compliant and table[c, CLOSED] == 1.0]
    at.workspace.taking_part[:] = 0
    at.workspace.taking_part[touching], at.workspace.taking_part[pressed] = CANDIDATE, PRESSED
    at.workspace.moved[:] = 0
    slow = spin_tolerance_of(at.system)
    for c in (*touching, *pressed):
        law, (across, about) = at.laws[c], turning(at.system, c)
        moves = at.slip_speed(c) > at.velocity_tolerance, norm(across) > slow, abs(about) > slow
        at.workspace.moved[c] = moves
        # what has friction at rest is stuck
        table[c, CLOSED], table[c, SLIDE] = 1.0, STUCK if law.static > 0.0 else SLIDING
        table[c, ROLL] = STUCK if law.rolling_arm > 0.0 else NONE
        table[c, SPIN] = STUCK if law.spinning_arm > 0.0 else NONE
    at.refresh()
    if at.call.over(at.t, at.y, duration) != SOLVED:
        return None
    u = velocities(at.system, at.y)
    impulses = at.workspace.impulses.copy()
    p = at.pushes.T @ impulses
    gained = (at.inverse_mass @ p).reshape(u.shape)
    after = u + duration * at.workspace.free_accelerations + gained
    u_mean = 0.5 * (u + after)
    held = slice(at.first[0], None)
    along = at.rows[held] @ u_mean.reshape(-1) - at.workspace.row_rate[held]
    if impulses[held] @ along > GAINED * at.system.mass * at.system.speed**2:
        return leap(at, SHORTER * duration) if at.t + SHORTER * duration > at.t else None
    work = float(p @ u_mean.reshape(-1)) + duration * power_of_given(at, u_mean)
    for i, mean in enumerate(u_mean):
        q = slice(WIDTH * i + 3, WIDTH * i + 7)
        at.y[WIDTH * i : WIDTH * i + 3] += duration * mean[:3]
        at.y[q] += duration * np.array(quaternion_rate(tuple(at.y[q]), tuple(mean[3:])))
    set_velocities(at.system, at.y, after)
    at.y[WIDTH * at.system.bodies.shape[0]] += work
    at.t += duration
    for c in touching:
        if impulses[at.first[c]] == 0.0:
            table[c, [CLOSED, SLIDE, ROLL, SPIN]] = NONE
    return duration


def bring_back(at: Instant) -> None:
    """Project the state after a leap onto the manifold of its modes, and separate overlaps."""
    at.refresh()
    table, u = at.system.contact_table, velocities(at.system, at.y)
    under = [c for c in at.touching() if table[c, CLOSED] == 0.0 and table[c, GAP] < 0.0]
    if under:
        table[under, CLOSED] = 1.0
        at.call(SETTLE, at.t, at.y)
        set_velocities(at.system, at.y, u)
        table[under, CLOSED] = 0.0
    at.call(SETTLE, at.t, at.y)
    at.refresh()


def power_of_given(at: Instant, u: Array) -> float:
    """Power of the direct contact forces (compliant, viscous) at the velocities u [W]."""
    y, multipliers = at.y.copy(), at.system.vectors[MULTIPLIERS].copy()
    set_velocities(at.system, y, u)
    at.system.vectors[MULTIPLIERS] = 0.0
    power = power_of_contacts(at.system, y)
    at.system.vectors[MULTIPLIERS] = multipliers
    return float(power)
