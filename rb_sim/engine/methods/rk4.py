"""The classical Runge-Kutta method of order 4 (Kutta 1901); its step is `loops.methods.rk4`."""

from __future__ import annotations

from typing import NamedTuple


class Rk4(NamedTuple):
    """Fixed step [s]."""

    step: float
