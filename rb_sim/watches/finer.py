"""A finer fixed step by the order of a method: error ~ step^order."""

from __future__ import annotations

import math

MARGIN = 2.0
"""Times below its bound that the figure is to come."""

LARGEST_SHARE = 1.0
"""A figure above it tells of a motion that is lost, not of how the error grows with the step."""

ROUND = (5.0, 2.0, 1.0)
"""Leading digits of steps that are named."""


def finer_step(step: float, figure: float, bound: float, order: int) -> float:
    """The step [s] whose figure is MARGIN below its bound, if figure ~ step^order; at most half of
    `step`, rounded down to 1, 2 or 5 times a power of ten."""
    known = min(figure, LARGEST_SHARE) if math.isfinite(figure) else LARGEST_SHARE
    ratio = min(1.0, bound / (MARGIN * known)) if known > 0.0 else 1.0
    return round_down(step * min(0.5, ratio ** (1.0 / order)))


def try_step(step: float) -> str:
    """Advice to try a step [s] that has not been tried."""
    return f"try step {step:g} s, or method dopri853 with a tolerance"


def round_down(step: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above step > 0."""
    power = math.floor(math.log10(step))
    for digit in ROUND:
        rounded = float(f"{digit:.0f}e{power}")
        if rounded <= step:
            return rounded
    return float(f"5e{power - 1}")  # where the logarithm was rounded up to a power of ten


def below(step: float) -> float:
    """The next smaller one of 1, 2 and 5 times a power of ten that is at most half of step."""
    return round_down(0.5 * step)
