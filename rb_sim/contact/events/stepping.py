"""The stepping loop of bodies in contact from event to event: methods, step control."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any

import numpy as np

from rb_sim.base.errors import SimulationError, StepTooLargeError
from rb_sim.catalogue.effects.wrench import BodyHarmonicRow, WorldHarmonicRow
from rb_sim.catalogue.geometry.carriers import Shaken, Turntable, carrier
from rb_sim.catalogue.geometry.pairs import touching
from rb_sim.catalogue.types import WORLD
from rb_sim.contact.events.grid import Stepping
from rb_sim.contact.events.instant import told
from rb_sim.contact.events.limits import TOOL
from rb_sim.contact.events.next_event import KEPT
from rb_sim.contact.events.shares import turned_by_rounding
from rb_sim.contact.events.steps import EVENT, record_contacts
from rb_sim.contact.events.tasks import BEGIN, Tasks
from rb_sim.contact.grid_motion import GridMotion, LeftOpen
from rb_sim.contact.tunnelling import refuse_sunk, run_looking
from rb_sim.graph.machine import interpreted
from rb_sim.integrate.layout import (
    FLOOR,
    IS_VELOCITY,
    NOT_FINITE,
    SHARE_OF_WAY,
    UNFINISHED,
    WORK_ROWS,
    held,
)
from rb_sim.integrate.methods.radau5 import radau5_of_slips
from rb_sim.mechanics.contact.contact_bodies import least_slip
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING
from rb_sim.mechanics.contact.contact_laws import ContactLaws, rate_of_change
from rb_sim.mechanics.contact.contact_table import CLOSED, COMPLIANT, SLIDE, SLIP, STATIC
from rb_sim.mechanics.contact.creep import rubs
from rb_sim.mechanics.contact.motion_kernels import contact_rate
from rb_sim.mechanics.error_scales import OF_SYMMETRIC, spin_lengths
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS, WIDTH, state_of, vec
from rb_sim.motion.traced import settings_of
from rb_sim.numerics.kernels import by_address, inline
from rb_sim.numerics.vectors import norm
from rb_sim.scene.compiled import Compiled

# df/dy of bodies in contact, by differences, for implicit steps where friction is stiff.
#
# A slow slip s is turned by friction at a rate that changes with s over |s| itself: differences are
# small parts of the slowest slip.


OF_SLIP = 1e-4
"""Difference of velocities, over the slowest slip: what is left out is as much of the entry."""
OF_PLACES = 1e-3
"""Difference of places, in lengths of the scene, over the slowest slip, in its speeds: a support
that turns makes a slip of it."""
LEAST, MOST = 1e-12, 1e-8
"""Bounds of the difference of places, in lengths of the scene, and of quaternions: below rounding
counts, above the bend of the equations."""
FASTEST = 1e-3
"""Slip, in speeds of the scene, beyond which differences do not grow with it."""


@inline
def slowest_slip(system):
    """The least speed of a slip whose friction has a corner, over the scene's."""
    touch, least = system.touch, FASTEST * system.speed
    for c in range(touch.shape[0]):
        if rubs(touch, c):
            least = min(least, max(norm(vec(touch, c, SLIP)), least_slip(system, c)))
    return least / system.speed


@inline
def difference(system, k, slip):
    """Of the k-th coordinate of a body; slip: the slowest."""
    if k >= 7:
        speed = OF_SLIP * slip * system.speed
        return speed if k < 10 else speed / system.length
    place = max(LEAST, min(MOST, OF_PLACES * slip))
    return place * system.length if k < 3 else place


@by_address
def jacobian_by_differences(t, y, p, out):
    """df_i/dy_j into out[n i + j], n numbers of y; of the contacts' work, the last, nothing
    depends."""
    system = held(p)
    n = WIDTH * system.bodies.shape[0] + 1
    f, g, at = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        at[i] = y[i]
        out[n * i + n - 1] = 0.0
    contact_rate(system, t, at, f)
    slip = slowest_slip(system)
    for j in range(n - 1):
        step = difference(system, j % WIDTH, slip)
        at[j] = y[j] + step
        contact_rate(system, t, at, f)
        width = at[j]
        at[j] = y[j] - step
        contact_rate(system, t, at, g)
        width -= at[j]
        at[j] = y[j]
        for i in range(n):
            out[n * i + j] = (f[i] - g[i]) / width


# How long an adaptive step may be where a support or a force comes and goes with time alone.
#
# The equations of bodies in flight know nothing of a support that they do not touch, and those of
# bodies at rest nothing of a force that friction holds: a step may be as long as the flight or the
# rest, while the support or the force comes and goes many times.


SHARE_OF_PERIOD = 0.125
"""Of a period, within which a gap, or the distance of a force to its bound, has one minimum at
most."""
PHASES = (0.13, 0.31, 0.57, 0.83)
"""Of a turn, at which a turning surface must lie where it was, to count as at rest."""


def paced(compiled: Compiled, method: Any) -> Any:
    """The method with steps no longer than a share of the shortest period of the scene."""
    largest = getattr(method, "largest_step", None)
    if largest is None:
        return method
    return method._replace(largest_step=min(largest, SHARE_OF_PERIOD * shortest_period(compiled)))


def shortest_period(compiled: Compiled) -> float:
    """Of all harmonic forces, and supports whose surface moves as prescribed; inf if none [s]."""
    shortest = math.inf
    for effect in compiled.system.effects:
        if isinstance(effect.row, WorldHarmonicRow | BodyHarmonicRow):
            rate = abs(effect.row.angular_frequency)
            shortest = min(shortest, 2.0 * math.pi / rate if rate > 0.0 else math.inf)
    for group in compiled.system.contacts:
        for contact in group:
            motion = contact.row.carrier
            if isinstance(motion, Shaken):
                shortest = min(shortest, 2.0 * math.pi / motion.frequency)
            elif isinstance(motion, Turntable) and wobbles(compiled, contact):
                shortest = min(shortest, 2.0 * math.pi / float(np.linalg.norm(motion.spin)))
    return shortest


def wobbles(compiled: Compiled, contact: Any) -> bool:
    """True if the turning support's surface does not turn into itself."""
    motion = contact.row.carrier
    rate = float(np.linalg.norm(motion.spin))
    if rate == 0.0:
        return False
    B = state_of(compiled.y, contact.body)
    gaps = [
        touching(contact.row.pair, B, carrier(motion, 2.0 * math.pi * turn / rate, WORLD)[0]).gap
        for turn in (0.0, *PHASES)
    ]
    return max(gaps) - min(gaps) > 1e-9 * compiled.system.length


# Methods as the loop of bodies in contact takes them, and the slips that they follow.


NOISE = 30.0
"""Slip in tolerances of an adaptive method whose direction is lost in its errors: explicit methods
turn it about where steps that keep the tolerance are too long for its stiffness."""
CREEP = 1e-9
"""Slip, relative to the scene's speed, below which contacts that give way creep in steps of an
adaptive method; above, implicit steps follow it."""


def slow_slips(system: Any, method: Any) -> dict[str, float]:
    """The slips [m/s] that are lost in errors, and that creep."""
    tolerance = getattr(method, "tolerance", 0.0)
    creep = CREEP * system.speed if tolerance > 0.0 else 0.0
    return {"still": max(system.still, NOISE * tolerance), "creep": creep}


def stepping_of(compiled: Compiled, method: Any, rubs: bool) -> Stepping:
    """rubs: whether slips may be slow and stiff."""
    step, setting = settings_of(paced(compiled, method))
    implicit: tuple[Any, Any] = 0, 0
    if rubs and getattr(method, "tolerance", 0.0) > 0.0:
        implicit = radau5_of_slips.reference, jacobian_by_differences.address
    setting = (*setting, float(step.implicit > 0))
    return Stepping(step.reference, rate_of_change.address, setting, *implicit)


# The grid of steps of bodies in contact from event to event: the loop is called, and its tables.
#
# What an event does is for a subclass (`motion`).


MOST_CUT, CREEPS = 4096, 256
"""Lengths of fixed steps that may be cut from steps on one grid while nothing rubs; and, from there
on, times the way ahead that may be cut as well."""

STALLED_STEPS, STALLED_SPAN = 100_000, 1e-4
"""So many steps within so short a time (natural units) are no motion any more: a whole unit of it
would take a milliard."""

ROUNDING = 1e-13
"""Of the work of contacts, relative to the energy of a scene."""


class EventStepping(GridMotion):
    """As GridMotion, stopped at each event, for which `_event` is called."""

    names: tuple[str, ...]
    """of the points of contact."""

    def __init__(self, compiled: Compiled, method: Any) -> None:
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

    def reset(self, y: Any = None, time: float = 0.0) -> None:
        super().reset(y, time)
        system = self.compiled.system
        # tables that outlast an evaluation: another motion of the scene has its own
        own = {name: getattr(system, name).copy() for name in ("touch", "vectors", "rows", "lines")}
        self.system = system._replace(**own, **slow_slips(system, self.method))
        self._packed: Any = None
        self._made: tuple[Any, Tasks] | None = None
        self._inputs = np.array([*self._laws.inputs.values(self.system, time), 0.0])
        self._places = np.array(self._laws.inputs.kept(self.system), dtype=int)
        """of the inputs that laws keep from step to step."""
        self._due = -1
        self._pause = math.inf
        self._begun = time
        self._mark = 0, time
        self._kept = np.zeros((len(self.names), KEPT))
        moments = system.bodies[:, INERTIA + OF_SYMMETRIC]
        self._arms = np.ascontiguousarray(
            spin_lengths(moments, system.bodies[:, MASS]).reshape(-1, 9)
        )

    @abstractmethod
    def _event(self) -> None:
        """Deal with the event that is due, at the grid's last point."""

    def _laws_now(self) -> str:
        """What linear algebra is done for, and when."""
        return f"the laws of contact at t = {self.time:.9g} s"

    @property
    def _fixed(self) -> bool:
        """True of a method whose steps have a fixed length."""
        return getattr(self.method, "tolerance", 0.0) == 0.0

    @property
    def _doubted(self) -> LeftOpen:
        """How far rounding has turned rims that hardly missed flat."""
        return turned_by_rounding(self._kept, self.names)

    def _explain(self, status: int) -> str:
        """As Motion; also which slips an implicit method may not follow."""
        touch, text = self.system.touch, super()._explain(status)
        rubs = (touch[:, CLOSED] == 1.0) & (touch[:, SLIDE] == SLIDING) & (touch[:, STATIC] > 0.0)
        if status != NOT_FINITE or not self._stepping.setting[4] or not rubs.any():
            return text
        names = ", ".join(name for name, rub in zip(self.names, rubs, strict=True) if rub)
        return f"{text}: its iteration may fail at slow slips with friction ({names})"

    def _record(self, times: Array, stop: float, out: Array | None) -> None:
        with told(self._laws_now):
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
                refuse_sunk(self.compiled.sides, *last, self.system.length)
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
            )  # fmt: skip
            if reached and n:
                self.time = float(times[done + reached - 1])
                done += reached
            if status == EVENT:
                self._event()
            elif status == UNFINISHED:
                self.watch()
                self._refuse_to_stall()
                self._refuse_to_creep()
            elif status:
                raise self._failure(status)
            elif not n:
                self._pass_pause()

    def _refuse_to_creep(self) -> None:
        """Raise SimulationError where steps of fixed length have no solution over and over, and are
        cut each time, though nothing rubs: they come near no end of a slip, which has none beyond,
        but creep through loads that they are too long for."""
        cut = self._begun - self._grid.origin  # each step that is cut moves the origin back
        ahead = self._grid.t1 - self._begun
        if not self._fixed or cut <= CREEPS * ahead + MOST_CUT * self.method.step:
            return
        touch = self.system.touch
        if not ((touch[:, CLOSED] == 1.0) & (touch[:, SLIDE] != NONE)).any():
            raise self._failure(NOT_FINITE)

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

    def _begin_grid(self, t: float, y: Any, h: float) -> None:
        super()._begin_grid(t, y, h)
        self._begun = t

    @property
    def _stepping(self) -> Stepping:
        """The method, as the loop takes it; made anew where `method` is another one."""
        if self._taken is None or self._taken[0] is not self.method:
            touch = self.system.touch
            rubs = bool(((touch[:, STATIC] > 0.0) & (touch[:, COMPLIANT] == 1.0)).any())
            taken = stepping_of(self.compiled, self.method, rubs)
            self._taken = self.method, taken
        return self._taken[1]

    def _take_inputs(self, onwards: bool = True) -> None:
        """Commands and tables from now on, or at this instant alone."""
        kept = self.kept
        self._inputs[:-1] = self._laws.inputs.values(self.system, self.time, onwards)
        self.kept = kept

    @property
    def kept(self) -> Array:
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
