# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Compiled meaning of calls of library functions, types and array methods.

`@means(function)` registers a handler(f, *values) for calls of a function; f writes instructions.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler import arrays
from rb_sim.compiler.builder import (
    BOOLEAN,
    COMPLEX,
    DTYPES,
    INTEGER,
    REAL,
    Array,
    Builder,
    KindError,
    Object,
    Tuple,
    Value,
    common,
    entries,
    kind_text,
    known,
    real_text,
)
from rb_sim.compiler.graph import symbols

Handler = Callable[..., Value]
_MEANINGS: dict[Any, Handler] = {}


def means(*functions: Any) -> Callable[[Handler], Handler]:
    """Decorator that registers a handler for compiled calls of the functions."""

    def register(handler: Handler) -> Handler:
        for function in functions:
            _MEANINGS[function] = handler
        return handler

    return register


def meaning_of(function: Any) -> Handler | None:
    """The handler of calls of the object, or None."""
    try:
        return _MEANINGS.get(function)
    except TypeError:  # not hashable
        return None


def declared(f: Any, name: str, result: str, arguments: tuple[str, ...]) -> None:
    """Declare a function of the C library."""
    f.unit.declarations.add(f"declare {result} @{name}({', '.join(arguments)})")


def of_library(function: Any, name: str, count: int = 1) -> None:
    """Register a function of `count` reals of the C library."""

    @means(function)
    def call(f: Any, *values: Value) -> Value:
        if len(values) != count:
            raise KindError(f"{name} takes {count} numbers")
        arguments = ", ".join(f"double {numbers.real(f, value).leaf}" for value in values)
        if not name.startswith("llvm."):
            declared(f, name, "double", ("double",) * count)
        return Value(REAL, (f.get(f"call double @{name}({arguments})"),))


for _function, _name in (
    (symbols.sqrt, "llvm.sqrt.f64"), (symbols.sin, "llvm.sin.f64"),
    (symbols.cos, "llvm.cos.f64"), (math.sqrt, "llvm.sqrt.f64"),
    (math.sin, "llvm.sin.f64"), (math.cos, "llvm.cos.f64"),
    (math.exp, "llvm.exp.f64"), (math.log, "llvm.log.f64"), (math.tan, "tan"),
    (math.atan, "atan"), (math.asin, "asin"), (math.acos, "acos"), (math.log1p, "log1p"),
    (math.expm1, "expm1"), (math.tanh, "tanh"),
):  # fmt: skip
    of_library(_function, _name)
for _function, _name in (
    (symbols.atan2, "atan2"), (math.atan2, "atan2"), (math.hypot, "hypot"), (math.fmod, "fmod"),
    (math.copysign, "llvm.copysign.f64"),
):  # fmt: skip
    of_library(_function, _name, 2)


@means(math.floor)
def _floor(f: Builder, x: Value) -> Value:
    leaf = numbers.real(f, x).leaf
    return numbers.integer(f, Value(REAL, (f.get(f"call double @llvm.floor.f64(double {leaf})"),)))


@means(math.isfinite)
def _is_finite(f: Builder, x: Value) -> Value:
    size = numbers.absolute(f, numbers.real(f, x)).leaf
    return Value(BOOLEAN, (f.get(f"fcmp olt double {size}, {real_text(math.inf)}"),))


@means(math.isnan)
def _is_nan(f: Builder, x: Value) -> Value:
    leaf = numbers.real(f, x).leaf
    return Value(BOOLEAN, (f.get(f"fcmp uno double {leaf}, {leaf}"),))


@means(abs)
def _abs(f: Builder, x: Value) -> Value:
    return numbers.absolute(f, x)


def _several(values: tuple[Value, ...]) -> list[Value]:
    return entries(values[0]) if len(values) == 1 else list(values)


@means(symbols.where, symbols.rarely)
def _where(f: Builder, condition: Value, a: Value, b: Value) -> Value:
    kind = common(a.kind, b.kind)
    holds = numbers.truth(f, condition).leaf
    return numbers.selected(f, holds, numbers.converted(f, a, kind), numbers.converted(f, b, kind))


@means(max, symbols.maximum)
def _max(f: Builder, *values: Value) -> Value:
    return numbers.extreme(f, ast.Gt(), _several(values))


@means(min, symbols.minimum)
def _min(f: Builder, *values: Value) -> Value:
    return numbers.extreme(f, ast.Lt(), _several(values))


@means(float)
def _float(f: Builder, x: Value) -> Value:
    return numbers.real(f, x)


@means(int)
def _int(f: Builder, x: Value) -> Value:
    return numbers.integer(f, x)


@means(bool)
def _bool(f: Builder, x: Value) -> Value:
    return numbers.truth(f, x)


@means(complex)
def _complex(f: Builder, re: Value, im: Value) -> Value:
    return Value(COMPLEX, (numbers.real(f, re).leaf, numbers.real(f, im).leaf))


@means(len)
def _len(f: Builder, x: Value) -> Value:
    if isinstance(x.kind, Tuple):
        return numbers.constant(len(x.kind.kinds))
    return arrays.length_of(x)


@means(tuple)
def _tuple(f: Builder, x: Value) -> Value:
    if not isinstance(x.kind, Tuple):
        raise KindError(f"a tuple of {kind_text(x.kind)}")
    return Value(Tuple(x.kind.kinds), x.leaves)


def _counts(f: Builder, shape: Value) -> list[Value]:
    """Lengths along the axes, as integers."""
    sizes = entries(shape) if isinstance(shape.kind, Tuple) else [shape]
    return [numbers.converted(f, size, INTEGER) for size in sizes]


def _element(dtype: Value | None) -> str:
    """Element type of arrays of the dtype."""
    if dtype is None:
        return "real"
    assert isinstance(dtype.kind, Object)
    return DTYPES[np.dtype(dtype.kind.value)]


@means(np.empty)
def _empty(f: Any, shape: Value, dtype: Value | None = None) -> Value:
    return arrays.made(f, _element(dtype), _counts(f, shape))


@means(np.zeros)
def _zeros(f: Any, shape: Value, dtype: Value | None = None) -> Value:
    return arrays.filled(f, _empty(f, shape, dtype), numbers.constant(0))


@means(np.full)
def _full(f: Any, shape: Value, value: Value) -> Value:
    made = _empty(f, shape, known(np.int64) if value.kind == INTEGER else None)
    return arrays.filled(f, made, value)


def _like(f: Any, array: Value) -> Value:
    assert isinstance(array.kind, Array)
    counts = [Value(INTEGER, (length,)) for length in arrays.lengths(array)]
    return arrays.made(f, array.kind.element, counts)


@means(np.empty_like)
def _empty_like(f: Any, array: Value) -> Value:
    return _like(f, array)


@means(np.zeros_like)
def _zeros_like(f: Any, array: Value) -> Value:
    return arrays.filled(f, _like(f, array), numbers.constant(0))


def copy_of(f: Any, array: Value) -> Value:
    """array.copy()."""
    return arrays.copied(f, _like(f, array), array)


def reshaped(f: Builder, array: Value, *shape: Value) -> Value:
    """array.reshape(shape); a single -1 gives one axis."""
    assert isinstance(array.kind, Array)
    counts = _counts(f, shape[0]) if len(shape) == 1 else [*shape]
    if len(counts) == 1 and counts[0].number == -1:
        counts = [Value(INTEGER, (arrays.product(f, arrays.lengths(array)),))]
    pointer = arrays.first_of(f, array).leaf
    return arrays.shaped(pointer, array.kind.element, counts, array.kind.origins)


def viewed(f: Builder, array: Value, dtype: Value) -> Value:
    """array.view(dtype) of a one-dimensional array."""
    assert isinstance(array.kind, Array)
    element, (length,) = _element(dtype), arrays.lengths(array)
    factor = arrays.SIZES[array.kind.element] // arrays.SIZES[element]
    count = Value(INTEGER, (f.get(f"mul i64 {length}, {factor}"),))
    return arrays.shaped(arrays.first_of(f, array).leaf, element, [count], array.kind.origins)


def as_type(f: Any, array: Value, dtype: Value) -> Value:
    """array.astype(dtype) of a one-dimensional array."""
    (length,) = arrays.lengths(array)
    made = arrays.made(f, _element(dtype), [Value(INTEGER, (length,))])

    def convert(at: str) -> None:
        index = Value(INTEGER, (at,))
        value = arrays.entry(f, array, [index])
        whole = _element(dtype) != "real"
        arrays.put(f, made, [index], numbers.integer(f, value) if whole else value)

    arrays.counted(f, length, convert)
    return made


METHODS: dict[str, Handler] = {
    "copy": copy_of, "reshape": reshaped, "view": viewed, "astype": as_type,
}  # fmt: skip
"""Handlers of array methods by name."""
