"""The effects that can exist: one line each. What a scene does not name is not compiled."""

from __future__ import annotations

from rb_sim.catalogue.effects.drag import AngularDamping, LinearDrag, QuadraticDrag
from rb_sim.catalogue.effects.gravity import Gravity
from rb_sim.catalogue.effects.spring import Spring
from rb_sim.catalogue.effects.torsion import TorsionSpring
from rb_sim.catalogue.effects.wrench import CommandedWrench, Wrench, WrenchTable
from rb_sim.catalogue.spec import Spec

SPECS: dict[str, type[Spec]] = {
    "gravity": Gravity,
    "linear_drag": LinearDrag,
    "quadratic_drag": QuadraticDrag,
    "angular_damping": AngularDamping,
    "spring": Spring,
    "torsion_spring": TorsionSpring,
    "wrench": Wrench,
    "wrench_table": WrenchTable,
    "commanded_wrench": CommandedWrench,
}
