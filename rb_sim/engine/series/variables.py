"""Other variables z than the coordinates y for the steps along a Taylor series.

The series comes from the graph of dz/dt as any other; what is written for a system is that law and
the ways between y and z.  Worth it where it is 1.3 times cheaper (`python -m benchmarks.series`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rb_sim.catalogue.types import BodyState
from rb_sim.maths.vectors import ZERO

Numbers = Sequence[Any]

AT_REST = BodyState(ZERO, (0.0, 0.0, 0.0, 1.0), ZERO, ZERO)
"""At the origin, its axes those of the world: where loads do not depend on the state."""


class Variables(NamedTuple):
    """Plain Python on numbers and symbols, as every law."""

    suits: Callable[[Any], bool]
    """whether the motion of this compiled system can be written in them."""
    count: int
    begin: Callable[[Any, Numbers], Numbers]
    """(system, y) -> z at the start of a step."""
    rates: Callable[[Any, Numbers], Numbers]
    """(system, z) -> dz/dt."""
    change: Callable[[Any, Numbers, Numbers, Numbers], Numbers]
    """(system, y and z at the start, change of z) -> change of y."""
