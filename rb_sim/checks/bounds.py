"""Bounds of the accuracy checks: what a run may lose before a check speaks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from rb_sim.checks.step_doubling import Coarseness
from rb_sim.mechanics.methods import METHODS

if TYPE_CHECKING:
    from collections.abc import Callable

    from rb_sim.contact.events.shares import LeftOpen
    from rb_sim.mechanics.samples import SampleBlock


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


# What a run may lose before a watch speaks: bounds that follow from method and setting.


if TYPE_CHECKING:
    Ahead = Callable[..., SampleBlock | None]

RESOLVED = 1e-9
"""Of the energy exchanged: what a run to round-off may part by in any case."""

LOCAL_TO_GLOBAL = 10.0
"""Local errors, each within the tolerance, add up over the steps; the motion may magnify the sum by
about this where it is not chaotic."""

FIXED = {1: 2e-2}
"""Order -> relative balance that a fixed step may break. First order loses a share of h/T per
period T, and a step that resolves the motion has fifty to the period."""

FIXED_HIGHER = 1e-3
"""The same of all higher orders: a step that follows the motion at all keeps three digits."""

COARSE = {1: 0.1}
"""Order -> share of the change of velocities in a step that the step may miss.  Of an oscillation
a first order misses w h / 4, so that 0.1 is a period of 16 steps."""

COARSE_HIGHER = 1e-2
"""The same of all higher orders: (w h)^6 / 1e5 for gauss6, which is a period of two steps."""

GROWN = {1: 0.5}
"""Order -> what the steps of a run may miss of the velocities, added up.  It is the most that they
may err by, of a first order, whose errors a balance shows as well, more than they do."""

GROWN_HIGHER = 0.1
"""The same of all higher orders: 0.1 rad of the phase of an oscillation."""

STRAYED = 0.05
"""Share of its way, or of its largest velocity, by which a body of a short run may be off the same
run in half steps: an error of 0.1 at first order, where Euler errs by 1/n of the way of n steps
under a constant load, and of 0.05 at higher ones."""

RESIDUAL = 1e-9
"""Constraints are projected after every step to round-off; this is the relative violation above
which the scene compiler, too, takes constraints for contradictory."""


class Effort(NamedTuple):
    """How a run was integrated, as far as bounds depend on it."""

    method: str
    step: float | None
    """[s]; None of an adaptive method."""
    tolerance: float | None
    steps: int
    rejected: int
    """attempts beyond the tolerance."""
    unsolved: int = 0
    """steps of time stepping whose friction problem was not solved within their bound of work."""
    solver_residual: float = 0.0
    """the worst of those, relative to the largest impulse."""
    turned: int = 0
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
    coarse: Coarseness = Coarseness()
    """what a fixed step misses of the motion."""
    local: float = 0.0
    """error that a step of an adaptive method may make [m, rad], or of where a body is."""
    held: frozenset[str] = frozenset()
    """bodies whose errors are held to their own motion instead."""
    left_open: LeftOpen | None = None
    """the widest choice that the laws of contact left."""
    ahead: Ahead | None = None
    """gives the motion from here on over a span [s] in so many steps, as it is or faster by a
    share; None: nobody does."""
    asked: float | None = None
    """the tolerance that the scene gives, where `auto` chose another one to keep it."""
    kept_to: float = 0.0
    """the end of the time over which `auto` measured that its choice keeps it [s]."""
    again: Callable[[int], SampleBlock | None] | None = None
    """gives the motion from its start on after each of so many steps; None: nobody does."""

    @property
    def outcome_bound(self) -> float:
        """How far two motions may be apart, relative, that the setting takes for one."""
        return FIXED_HIGHER if self.tolerance is None else self.tolerance

    @property
    def coarse_bound(self) -> float:
        """Share of a step's change of velocities above which it does not follow the motion."""
        entry = METHODS.get(self.method)
        return COARSE.get(entry.order, COARSE_HIGHER) if entry else COARSE_HIGHER

    @property
    def grown_bound(self) -> float:
        """What all steps may miss of the velocities of a body, added up, over the largest."""
        entry = METHODS.get(self.method)
        return GROWN.get(entry.order, GROWN_HIGHER) if entry else GROWN_HIGHER

    @property
    def own_tolerance(self) -> float | None:
        """The one to change for another error: that of the scene."""
        return self.tolerance if self.asked is None else self.asked

    @property
    def balance(self) -> float:
        """Relative error of a balance above which the motion is not what the setting promises."""
        if self.tolerance is not None:
            grown = LOCAL_TO_GLOBAL * self.tolerance * max(1, self.steps)
            return min(max(RESOLVED, grown), FIXED_HIGHER)
        entry = METHODS.get(self.method)
        return FIXED.get(entry.order, FIXED_HIGHER) if entry else FIXED_HIGHER

    def finer_step(self, figure: float, bound: float) -> float | None:
        """The step [s] that takes the figure below the bound by the order of the method; None of
        an adaptive one."""
        if self.step is None:
            return None
        entry = METHODS.get(self.method)
        return finer_step(self.step, figure, bound, entry.order if entry else 1)

    def advice(self, finer: float | None) -> str:
        """What makes the error of the motion smaller. finer: step to try [s], if one is fixed."""
        if finer is None:
            return f"try a tolerance below {self.own_tolerance:g}"
        return try_step(finer)


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
        simulation.rejected_steps - simulation.cut_steps,
        unsolved,
        residual,
        simulation.circling_steps,
        simulation.paradox_steps,
        simulation.slipping_steps,
        simulation.restruck_energy,
        simulation.made_energy,
        simulation.astray,
        simulation.coarseness,
        local_error(simulation),
        simulation.held_bodies,
        simulation.left_open,
        simulation.ahead,
        None if choice is None else choice.target,
        options.duration if choice is not None and choice.reached else 0.0,
        simulation.again,
    )


def local_error(simulation: Any) -> float:
    """Error that a step may make [m, rad]: one of them no more than `auto` measured of all."""
    choice = simulation.choice
    allowed = float(getattr(simulation.method, "tolerance", 0.0))
    return min(allowed, choice.target) if choice is not None and choice.reached else allowed
