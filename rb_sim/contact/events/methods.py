"""Methods as the loop of bodies in contact takes them, and the slips that they follow."""

from __future__ import annotations

from typing import Any

from rb_sim.contact.events.grid import Stepping
from rb_sim.contact.events.pace import paced
from rb_sim.contact.system.compiled import rate_of_change
from rb_sim.contact.system.jacobian import jacobian_by_differences
from rb_sim.engine.traced import settings_of
from rb_sim.loops.methods.radau5 import radau5_of_slips
from rb_sim.scene.compiled import Compiled

NOISE = 30.0
"""Slip in tolerances of an adaptive method whose direction is lost in its errors: explicit methods
turn it about where steps that keep the tolerance are too long for its stiffness."""
CREEP = 1e-9
"""Slip, relative to the scene's speed, below which contacts that give way creep in steps of an
adaptive method; above, implicit steps follow it."""


def slow_slips(system: Any, method: Any) -> dict[str, float]:
    """The slips [m/s] that are lost in errors, and that creep."""
    tolerance = getattr(method, "tolerance", 0.0)
    creep = CREEP * system.speed if tolerance > 0.0 else 0.0
    return {"still": max(system.still, NOISE * tolerance), "creep": creep}


def stepping_of(compiled: Compiled, method: Any, rubs: bool) -> Stepping:
    """rubs: whether slips may be slow and stiff."""
    step, setting = settings_of(paced(compiled, method))
    implicit: tuple[Any, Any] = 0, 0
    if rubs and getattr(method, "tolerance", 0.0) > 0.0:
        implicit = radau5_of_slips.reference, jacobian_by_differences.address
    setting = (*setting, float(step.implicit > 0))
    return Stepping(step.reference, rate_of_change.address, setting, *implicit)
