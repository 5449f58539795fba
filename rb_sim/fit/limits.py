"""How far the numbers of a fit may go: bounds that are known, and those at which a scene refuses.

A scene says no where friction would be less at rest than in a slip, a body would begin inside a
floor, an inertia would be no body's. A derivative is taken to the side that is possible, and a
search that such a limit stops goes on along it. What a recording does not tell stays where it was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rb_sim.scene.schema import SimulationOptions

STEP = 1e-5
"""Of a difference, relative to a number's scale."""
UNDETERMINED = 1e-9
"""Singular value of J, relative to the largest, below which a combination has no effect."""
UNTOLD = 1e-5
"""The same where J is taken by differences: a motion to 1e-10 over steps of 1e-5."""
TOLERANCE = 1e-10
"""Of motions of which differences are taken, at most."""
NEAR = 1e-6
"""From a bound, within which a number is at it."""


def differenced(options: SimulationOptions) -> SimulationOptions:
    """How the motions of differences are integrated: steps of adaptive length change with the
    numbers, and what a coarse tolerance leaves of the motion changes with them."""
    if options.tolerance is None:
        return options
    method = "dopri853" if options.method == "auto" else options.method
    return options.model_copy(
        update={"method": method, "tolerance": min(TOLERANCE, options.tolerance)}
    )


def difference(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, k: int) -> np.ndarray:
    """df/dx_k of second order; nothing where f is not finite on either side.

    Central, or to one side, (4 f(x + h) - f(x + 2 h) - 3 f(x)) / 2 h, where f(x - h) is not finite.
    """
    h = np.zeros(len(x))
    h[k] = STEP
    above, below = f(x + h), f(x - h)
    sides = np.isfinite(above).all(), np.isfinite(below).all()
    if all(sides):
        return (above - below) / (2.0 * STEP)
    if not any(sides):
        return np.zeros_like(above)
    sign, one = (1.0, above) if sides[0] else (-1.0, below)
    here, two = f(x), f(x + 2.0 * sign * h)
    if not np.isfinite(two).all():
        return sign * (one - here) / STEP
    return sign * (4.0 * one - two - 3.0 * here) / (2.0 * STEP)


def differences(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """`difference` by each number, shape (len(f), len(x))."""
    return np.stack([difference(f, x, k) for k in range(len(x))], axis=1)


def moving(J: np.ndarray) -> np.ndarray:
    """Which numbers have an effect."""
    sizes = np.linalg.norm(J, axis=0)
    return sizes > UNDETERMINED * sizes.max(initial=1e-300)


def negligible(exact: bool) -> float:
    """Singular value of J, relative to the largest, that says nothing."""
    return UNDETERMINED if exact else UNTOLD


def untold(s: np.ndarray, least: float) -> np.ndarray:
    """Which singular values say nothing beside the largest."""
    return s <= least * max(s[0], 1e-300)


def still(J: np.ndarray, least: float) -> np.ndarray:
    """Rows that hold the combinations without effect, as strongly as the data hold the weakest
    of the others: what the data do not tell is where the search began."""
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    weak = untold(s, least)
    return s[~weak].min() * Vt[weak] if weak.any() and not weak.all() else Vt[:0]


def held_still(
    slopes: Callable[[np.ndarray], np.ndarray], start: np.ndarray, least: float
) -> tuple[np.ndarray, Any]:
    """The rows of `still` at the start, and the derivative with them; at the start it is taken
    once."""
    first = slopes(start)
    held = still(first, least)

    def derivative(x: np.ndarray) -> np.ndarray:
        return np.vstack([first if np.array_equal(x, start) else slopes(x), held])

    return held, derivative


@dataclass
class Limits:
    """low and high of each number, of the numbers of the search."""

    low: np.ndarray
    high: np.ndarray

    @property
    def fixed(self) -> np.ndarray:
        """Those that may not move at all."""
        return self.low >= self.high

    def same(self, other: Limits) -> bool:
        """Whether they are the same."""
        return np.array_equal(self.low, other.low) and np.array_equal(self.high, other.high)

    def inside(self, x: np.ndarray) -> np.ndarray:
        """x, not beyond them."""
        return np.clip(x, self.low, self.high)

    def reached(self, x: np.ndarray) -> np.ndarray:
        """Which numbers are at one of them."""
        near = NEAR * np.maximum(1.0, np.abs(x))
        return (x - self.low < near) | (self.high - x < near)

    def at(
        self, x: np.ndarray, slope: np.ndarray, possible: Callable[[np.ndarray], bool]
    ) -> Limits:
        """These, and x itself on each side on which it would go down but is not possible.

        slope: of the sum of squares along each number.
        """
        low, high = self.low.copy(), self.high.copy()
        for k, downhill in enumerate(-np.sign(slope)):
            step = np.zeros(len(x))
            step[k] = STEP
            refused = {sign: not possible(x + sign * step) for sign in (-1.0, 1.0)}
            if refused.get(float(downhill)):
                low[k] = x[k] if refused[-1.0] else low[k]
                high[k] = x[k] if refused[1.0] else high[k]
        return Limits(low, high)
