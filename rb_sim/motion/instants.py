"""At which instants a run is sampled."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.mechanics.samples import Array

MOST_SAMPLES = 2**53
"""Of one run: beyond, sample times are no longer distinct numbers."""

BESIDE = 64.0
"""Distance of the samples beside an event, in roundings of the run's end."""


def is_finite(value: Any) -> bool:
    """Whether it is a finite number; False of what is none."""
    try:
        return math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def samples_at_rate(duration: float, rate: float) -> int:
    """How many samples at `rate` [Hz] lie within `duration` [s], the start included.

    Raises RbSimError where their times are no longer distinct numbers.
    """
    if not duration * rate < MOST_SAMPLES:
        raise RbSimError(f"got {duration:g} s at {rate:g} Hz; must be fewer than 2^53 samples")
    return math.floor(duration * rate * (1.0 + COMPUTED_ROUNDING) + COMPUTED_ROUNDING) + 1


def instants_at_rate(start: float, duration: float, rate: float) -> Array:
    """Every 1/rate [s] from `start` on, and the end."""
    count, end = samples_at_rate(duration, rate), start + duration
    times = np.minimum(start + np.arange(count) / rate, end)
    if end - (start + (count - 1) / rate) > COMPUTED_ROUNDING / rate:
        times = np.append(times, end)
    return times


def instants_given(at: Sequence[float] | Array, now: float) -> Array:
    """The instants that a caller names, checked. now: the present time [s]."""
    allowed = f"at: must be increasing finite numbers, from the present time {now:g} s on"
    try:
        times: Any = np.array(at, dtype=float)
    except (TypeError, ValueError):
        raise RbSimError(f"{allowed}; got {at!r}") from None
    if times.ndim != 1 or not len(times):
        raise RbSimError(f"{allowed}; got {'none' if times.size == 0 else 'no list of numbers'}")
    if not np.isfinite(times).all():
        raise RbSimError(f"{allowed}; got {times[~np.isfinite(times)][0]}")
    wrong = np.flatnonzero(np.diff(times, prepend=np.nextafter(now, -np.inf)) <= 0.0)
    if len(wrong):
        before = f" after {times[wrong[0] - 1]:g}" if wrong[0] else ""
        raise RbSimError(f"{allowed}; got {times[wrong[0]]:g}{before}")
    return times


def instants_beside(events: Sequence[float], start: float, end: float) -> Array:
    """Just before and just after each event, within the run from `start` to `end` [s]."""
    if not events:
        return np.empty(0)
    apart = BESIDE * np.spacing(end)
    found = np.array(events)
    beside = np.concatenate([found - apart, found + apart])
    return np.unique(beside[(beside > start) & (beside < end)])
