# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The shape of all accuracy checks: what each is made for, what it is shown, and the bounds that
follow from how the run was integrated.

A check is a function of a Run that gives a function of what is Seen, which yields findings: what it
measures, its scale and its one bound are in its file, its words in `base.diagnostic.CHECKS`.  One
line in `check_list.CHECKS` registers it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

from rb_sim.base.rounding import SOLVED
from rb_sim.checks.step_doubling import Missed
from rb_sim.mechanics.methods import METHODS

if TYPE_CHECKING:
    from rb_sim.base.errors import Finding
    from rb_sim.checks.balance import Ledger
    from rb_sim.contact.grid_motion import LeftOpen
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.compiled import Compiled
    from rb_sim.scene.schema import Scene

    Between = Callable[[float, Array, Array], Array | None]


class Run(NamedTuple):
    """What is checked."""

    scene: Scene
    layout: SampleLayout
    compiled: Compiled | None = None
    """the scene as it is run, which spares compiling a linkage once more to watch its rank."""


class Seen(NamedTuple):
    """Of a run, up to the end of the last samples."""

    block: SampleBlock
    """the last samples, at least one."""
    effort: Effort
    ledger: Ledger
    """balances of all samples."""
    samples: int
    """of the whole run."""


Look = Callable[[Seen], Iterable["Finding"]]
"""Tells what has passed its bound in the last samples; asked until all its names have been
reported."""

Check = tuple[tuple[str, ...], Callable[[Run], Look]]
"""Names of the findings, and what makes the check of a run."""


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


def try_step(step: float, alone: bool = False) -> str:
    """Advice to try a step [s] that has not been tried; alone: no other method takes the scene."""
    return f"try step {step:g} s" + ("" if alone else ", or method dopri853 with a tolerance")


def steps_alone(simulation: Any) -> bool:
    """Whether time stepping is the only method that takes the scene."""
    return simulation.compiled.between is not None


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


BALANCE_OF_FIRST_ORDER, BALANCE = 2e-2, 1e-3
"""Relative energy that fixed steps may lose, ten times as much of a momentum: of first order they
lose a share of h/T of it per period T, and have fifty to the period; of higher order steps that
follow the motion at all keep three digits."""

MISSED = 0.1
"""What all fixed steps may miss of a velocity, or of an attitude [rad]: 0.1 rad of the phase of an
oscillation."""

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
    missed: Missed = Missed()
    """what fixed steps miss of the motion."""
    left_open: LeftOpen | None = None
    """the widest choice that the laws of contact left."""
    between: Between | None = None
    """gives the motion between two samples; None: nobody does."""
    asked: float | None = None
    """the tolerance that the scene gives, where `auto` chose another one to keep it."""
    kept_to: float = 0.0
    """the end of the time over which `auto` measured that its choice keeps it [s]."""
    alone: bool = False
    """whether no other method takes the scene."""

    @property
    def order(self) -> int:
        """Of the method; 1 of one that nobody knows."""
        entry = METHODS.get(self.method)
        return entry.order if entry else 1

    @property
    def balance(self) -> float:
        """Relative error of a balance above which the motion is not what the setting promises."""
        if self.tolerance is None:
            known = self.method in METHODS
            return BALANCE_OF_FIRST_ORDER if known and self.order == 1 else BALANCE
        grown = LOCAL_TO_GLOBAL * self.tolerance * max(1, self.steps)
        return min(max(SOLVED, grown), BALANCE)

    @property
    def outcome_bound(self) -> float:
        """How far two motions may be apart, relative, that the setting takes for one."""
        return BALANCE if self.tolerance is None else self.tolerance

    def finer_step(self, figure: float, bound: float) -> float | None:
        """The step [s] that takes the figure below the bound by the order of the method; None of
        an adaptive one."""
        return None if self.step is None else finer_step(self.step, figure, bound, self.order)

    def advice(self, finer: float | None) -> str:
        """What makes the error of the motion smaller. finer: step to try [s], if one is fixed."""
        if finer is not None:
            return try_step(finer, self.alone)
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
        simulation.missed,
        simulation.left_open,
        simulation.between,
        None if choice is None else choice.target,
        options.duration if choice is not None and choice.reached else 0.0,
        steps_alone(simulation),
    )
