"""Integrals over samples that come in pieces: what `loops.quadrature` is told, and tells."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from rb_sim.graph.machine import interpreted
from rb_sim.loops.compiled import where
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


class Samples:
    """Where samples of functions are: t (n,) and values (n, width), which must live as long."""

    def __init__(self, t: Any, values: Any) -> None:
        self._arrays = np.ascontiguousarray(t, float), np.ascontiguousarray(values, float)
        self.t, self.values = map(where, self._arrays)
        self.count = len(t)

    @property
    def last(self) -> Samples:
        """The last of them."""
        t, values = self._arrays
        return Samples(t[-1:], values[-1:])


class Integral:
    """Integrals of so many functions over samples that come in pieces."""

    def __init__(self, width: int) -> None:
        self._state = np.zeros(COLUMNS + COLUMN * width)
        self._state[LONGEST] = np.inf
        self._width = width
        plain = interpreted()
        self._places: Any = [None] * (ENDS + 1) if plain else np.zeros(ENDS + 1, np.int64)
        self._places[STATE_AT], self._places[WIDTH] = where(self._state), width
        self._at = self._places if plain else where(self._places)
        self._nothing = where(NONE)
        self._pack = None if plain else partial(NUMBERS.pack_into, self._places, 8 * TIMES_AT)

    def take(
        self, samples: Samples, breaks: Sequence[float] = (), first: int = 0, stride: int = 1
    ) -> int:
        """Take every stride-th of the samples from `first` on; how many breaks are used up.

        breaks: increasing; those beyond the last sample stay.
        """
        beside, at = None, self._nothing
        if breaks:
            beside = np.array(breaks, dtype=float)
            at = where(beside)
        self._call(samples.t, samples.values, at, samples.count, first, stride, len(breaks), 0)
        return int(self._places[USED])

    def _call(self, *numbers: Any) -> None:
        if self._pack is None:
            self._places[TIMES_AT:] = numbers
        else:
            self._pack(*numbers)
        integrate_into(self._at)

    def copy(self) -> Integral:
        """Another one of the same samples."""
        other = Integral(self._width)
        other._state[:] = self._state
        return other

    def ended(self) -> Any:
        """The columns, (width, COLUMN), with what is missing up to the last sample."""
        other = self.copy()
        other._call(*[other._nothing] * 3, 0, 0, 1, 0, 1)
        return other.columns

    @property
    def columns(self) -> Any:
        """(width, COLUMN)."""
        return self._state[COLUMNS:].reshape(-1, COLUMN)

    def gaps_from(self, longest: float) -> None:
        """Intervals beyond this are gaps from now on."""
        self._state[LONGEST] = longest
