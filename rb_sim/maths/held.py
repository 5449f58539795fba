"""The system of N bodies as kernels pass it on: by address.

It is a hundred numbers and more, and goes to every function: taking it apart and putting it
together again was three quarters of the code that LLVM was given.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.extending import lower_builtin, lower_getattr_generic, register_model

from rb_sim.maths.tables import stripped, without_arrays


class Held(types.Type):
    """A NamedTuple of numbers, tables and tuples that is passed on by its address."""

    def __init__(self, held: Any) -> None:
        self.held = held
        super().__init__(name=f"Held({held})")


@register_model(Held)
class HeldModel(models.PrimitiveModel):
    """The address."""

    def __init__(self, dmm: Any, fe_type: Held) -> None:
        super().__init__(dmm, fe_type, dmm.lookup(fe_type.held).get_value_type().as_pointer())


@infer_getattr
class HeldField(AttributeTemplate):
    """A field, by value."""

    key = Held

    def generic_resolve(self, value: Any, attr: str) -> Any:
        fields = value.held.fields
        return value.held.types[fields.index(attr)] if attr in fields else None


def _load(builder: Any, place: Any) -> Any:
    """The value at `place`, number by number; nothing writes there after `hold`."""
    kind = place.type.pointee
    if isinstance(kind, (ir.LiteralStructType, ir.ArrayType)):
        value = ir.Constant(kind, ir.Undefined)
        for i in range(len(kind)):
            member = _load(builder, cgutils.gep_inbounds(builder, place, 0, i))
            value = builder.insert_value(value, member, i)
        return value
    number = builder.load(place)
    number.set_metadata("invariant.load", builder.module.add_metadata([]))
    return number


@lower_getattr_generic(Held)
def get_field(context, builder, kind, value, attr):
    i = kind.held.fields.index(attr)
    field = _load(builder, cgutils.gep_inbounds(builder, value, 0, i))
    return impl_ret_borrowed(context, builder, kind.held.types[i], field)


def hold(system, y):
    """The system as kernels of N bodies pass it on; its arrays stay with the caller.

    Called by the kernel that Python calls, in whose frame the copy is.
    """
    return system


@infer_global(hold)
class Hold(AbstractTemplate):
    """By address where y is an array; one body's few constants stay in registers."""

    def generic(self, args: Any, kws: Any) -> Any:
        system, y = args
        by_address = isinstance(y, types.Array)
        return signature(Held(without_arrays(system)) if by_address else system, system, y)


@lower_builtin(hold, types.Any, types.Any)
def hold_in_frame(context, builder, sig, args):
    if not isinstance(sig.return_type, Held):
        return impl_ret_borrowed(context, builder, sig.return_type, args[0])
    value = stripped(context, builder, sig.args[0], args[0])
    place = cgutils.alloca_once_value(builder, value)
    # what is behind an address from elsewhere may be loaded once and kept
    opaque = ir.FunctionType(place.type, [place.type])
    return builder.asm(opaque, "", "=r,0,~{memory}", [place], side_effect=True)
