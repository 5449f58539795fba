"""Dormand-Prince method of order 8 with error estimates of orders 5 and 3.

Hairer, Norsett, Wanner I, section II.5 and the code DOP853.  Between grid points the state is found
by one more step of the length wanted, from the grid point before it: order 8 at every sample time,
paid only where a sample is asked for.  The step is `loops.methods.dopri853`.
"""

from __future__ import annotations

from typing import NamedTuple


class Dopri853(NamedTuple):
    """Fixed step [s]."""

    step: float


class AdaptiveDopri853(NamedTuple):
    """Step chosen so that the estimated local error stays within the tolerance."""

    tolerance: float
    """relative to max(1, |y_i|) of each coordinate."""
    largest_step: float
    """[s]."""
