"""Series of a rolling body, chosen by the class of its surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rb_sim.engine.series.expansion import SUITS, evaluate, expand, plan
from rb_sim.engine.systems.rolling import RollingBody
from rb_sim.maths.jit import dispatch

rolling_suits: dict[type, Callable[[Any], bool]] = {}
"""As SUITS, for each class of surface."""


@dispatch
def rolling_plan(surface, tolerance):
    """As plan."""


@dispatch
def rolling_expand(surface, system, t, y, order, room):
    """As expand."""


@dispatch
def rolling_evaluate(surface, system, t, y, order, room, h):
    """As evaluate."""


def suits_surface(system: Any) -> bool:
    suits = rolling_suits.get(type(system.surface))
    return suits is not None and suits(system)


SUITS[RollingBody] = suits_surface


@plan.register(RollingBody)
def plan_by_surface(system, tolerance):
    return rolling_plan(system.surface, tolerance)


@expand.register(RollingBody)
def expand_by_surface(system, t, y, order, room):
    return rolling_expand(system.surface, system, t, y, order, room)


@evaluate.register(RollingBody)
def evaluate_by_surface(system, t, y, order, room, h):
    return rolling_evaluate(system.surface, system, t, y, order, room, h)
