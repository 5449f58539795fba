"""Tables and systems as loops pass them on: where the numbers are, and how many.

An array of numba is nine fields and counts its references, and every call takes it apart and puts
it together again.  Whoever calls a loop holds the arrays, so inside it a pointer and the lengths
do; and a system of many tables goes on as the one address of its `Layout`.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import (
    intrinsic,
    make_attribute_wrapper,
    models,
    overload,
    overload_attribute,
    overload_method,
    register_model,
)

from rb_sim.loops.compiled import INNER, VECTOR, pointer

_intrinsic: Any = intrinsic
_carray: Any = numba.carray  # pyright: ignore[reportPrivateImportUsage]

REAL, INTEGER = "real", "integer"
"""Kinds of fields that are one number; tables are ("real", dimensions) or ("integer", ...)."""
_NUMBERS: dict[str, Any] = {REAL: types.float64, INTEGER: types.int64}
_ARRAYS: dict[str, Any] = {REAL: np.float64, INTEGER: np.int64}


class Table(types.Type):
    """A C-contiguous array whose memory someone else holds."""

    def __init__(self, dtype: Any, ndim: int) -> None:
        self.dtype, self.ndim = dtype, ndim
        super().__init__(name=f"Table({dtype}, {ndim})")


@register_model(Table)
class _TableModel(models.StructModel):
    """Pointer to the first element, and the lengths."""

    def __init__(self, dmm: Any, fe_type: Table) -> None:
        members = [
            ("data", types.CPointer(fe_type.dtype)),
            ("shape", types.UniTuple(types.intp, fe_type.ndim)),
        ]
        super().__init__(dmm, fe_type, members)


make_attribute_wrapper(Table, "data", "data")
make_attribute_wrapper(Table, "shape", "shape")


@_intrinsic
def _row(context, table, i):
    """The rest of the table from its i-th entry on."""
    rest = Table(table.dtype, table.ndim - 1)

    def generate(context, builder, signature, arguments):
        data = builder.extract_value(arguments[0], 0)
        place = arguments[1]
        lengths = [builder.extract_value(arguments[0], [1, d]) for d in range(1, table.ndim)]
        for length in lengths:
            place = builder.mul(place, length)
        value = ir.Constant(context.get_value_type(rest), ir.Undefined)
        value = builder.insert_value(value, builder.gep(data, [place]), 0)
        for d, length in enumerate(lengths):
            value = builder.insert_value(value, length, [1, d])
        return value

    return rest(table, types.intp), generate


def _depth(index: Any) -> int:
    """How many leading indices the type stands for; 0 where they are no integers."""
    kinds = tuple(getattr(index, "types", ())) if isinstance(index, types.BaseTuple) else (index,)
    return len(kinds) if all(isinstance(kind, types.Integer) for kind in kinds) else 0


@overload(operator.getitem, jit_options=INNER)
def _element_of(table, index):
    if not isinstance(table, Table):
        return None
    whole = isinstance(index, types.BaseTuple)
    depth = _depth(index)
    if depth == 1 and not whole:
        if table.ndim == 1:
            return lambda table, index: table.data[index]
        return lambda table, index: _row(table, index)
    if depth == 2 and table.ndim == 2:
        return lambda table, index: table.data[index[0] * table.shape[1] + index[1]]
    if depth == 2 and table.ndim == 3:
        return lambda table, index: _row(_row(table, index[0]), index[1])
    if depth == 3 and table.ndim == 3:
        return lambda table, index: table.data[
            (index[0] * table.shape[1] + index[1]) * table.shape[2] + index[2]
        ]
    return None


@overload(operator.setitem, jit_options=INNER)
def _set_element_of(table, index, value):
    if not isinstance(table, Table) or _depth(index) != table.ndim:
        return None
    if table.ndim == 1:

        def one(table, index, value):
            table.data[index] = value

        return one
    if table.ndim == 2:

        def two(table, index, value):
            table.data[index[0] * table.shape[1] + index[1]] = value

        return two

    def three(table, index, value):
        table.data[(index[0] * table.shape[1] + index[1]) * table.shape[2] + index[2]] = value

    return three


def whole(table):
    """The table as an array that can be sliced and given to numpy."""
    return table


@overload(whole, jit_options=INNER)
def _whole_of(table):
    if isinstance(table, Table):
        return lambda table: _carray(table.data, table.shape)
    return lambda table: table


@overload_method(Table, "copy")
def _copy_of(table):
    return lambda table: _carray(table.data, table.shape).copy()


@overload(pointer, jit_options=INNER)
def _pointer_of(table):
    return (lambda table: table.data) if isinstance(table, Table) else None


class Held(types.Type):
    """A system behind one address."""

    def __init__(self) -> None:
        super().__init__(name="Held")


@register_model(Held)
class _HeldModel(models.PrimitiveModel):
    """The address of its layout."""

    def __init__(self, dmm: Any, fe_type: Held) -> None:
        super().__init__(dmm, fe_type, ir.IntType(64).as_pointer())


HELD = Held()


@_intrinsic
def _as_held(context, vector):
    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(HELD))

    return HELD(VECTOR), generate


def held(vector):
    """The system whose packed layout begins here; interpreted, the system itself."""
    return vector


def address(system):
    """Where the packed layout of the system begins; interpreted, the system itself."""
    return system


@_intrinsic
def _as_vector(context, system):
    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(VECTOR))

    return VECTOR(HELD), generate


@overload(address, jit_options=INNER)
def _address_of(system):
    return lambda system: _as_vector(system)


@overload(held, jit_options=INNER)
def _held_of(vector):
    return lambda vector: _as_held(vector)


def _slots(kind: Any) -> int:
    return 1 if isinstance(kind, str) else 1 + kind[1]


class Layout:
    """Names and kinds of the fields of a system; loops read them as attributes."""

    def __init__(self, fields: Mapping[str, Any]) -> None:
        self.fields = dict(fields)
        at = 0
        for name, kind in self.fields.items():
            _add_field(name, kind, at)
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


def _add_field(name: str, kind: Any, at: int) -> None:
    number = isinstance(kind, str)
    result = _NUMBERS[kind] if number else Table(_NUMBERS[kind[0]], kind[1])

    @_intrinsic
    def read(context, system):
        def slot(builder, address, k):
            place = builder.gep(address, [ir.Constant(ir.IntType(64), k)])
            value = builder.load(place)
            value.set_metadata("invariant.load", builder.module.add_metadata([]))
            return value

        def generate(context, builder, signature, arguments):
            first = slot(builder, arguments[0], at)
            if number:
                kind_of = context.get_value_type(result)
                return first if kind == INTEGER else builder.bitcast(first, kind_of)
            value = ir.Constant(context.get_value_type(result), ir.Undefined)
            pointer = context.get_value_type(types.CPointer(result.dtype))
            value = builder.insert_value(value, builder.inttoptr(first, pointer), 0)
            for d in range(result.ndim):
                value = builder.insert_value(value, slot(builder, arguments[0], at + 1 + d), [1, d])
            return value

        return result(HELD), generate

    @overload_attribute(Held, name)
    def get(system):
        return lambda system: read(system)
