"""Impacts, jammed slips (Painleve) and impulse steps: what ends at an instant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.base.errors import SimulationError, StepTooLargeError
from rb_sim.catalogue.contacts.touching import ContactLaw
from rb_sim.contact.events import tasks
from rb_sim.contact.events.flat_rims import aim_where_it_turns, rims_of
from rb_sim.contact.events.instant import Instant, not_finite, pseudo_inverse
from rb_sim.contact.events.limits import TOOL, refuse_rough
from rb_sim.contact.events.shares import OF
from rb_sim.contact.events.stepping import EventStepping
from rb_sim.contact.events.tasks import SETTLE
from rb_sim.contact.problem.bounces import AT_ONCE, Chatter
from rb_sim.contact.problem.delassus import set_velocities, velocities
from rb_sim.contact.problem.event_workspace import JAMS, LEAPS, Journal, turn_that_is_none, turning
from rb_sim.contact.problem.forces import CANDIDATE, PRESSED, SOLVED
from rb_sim.contact.problem.impacts import ENDLESS, GOES_ON, NO_IMPULSES, NOTHING, OVERFLOWN
from rb_sim.mechanics.contact.accelerations import power_of_contacts
from rb_sim.mechanics.contact.contact_bodies import NEAR_JAM
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import CLOSED, GAP, ROLL, SLIDE, SPIN
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import MULTIPLIERS, WIDTH
from rb_sim.numerics.vectors import norm, quaternion_rate
from rb_sim.scene.compiled import Compiled

# The impulse process of one contact that jams: Painleve's paradox resolved by an impact.
#
# While the contact slips, its velocities change with the normal impulse p as dv/dp = A (n - mu
# s/|s|); they go on until the slip has stopped and the normal velocity, which that drives downward,
# has come back to zero: compression.  Restitution adds e times its impulse (Darboux 1880, Keller
# 1986; "impact without collision", Genot and Brogliato 1999).


DRIVEN, LIFTED = -1e-5, 1e-2
"""Normal velocities, relative to the slip, at which the contact is driven in and leaves: where the
effective pivot just vanishes, it does neither until the slip has stopped."""
TIGHT = {"rtol": 1e-12, "atol": 1e-14, "method": "DOP853"}


def impulse_process(A: Array, v: Array, friction: float, restitution: float) -> Array | None:
    """Impulse (n, t1, t2) of a contact with velocities v = (v_n, s) and A = J M^-1 J^T, (3, 3).

    None if the process does not end: the slip never stops while the contact holds.
    """
    size, stiffness = float(np.linalg.norm(v)) + 1e-300, A[0, 0]
    found = natural_process(A / stiffness, v / size, friction, restitution)
    return None if found is None else (size / stiffness) * found


def slopes_and_events(A: Array, v: Array, friction: float) -> tuple[Any, ...]:
    """(dx/dp, events of the end of the slip, of being driven in, of leaving, of coming back)."""

    def push(s: Array, last: Array) -> Array:
        speed = float(np.linalg.norm(s))
        d = s / speed if speed > 0.0 else last
        return np.array([1.0, -friction * d[0], -friction * d[1]])

    ahead = v[1:] / max(float(np.linalg.norm(v[1:])), 1e-300)

    def slope(p: float, x: Array) -> Array:
        f = push(v[1:] + (A @ x)[1:], ahead)
        if float((v[1:] + (A @ x)[1:]) @ ahead) < 0.0:
            f[1:] = -f[1:]
        return f

    def slip(p: float, x: Array) -> float:
        return float((v[1:] + (A @ x)[1:]) @ ahead)

    def normal(p: float, x: Array, level: float) -> float:
        return float(v[0] + (A @ x)[0]) - level

    def driven_in(p: float, x: Array) -> float:
        return normal(p, x, DRIVEN)

    def lifted(p: float, x: Array) -> float:
        return normal(p, x, LIFTED)

    def back(p: float, x: Array) -> float:
        return normal(p, x, 0.0)

    for event, direction in ((slip, -1.0), (driven_in, -1.0), (lifted, 1.0), (back, 1.0)):
        event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
    return slope, slip, driven_in, lifted, back


def natural_process(A: Array, v: Array, friction: float, restitution: float) -> Array | None:
    """As `impulse_process`, of |v| = 1 and A[0, 0] = 1, in which TIGHT means something: the impulse
    of a rod of a micrometre is 1e-21 N s."""
    from scipy.integrate import solve_ivp  # half a second to import, and hardly ever needed

    slope, slip, driven_in, lifted, back = slopes_and_events(A, v, friction)
    most = 1e6
    sliding = solve_ivp(slope, (0.0, most), np.zeros(3), events=(slip, driven_in, lifted), **TIGHT)
    if len(sliding.t_events[1]):
        start = (sliding.t[-1], most)
        sliding = solve_ivp(slope, start, sliding.y[:, -1], events=(slip, back), **TIGHT)
    elif not len(sliding.t_events[0]):
        return None
    if not any(len(instants) for instants in sliding.t_events):
        return None
    x = sliding.y[:, -1]
    if len(sliding.t_events[0]):
        x = x + _after_slip(A, v + A @ x, friction)
    compressed = x[0]
    if restitution > 0.0 and compressed > 0.0:
        x = x + restitution * compressed * _stuck_or_sliding(A, friction)
    return x


def _stuck_or_sliding(A: Array, friction: float) -> Array:
    """Direction of the impulse per unit of normal impulse at a contact without slip."""
    along = pseudo_inverse(A[1:, 1:], "the impulses of a jammed contact") @ A[1:, 0]
    stuck = np.concatenate([[1.0], -along])
    if np.linalg.norm(stuck[1:]) <= friction:
        return stuck
    return np.concatenate([[1.0], friction * stuck[1:] / np.linalg.norm(stuck[1:])])


def _after_slip(A: Array, v: Array, friction: float) -> Array:
    """What is still needed for the normal velocity to come back to zero once slip has stopped."""
    direction = _stuck_or_sliding(A, friction)
    rise = float((A @ direction)[0])
    return direction * max(0.0, -v[0] / rise) if rise > 0.0 else np.zeros(3)


# What stops a slip that jams (Painleve's paradox): the impulses of all lines.


def impulses_of_jam(at: Instant, c: int) -> Array | None:
    """Impulses of all lines for the impulse process of contact c, joints taking part; None if the
    process has no end."""
    k, joints = at.first[c], at.first[0]
    J = at.workspace.J
    own = J[k : k + 3]
    A = at.pivot_of(own, own)
    v = own @ velocities(at.system, at.y)
    v = v - at.workspace.line_rate[k : k + 3]
    law = at.laws[c]
    x = impulse_process(A, v, law.kinetic, law.restitution)
    if x is None:
        return None
    out = np.zeros(len(J))
    out[k : k + 3], out[:joints] = x, -at.taken_by_joints(own) @ x
    return out


def least_lifted(at: Instant) -> int | None:
    """The touching contact that its own push and the friction that follows it lift least; None if
    there is none."""
    lines = [at.first[c] for c in at.touching()]
    if not lines:
        return None
    J, W = at.workspace.J[lines], at.workspace.W[lines]
    lifted, alone = (np.einsum("ij,jk,ik->i", J, at.inverse_mass, P) for P in (W, J))
    return at.touching()[int(np.argmin(lifted / alone))]


# A short step of impulses over what the laws between forces and accelerations leave open.
#
# Some motions change their contacts at every instant (corners that slip about a point that wanders,
# a slip whose direction turns faster than it grows, a rod that Painleve's paradox leaves no force).
# Between velocities and impulses the laws of contact have a solution (Stewart and Trinkle 1996):
# over a length of time too short to matter, the loads act as one impulse, and those of the contacts
# answer it.


def leap(at: Instant, duration: float) -> Array | None:
    """Impulses of all lines [N s] over `duration` [s]; y becomes the state after it, off the
    manifold by the square of the duration, and the table has the modes that it ends in.  Impulses
    and contact forces work on the mean velocity.  None if the laws have no solution here either."""
    touching, touch = at.touching(), at.system.touch
    pressed = [c for c, law in enumerate(at.laws) if law.compliant and touch[c, CLOSED] == 1.0]
    at.workspace.taking_part[:] = 0
    at.workspace.taking_part[touching], at.workspace.taking_part[pressed] = CANDIDATE, PRESSED
    at.workspace.moved[:] = 0
    for c in (*touching, *pressed):
        at.workspace.moved[c] = what_moves(at, c)
        rest_if_it_may(at, c)
    at.refresh()
    if at.call.over(at.t, at.y, duration) != SOLVED:
        return None
    u = velocities(at.system, at.y)
    impulses = at.workspace.impulses.copy()
    p = at.workspace.W.T @ impulses
    after = u + duration * at.workspace.free_accelerations + at.inverse_mass @ p
    u_mean = 0.5 * (u + after)
    work = float(p @ u_mean) + duration * power_of_given(at, u_mean)
    for i in range(at.system.bodies.shape[0]):
        mean = u_mean[6 * i : 6 * i + 6]
        q = slice(WIDTH * i + 3, WIDTH * i + 7)
        at.y[WIDTH * i : WIDTH * i + 3] += duration * mean[:3]
        at.y[q] += duration * np.array(quaternion_rate(tuple(at.y[q]), tuple(mean[3:])))
    set_velocities(at.system, at.y, after)
    at.y[WIDTH * at.system.bodies.shape[0]] += work
    at.t += duration
    for c in touching:
        if impulses[at.first[c]] == 0.0:
            touch[c, [CLOSED, SLIDE, ROLL, SPIN]] = NONE
    return impulses


def what_moves(at: Instant, c: int) -> tuple[bool, bool, bool]:
    """Whether contact c moves over its support, in each of its three ways."""
    across, about = turning(at.system, c)
    slow = turn_that_is_none(at.system)
    return at.slip_speed(c) > at.still, norm(across) > slow, abs(about) > slow


def rest_if_it_may(at: Instant, c: int) -> None:
    """Close contact c, at rest in each way in which its law has a rest."""
    touch, law = at.system.touch, at.laws[c]
    touch[c, CLOSED] = 1.0
    touch[c, SLIDE] = STUCK if law.static > 0.0 else SLIDING
    touch[c, ROLL] = STUCK if law.rolling_arm > 0.0 else NONE
    touch[c, SPIN] = STUCK if law.spinning_arm > 0.0 else NONE


def bring_back(at: Instant) -> None:
    """Bring the state after a leap back to the manifold of its modes, and apart what overlaps."""
    at.refresh()
    touch, u = at.system.touch, velocities(at.system, at.y)
    under = [c for c in at.touching() if touch[c, CLOSED] == 0.0 and touch[c, GAP] < 0.0]
    if under:
        touch[under, CLOSED] = 1.0
        at.call(SETTLE, at.t, at.y)
        set_velocities(at.system, at.y, u)
        touch[under, CLOSED] = 0.0
    at.call(SETTLE, at.t, at.y)
    at.refresh()


def power_of_given(at: Instant, u: Array) -> float:
    """Power of the forces of contacts that are among the loads (of compliant supports, and viscous
    ones) at the velocities u [W]."""
    y, multipliers = at.y.copy(), at.system.vectors[MULTIPLIERS].copy()
    set_velocities(at.system, y, u)
    at.system.vectors[MULTIPLIERS] = 0.0
    power = power_of_contacts(at.system, y)
    at.system.vectors[MULTIPLIERS] = multipliers
    return float(power)


# What ends at an instant in a motion of bodies in contact: impacts, slips that jam, leaps.


IMPACTS_AT_ONCE = 20
"""Impacts one by one at an instant, for each contact, that are taken to have no end."""


class StrikingMotion(EventStepping):
    """As EventStepping, with what happens at one instant of it."""

    laws: Sequence[ContactLaw]
    _journal: Journal
    _chatter: Chatter

    def __init__(self, compiled: Compiled, method: Any) -> None:
        self.names = compiled.layout.contacts
        self.rims = rims_of(compiled.system)
        super().__init__(compiled, method)

    def _instant(self, t: float, y: Array) -> Instant:
        return Instant(self.laws, self._call, t, y, tasks.ARRIVE)

    def _strike(self, instant: Instant) -> None:
        """Impacts until nothing approaches; an endless series of bounces is closed."""
        single = IMPACTS_AT_ONCE * len(self.laws) if self.compiled.one_by_one else 0
        n, last, status = 0, single + AT_ONCE, GOES_ON
        while status != NOTHING:
            aim_where_it_turns(instant, self.rims)
            to = min(n + 1, last) if self.rims else last  # rims aim anew before each round
            status = self._call(tasks.IMPACTS, instant.t, instant.y, (n, to, single))
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
        status = self._call(tasks.STRIKE, instant.t, instant.y)
        self._journal.take(instant.workspace)
        self._refuse_impacts(instant, status, False)

    def _jam(self, instant: Instant, c: int | None) -> None:
        """Painleve: the slip of contact c (or of whichever jams) stops at once, in an impact."""
        for i in range(len(self.laws)) if c is None else (c,):
            touch = self.system.touch
            if touch[i, CLOSED] and instant.effective_pivot(i) < NEAR_JAM:
                x = impulses_of_jam(instant, i)
                if x is None:
                    break
                instant.apply(x)
                self._call(tasks.NOTE, instant.t, instant.y, (JAMS, 0, 0))
                self._journal.take(instant.workspace)
                return
        rough = [i for i in instant.touching() if math.isinf(self.laws[i].static)]
        if c is None and rough:
            refuse_rough(instant, rough[0], self.names)
        hardly = c is not None and instant.slip_speed(c) <= self.system.still
        # compliant contacts that stick may find no forces either, and touch nothing rigidly
        near = instant.touching() or np.flatnonzero(self.system.touch[:, CLOSED] == 1.0).tolist()
        if (c is None or hardly) and near and self._leapt_over(instant, near[0]):
            return
        if c is None and near and not instant.touching():
            raise SimulationError(
                f"no friction forces found for compliant contacts ({self.names[near[0]]} and "
                "others) "
                f"that hardly slip at t = {instant.t:.9g} s: {TOOL}"
            )
        c = least_lifted(instant) if c is None else c
        name = "" if c is None else f" of {self.names[c]}"
        raise SimulationError(
            f"Painleve's paradox at t = {instant.t:.9g} s: no force{name} satisfies the friction "
            "law, and no impact stops the slip"
        )

    def _leapt_over(self, instant: Instant, c: int) -> bool:
        """Move the instant on by a time too short to matter, over which impulses answer the loads;
        longer if it has just been done.  False if the laws have no impulses either."""
        t, length = instant.t, self._chatter.length_of_leap(instant.t)
        if leap(instant, length) is None:
            return False
        bring_back(instant)
        self._journal.note(t, c, LEAPS)
        self._chatter.leapt(t + length, length)
        return True
