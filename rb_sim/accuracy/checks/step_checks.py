# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Checks of the steps of a run: local errors, rotation per step, contacts, chatter."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from rb_sim.accuracy.checks.check import (
    LARGEST_SHARE,
    MISSED,
    Checker,
    CheckInput,
    Run,
    below,
    round_down,
)
from rb_sim.base.errors import Finding
from rb_sim.base.rounding import SOLVED_IN_CONTACT
from rb_sim.numerics.rotations import norms

if TYPE_CHECKING:
    from rb_sim.accuracy.checks.check import Effort
    from rb_sim.mechanics.samples import SampleBlock

RESTRUCK = 2e-2
"""Largest energy that closed contacts may lose in impacts, relative to the energy exchanged."""

MADE = 1e-2
"""Largest energy that rigid contacts may gain, relative to the energy exchanged. By their laws they
gain none; steps that resolve the motion gain up to 1e-3 for single bodies, 5e-3 in heaps."""

ASTRAY = 5e-2
"""Largest speed by an impulse of time stepping along a normal that turned within the step, relative
to the scene's speed; the error of the velocity is up to twice as much."""


MOST_TURN = np.pi
"""Rotation in one fixed step [rad] above which its direction is not known."""

ADVISED_TURN = 0.5
"""Rotation in one step that methods of order 4 and above resolve [rad]."""


def steps(run: Run) -> Checker:
    """Checks of the steps of the run."""

    def look(seen: CheckInput) -> Iterator[Finding]:
        yield from found_in(seen.block, seen.effort, seen.ledger.exchanged)
        yield from turned(seen.block, seen.effort, run.layout.bodies)

    return look


def found_in(block: SampleBlock, effort: Effort, exchanged: float) -> Iterator[Finding]:
    """Findings about the effort of the run up to the end of the block.

    exchanged: energy that the scene has exchanged [J].
    """
    yield from _of_steps(block, effort)
    yield from _of_contact_steps(block, effort, exchanged)
    yield from _of_choices(effort)


def _of_steps(block: SampleBlock, effort: Effort) -> Iterator[Finding]:
    """Whether the sum of the local errors of fixed steps is too large, unless `auto` has measured
    the global error."""
    (figure, body), last = effort.missed, float(block.t[-1])
    if effort.step is not None and last > effort.kept_to and figure > MISSED:
        what = f"error of all steps of {effort.step:.3g} s, relative to the velocity or in rad,"
        finer = effort.finer_step(figure, MISSED)
        yield Finding("step", last, figure, MISSED, what, body, effort.advice(finer), finer)


def turned(block: SampleBlock, effort: Effort, bodies: tuple[str, ...]) -> Iterator[Finding]:
    """Whether a body rotates by more than MOST_TURN in a fixed step, e.g. after a motion has blown
    up, where neither step doubling nor balances see it."""
    last = float(block.t[-1])
    if effort.step is None or effort.tolerance is not None or last <= effort.kept_to:
        return
    # events cut steps; the last one reaches beyond the last sample
    step = min(effort.step, last / (effort.steps - 1)) if effort.steps > 1 else effort.step
    spin = norms(block.angular_velocity)
    beyond = np.argwhere(spin * step > MOST_TURN)
    if len(beyond):
        i, body = (int(k) for k in beyond[0])
        fastest = float(spin[i, body])
        finer = round_down(ADVISED_TURN / fastest) if np.isfinite(fastest) else below(step)
        what = f"rotation in one step of {step:.3g} s [rad]"
        figure, t, advice = fastest * step, float(block.t[i]), effort.advice(finer)
        yield Finding("step", t, figure, MOST_TURN, what, bodies[body], advice, finer)


def _of_contact_steps(block: SampleBlock, effort: Effort, exchanged: float) -> Iterator[Finding]:
    """The first check of the contacts of time stepping that fails.

    The energy balance does not show what contacts gain or lose, since it counts as their work.
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
        (unsolved, SOLVED_IN_CONTACT, last, of(effort.unsolved), 0.5,
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
            advice = why if finer is None else f"{why}: {effort.advice(finer)}"
            yield Finding("contact steps", t, figure, bound, what, where, advice, finer)
            return


def _of_choices(effort: Effort) -> Iterator[Finding]:
    """Whether the contact laws allow several motions that differ by more than the setting's
    accuracy; a second run makes the same choice."""
    chosen, bound = effort.left_open, effort.outcome_bound
    if chosen is not None and chosen.figure > bound:
        figure, t, contact, what, by_setting, advice = chosen
        finer = below(effort.step) if by_setting and effort.step else None
        advice = effort.advice(finer) if by_setting else advice
        yield Finding("ambiguous", t, figure, bound, what, contact, advice, finer)


MOST_EVENTS_PER_SAMPLE = 50.0
CHATTER = 1000
"""A contact chatters if it has more than CHATTER events, and more than MOST_EVENTS_PER_SAMPLE on
average between two samples."""


def chatter(run: Run) -> Checker:
    """Checks that no contact opens and closes far more often than the samples show."""
    events: Counter[str] = Counter()

    def look(seen: CheckInput) -> Iterator[Finding]:
        events.update(event.contact for event in seen.block.events)
        for name, count in events.most_common(1):
            mean = count / seen.samples
            if count > CHATTER and mean > MOST_EVENTS_PER_SAMPLE:
                advice = "the contact chatters; try method time_stepping"
                what, t = "number of contact events between two samples", float(seen.block.t[-1])
                yield Finding("events", t, mean, MOST_EVENTS_PER_SAMPLE, what, name, advice)

    return look
