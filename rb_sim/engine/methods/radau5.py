"""Radau IIA of order 5: L-stable, for stiff springs, strong damping and extreme mass ratios.

The step is `loops.methods.radau5`; it needs the Jacobian of traced laws.
"""

from __future__ import annotations

from typing import NamedTuple


class Radau5(NamedTuple):
    """Fixed step [s]."""

    step: float


class AdaptiveRadau5(NamedTuple):
    """Local tolerance, relative to max(1, |y|) in each coordinate; largest step [s]."""

    tolerance: float
    largest_step: float
