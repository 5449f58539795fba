"""Systems as loops pass them on: one address, behind which numbers and tables are packed.

A system of many tables goes from function to function as the address of its `Layout`; its tables
are read from there where they are used.  Whoever calls a loop holds the arrays.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rb_sim.compiler import arrays
from rb_sim.compiler import kinds as k
from rb_sim.compiler.builder import Value
from rb_sim.compiler.calls import means
from rb_sim.compiler.kinds import PackedSystem

REAL, INTEGER = "real", "integer"
"""Kinds of fields that are one number; tables are ("real", dimensions) or ("integer", ...)."""
_NUMBERS = {REAL: k.REAL, INTEGER: k.INTEGER}
_ARRAYS: dict[str, Any] = {REAL: np.float64, INTEGER: np.int64}


def held(vector):
    """The system whose packed layout begins here; interpreted, the system itself."""
    return vector


@means(held)
def _held(f: Any, vector: Value) -> Value:
    return Value(PackedSystem(), (vector.leaves[0],))


def held_at(places, i):
    """As `held`, of the layout whose address is among the places, at i."""
    return places[i]


@means(held_at)
def _held_at(f: Any, places: Value, i: Value) -> Value:
    return Value(PackedSystem(), arrays.as_kind(f, arrays.entry(f, places, [i]), k.VECTOR).leaves)


def address(system):
    """Where the packed layout of the system begins; interpreted, the system itself."""
    return system


@means(address)
def _address(f: Any, system: Value) -> Value:
    return Value(k.VECTOR, system.leaves)


def _slots(kind: Any) -> int:
    return 1 if isinstance(kind, str) else 1 + kind[1]


class Layout:
    """Names and kinds of the fields of a system; loops read them as attributes."""

    def __init__(self, fields: Mapping[str, Any]) -> None:
        self.fields = dict(fields)
        at = 0
        for name, kind in self.fields.items():
            number = isinstance(kind, str)
            found = _NUMBERS[kind] if number else k.Array(kind[0], kind[1])
            if arrays.FIELDS.setdefault(name, (found, at)) != (found, at):
                raise ValueError(f"{name}: a field of another layout, which lies elsewhere")
            at += _slots(kind)
        self.size = at

    def pack(self, values: Mapping[str, Any]) -> np.ndarray:
        """The system as numbers; arrays by address, which the caller keeps alive."""
        packed = np.zeros(self.size, np.int64)
        at = 0
        for name, kind in self.fields.items():
            value = values[name]
            if kind == REAL:
                packed[at : at + 1].view(np.float64)[0] = value
            elif kind == INTEGER:
                packed[at] = value
            else:
                if value.dtype != _ARRAYS[kind[0]] or not value.flags.c_contiguous:
                    raise TypeError(f"{name}: must be a contiguous table of {kind[0]} numbers")
                packed[at] = value.ctypes.data
                packed[at + 1 : at + 1 + kind[1]] = value.shape
            at += _slots(kind)
        return packed.view(np.float64)
