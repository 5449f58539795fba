"""Integrals over samples that come in pieces: what `loops.quadrature` is told, and tells."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from rb_sim.graph.machine import interpreted
from rb_sim.loops.quadrature import (
    COLUMN,
    COLUMNS,
    ENDS,
    LONGEST,
    STATE_AT,
    TIMES_AT,
    USED,
    WIDTH,
    integrate_into,
)

NONE = np.zeros(1)
NUMBERS = struct.Struct("=8q")
"""What stands from TIMES_AT on."""


FEW = 32
"""Samples up to which Python takes them: to load the loop takes more than that of all of them."""


class Samples:
    """Samples of functions. t: (n,); values: (n, width)."""

    def __init__(self, t: Any, values: Any) -> None:
        self.arrays = np.ascontiguousarray(t, float), np.ascontiguousarray(values, float)
        self.count = len(t)

    @cached_property
    def places(self) -> tuple[Any, Any]:
        """Where the arrays are."""
        t, values = self.arrays
        return t.ctypes.data, values.ctypes.data

    @property
    def last(self) -> Samples:
        """The last of them."""
        t, values = self.arrays
        return Samples(t[-1:], values[-1:])


class Integral:
    """Integrals of so many functions over samples that come in pieces."""

    def __init__(self, width: int) -> None:
        self._state = np.zeros(COLUMNS + COLUMN * width)
        self._state[LONGEST] = np.inf
        self._width = width
        self._few = np.inf if interpreted() else FEW
        """samples that Python still takes."""
        self._numbers: Any = None
        """places of the loop, and what writes them, once it is needed."""

    def take(
        self, samples: Samples, breaks: Sequence[float] = (), first: int = 0, stride: int = 1
    ) -> int:
        """Take every stride-th of the samples from `first` on; how many breaks are used up.

        breaks: increasing; those beyond the last sample stay.
        """
        self._few -= samples.count
        return self._call(samples, breaks, (samples.count, first, stride, len(breaks), 0))

    def _call(self, samples: Samples, breaks: Sequence[float], numbers: tuple[int, ...]) -> int:
        beside = np.array(breaks, dtype=float) if breaks else NONE
        if self._few >= 0:
            arrays = (array.reshape(-1) for array in (*samples.arrays, beside))
            places: Any = [self._state, self._width, 0, *arrays, *numbers]
            integrate_into.function(places)
            return places[USED]
        if self._numbers is None:
            places = np.zeros(ENDS + 1, np.int64)
            places[STATE_AT], places[WIDTH] = self._state.ctypes.data, self._width
            pack = partial(NUMBERS.pack_into, places, 8 * TIMES_AT)
            self._numbers = places, places.ctypes.data, pack
        places, at, pack = self._numbers
        pack(*samples.places, beside.ctypes.data if breaks else 0, *numbers)
        integrate_into(at)
        return int(places[USED])

    def copy(self) -> Integral:
        """Another one of the same samples."""
        other = Integral(self._width)
        other._state[:], other._few = self._state, self._few
        return other

    def ended(self) -> Any:
        """The columns, (width, COLUMN), with what is missing up to the last sample."""
        other = self.copy()
        other._call(NO_SAMPLES, (), (0, 0, 1, 0, 1))
        return other.columns

    @property
    def columns(self) -> Any:
        """(width, COLUMN)."""
        return self._state[COLUMNS:].reshape(-1, COLUMN)

    def gaps_from(self, longest: float) -> None:
        """Intervals beyond this are gaps from now on."""
        self._state[LONGEST] = longest


NO_SAMPLES = Samples(NONE[:0], NONE[:0, None])
