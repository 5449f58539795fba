"""Statics: the reactions that hold bodies at rest, or why there is no equilibrium (LL 38)."""

import sys

from rb_sim.base.callable_package import Called
from rb_sim.scene.load import load_statics
from rb_sim.scene.schema import StaticsScene
from rb_sim.statics.result import Finding, Reaction, ReactionRange, StaticsResult
from rb_sim.statics.solve import solve

__all__ = [
    "Finding",
    "Reaction",
    "ReactionRange",
    "StaticsResult",
    "StaticsScene",
    "load_statics",
    "solve",
]

sys.modules[__name__].__class__ = Called  # rb_sim.statics is a function, too
