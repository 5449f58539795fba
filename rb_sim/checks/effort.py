"""What shows in how a run was integrated: steps rejected, too long, unsolved; the time itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rb_sim.base.diagnostic import Finding
from rb_sim.checks.bounds import LARGEST_SHARE, STRAYED, below, round_down, try_step
from rb_sim.io.frames import norms

if TYPE_CHECKING:
    from rb_sim.checks.bounds import Effort
    from rb_sim.mechanics.samples import SampleBlock

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

STRAYED_TURN = 2e-2
"""Angle [rad] by which a body of a run may be off the same run in half steps: of wrong runs that
nothing else shows it shows half, and of right ones none (5,737 random runs)."""

MOST_TURN = np.pi
"""Angle in one fixed step [rad] above which the step cannot tell a turn from the opposite one."""
SAFE_TURN = MOST_TURN / 3.0**0.5
"""A body turns by less than MOST_TURN if it does by less than this about each of its axes [rad]."""

ADVISED_TURN = 0.5
"""Angle in one step that methods of order 4 and above resolve [rad]."""

EPS = float(np.finfo(float).eps)


def found_in(
    block: SampleBlock, effort: Effort, rate: float, exchanged: float
) -> Iterator[Finding]:
    """What the effort of the run up to the end of the block tells.

    rate: of the samples [Hz]. exchanged: energy that the scene has exchanged by right [J].
    """
    yield from _of_steps(block, effort, rate)
    yield from _of_coarseness(block, effort)
    yield from _of_solver(block, effort)
    yield from _of_running(block, effort, exchanged)
    yield from _of_gains(block, effort, exchanged)
    yield from _of_choices(effort)
    yield from _of_aims(effort)


def _of_steps(block: SampleBlock, effort: Effort, rate: float) -> Iterator[Finding]:
    t = float(block.t[-1])
    shortest = 1.0 / rate
    if effort.steps:
        shortest = min(shortest, t / effort.steps)
    if t > 0.0 and ULPS * EPS * t > shortest:
        advice = "times this large cannot resolve such short steps; start the time at 0"
        what = "rounding of the time relative to the step or sample period"
        yield Finding("time", t, EPS * t / shortest, 1.0 / ULPS, what, "", advice)


def turns(
    block: SampleBlock, effort: Effort, bodies: tuple[str, ...], stride: int = 1
) -> Iterator[Finding]:
    """Whether a fixed step leaps over turns; balances are silent then, for samples do as well.

    An adaptive method compares two formulas in every step, and may take a constant spin in one; a
    step that `auto` chose has been measured beside such a method.
    """
    if effort.step is None or effort.tolerance is not None or block.t[-1] <= effort.kept_to:
        return
    step = effort.step
    if effort.steps > 1:  # events cut steps; the last one reaches beyond the last sample
        step = min(step, float(block.t[-1]) / (effort.steps - 1))
    spin = norms(block.angular_velocity[::stride])
    beyond = np.argwhere(spin * step > MOST_TURN)
    if not len(beyond):
        return
    i, body = int(beyond[0, 0]), int(beyond[0, 1])
    fastest = float(spin[i, body])
    what = f"rotation in one step of {step:.3g} s [rad]"
    # a spin that blows up may be no number, and says nothing of a step that resolves it
    finer = round_down(ADVISED_TURN / fastest) if np.isfinite(fastest) else below(step)
    where = bodies[body]
    t = float(block.t[i * stride])
    yield Finding("turn", t, fastest * step, MOST_TURN, what, where, try_step(finer), finer)


def _of_coarseness(block: SampleBlock, effort: Effort) -> Iterator[Finding]:
    """Whether a fixed step follows the motion; symplectic ones keep the energy all the same.

    Of a step that `auto` chose the error of the motion has been measured.
    """
    share, t, body, grown, where, strayed = effort.coarse
    bound, most = effort.coarse_bound, effort.grown_bound
    if effort.step is None or block.t[-1] <= effort.kept_to:
        return
    if share > bound:
        what = f"relative velocity error of one step of {effort.step:.3g} s"
        finer = effort.finer_step(share, bound)
        yield Finding("step", t, share, bound, what, body, effort.advice(finer), finer)
    elif grown > most:
        what = f"relative velocity error summed over all steps of {effort.step:.3g} s"
        finer = effort.finer_step(grown, most)
        last = float(block.t[-1])
        yield Finding("step", last, grown, most, what, where, effort.advice(finer), finer)
    elif strayed.share > STRAYED:
        share, t, body, of, *_ = strayed
        what = f"difference from a run with half the step, relative to the {of},"
        finer = effort.finer_step(share, STRAYED)
        yield Finding("step", t, share, STRAYED, what, body, effort.advice(finer), finer)
    elif strayed.turn > STRAYED_TURN:
        what = "difference in attitude from a run with half the step [rad]"
        finer = effort.finer_step(strayed.turn, STRAYED_TURN)
        advice = effort.advice(finer)
        yield Finding(
            "step", strayed.upto, strayed.turn, STRAYED_TURN, what, strayed.turned, advice, finer
        )


def _counted(
    watch: str, count: int, block: SampleBlock, effort: Effort, what: str, advice: str,
    finer: float | None = None,
) -> Finding:  # fmt: skip
    """That so many of the run's steps were not as they should."""
    share, where = count / max(1, effort.steps), f"{count} of {effort.steps} steps"
    return Finding(watch, float(block.t[-1]), share, 0.0, what, where, advice, finer)


def _of_solver(block: SampleBlock, effort: Effort) -> Iterator[Finding]:
    """Whether every step of a heap solved its friction problem within its bound of work."""
    if effort.unsolved:
        where = f"{effort.unsolved} of {effort.steps} steps"
        what = "residual of the contact solver relative to the largest impulse"
        finer = effort.step and below(effort.step)
        advice = f"contact forces of these steps have this error; try step {finer:g} s"
        t, worst = float(block.t[-1]), effort.solver_residual
        yield Finding("solver", t, worst, ENOUGH, what, where, advice, finer)
    if effort.paradox:
        what = "share of the steps with several solutions (Painleve's paradox)"
        advice = "another motion is possible from here; an event-driven method says which"
        yield _counted("paradox", effort.paradox, block, effort, what, advice)
    if effort.slipping:
        what = "share of the steps in which a perfectly rough contact slips"
        advice = "friction that stops the slip would lift the body; try an event-driven method"
        yield _counted("rough", effort.slipping, block, effort, what, advice)


def _of_running(block: SampleBlock, effort: Effort, exchanged: float) -> Iterator[Finding]:
    """Whether points of contact ran on faster than the steps, and were struck again and again."""
    t, lost = float(block.t[-1]), effort.restruck
    if effort.turned:
        what = "share of the steps in which a contact point ran around its body"
        finer = effort.step and round_down(0.1 * effort.step)
        advice = f"each such step loses energy in a spurious impact; try step {finer:g} s"
        yield _counted("running contact", effort.turned, block, effort, what, advice, finer)
    elif lost > RESTRUCK * exchanged > 0.0:
        what = "energy lost in closed contacts relative to the energy exchanged"
        share = lost / exchanged
        known = min(share, LARGEST_SHARE)  # infinite where a trial blows up
        finer = effort.step and round_down(effort.step * RESTRUCK / known)
        advice = (
            "contact points that move within a step cause spurious impacts; "
            f"try step {finer:g} s or an event-driven method"
        )
        yield Finding("running contact", t, share, RESTRUCK, what, "", advice, finer)


def _of_gains(block: SampleBlock, effort: Effort, exchanged: float) -> Iterator[Finding]:
    """Whether contacts made energy: the balance has it as their work, and does not see it."""
    if effort.made > MADE * exchanged > 0.0:
        what = "energy gained in contacts relative to the energy exchanged"
        share = min(effort.made / exchanged, LARGEST_SHARE)
        finer = effort.step and round_down(effort.step * MADE / share)
        advice = f"steps are too long for slips that stop or reverse; try step {finer:g} s"
        yield Finding("energy", float(block.t[-1]), share, MADE, what, "", advice, finer)


def _of_aims(effort: Effort) -> Iterator[Finding]:
    """Whether impulses were given along normals that turned on within their step."""
    figure, t, contact = effort.astray
    if figure > ASTRAY:
        what = "speed given along a normal that rotated within the step, relative to the scene's,"
        finer = effort.finer_step(figure, ASTRAY)
        yield Finding("aim", t, figure, ASTRAY, what, contact, effort.advice(finer), finer)


def _of_choices(effort: Effort) -> Iterator[Finding]:
    """Whether more than the setting tells apart was left open: by the laws of contact, of which a
    second run makes the same choice, or by the setting, which a second run decides."""
    chosen, bound = effort.left_open, effort.outcome_bound
    if chosen is not None and chosen.figure > bound:
        figure, t, contact, what, by_setting, advice = chosen
        finer = below(effort.step) if by_setting and effort.step else None
        advice = effort.advice(finer) if by_setting else advice
        yield Finding("ambiguous", t, figure, bound, what, contact, advice, finer)
