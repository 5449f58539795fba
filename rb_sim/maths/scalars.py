"""Functions of numbers that kernels call, for floats, compiled code and the symbols of a trace.

`where(condition, a, b)` takes the place of a branch on the state; both sides are computed.
"""

from __future__ import annotations

from rb_sim.graph.functions import atan2, cos, maximum, rarely, sin, sqrt, where

__all__ = ["atan2", "cos", "maximum", "rarely", "sin", "sqrt", "where"]
