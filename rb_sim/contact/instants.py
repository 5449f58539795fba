"""What happens at one instant: impacts, and the modes in which contacts go on.

Impact: u+ = u- + M^-1 J^T x with Newton's restitution v_n+ = -e v_n- where the contact pushes and
Coulomb's law between impulse and slip after it, all contacts at once; if that would create energy,
Poisson's two phases instead, and if they do too, no rebound (Glocker, Set-Valued Force Laws, 2001).
Modes: the same law between forces and accelerations (LL 38; Moreau 1988).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rb_sim.catalogue.constraints.contact import ContactLaw
from rb_sim.contact.complementarity import Bounded, Normal, Problem, Solution
from rb_sim.contact.dense import Call, Lines, inverse_mass, lines_at, set_velocities, velocities
from rb_sim.engine.contact_steps import SETTLE
from rb_sim.engine.samples import Array
from rb_sim.engine.systems.contact_bodies import (
    AHEAD,
    CLOSED,
    GAP,
    GAP_RATE,
    JAMMED,
    LIFT_OFF,
    NONE,
    NORMAL,
    ROLL,
    ROLL_AHEAD,
    ROLL_BEGINS,
    SIDE,
    SLIDE,
    SLIDING,
    SLIP,
    SLIP_BEGINS,
    SPIN,
    SPIN_AHEAD,
    SPIN_BEGINS,
    SPRING,
    STUCK,
    TURN,
    ContactBodies,
    line_of,
)
from rb_sim.engine.systems.many_bodies import WIDTH
from rb_sim.errors import SimulationError
from rb_sim.maths.vectors import perpendicular

TOUCHING = 1e-10
"""Gap, relative to the scene's length, at which surfaces touch."""
STILL = 1e-10
"""Speed, relative to the scene's, that is none: of approach, of slip, of turning."""
ENERGY_SLACK = 1e-12
"""Relative gain of kinetic energy in an impact that is round-off."""
MODE_ROUNDS = 8


@dataclass(frozen=True)
class Impact:
    """Impulses of one impact."""

    impulses: Array
    """of every line [N s] or [N m s], (n,)."""
    struck: tuple[int, ...]
    """contacts that approached."""
    rebound: tuple[int, ...]
    """contacts that separate after it."""


@dataclass(frozen=True)
class Modes:
    """How the contacts go on, and what could not be decided by the laws alone."""

    ambiguous: tuple[int, ...] = ()
    """slipping contacts that may as well lift off as stay (Painleve)."""


class Instant:
    """The contacts of a system at (t, y); y and the table of contacts are changed in place.

    Raises SimulationError where no modes or impulses satisfy the laws.
    """

    def __init__(
        self, system: ContactBodies, laws: Sequence[ContactLaw], call: Call, t: float, y: Array
    ) -> None:
        self.system, self.laws, self.t, self.y = system, laws, t, y
        self.call = call
        self.inverse_mass = inverse_mass(system)
        self.refresh()

    def refresh(self) -> None:
        """Write the lines again, after y or the modes have changed."""
        self.lines: Lines = lines_at(self.system, self.call, self.t, self.y)

    # geometry and tolerances

    def rigid(self, c: int) -> bool:
        return not self.laws[c].compliant

    def touching(self) -> list[int]:
        """Rigid contacts whose surfaces touch."""
        touch, near = self.system.touch, TOUCHING * self.system.length
        return [
            c
            for c in range(len(self.laws))
            if self.rigid(c) and (touch[c, GAP] <= near or self.laws[c].bilateral)
        ]

    @property
    def still(self) -> float:
        return STILL * self.system.speed

    def tangents(self, c: int) -> list[int]:
        k = line_of(self.system, c)
        return [k + 1, k + 2]

    def has_resistance(self, c: int) -> bool:
        first = self.system.first_row
        part = len(self.system.constraints) + c
        return bool(first[part + 1] - first[part] > 3)

    def slip_speed(self, c: int) -> float:
        return float(np.linalg.norm(self.system.touch[c, SLIP : SLIP + 3]))

    def turning(self, c: int) -> tuple[float, float]:
        """Relative angular speed across and along the normal [rad/s]."""
        turn, n = self.system.touch[c, TURN : TURN + 3], self.system.touch[c, NORMAL : NORMAL + 3]
        about = float(turn @ n)
        return float(np.linalg.norm(turn - about * n)), about

    # impacts

    def impact(self, plastic: frozenset[int] = frozenset()) -> Impact | None:
        """Let what approaches strike; None if nothing does. plastic: contacts without rebound."""
        touching = self.touching()
        struck = tuple(
            c
            for c in touching
            if self.system.touch[c, GAP_RATE] < -self.still or self._must_stop_slipping(c)
        )
        if not struck:
            return None
        u = velocities(self.system, self.y)
        v = self.lines.J @ u - self.lines.rate
        bounce = {
            c: 0.0 if c in plastic else self.laws[c].restitution
            for c in touching
            if v[line_of(self.system, c)] < 0.0
        }
        x = self._newton_impulses(touching, v, bounce)
        if x is None or self._gains(u, x):
            x = self._poisson_impulses(touching, v, bounce)
        if x is None or self._gains(u, x):
            x = self._newton_impulses(touching, v, {})
        if x is None:
            raise SimulationError(
                f"no impulses satisfy the laws of impact and friction at t = {self.t:.9g} s"
            )
        self.apply(x)
        v = self.lines.J @ velocities(self.system, self.y) - self.lines.rate
        rebound = tuple(c for c in touching if v[line_of(self.system, c)] > self.still)
        return Impact(x, struck, rebound)

    def _must_stop_slipping(self, c: int) -> bool:
        """A perfectly rough contact that has just come to be and slips."""
        rough = math.isinf(self.laws[c].static)
        return rough and self.system.touch[c, CLOSED] == 1.0 and self.slip_speed(c) > self.still

    def apply(self, x: Array) -> None:
        """Add the impulses x to the velocities, and their work to that of the contacts."""
        u = velocities(self.system, self.y)
        p = self.lines.J.T @ x
        du = self.inverse_mass @ p
        set_velocities(self.system, self.y, u + du)
        self.y[WIDTH * self.system.bodies.shape[0]] += float(p @ (u + 0.5 * du))
        self.refresh()

    def _gains(self, u: Array, x: Array) -> bool:
        """True if the impulses would create kinetic energy (driven supports may)."""
        p = self.lines.J.T @ x
        work = float(p @ (u + 0.5 * (self.inverse_mass @ p))) - float(x @ self.lines.rate)
        size = float(np.abs(p) @ np.abs(u)) + 1e-300
        return work > ENERGY_SLACK * size

    def _velocity_problem(
        self, touching: list[int], v: Array, bounce: dict[int, float], least: dict[int, float]
    ) -> Array | None:
        """Impulses with w = A x + v + e v-, on the lines of the touching contacts."""
        used = self._used_lines(touching)
        where = {k: i for i, k in enumerate(used)}
        A = self.lines.J[used] @ self.inverse_mass @ self.lines.J[used].T
        b = v[used].copy()
        normals, bounded, holding = [], [], []
        for c in touching:
            k, law = line_of(self.system, c), self.laws[c]
            b[where[k]] *= 1.0 + bounce.get(c, 0.0)
            normals.append(Normal(where[k], law.bilateral, least.get(c, 0.0)))
            bounds = self._bounds(c, where, law.kinetic)
            bounded += bounds
            if math.isinf(law.kinetic) and v[k] <= self.still:
                holding.append(bounds[0])
        u = np.abs(velocities(self.system, self.y))
        terms = np.abs(self.lines.J[used]) @ u + np.abs(self.lines.rate[used])
        solution = Problem(A, b, normals, bounded, terms).solve()
        if solution is None and holding:
            # what is perfectly rough stops the slip even where that alone lifts it off
            others = [item for item in bounded if item not in holding]
            solution = Problem(A, b, normals, others, terms).solve()
        if solution is None:
            return None
        x = np.zeros(len(v))
        x[used] = solution.x
        return x

    def _bounds(self, c: int, where: dict[int, int], coefficient: float) -> list[Bounded]:
        """Friction of contact c on slip, rolling and spinning."""
        k, law = line_of(self.system, c), self.laws[c]
        items = []
        if coefficient > 0.0:
            items.append(Bounded((where[k + 1], where[k + 2]), where[k], coefficient))
        if law.rolling_arm > 0.0:
            items.append(Bounded((where[k + 3], where[k + 4]), where[k], law.rolling_arm))
        if law.spinning_arm > 0.0:
            items.append(Bounded((where[k + 5],), where[k], law.spinning_arm))
        return items

    def _used_lines(self, contacts: list[int]) -> list[int]:
        """Lines of the constraints and of these contacts' normals and frictions, as in impacts."""
        used = list(range(line_of(self.system, 0)))
        for c in contacts:
            k, law = line_of(self.system, c), self.laws[c]
            used.append(k)
            if law.kinetic > 0.0:
                used += [k + 1, k + 2]
            if law.rolling_arm > 0.0:
                used += [k + 3, k + 4]
            if law.spinning_arm > 0.0:
                used.append(k + 5)
        return used

    def _newton_impulses(
        self, touching: list[int], v: Array, bounce: dict[int, float]
    ) -> Array | None:
        return self._velocity_problem(touching, v, bounce, {})

    def _poisson_impulses(
        self, touching: list[int], v: Array, bounce: dict[int, float]
    ) -> Array | None:
        """Compression to rest, then at least e times its normal impulse once more."""
        x = self._velocity_problem(touching, v, {}, {})
        if x is None:
            return None
        least = {c: e * float(x[line_of(self.system, c)]) for c, e in bounce.items()}
        after = v + self.lines.J @ (self.inverse_mass @ (self.lines.J.T @ x))
        again = self._velocity_problem(touching, after, {}, least)
        return None if again is None else x + again

    # modes

    def choose_modes(self, code: tuple[int, int] | None = None) -> Modes:
        """Decide which contacts are closed, slip, stick, roll, and project y onto that.

        code: (contact, kind) of the event that led here: what it ends does not go on.
        """
        self._compliant_modes()
        leaving = {code[0]} if code is not None and code[1] == LIFT_OFF else set()
        leaving = {c for c in leaving if not self.laws[c].bilateral}
        touch = self.system.touch
        candidates = []
        for c in range(len(self.laws)):
            if not self.rigid(c):
                continue
            near = c in self.touching() and abs(touch[c, GAP_RATE]) <= self.still
            if (near and c not in leaving) or self.laws[c].bilateral:
                candidates.append(c)
            else:
                self._open(c)
        sticking = [c for c in range(len(self.laws)) if self._compliant_closed(c)]
        for c in candidates:
            touch[c, CLOSED] = 1.0
            self._first_guess(c, code)
        for c in sticking:
            self._first_guess(c, code)
        slipped = {c for c in (*candidates, *sticking) if code == (c, SLIP_BEGINS)}
        rolled = {c for c in (*candidates, *sticking) if code == (c, ROLL_BEGINS)}
        spun = {c for c in (*candidates, *sticking) if code == (c, SPIN_BEGINS)}
        solution = self._accelerations(candidates, sticking, slipped, rolled, spun)
        if solution is None:
            raise JammedError(self.t)
        self.call(SETTLE, self.t, self.y)
        self.refresh()
        return Modes(self._ambiguous(candidates))

    def _open(self, c: int) -> None:
        self.system.touch[c, [CLOSED, SLIDE, ROLL, SPIN]] = NONE

    def _compliant_modes(self) -> None:
        """A compliant contact is closed where it is pressed and pushes."""
        touch = self.system.touch
        for c, law in enumerate(self.laws):
            if law.compliant:
                pressed = touch[c, GAP] < 0.0 and touch[c, SPRING] > 0.0
                if pressed:
                    touch[c, CLOSED] = 1.0
                else:
                    self._open(c)

    def _compliant_closed(self, c: int) -> bool:
        return self.laws[c].compliant and self.system.touch[c, CLOSED] == 1.0

    def _first_guess(self, c: int, code: tuple[int, int] | None) -> None:
        """Sliding where it moves; stuck, until the solve says otherwise, where it does not."""
        touch, law = self.system.touch, self.laws[c]
        if touch[c, SIDE] == 0.0:
            touch[c, SIDE] = 1.0
        if law.bilateral and code == (c, LIFT_OFF):
            touch[c, SIDE] = -touch[c, SIDE]
        slides = law.static == 0.0 or self.slip_speed(c) > self.still
        touch[c, SLIDE] = SLIDING if slides else STUCK
        if slides and self.slip_speed(c) > self.still:
            touch[c, AHEAD : AHEAD + 3] = touch[c, SLIP : SLIP + 3] / self.slip_speed(c)
        across, about = self.turning(c)
        slow = self.still / self.system.length
        touch[c, ROLL] = NONE if law.rolling_arm == 0.0 else SLIDING if across > slow else STUCK
        touch[c, SPIN] = (
            NONE if law.spinning_arm == 0.0 else SLIDING if abs(about) > slow else STUCK
        )
        if touch[c, ROLL] == SLIDING:
            n = touch[c, NORMAL : NORMAL + 3]
            touch[c, ROLL_AHEAD : ROLL_AHEAD + 3] = (touch[c, TURN : TURN + 3] - about * n) / across
        if touch[c, SPIN] == SLIDING:
            touch[c, SPIN_AHEAD] = math.copysign(1.0, about)

    def _accelerations(
        self,
        candidates: list[int],
        pressed: list[int],
        slipped: set[int],
        rolled: set[int],
        spun: set[int],
    ) -> Solution | None:
        """Solve for forces and accelerations; writes the modes that follow into the table."""
        for _ in range(MODE_ROUNDS):
            self.refresh()
            problem, used, kinds = self._force_problem(candidates, pressed, slipped, rolled, spun)
            solution = problem.solve()
            if solution is None:
                return None
            before = (len(slipped), len(rolled), len(spun))
            self._read_modes(candidates, pressed, solution, used, kinds, (slipped, rolled, spun))
            if before == (len(slipped), len(rolled), len(spun)):
                return solution
            for c in (*candidates, *pressed):  # the kinetic law now holds for what began to slide
                self.system.touch[c, CLOSED] = 1.0
                self._first_guess(c, None)
        return solution

    def _force_problem(
        self,
        candidates: list[int],
        pressed: list[int],
        slipped: set[int],
        rolled: set[int],
        spun: set[int],
    ) -> tuple[Problem, list[int], dict[int, list[tuple[int, Bounded]]]]:
        """The problem between forces and accelerations in the modes of the table."""
        touch, joints = self.system.touch, line_of(self.system, 0)
        used = list(range(joints))
        for c in (*candidates, *pressed):
            k = line_of(self.system, c)
            used += [k] if c in candidates else []
            used += [k + 1, k + 2] if touch[c, SLIDE] == STUCK else []
            used += [k + 3, k + 4] if touch[c, ROLL] == STUCK else []
            used += [k + 5] if touch[c, SPIN] == STUCK else []
        where = {k: i for i, k in enumerate(used)}
        J, W = self.lines.J[used], self.lines.W[used]
        A = J @ self.inverse_mass @ W.T
        b = J @ self.lines.free + self.lines.bias[used]
        terms = np.abs(J) @ np.abs(self.lines.free) + np.abs(self.lines.bias[used])
        normals = [
            Normal(where[line_of(self.system, c)], self.laws[c].bilateral) for c in candidates
        ]
        bounded, kinds = [], {}
        extra: list[int] = []
        for c in (*candidates, *pressed):
            k, law = line_of(self.system, c), self.laws[c]
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
                    bound = kinetic if c in moved else static
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
        return Problem(A, b, normals, bounded, terms), used, kinds

    def _read_modes(
        self,
        candidates: list[int],
        pressed: list[int],
        solution: Solution,
        used: list[int],
        kinds: dict[int, list[tuple[int, Bounded]]],
        moved: tuple[set[int], set[int], set[int]],
    ) -> None:
        """Modes from forces and accelerations."""
        touch = self.system.touch
        where = {k: i for i, k in enumerate(used)}
        size = float(np.abs(solution.w).max(initial=0.0)) + float(np.abs(self.lines.free).max())
        for c in candidates:
            i = where[line_of(self.system, c)]
            opens = not self.laws[c].bilateral and solution.w[i] > 1e-10 * size
            if opens:
                self._open(c)
            if self.laws[c].bilateral and touch[c, SLIDE] != SLIDING:
                touch[c, SIDE] = -1.0 if solution.x[i] < 0.0 else 1.0
        for c in (*candidates, *pressed):
            if touch[c, CLOSED] == 0.0:
                continue
            for mode, item in kinds.get(c, ()):
                set_of = moved[(SLIDE, ROLL, SPIN).index(mode)]
                self._read_one(c, mode, item, solution, size, set_of)

    def _read_one(
        self, c: int, mode: int, item: Bounded, solution: Solution, size: float, moved: set[int]
    ) -> None:
        """Stuck, or sliding from rest in the direction in which it starts."""
        touch = self.system.touch
        i = list(item.lines)
        x, w = solution.x[i], solution.w[i]
        rate = float(np.linalg.norm(w))
        begins = rate > 1e-10 * size / (1.0 if mode == SLIDE else self.system.length)
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
        at = AHEAD if mode == SLIDE else ROLL_AHEAD
        touch[c, at : at + 3] = along[0] * t1 + along[1] * t2

    def _ambiguous(self, candidates: list[int]) -> tuple[int, ...]:
        """Slipping contacts that were opened though their effective pivot is negative."""
        touch = self.system.touch
        return tuple(
            c for c in candidates if touch[c, CLOSED] == 0.0 and self._effective_pivot(c) < JAMMED
        )

    def _effective_pivot(self, c: int) -> float:
        """n . M^-1 (n + T/N) over n . M^-1 n for the slip that contact c has."""
        speed, law = self.slip_speed(c), self.laws[c]
        if speed <= self.still or not 0.0 < law.kinetic < math.inf:
            return 1.0
        k = line_of(self.system, c)
        J = self.lines.J
        n = self.system.touch[c, NORMAL : NORMAL + 3]
        t1, t2 = frame(n)
        d = self.system.touch[c, SLIP : SLIP + 3] / speed
        push = J[k] - law.kinetic * (float(d @ t1) * J[k + 1] + float(d @ t2) * J[k + 2])
        ideal = float(J[k] @ self.inverse_mass @ J[k])
        return float(J[k] @ self.inverse_mass @ push) / ideal


def frame(n: Array) -> tuple[Array, Array]:
    """The tangents that the kernels use."""
    t1, t2 = perpendicular(tuple(float(x) for x in n))
    return np.array(t1), np.array(t2)


class JammedError(SimulationError):
    """No force keeps a slipping contact from penetrating (Painleve's paradox)."""

    def __init__(self, t: float) -> None:
        super().__init__(f"no contact force satisfies Coulomb's law at t = {t:.9g} s")
        self.t = t
