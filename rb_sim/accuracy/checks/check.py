# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The interface of accuracy checks, and the bounds that follow from how the run was integrated.

A check is a function that takes a Run and returns a Checker: a function that takes a CheckInput and
yields findings. Quantity, scale and bound of a check are in its file, its name and meaning in
`base.errors.CHECKS`. One line in `check_list.CHECKS` registers it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

from rb_sim.accuracy.checks.step_doubling import Missed
from rb_sim.base.rounding import SOLVED
from rb_sim.mechanics.methods import METHODS

if TYPE_CHECKING:
    from rb_sim.accuracy.checks.balance import Ledger
    from rb_sim.base.errors import Finding
    from rb_sim.contact.grid_motion import LeftOpen
    from rb_sim.mechanics.compiled import Compiled
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

    Between = Callable[[float, Array, Array], Array | None]


class Run(NamedTuple):
    """The run to be checked."""

    scene: Scene
    layout: SampleLayout
    compiled: Compiled | None = None
    """the compiled scene of the run; None: checks that need it compile the scene again."""


class CheckInput(NamedTuple):
    """State of a run at the end of the last samples."""

    block: SampleBlock
    """the last samples, at least one."""
    effort: Effort
    ledger: Ledger
    """balances of all samples so far."""
    samples: int
    """number of samples so far."""


Checker = Callable[[CheckInput], Iterable["Finding"]]
"""Yields the quantities that passed their bound in the last samples; called until each of its names
has been reported."""

Check = tuple[tuple[str, ...], Callable[[Run], Checker]]
"""Names of the findings, and the function that makes the Checker of a run."""


# A finer fixed step by the order of a method: error ~ step^order.


MARGIN = 2.0
"""Factor by which an advised step should bring the figure below its bound."""

LARGEST_SHARE = 1.0
"""Largest figure from which a step is extrapolated; above it the error has no order."""

ROUND = (5.0, 2.0, 1.0)
"""Leading digits of advised steps."""


def finer_step(step: float, figure: float, bound: float, order: int) -> float:
    """The step [s] that brings the figure to bound / MARGIN if figure ~ step^order; at most half of
    `step`, rounded down to 1, 2 or 5 times a power of ten."""
    known = min(figure, LARGEST_SHARE) if math.isfinite(figure) else LARGEST_SHARE
    ratio = min(1.0, bound / (MARGIN * known)) if known > 0.0 else 1.0
    return round_down(step * min(0.5, ratio ** (1.0 / order)))


def try_step(step: float, alone: bool = False) -> str:
    """Advice to try a step [s]; alone: whether no other method can simulate the scene."""
    return f"try step {step:g} s" + ("" if alone else ", or method dopri853 with a tolerance")


def steps_alone(simulation: Any) -> bool:
    """Whether time stepping is the only method that can simulate the scene."""
    return simulation.compiled.between is not None


def round_down(step: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above step > 0."""
    power = math.floor(math.log10(step))
    for digit in ROUND:
        rounded = float(f"{digit:.0f}e{power}")
        if rounded <= step:
            return rounded
    return float(f"5e{power - 1}")  # the logarithm was rounded up to a power of ten


def below(step: float) -> float:
    """The next smaller one of 1, 2 and 5 times a power of ten that is at most half of step."""
    return round_down(0.5 * step)


# Bounds that follow from the method and its setting.


BALANCE_OF_FIRST_ORDER, BALANCE = 2e-2, 1e-3
"""Relative energy that fixed steps may lose; a momentum may lose ten times as much. A method of
order 1 loses about step / period of it per period, with fifty steps to the period; methods of
higher order keep three digits if they resolve the motion."""

MISSED = 0.1
"""Largest sum of the local errors of all fixed steps, relative to the velocity or as an angle
[rad]: 0.1 rad of the phase of an oscillation."""

LOCAL_TO_GLOBAL = 10.0
"""Factor by which a motion that is not chaotic may amplify the sum of the local errors."""


class Effort(NamedTuple):
    """How a run was integrated, as far as checks depend on it."""

    method: str
    step: float | None
    """[s]; None for an adaptive method."""
    tolerance: float | None
    steps: int
    unsolved: int = 0
    """steps of time stepping whose contact problem was not solved to its tolerance."""
    solver_residual: float = 0.0
    """largest residual of these steps, relative to the largest impulse."""
    circling: int = 0
    """steps of time stepping in which a contact point ran around its body."""
    paradox: int = 0
    """steps of time stepping with Painleve's paradox."""
    slipping: int = 0
    """steps of time stepping in which a perfectly rough contact slipped."""
    restruck: float = 0.0
    """energy that time stepping dissipated in impacts of contacts that were closed already [J]."""
    made: float = 0.0
    """energy that rigid contacts gained under time stepping [J]."""
    astray: tuple[float, float, str] = (0.0, 0.0, "")
    """largest velocity by an impulse of time stepping along a normal that turned within the step,
    relative to the scene's speed; its time [s], and contact."""
    missed: Missed = Missed()
    """sum of the local errors of fixed steps."""
    left_open: LeftOpen | None = None
    """the widest choice that the contact laws left open."""
    between: Between | None = None
    """computes the motion between two samples; None if that is not possible."""
    asked: float | None = None
    """the scene's tolerance with `method: auto`."""
    kept_to: float = 0.0
    """time up to which `auto` has measured that its choice keeps this tolerance [s]."""
    alone: bool = False
    """whether no other method can simulate the scene."""

    @property
    def order(self) -> int:
        """Order of the method; 1 if it is not in the registry."""
        entry = METHODS.get(self.method)
        return entry.order if entry else 1

    @property
    def balance(self) -> float:
        """Bound of the relative error of a balance."""
        if self.tolerance is None:
            known = self.method in METHODS
            return BALANCE_OF_FIRST_ORDER if known and self.order == 1 else BALANCE
        grown = LOCAL_TO_GLOBAL * self.tolerance * max(1, self.steps)
        return min(max(SOLVED, grown), BALANCE)

    @property
    def outcome_bound(self) -> float:
        """Relative difference up to which two motions are equal within the setting's accuracy."""
        return BALANCE if self.tolerance is None else self.tolerance

    def finer_step(self, figure: float, bound: float) -> float | None:
        """The step [s] that should bring the figure below the bound; None for adaptive methods."""
        return None if self.step is None else finer_step(self.step, figure, bound, self.order)

    def advice(self, finer: float | None) -> str:
        """Advice that reduces the error. finer: step to try [s]; None for adaptive methods."""
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
