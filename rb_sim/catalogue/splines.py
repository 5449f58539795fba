"""A spline c(s) as data: its pieces in one table, which functions compiled once read by address.

A traced law asks for the coefficients of the piece at a parameter and evaluates them itself, so the
same code serves every spline of a degree, and its derivatives are those of the piece.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from rb_sim.catalogue.spline_tables import (
    nearest_routine,
    nearest_to,
    piece_routine,
    put_piece,
    share_of_step,
    share_routine,
)
from rb_sim.graph.functions import call
from rb_sim.graph.machine import bound
from rb_sim.graph.symbols import External, stepwise
from rb_sim.loops.compiled import Routine, place_of

LEAST_POINTS = 64
"""Points from which the nearest is looked for, at least; and as many as there are breaks."""


class Pieces:
    """The pieces of a spline; equal to others with the same numbers.

    breaks: (m + 1,); coefficients: highest power first, (m, 3, degree + 1); period: length of the
    parameter range of a closed curve, 0 for an open one.
    """

    def __init__(self, breaks: np.ndarray, coefficients: np.ndarray, period: float) -> None:
        self.breaks, self.coefficients, self.period = breaks, coefficients, period
        m, _, width = coefficients.shape
        points = points_of(breaks, coefficients)
        head = [float(m), float(width - 1), period, float(len(points))]
        jumps = jumps_of(breaks, coefficients, period)
        parts = [head, breaks, jumps, coefficients.ravel(), points.ravel()]
        self.table = np.concatenate(parts)
        self._digest = hashlib.sha256(self.table.tobytes()).hexdigest()[:32]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pieces) and self._digest == other._digest

    def __hash__(self) -> int:
        return hash(self._digest)

    def point(self, s: Any) -> tuple[Any, Any, Any]:
        """(c, c', c'') at the parameter s."""
        start, *numbers = call(self.piece, s)
        u, width = s - start, len(numbers) // 3
        x, y, z = (derivatives(numbers[i * width : (i + 1) * width], u) for i in range(3))
        c, slope, bend = zip(x, y, z, strict=True)
        return c, slope, bend

    @cached_property
    def piece(self) -> External:
        """s -> where its piece begins, and its coefficients."""
        width = 3 * self.coefficients.shape[2]

        def plainly(s: float) -> tuple[float, ...]:
            results = [0.0] * (1 + width)
            put_piece(self.table, s, results)
            return tuple(map(float, results))

        return External(
            f"rb_sim_piece_{self._digest}",
            1 + width,
            plainly,
            lambda: self._address("_piece_law", piece_routine, 1),
            stepwise,
        )

    @cached_property
    def nearest(self) -> External:
        """A point -> the parameter of the nearest point of the curve."""

        def slope(x: float, y: float, z: float) -> list[tuple[float, ...]]:
            """ds/dp = c' / (c' . c' + (c - p) . c'')."""
            p = (x, y, z)
            c, c1, c2 = self.point(call(self.nearest, *p)[0])
            below = sum(a * a for a in c1) + sum(
                (a - b) * d for a, b, d in zip(c, p, c2, strict=True)
            )
            return [tuple(a / below for a in c1)]

        return External(
            f"rb_sim_nearest_{self._digest}",
            1,
            lambda *p: (float(nearest_to(self.table, *p)),),
            lambda: self._address("_nearest_law", nearest_routine, 3),
            slope,
        )

    @cached_property
    def share(self) -> External:
        """s0, v0, s1, v1, h, tolerance -> share of a step that ends where a piece does."""
        return External(
            f"rb_sim_share_{self._digest}",
            1,
            lambda *step: (float(share_of_step(self.table, *step)),),
            lambda: self._address("_share_law", share_routine, 6),
            stepwise,
        )

    def _address(self, name: str, does: Routine, arguments: int) -> int:
        """The address of the routine with this table; made once."""
        if name not in self.__dict__:
            numbers = (place_of(self.table), float(len(self.table)))
            self.__dict__[name] = bound(does.address, numbers, arguments)
        return self.__dict__[name].address


def derivatives(coefficients: Sequence[Any], u: Any) -> tuple[Any, Any, Any]:
    """A polynomial, its first and its second derivative at u; highest power first (Horner)."""
    c0: Any = 0.0
    c1: Any = 0.0
    c2: Any = 0.0
    for a in coefficients:
        c0, c1, c2 = c0 * u + a, c1 * u + c0, c2 * u + 2.0 * c1
    return c0, c1, c2


def jumps_of(breaks: np.ndarray, coefficients: np.ndarray, period: float) -> np.ndarray:
    """|c'' after - c'' before| / (|c'| u^(k - 2)) across each break, u beyond it; 0 at ends.

    Only the highest derivative jumps at a break of a spline.
    """
    m, _, width = coefficients.shape
    k = width - 1
    before = coefficients[np.arange(-1, m - 1)]
    jump = k * (k - 1) * np.linalg.norm(coefficients[:, :, 0] - before[:, :, 0], axis=1)
    jump /= np.linalg.norm(coefficients[:, :, k - 1], axis=1)
    jumps = np.append(jump, jump[0])
    if period == 0.0:
        jumps[[0, -1]] = 0.0
    return jumps


def points_of(breaks: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Rows s, c(s), equally many on each piece, its beginning among them, and the end; (n, 4)."""
    m, _, width = coefficients.shape
    inner = np.arange(-(-LEAST_POINTS // m)) / -(-LEAST_POINTS // m)
    u = np.diff(breaks)[:, None] * inner
    powers = u[:, :, None] ** np.arange(width - 1, -1, -1)
    c = np.einsum("iak,ijk->ija", coefficients, powers).reshape(-1, 3)
    last = coefficients[-1] @ (breaks[-1] - breaks[-2]) ** np.arange(width - 1.0, -1.0, -1.0)
    s = np.append((breaks[:-1, None] + u).ravel(), breaks[-1])
    return np.column_stack([s, np.vstack([c, last])])
