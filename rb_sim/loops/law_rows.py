"""The least number that a law gives, at many instants and states in one call."""

from __future__ import annotations

from typing import Any

import numpy as np

from rb_sim.graph.machine import Law, evaluate_rows
from rb_sim.loops.compiled import call_law, for_python, integers_to, part, pointer_to

LAW, TIMES_AT, STATES_AT, INPUTS_AT, ROOM_AT, FOUND_AT = range(6)
COUNT, COORDINATES, WIDTH, TOLD = range(6, 10)
"""Places in what `least_into` is told."""


@for_python
def least_into(places):
    """Write the least number that the law gives at every time with its row of the states, and which
    of its numbers that is; or, if TOLD, the last two of its numbers, which say the same."""
    times, states = pointer_to(places, TIMES_AT), pointer_to(places, STATES_AT)
    p, row = pointer_to(places, INPUTS_AT), pointer_to(places, ROOM_AT)
    found, laws = pointer_to(places, FOUND_AT), integers_to(places, LAW)
    width = places[WIDTH]
    for i in range(places[COUNT]):
        call_law(laws[0], times[i], part(states, i * places[COORDINATES]), p, row)
        least, number = 1.0, 0.0
        if places[TOLD]:
            if row[width - 2] - row[width - 2] == 0.0:
                least, number = row[width - 2], row[width - 1]
        else:
            for k in range(width):
                if row[k] < least and row[k] - row[k] == 0.0:
                    least, number = row[k], 1.0 * k
        found[2 * i] = least
        found[2 * i + 1] = number
    return 0


FEW = 1024
"""Calls of a law up to which Python makes them, a third of a microsecond each: to load the loop
takes more than that of all of them."""


class LeastOf:
    """The least number of those that a law gives at many instants, 1 where none is below.

    What is not finite counts as 1. law: machine code, or a Python function of arrays.

    inputs: p. width: how many numbers it gives. told: whether its last two tell the least of them
    and which it is.
    """

    def __init__(self, law: Any, inputs: Any, width: int, told: bool) -> None:
        self._law, self._inputs, self._width, self._told = law, inputs, width, told
        self._address = np.array([law.address]) if isinstance(law, Law) else None
        self._room = np.zeros(width)
        self._called = 0

    def __call__(self, t: Any, y: Any) -> tuple[Any, Any]:
        """(the least, which) at every t (n,) with the rows of y (n, N), both contiguous."""
        self._called += len(t)
        if self._address is None or self._called <= FEW:
            return self._by_python(t, y)
        found = np.empty((len(t), 2))
        arrays = self._address, t, y, self._inputs, self._room, found
        numbers = *y.shape, self._width, int(self._told)
        places = np.array([*(a.ctypes.data for a in arrays), *numbers])
        least_into(places.ctypes.data)
        return found[:, 0], found[:, 1].astype(int)

    def _by_python(self, t: Any, y: Any) -> tuple[Any, Any]:
        rows = np.zeros((len(t), self._width))
        evaluate_rows(self._law, t, y, self._inputs, rows)
        rows[~np.isfinite(rows)] = 1.0
        if self._told:
            return rows[:, -2], rows[:, -1].astype(int)
        return np.minimum(rows.min(axis=1), 1.0), rows.argmin(axis=1)
