"""Planes and second-order cones on a vector y, and what is minimised over them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MIRROR = np.array([1.0, -1.0, -1.0])
"""the quadratic form head^2 - |tail|^2."""
ROUNDING = 1e-13
"""Slack below zero, relative to 1 (the largest of the given loads) and to the size of y, that is
rounding: up to it y keeps within its bounds, beyond it does not."""


class Cones(NamedTuple):
    """The admissible set. p half-spaces, q cones, k unknowns."""

    lin_h: Array
    """(p,)."""
    lin_G: Array
    """(p, k)."""
    soc_h: Array
    """(q, 3), [head, tail, tail]."""
    soc_G: Array
    """(q, 3, k)."""

    @property
    def soc_rows(self) -> Array:
        """soc_G as one matrix, (3 q, k)."""
        return self.soc_G.reshape(-1, self.soc_G.shape[2])

    def at(self, y: Array) -> tuple[Array, Array]:
        """Values (p,) of the half-spaces and (q, 3) of the cones."""
        return self.lin_h + self.lin_G @ y, self.soc_h + self.soc_G @ y

    def slack(self, y: Array) -> Array:
        """a_i and head_j - |tail_j|, shape (p + q,): all >= 0 is admissible."""
        lin, soc = self.at(y)
        return np.concatenate([lin, soc[:, 0] - np.hypot(soc[:, 1], soc[:, 2])])

    def admits(self, y: Array) -> bool:
        """Whether y keeps within all bounds, but for rounding."""
        least = -ROUNDING * (1.0 + float(np.linalg.norm(y)))
        return bool(self.slack(y).min(initial=np.inf) >= least)


class Objective(NamedTuple):
    """1/2 |root y|^2 + c.y."""

    root: Array
    """(m, k); (0, k) for a linear objective."""
    c: Array
    """(k,)."""

    def slope(self, y: Array) -> Array:
        """Gradient, (k,)."""
        return self.root.T @ (self.root @ y) + self.c


def linear(c: Array) -> Objective:
    """The objective c.y."""
    return Objective(np.zeros((0, len(c))), c)


def lorentz_form(soc: Array) -> Array:
    """head^2 - |tail|^2 without cancellation, (q,)."""
    tail = np.hypot(soc[:, 1], soc[:, 2])
    return (soc[:, 0] - tail) * (soc[:, 0] + tail)
