"""Functions of numbers that kernels call, for floats, compiled code and the symbols of a trace.

`where(condition, a, b)` takes the place of a branch on the state; both sides are computed.
"""

from __future__ import annotations

import math

from rb_sim.graph import functions
from rb_sim.maths.jit import by_type


def _sqrt(x):
    """The square root."""


def _sin(x):
    """The sine of x [rad]."""


def _cos(x):
    """The cosine of x [rad]."""


def _atan2(y, x):
    """The angle of the point (x, y) [rad], in [-pi, pi]."""


def _where(condition, a, b):
    """a where the condition holds, else b; numbers, or tuples of them alike."""


def _rarely(condition, a, b):
    """As `where` for numbers and a condition that hardly ever holds."""


def _maximum(a, b):
    """The larger of two."""


sqrt = by_type(_sqrt, lambda x: lambda x: math.sqrt(x), functions.sqrt)
sin = by_type(_sin, lambda x: lambda x: math.sin(x), functions.sin)
cos = by_type(_cos, lambda x: lambda x: math.cos(x), functions.cos)
atan2 = by_type(_atan2, lambda y, x: lambda y, x: math.atan2(y, x), functions.atan2)
where = by_type(
    _where,
    lambda condition, a, b: lambda condition, a, b: a if condition else b,
    functions.where,
)
rarely = by_type(
    _rarely,
    lambda condition, a, b: lambda condition, a, b: a if condition else b,
    functions.rarely,
)
maximum = by_type(_maximum, lambda a, b: lambda a, b: max(a, b), functions.maximum)
