"""One support as it enters the equilibrium: its wrench per unknown, and the unknowns' bounds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Law = Literal["two-way", "one-way"]


class Bound(NamedTuple):
    """|x[tails]| <= coefficient N, N the push x[0], or `push` where that is given."""

    gives: Literal["slips", "rolls", "spins"]
    """what happens beyond it."""
    coefficient: float
    """of friction, or the arm of a resistance to turning [m]."""
    tails: tuple[int, ...]
    """one or two unknowns of the element."""
    push: float | None = None
    """[N], of a support that gives way: its depth says how hard it pushes."""


@dataclass(frozen=True)
class Element:
    """One support placed in the world, m unknowns."""

    name: str
    kind: str
    body: str
    parent: str | None
    anchor_W: Array
    """where it acts on the body, world [m], (3,)."""
    parent_anchor_W: Array
    """where it acts on the parent; differs from anchor_W for strings and rods, (3,)."""
    force_W: Array
    """force on the body per unknown, (3, m)."""
    torque_W: Array
    """torque on the body about anchor_W per unknown, (3, m)."""
    law: Law
    """two-way: any x; one-way: x[0] >= 0; its bounds hold besides."""
    friction: float = 0.0
    bounds: tuple[Bound, ...] = ()
    given_W: Array = field(default_factory=lambda: np.zeros(3))
    """force on the body whatever the unknowns are, (3,)."""
    normal_W: Array | None = None
    """of a contact without unknowns along it, (3,)."""

    @property
    def size(self) -> int:
        """m."""
        return self.force_W.shape[1]

    @property
    def rubs(self) -> bool:
        """Whether it is a contact with friction."""
        return self.direction is not None and self.friction > 0.0

    @property
    def direction(self) -> Array | None:
        """Unit vector of the first unknown: a contact's normal, a string's or rod's line; (3,)."""
        if self.normal_W is not None:
            return self.normal_W
        return self.force_W[:, 0] if self.kind in ("contact", "string", "rod") else None
