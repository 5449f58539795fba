"""Arrays as kernels of N bodies pass them on: where the numbers are and how many, nothing else.

An array of numba is nine fields and counts its references, and every call of a function takes it
apart and puts it together again.  Whoever calls a kernel holds the arrays, so inside it a pointer
and the lengths do.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import (
    intrinsic,
    lower_builtin,
    make_attribute_wrapper,
    overload,
    overload_method,
    register_model,
)
from numba.np.arrayobj import make_array, populate_array

from rb_sim.maths.jit import by_type


class Table(types.Type):
    """A C-contiguous array whose memory someone else holds."""

    def __init__(self, dtype: Any, ndim: int) -> None:
        self.dtype, self.ndim = dtype, ndim
        super().__init__(name=f"Table({dtype}, {ndim})")


@register_model(Table)
class TableModel(models.StructModel):
    """Pointer to the first element, and the lengths."""

    def __init__(self, dmm: Any, fe_type: Table) -> None:
        members = [
            ("data", types.CPointer(fe_type.dtype)),
            ("shape", types.UniTuple(types.intp, fe_type.ndim)),
        ]
        super().__init__(dmm, fe_type, members)


make_attribute_wrapper(Table, "shape", "shape")


def _indices(table: Any, index: Any) -> Any:
    """The types of the leading indices, or None where they are not integers of a table."""
    kinds = tuple(index.types) if isinstance(index, types.BaseTuple) else (index,)
    if not isinstance(table, Table) or len(kinds) > table.ndim:
        return None
    if not all(isinstance(kind, types.Integer) for kind in kinds):
        return None
    if isinstance(index, types.BaseTuple):
        return types.UniTuple(types.intp, len(kinds))
    return types.intp


@infer_global(operator.getitem)
class GetElement(AbstractTemplate):
    """An element, or the rest of the table from the leading indices on."""

    def generic(self, args: Any, kws: Any) -> Any:
        table, index = args
        kind = _indices(table, index)
        if kind is None:
            return None
        left = table.ndim - (len(kind) if isinstance(kind, types.UniTuple) else 1)
        return signature(Table(table.dtype, left) if left else table.dtype, table, kind)


@infer_global(operator.setitem)
class SetElement(AbstractTemplate):
    """An element is written."""

    def generic(self, args: Any, kws: Any) -> Any:
        table, index, _ = args
        kind = _indices(table, index)
        if kind is None or table.ndim != (len(kind) if isinstance(kind, types.UniTuple) else 1):
            return None
        return signature(types.none, table, kind, table.dtype)


def _place(context: Any, builder: Any, kind: Any, table: Any, index_kind: Any, index: Any) -> Any:
    """(lengths, pointer to what the leading indices name); an index below zero is from the end."""
    lengths = cgutils.unpack_tuple(builder, builder.extract_value(table, 1))
    leading = [index]
    if isinstance(index_kind, types.UniTuple):
        leading = cgutils.unpack_tuple(builder, index)
    offset = None
    for length, i in zip(lengths, leading, strict=False):
        if isinstance(i, ir.Constant):
            place = i if i.constant >= 0 else builder.add(i, length)
        else:
            below = builder.icmp_signed("<", i, ir.Constant(i.type, 0))
            place = builder.select(below, builder.add(i, length), i)
        offset = place if offset is None else builder.add(builder.mul(offset, length), place)
    for length in lengths[len(leading) :]:
        offset = builder.mul(offset, length)
    return lengths[len(leading) :], builder.gep(builder.extract_value(table, 0), [offset])


@lower_builtin(operator.getitem, Table, types.Any)
def get_element(context, builder, sig, args):
    kind, index_kind = sig.args
    left, place = _place(context, builder, kind, args[0], index_kind, args[1])
    if not left:
        return context.unpack_value(builder, kind.dtype, place)
    rest = cgutils.create_struct_proxy(sig.return_type)(context, builder)
    rest.data, rest.shape = place, cgutils.pack_array(builder, left)
    return rest._getvalue()


@lower_builtin(operator.setitem, Table, types.Any, types.Any)
def set_element(context, builder, sig, args):
    kind, index_kind, _ = sig.args
    _, place = _place(context, builder, kind, args[0], index_kind, args[1])
    context.pack_value(builder, kind.dtype, args[2], place)
    return context.get_dummy_value()


@overload(len)
def length_of(table):
    return (lambda table: table.shape[0]) if isinstance(table, Table) else None


@intrinsic
def _array_of(typing, table):
    """A numba array on the table's memory, of which it holds no reference."""
    kind = types.Array(table.dtype, table.ndim, "C")

    def generate(context, builder, sig, args):
        array = make_array(kind)(context, builder)
        shape = cgutils.unpack_tuple(builder, builder.extract_value(args[0], 1))
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        step, strides = context.get_constant(types.intp, size), []
        for length in reversed(shape):
            strides.insert(0, step)
            step = builder.mul(step, length)
        populate_array(
            array,
            data=builder.extract_value(args[0], 0),
            shape=shape,
            strides=strides,
            itemsize=context.get_constant(types.intp, size),
            meminfo=None,
        )
        return array._getvalue()

    return kind(table), generate


def _whole(table):
    """The table as an array that can be sliced and given to numpy."""


whole = by_type(
    _whole,
    lambda table: (
        (lambda table: _array_of(table)) if isinstance(table, Table) else (lambda table: table)
    ),
    lambda table: table,
)


@overload_method(Table, "copy")
def copy_of(table):
    return lambda table: _array_of(table).copy()


def without_arrays(kind: Any) -> Any:
    """The type with every array in it as a table."""
    if isinstance(kind, types.Array) and kind.layout == "C":
        return Table(kind.dtype, kind.ndim)
    if isinstance(kind, types.BaseTuple):
        members = [without_arrays(member) for member in kind]
        return types.BaseTuple.from_types(members, getattr(kind, "instance_class", None))
    return kind


def stripped(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """The value of type `kind` as one of the type without arrays."""
    lean = without_arrays(kind)
    if lean == kind:
        return value
    if isinstance(kind, types.Array):
        array = make_array(kind)(context, builder, value)
        table = cgutils.create_struct_proxy(lean)(context, builder)
        table.data, table.shape = array.data, array.shape
        return table._getvalue()
    members = [
        stripped(context, builder, member, builder.extract_value(value, i))
        for i, member in enumerate(kind)
    ]
    return context.make_tuple(builder, lean, members)
