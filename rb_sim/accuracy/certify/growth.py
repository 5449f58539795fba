"""How one unit in the last place of the start grows: as a power of the time, or exponentially."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rb_sim.engine.samples import Array

CHAOTIC = 1e4
"""Growth over the run below which nothing is said about its law: too little to tell one by."""

SATURATED = 1e-2
"""Share of the motion's own size above which two runs no longer part exponentially."""

FEWEST = 20
"""Instants to fit."""


class Growth(NamedTuple):
    """Of one ulp in every coordinate of the start."""

    factor: float
    """largest distance over the run, over that after its first hundredth."""
    lyapunov_time: float
    """time in which it grows by a factor of e [s]; infinite where it grows no faster than a power
    of the time does."""


def growth_of(times: Array, apart: Array) -> Growth:
    """The law of growth of a distance, relative to the motion's size, at the times (n,) each."""
    so_far = np.maximum.accumulate(apart)
    first = max(1, len(times) // 100)
    if not len(times) or not so_far[-1] > 0.0:
        return Growth(1.0, math.inf)
    start = max(float(so_far[min(first, len(so_far) - 1)]), 1e-17)
    factor = float(so_far[-1]) / start
    used = (so_far <= SATURATED) & (so_far > 0.0) & (times > 0.0)
    if factor < CHAOTIC or used.sum() < FEWEST:
        return Growth(factor, math.inf)
    t, grown = times[used], np.log(so_far[used])
    rate, rest = fitted(t, grown)
    _, rest_of_power = fitted(np.log(t), grown)
    exponential = rest < rest_of_power and rate > 0.0
    return Growth(factor, 1.0 / rate if exponential else math.inf)


def fitted(x: Array, y: Array) -> tuple[float, float]:
    """(slope, sum of squares left) of the straight line through the points."""
    (slope, start), *_ = np.linalg.lstsq(np.stack([x, np.ones_like(x)], axis=1), y, rcond=None)
    left = y - slope * x - start
    return float(slope), float(left @ left)
