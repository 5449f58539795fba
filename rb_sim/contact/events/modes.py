"""Which contacts go on closed, slip, stick or roll: the laws between forces and accelerations.

A closed contact pushes or opens, friction bounds the force at rest and opposes the slip that begins
(LL 38; Moreau 1988); solved for all contacts at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rb_sim.contact.events.complementarity import Bounded, Normal, Problem, Solution, items_of
from rb_sim.contact.events.dense import SETTLE
from rb_sim.contact.events.instant import Instant, frame
from rb_sim.contact.events.shares import share_load
from rb_sim.contact.geometry.rims_on_cylinders import ABSENT
from rb_sim.contact.system.bodies import (
    JAMMED,
    LIFT_OFF,
    ROLL_BEGINS,
    SLIP_BEGINS,
    SPIN_BEGINS,
)
from rb_sim.contact.system.terms import NONE, SLIDING, STUCK
from rb_sim.contact.system.touch import (
    AHEAD,
    CLOSED,
    GAP,
    GAP_RATE,
    NORMAL,
    ROLL,
    ROLL_AHEAD,
    SENSE,
    SIDE,
    SLIDE,
    SLIP,
    SPIN,
    SPIN_AHEAD,
    SPRING,
    TURN,
)
from rb_sim.errors import SimulationError

MODE_ROUNDS = 8
EASED = 1e-8
"""Part of all bounds taken off where one has been reached: what shares the load, as the ends of an
edge, begins to slip as one, and in directions that go together."""
Bounds = dict[int, list[tuple[int, Bounded]]]
"""By contact: (mode, bound) of each of its ways to move."""


@dataclass(frozen=True)
class Modes:
    """How the contacts go on, and what could not be decided by the laws alone."""

    ambiguous: tuple[int, ...] = ()
    """slipping contacts that may as well lift off as stay (Painleve)."""


class JammedError(SimulationError):
    """No force keeps a slipping contact from penetrating (Painleve's paradox)."""

    def __init__(self, t: float) -> None:
        super().__init__(f"no contact force satisfies Coulomb's law at t = {t:.9g} s")
        self.t = t


def choose_modes(
    at: Instant, code: tuple[int, int] | None = None, opened: frozenset[int] = frozenset()
) -> Modes:
    """Decide which contacts are closed, slip, stick, roll, and project y onto that.

    code: (contact, kind) of the event that led here: what it ends does not go on; opened: contacts
    that do not close either.
    """
    compliant_modes(at)
    leaving = opened | {code[0]} if code is not None and code[1] == LIFT_OFF else opened
    leaving = frozenset(c for c in leaving if not at.laws[c].bilateral)
    touch, touching = at.system.touch, at.touching()
    candidates = []
    rates = touch[:, GAP_RATE].tolist()
    for c, law in enumerate(at.laws):
        if law.compliant:
            continue
        near = abs(rates[c]) <= at.still and c in touching
        if (near and c not in leaving) or law.bilateral:
            candidates.append(c)
        else:
            open_contact(at, c)
    sticking = [c for c, law in enumerate(at.laws) if law.compliant and is_pressed(at, c)]
    for c in candidates:
        touch[c, CLOSED] = 1.0
        first_guess(at, c, code)
    for c in sticking:
        first_guess(at, c, code)
    slipped = {c for c in (*candidates, *sticking) if code == (c, SLIP_BEGINS)}
    rolled = {c for c in (*candidates, *sticking) if code == (c, ROLL_BEGINS)}
    spun = {c for c in (*candidates, *sticking) if code == (c, SPIN_BEGINS)}
    closed = candidates or sticking
    if closed and forces(at, candidates, sticking, slipped, rolled, spun) is None:
        raise JammedError(at.t)
    at.call(SETTLE, at.t, at.y)
    at.refresh()
    share_load(at)
    return Modes(ambiguous(at, candidates))


def open_contact(at: Instant, c: int) -> None:
    at.system.touch[c, CLOSED : SPIN + 1] = NONE


def compliant_modes(at: Instant) -> None:
    """A compliant contact is closed where it is pressed and pushes."""
    touch = at.system.touch
    for c, law in enumerate(at.laws):
        if law.compliant:
            there = touch[c, SENSE] != ABSENT
            if there and touch[c, GAP] < 0.0 and touch[c, SPRING] > 0.0:
                touch[c, CLOSED] = 1.0
            else:
                open_contact(at, c)


def is_pressed(at: Instant, c: int) -> bool:
    return at.laws[c].compliant and at.system.touch[c, CLOSED] == 1.0


def first_guess(at: Instant, c: int, code: tuple[int, int] | None) -> None:
    """Sliding where it moves; stuck, until the solve says otherwise, where it does not."""
    touch, law = at.system.touch, at.laws[c]
    if touch[c, SIDE] == 0.0:
        touch[c, SIDE] = 1.0
    if law.bilateral and code == (c, LIFT_OFF):
        touch[c, SIDE] = -touch[c, SIDE]
    slides = law.static == 0.0 or at.slip_speed(c) > at.still
    touch[c, SLIDE] = SLIDING if slides else STUCK
    if slides and at.slip_speed(c) > at.still:
        touch[c, AHEAD : AHEAD + 3] = touch[c, SLIP : SLIP + 3] / at.slip_speed(c)
    across, about = at.turning(c)
    slow = at.still / at.system.length
    touch[c, ROLL] = NONE if law.rolling_arm == 0.0 else SLIDING if across > slow else STUCK
    touch[c, SPIN] = NONE if law.spinning_arm == 0.0 else SLIDING if abs(about) > slow else STUCK
    if touch[c, ROLL] == SLIDING:
        n = touch[c, NORMAL : NORMAL + 3]
        touch[c, ROLL_AHEAD : ROLL_AHEAD + 3] = (touch[c, TURN : TURN + 3] - about * n) / across
    if touch[c, SPIN] == SLIDING:
        touch[c, SPIN_AHEAD] = math.copysign(1.0, about)


def forces(
    at: Instant,
    candidates: list[int],
    pressed: list[int],
    slipped: set[int],
    rolled: set[int],
    spun: set[int],
) -> Solution | None:
    """Solve for forces and accelerations; writes the modes that follow into the table."""
    for _ in range(MODE_ROUNDS):
        at.refresh()
        problem, used, kinds = force_problem(at, candidates, pressed, slipped, rolled, spun)
        solution = problem.solve(at.compiled)
        if solution is None:
            return None
        before = (len(slipped), len(rolled), len(spun))
        read_modes(at, candidates, pressed, solution, used, kinds, (slipped, rolled, spun))
        if before == (len(slipped), len(rolled), len(spun)):
            return solution
        for c in (*candidates, *pressed):  # the kinetic law now holds for what began to slide
            at.system.touch[c, CLOSED] = 1.0
            first_guess(at, c, None)
    return solution


def force_problem(
    at: Instant,
    candidates: list[int],
    pressed: list[int],
    slipped: set[int],
    rolled: set[int],
    spun: set[int],
) -> tuple[Problem, list[int], Bounds]:
    """The problem between forces and accelerations in the modes of the table."""
    touch, joints = at.system.touch, at.first[0]
    used = list(range(joints))
    for c in (*candidates, *pressed):
        k = at.first[c]
        used += [k] if c in candidates else []
        used += [k + 1, k + 2] if touch[c, SLIDE] == STUCK else []
        used += [k + 3, k + 4] if touch[c, ROLL] == STUCK else []
        used += [k + 5] if touch[c, SPIN] == STUCK else []
    where = {k: i for i, k in enumerate(used)}
    J, W = at.lines.J[used], at.lines.W[used]
    A = J @ at.inverse_mass @ W.T
    b = J @ at.lines.free + at.lines.bias[used]
    terms = np.abs(J) @ np.abs(at.lines.free) + np.abs(at.lines.bias[used])
    normals = [Normal(where[at.first[c]], at.laws[c].bilateral) for c in candidates]
    bounded, kinds = [], {}
    ease = 1.0 - EASED if slipped or rolled or spun else 1.0
    extra: list[int] = []
    for c in (*candidates, *pressed):
        k, law = at.first[c], at.laws[c]
        if c in candidates:
            normal = where[k]
        else:  # a given force: a line of its own that always has this value
            normal = len(used) + len(extra)
            extra.append(c)
        for mode, lines, static, kinetic, moved in (
            (SLIDE, (k + 1, k + 2), law.static, law.kinetic, slipped),
            (ROLL, (k + 3, k + 4), law.rolling_arm, law.rolling_arm, rolled),
            (SPIN, (k + 5,), law.spinning_arm, law.spinning_arm, spun),
        ):
            if touch[c, mode] == STUCK:
                bound = ease * (kinetic if c in moved else static)
                item = Bounded(tuple(where[i] for i in lines), normal, bound)
                bounded.append(item)
                kinds.setdefault(c, []).append((mode, item))
    if extra:
        n, m = len(used), len(extra)
        A = np.block([[A, np.zeros((n, m))], [np.zeros((m, n)), np.eye(m)]])
        given = [touch[c, SPRING] for c in extra]
        b = np.concatenate([b, [-force for force in given]])
        terms = np.concatenate([terms, given])
        normals += [Normal(n + i, True) for i in range(m)]
    return Problem(A, b, items_of(len(b), normals, bounded), terms), used, kinds


def read_modes(
    at: Instant,
    candidates: list[int],
    pressed: list[int],
    solution: Solution,
    used: list[int],
    kinds: Bounds,
    moved: tuple[set[int], set[int], set[int]],
) -> None:
    """Modes from forces and accelerations."""
    touch = at.system.touch
    where = {k: i for i, k in enumerate(used)}
    size = float(np.abs(solution.w).max(initial=0.0)) + float(np.abs(at.lines.free).max())
    for c in candidates:
        i = where[at.first[c]]
        opens = not at.laws[c].bilateral and solution.w[i] > 1e-10 * size
        if opens:
            open_contact(at, c)
        if at.laws[c].bilateral and touch[c, SLIDE] != SLIDING:
            touch[c, SIDE] = -1.0 if solution.x[i] < 0.0 else 1.0
    for c in (*candidates, *pressed):
        if touch[c, CLOSED] == 0.0:
            continue
        for mode, item in kinds.get(c, ()):
            set_of = moved[(SLIDE, ROLL, SPIN).index(mode)]
            read_one(at, c, mode, item, solution, size, set_of)


def read_one(
    at: Instant, c: int, mode: int, item: Bounded, solution: Solution, size: float, moved: set[int]
) -> None:
    """Stuck, or sliding from rest in the direction in which it starts."""
    touch = at.system.touch
    i = list(item.lines)
    x, w = solution.x[i], solution.w[i]
    rate = float(np.linalg.norm(w))
    begins = rate > 1e-10 * size / (1.0 if mode == SLIDE else at.system.length)
    if not begins and c not in moved:
        touch[c, mode] = STUCK
        return
    moved.add(c)
    force = float(np.linalg.norm(x))
    along = w / rate if begins else (-x / force if force > 0.0 else np.zeros(len(i)))
    touch[c, mode] = SLIDING
    if mode == SPIN:
        touch[c, SPIN_AHEAD] = math.copysign(1.0, along[0])
        return
    n = touch[c, NORMAL : NORMAL + 3]
    t1, t2 = frame(n)
    ahead = AHEAD if mode == SLIDE else ROLL_AHEAD
    touch[c, ahead : ahead + 3] = along[0] * t1 + along[1] * t2


def ambiguous(at: Instant, candidates: list[int]) -> tuple[int, ...]:
    """Slipping contacts that were opened though their effective pivot is negative."""
    touch = at.system.touch
    return tuple(
        c for c in candidates if touch[c, CLOSED] == 0.0 and at.effective_pivot(c) < JAMMED
    )
