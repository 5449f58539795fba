"""What a closed form gives: the coordinates of a system at any time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from rb_sim.engine.samples import Array


class Exact(NamedTuple):
    """The exact motion of one compiled system."""

    name: str
    """what it is, and the source."""
    coordinates: Callable[[Array], Array]
    """times (n,) [s] -> coordinates y (n, len y) of the system."""
