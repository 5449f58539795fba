"""How a run was integrated: the bounds that follow from it, and what its steps themselves show."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.diagnostic import Finding
from rb_sim.checks.check import Look, Run, Seen
from rb_sim.checks.step_doubling import LocalError
from rb_sim.mechanics.methods import METHODS
from rb_sim.numerics.rotations import norms

if TYPE_CHECKING:
    from rb_sim.contact.grid_motion import LeftOpen
    from rb_sim.mechanics.samples import SampleBlock

    Ahead = Callable[..., SampleBlock | None]


# A finer fixed step by the order of a method: error ~ step^order.


MARGIN = 2.0
"""Times below its bound that the figure is to come."""

LARGEST_SHARE = 1.0
"""A figure above it tells of a motion that is lost, not of how the error grows with the step."""

ROUND = (5.0, 2.0, 1.0)
"""Leading digits of steps that are named."""


def finer_step(step: float, figure: float, bound: float, order: int) -> float:
    """The step [s] whose figure is MARGIN below its bound, if figure ~ step^order; at most half of
    `step`, rounded down to 1, 2 or 5 times a power of ten."""
    known = min(figure, LARGEST_SHARE) if math.isfinite(figure) else LARGEST_SHARE
    ratio = min(1.0, bound / (MARGIN * known)) if known > 0.0 else 1.0
    return round_down(step * min(0.5, ratio ** (1.0 / order)))


def try_step(step: float) -> str:
    """Advice to try a step [s] that has not been tried."""
    return f"try step {step:g} s, or method dopri853 with a tolerance"


def round_down(step: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above step > 0."""
    power = math.floor(math.log10(step))
    for digit in ROUND:
        rounded = float(f"{digit:.0f}e{power}")
        if rounded <= step:
            return rounded
    return float(f"5e{power - 1}")  # where the logarithm was rounded up to a power of ten


def below(step: float) -> float:
    """The next smaller one of 1, 2 and 5 times a power of ten that is at most half of step."""
    return round_down(0.5 * step)


# What a run may lose before a check speaks: bounds that follow from method and setting.


class Bounds(NamedTuple):
    """Of fixed steps."""

    balance: float
    """relative energy that may be lost; ten times as much of a momentum."""
    local: float
    """share of the change of velocities in a step that the step may miss."""
    grown: float
    """what all steps may miss of the velocities, added up."""


FIRST_ORDER = Bounds(balance=2e-2, local=0.1, grown=0.5)
"""It loses a share of h/T of the energy per period T, and a step that resolves the motion has fifty
to the period; of an oscillation it misses w h / 4 in a step, 0.1 at 16 steps to the period; and its
errors add up to no more than a balance shows as well."""

HIGHER_ORDER = Bounds(balance=1e-3, local=1e-2, grown=0.1)
"""A step that follows the motion at all keeps three digits of the energy; gauss6 misses
(w h)^6 / 1e5, a hundredth at two steps to the period; 0.1 rad of the phase of an oscillation."""

LOCAL_TURN = 2e-2
"""Angle [rad] that some steps may miss of a body's attitude; of wrong runs whose velocities show
nothing it shows half, of right ones none (5,737 random runs)."""

RESOLVED = 1e-9
"""Of the energy exchanged: what a run to round-off may part by in any case."""

LOCAL_TO_GLOBAL = 10.0
"""Local errors, each within the tolerance, add up over the steps; the motion may magnify the sum by
about this where it is not chaotic."""


class Effort(NamedTuple):
    """How a run was integrated, as far as checks depend on it."""

    method: str
    step: float | None
    """[s]; None of an adaptive method."""
    tolerance: float | None
    steps: int
    unsolved: int = 0
    """steps of time stepping whose friction problem was not solved within their bound of work."""
    solver_residual: float = 0.0
    """the worst of those, relative to the largest impulse."""
    circling: int = 0
    """steps of time stepping too long for a point of contact that runs around its body."""
    paradox: int = 0
    """steps of time stepping with Painleve's paradox."""
    slipping: int = 0
    """steps of time stepping in which a perfectly rough contact slipped."""
    restruck: float = 0.0
    """energy that time stepping took where contacts bore already and were struck anew [J]."""
    made: float = 0.0
    """energy that rigid contacts have made under time stepping [J]."""
    astray: tuple[float, float, str] = (0.0, 0.0, "")
    """velocity that an impulse of time stepping gave in a direction which its normal had left, over
    the scene's speed; when [s], and which contact."""
    local: LocalError = LocalError()
    """what a fixed step misses of the motion."""
    left_open: LeftOpen | None = None
    """the widest choice that the laws of contact left."""
    ahead: Ahead | None = None
    """gives the motion from here on over a span [s] in so many steps; None: nobody does."""
    asked: float | None = None
    """the tolerance that the scene gives, where `auto` chose another one to keep it."""
    kept_to: float = 0.0
    """the end of the time over which `auto` measured that its choice keeps it [s]."""

    @property
    def order(self) -> int:
        """Of the method; 1 of one that nobody knows."""
        entry = METHODS.get(self.method)
        return entry.order if entry else 1

    @property
    def bounds(self) -> Bounds:
        """Of a fixed step of this method."""
        known = self.method in METHODS
        return FIRST_ORDER if known and self.order == 1 else HIGHER_ORDER

    @property
    def balance(self) -> float:
        """Relative error of a balance above which the motion is not what the setting promises."""
        if self.tolerance is None:
            return self.bounds.balance
        grown = LOCAL_TO_GLOBAL * self.tolerance * max(1, self.steps)
        return min(max(RESOLVED, grown), HIGHER_ORDER.balance)

    @property
    def outcome_bound(self) -> float:
        """How far two motions may be apart, relative, that the setting takes for one."""
        return HIGHER_ORDER.balance if self.tolerance is None else self.tolerance

    def finer_step(self, figure: float, bound: float) -> float | None:
        """The step [s] that takes the figure below the bound by the order of the method; None of
        an adaptive one."""
        return None if self.step is None else finer_step(self.step, figure, bound, self.order)

    def advice(self, finer: float | None) -> str:
        """What makes the error of the motion smaller. finer: step to try [s], if one is fixed."""
        if finer is not None:
            return try_step(finer)
        return f"try a tolerance below {self.tolerance if self.asked is None else self.asked:g}"


def effort_of(simulation: Any) -> Effort:
    """The effort of a Simulation so far."""
    choice, options = simulation.choice, simulation.scene.simulation
    setting = options if choice is None else choice
    unsolved, residual = simulation.unsolved_steps
    return Effort(
        setting.method,
        setting.step,
        setting.tolerance,
        simulation.steps,
        unsolved,
        residual,
        simulation.circling_steps,
        simulation.paradox_steps,
        simulation.slipping_steps,
        simulation.restruck_energy,
        simulation.made_energy,
        simulation.astray,
        simulation.local_error,
        simulation.left_open,
        simulation.ahead,
        None if choice is None else choice.target,
        options.duration if choice is not None and choice.reached else 0.0,
    )


# What the steps themselves show.


ULPS = 16.0
"""A step or a sample period below this many units in the last place of the time is distorted."""

RESTRUCK = 2e-2
"""Share of the energy exchanged that contacts may take which bear already; it is of first order."""

MADE = 1e-2
"""Share of the energy exchanged that rigid contacts may make, which take some or none by their
laws: at most 1e-3 in steps that follow the motion of single bodies, 5e-3 in heaps."""

ASTRAY = 5e-2
"""Speed, over the scene's, that an impulse of time stepping may give in a direction which its
normal has left by the end of the step: what is wrong of the velocity is up to twice as much."""

ENOUGH = 1e-6
"""Relative change of an impulse above which a step of time stepping is told as unsolved."""

MOST_TURN = np.pi
"""Angle in one fixed step [rad] above which the step cannot tell a turn from the opposite one."""

ADVISED_TURN = 0.5
"""Angle in one step that methods of order 4 and above resolve [rad]."""

EPS = float(np.finfo(float).eps)


def steps(run: Run) -> Look:
    """What the steps of the run show."""
    rate = run.scene.simulation.rate
    return lambda seen: found_in(seen.block, seen.effort, rate, seen.ledger.exchanged)


def found_in(
    block: SampleBlock, effort: Effort, rate: float, exchanged: float
) -> Iterator[Finding]:
    """What the effort of the run up to the end of the block tells.

    rate: of the samples [Hz]. exchanged: energy that the scene has exchanged by right [J].
    """
    yield from _of_time(block, effort, rate)
    yield from _of_steps(block, effort)
    yield from _of_contact_steps(block, effort, exchanged)
    yield from _of_choices(effort)


def _of_time(block: SampleBlock, effort: Effort, rate: float) -> Iterator[Finding]:
    t = float(block.t[-1])
    shortest = 1.0 / rate
    if effort.steps:
        shortest = min(shortest, t / effort.steps)
    if t > 0.0 and ULPS * EPS * t > shortest:
        advice = "times this large cannot resolve such short steps; start the time at 0"
        what = "rounding of the time relative to the step or sample period"
        yield Finding("time", t, EPS * t / shortest, 1.0 / ULPS, what, "", advice)


def turns(run: Run) -> Look:
    """Whether a fixed step leaps over turns; balances are silent then, for samples do as well."""
    return lambda seen: turned(seen.block, seen.effort, run.layout.bodies)


def turned(block: SampleBlock, effort: Effort, bodies: tuple[str, ...]) -> Iterator[Finding]:
    """The first turn of more than MOST_TURN in one fixed step.

    An adaptive method compares two formulas in every step, and may take a constant spin in one; a
    step that `auto` chose has been measured beside such a method.
    """
    if effort.step is None or effort.tolerance is not None or block.t[-1] <= effort.kept_to:
        return
    step = effort.step
    if effort.steps > 1:  # events cut steps; the last one reaches beyond the last sample
        step = min(step, float(block.t[-1]) / (effort.steps - 1))
    spin = norms(block.angular_velocity)
    beyond = np.argwhere(spin * step > MOST_TURN)
    if not len(beyond):
        return
    i, body = int(beyond[0, 0]), int(beyond[0, 1])
    fastest = float(spin[i, body])
    what = f"rotation in one step of {step:.3g} s [rad]"
    # a spin that blows up may be no number, and says nothing of a step that resolves it
    finer = round_down(ADVISED_TURN / fastest) if np.isfinite(fastest) else below(step)
    t = float(block.t[i])
    yield Finding("turn", t, fastest * step, MOST_TURN, what, bodies[body], try_step(finer), finer)


def _of_steps(block: SampleBlock, effort: Effort) -> Iterator[Finding]:
    """Whether a fixed step follows the motion; symplectic ones keep the energy all the same.

    Of a step that `auto` chose the error of the motion has been measured.
    """
    found, bounds, last = effort.local, effort.bounds, float(block.t[-1])
    if effort.step is None or last <= effort.kept_to:
        return
    step = f"{effort.step:.3g} s"
    for figure, bound, t, body, what in (
        (found.share, bounds.local, found.t, found.body,
         f"velocity error of one step of {step}, relative to its change,"),
        (found.turn, LOCAL_TURN, found.turn_t, found.turn_body,
         f"attitude error of four steps of {step} [rad]"),
        (found.grown, bounds.grown, last, found.grown_body,
         f"relative velocity error summed over all steps of {step}"),
    ):  # fmt: skip
        if figure > bound:
            finer = effort.finer_step(figure, bound)
            yield Finding("step", t, figure, bound, what, body, effort.advice(finer), finer)
            return


def _of_contact_steps(block: SampleBlock, effort: Effort, exchanged: float) -> Iterator[Finding]:
    """Whether every step of time stepping solved and followed its contacts; the first that fails.

    Energy that contacts make or take is among their work, so that no balance shows it.
    """
    step, steps, last = effort.step, effort.steps, float(block.t[-1])
    if step is None or effort.tolerance is not None:
        return
    energy = exchanged if exchanged > 0.0 else math.inf
    restruck, made = effort.restruck / energy, effort.made / energy
    astray, t_astray, contact = effort.astray
    unsolved = effort.solver_residual if effort.unsolved else 0.0

    def part(count: int) -> float:
        return count / max(1, steps)

    def of(count: int) -> str:
        return f"{count} of {steps} steps"

    def shorter(figure: float, bound: float) -> float:
        return bound / min(max(figure, bound), LARGEST_SHARE)

    # figure, bound, time, where, part of the step to try, what the figure is, what it means
    for figure, bound, t, where, try_part, what, why in (
        (unsolved, ENOUGH, last, of(effort.unsolved), 0.5,
         "residual of the contact solver relative to the largest impulse",
         "the contact forces of these steps have this error"),
        (part(effort.circling), 0.0, last, of(effort.circling), 0.1,
         "share of the steps in which a contact point ran around its body",
         "each such step loses energy in a spurious impact"),
        (restruck, RESTRUCK, last, "", shorter(restruck, RESTRUCK),
         "energy lost in closed contacts relative to the energy exchanged",
         "contact points that move within a step cause spurious impacts"),
        (made, MADE, last, "", shorter(made, MADE),
         "energy gained in contacts relative to the energy exchanged",
         "steps are too long for slips that stop or reverse"),
        (astray, ASTRAY, t_astray, contact, 0.5 * shorter(astray, ASTRAY),
         "speed given along a normal that rotated within the step, relative to the scene's,",
         "the normal rotates too far in one step"),
        (part(effort.paradox), 0.0, last, of(effort.paradox), None,
         "share of the steps with several solutions (Painleve's paradox)",
         "the motion from here is not unique; an event-driven method names the branch"),
        (part(effort.slipping), 0.0, last, of(effort.slipping), None,
         "share of the steps in which a perfectly rough contact slips",
         "friction that stops the slip would lift the body; try an event-driven method"),
    ):  # fmt: skip
        if figure > bound:
            finer = None if try_part is None else round_down(try_part * step)
            advice = why if finer is None else f"{why}: {try_step(finer)}"
            yield Finding("contact steps", t, figure, bound, what, where, advice, finer)
            return


def _of_choices(effort: Effort) -> Iterator[Finding]:
    """Whether the laws of contact left more open than the setting tells apart; a second run makes
    the same choice."""
    chosen, bound = effort.left_open, effort.outcome_bound
    if chosen is not None and chosen.figure > bound:
        figure, t, contact, what, by_setting, advice = chosen
        finer = below(effort.step) if by_setting and effort.step else None
        advice = effort.advice(finer) if by_setting else advice
        yield Finding("ambiguous", t, figure, bound, what, contact, advice, finer)


# Whether a contact chatters: opens and closes so often that its events say nothing any more.


MOST_EVENTS_PER_SAMPLE = 50.0
CHATTER = 1000
"""Events, all in all and on average between two samples, that say: a contact chatters."""


def chatter(run: Run) -> Look:
    """Whether a contact has more events than samples can show."""
    events: Counter[str] = Counter()

    def look(seen: Seen) -> Iterator[Finding]:
        events.update(event.contact for event in seen.block.events)
        for name, count in events.most_common(1):
            mean = count / seen.samples
            if count > CHATTER and mean > MOST_EVENTS_PER_SAMPLE:
                advice = "the contact chatters; try method time_stepping"
                what, t = "number of contact events between two samples", float(seen.block.t[-1])
                yield Finding("events", t, mean, MOST_EVENTS_PER_SAMPLE, what, name, advice)

    return look
