"""What calls mean that are not calls of functions compiled with their callers.

`@means(function)` over a handler(f, *values) registers one; f writes the instructions.
"""

from __future__ import annotations

import ast
import ctypes
import importlib
import math
import os
import signal
import threading
import traceback
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler import arrays
from rb_sim.compiler.arrays import counted, first_of
from rb_sim.compiler.builder import Builder, Value, entries, known, real_text
from rb_sim.compiler.kinds import (
    BOOLEAN,
    COMPLEX,
    DTYPES,
    INTEGER,
    REAL,
    Array,
    KindError,
    Object,
    Tuple,
    common,
    kind_text,
)
from rb_sim.graph import functions

Handler = Callable[..., Value]
_MEANINGS: dict[Any, Handler] = {}


def means(*functions: Any) -> Callable[[Handler], Handler]:
    """Let the handler say what compiled calls of the functions do."""

    def register(handler: Handler) -> Handler:
        for function in functions:
            _MEANINGS[function] = handler
        return handler

    return register


def meaning_of(function: Any) -> Handler | None:
    """The handler of calls of the object, or None."""
    try:
        return _MEANINGS.get(function)
    except TypeError:  # cannot be hashed
        return None


def declared(f: Any, name: str, result: str, arguments: tuple[str, ...]) -> None:
    """Tell of a function of the C library."""
    f.unit.declarations.add(f"declare {result} @{name}({', '.join(arguments)})")


def of_library(function: Any, name: str, count: int = 1) -> None:
    """A function of reals in the C library."""

    @means(function)
    def call(f: Any, *values: Value) -> Value:
        if len(values) != count:
            raise KindError(f"{name} takes {count} numbers")
        arguments = ", ".join(f"double {numbers.real(f, value).leaf}" for value in values)
        if not name.startswith("llvm."):
            declared(f, name, "double", ("double",) * count)
        return Value(REAL, (f.get(f"call double @{name}({arguments})"),))


for _function, _name in (
    (functions.sqrt, "llvm.sqrt.f64"), (functions.sin, "llvm.sin.f64"),
    (functions.cos, "llvm.cos.f64"), (math.sqrt, "llvm.sqrt.f64"),
    (math.sin, "llvm.sin.f64"), (math.cos, "llvm.cos.f64"),
    (math.exp, "llvm.exp.f64"), (math.log, "llvm.log.f64"), (math.tan, "tan"),
    (math.atan, "atan"), (math.asin, "asin"), (math.acos, "acos"), (math.log1p, "log1p"),
    (math.expm1, "expm1"), (math.tanh, "tanh"),
):  # fmt: skip
    of_library(_function, _name)
for _function, _name in (
    (functions.atan2, "atan2"), (math.atan2, "atan2"), (math.hypot, "hypot"), (math.fmod, "fmod"),
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


@means(functions.where, functions.rarely)
def _where(f: Builder, condition: Value, a: Value, b: Value) -> Value:
    kind = common(a.kind, b.kind)
    holds = numbers.truth(f, condition).leaf
    return numbers.selected(f, holds, numbers.converted(f, a, kind), numbers.converted(f, b, kind))


@means(max, functions.maximum)
def _max(f: Builder, *values: Value) -> Value:
    return numbers.extreme(f, ast.Gt(), _several(values))


@means(min, functions.minimum)
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
    """Lengths along the axes."""
    sizes = entries(shape) if isinstance(shape.kind, Tuple) else [shape]
    return [numbers.converted(f, size, INTEGER) for size in sizes]


def _element(dtype: Value | None) -> str:
    """What arrays of the dtype hold."""
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
    """array.reshape(shape), -1 for all in one axis."""
    assert isinstance(array.kind, Array)
    counts = _counts(f, shape[0]) if len(shape) == 1 else [*shape]
    if len(counts) == 1 and counts[0].number == -1:
        counts = [Value(INTEGER, (arrays.product(f, arrays.lengths(array)),))]
    pointer = arrays.first_of(f, array).leaf
    return arrays.shaped(pointer, array.kind.element, counts, array.kind.origins)


def viewed(f: Builder, array: Value, dtype: Value) -> Value:
    """array.view(dtype) of one axis."""
    assert isinstance(array.kind, Array)
    element, (length,) = _element(dtype), arrays.lengths(array)
    factor = arrays.SIZES[array.kind.element] // arrays.SIZES[element]
    count = Value(INTEGER, (f.get(f"mul i64 {length}, {factor}"),))
    return arrays.shaped(arrays.first_of(f, array).leaf, element, [count], array.kind.origins)


def as_type(f: Any, array: Value, dtype: Value) -> Value:
    """array.astype(dtype) of one axis."""
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
"""What methods of arrays do."""


# LAPACK for compiled functions: what SciPy offers to C, by its address.
#
# `eigenvectors` and `singular_vectors` work in place on vectors that the caller has; interpreted
# they are numpy's.


@cache
def address(symbol: str) -> int:
    """Where LAPACK's function is, as scipy.linalg.cython_lapack tells compiled code."""
    lapack: Any = importlib.import_module("scipy.linalg.cython_lapack")
    capsule: Any = lapack.__pyx_capi__[symbol.removeprefix("lapack_")]
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = (
        ctypes.c_char_p,
        [ctypes.py_object],
    )
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    return api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule))


_FINDER = ctypes.CFUNCTYPE(ctypes.c_void_p)


@cache
def finder(symbol: str) -> int:
    """Where a function is that C calls to have the address of LAPACK's function; see `_FOUND`.

    Nothing can be raised through what is compiled: a signal that ends the import is sent again a
    little later, and 0 is the answer, upon which the caller asks again.
    """

    def find() -> int:
        try:
            return address(symbol)
        except KeyboardInterrupt as error:
            number = getattr(error, "number", signal.SIGINT)
            threading.Timer(LATER, os.kill, (os.getpid(), number)).start()
            return 0
        except Exception:
            traceback.print_exc()
            os._exit(1)

    _FINDERS.append(_FINDER(find))
    place = ctypes.cast(_FINDERS[-1], ctypes.c_void_p).value
    assert place is not None
    return place


_FINDERS: list[Any] = []
"""Compiled code calls them as long as the process lives."""
LATER = 0.2
"""Time after which a signal that came in between is sent again [s]; an import takes less."""
WORK = 8
"""Rows of n numbers of work space that `eigenvectors` takes."""


def work_of_singular_vectors(n):
    """Numbers of work space that `singular_vectors` takes: of dgesdd, and its integers."""
    return 4 * n * n + 12 * n


def eigenvectors(n, a, values, work):
    """A symmetric matrix of n rows becomes its eigenvectors, one after another, by rising
    eigenvalues, which go to `values`."""
    matrix = np.array(a[: n * n]).reshape(n, n)
    found, vectors = np.linalg.eigh(matrix)
    values[:n] = found
    a[: n * n] = vectors.T.ravel()


@means(eigenvectors)
def _eigenvectors(f: Any, n: Value, a: Value, values: Value, work: Value) -> Value:
    size = numbers.converted(f, n, INTEGER).leaf
    rows, workspace = _int_argument(f, size), _int_argument(f, f.get(f"mul i64 {size}, {WORK}"))
    at = [first_of(f, array).leaf for array in (a, values, work)]
    letters = [_letter(f, letter) for letter in "VL"]
    return _call(f, "dsyev", [*letters, rows, at[0], rows, at[1], at[2], workspace])


def singular_vectors(n, a, right, values, left, work):
    """Of a matrix of n rows, which is lost: into `values` its singular values, the largest first;
    into `right` and `left` its singular vectors, one after another."""
    u, s, vt = np.linalg.svd(np.array(a[: n * n]).reshape(n, n))
    values[:n], right[: n * n], left[: n * n] = s, vt.ravel(), u.T.ravel()


@means(singular_vectors)
def _singular_vectors(
    f: Any, n: Value, a: Value, right: Value, values: Value, left: Value, work: Value
) -> Value:
    # Fortran sees the matrix turned over, so that its left vectors are those from the right here
    size = numbers.converted(f, n, INTEGER).leaf
    square = f.get(f"mul i64 {size}, {size}")
    own = [f.get(f"mul i64 {x}, {k}") for x, k in ((square, 4), (size, 8))]
    count = f.get(f"add i64 {own[0]}, {own[1]}")
    rows, workspace = _int_argument(f, size), _int_argument(f, count)
    at = [first_of(f, array).leaf for array in (a, values, right, left, work)]
    integers = f.place("double", at[4], count)
    order = [rows, rows, at[0], rows, at[1], at[2], rows, at[3], rows, at[4], workspace, integers]
    _call(f, "dgesdd", [_letter(f, "A"), *order])
    _turn(f, size, at[3])
    return known(None)


def _turn(f: Any, n: str, place: str) -> None:
    """A square matrix is turned over in place."""

    def row(i: str) -> None:
        def entry(j: str) -> None:
            ways = [
                f.place("double", place, f.get(f"add i64 {f.get(f'mul i64 {a}, {n}')}, {b}"))
                for a, b in ((i, j), (j, i))
            ]
            found = [f.load("double", way) for way in ways]
            f.store("double", found[1], ways[0])
            f.store("double", found[0], ways[1])

        counted(f, i, entry)

    counted(f, n, row)


def _call(f: Any, name: str, places: list[str]) -> Value:
    """Call a function of LAPACK, which tells at last how it went."""
    symbol, order = f"lapack_{name}", [*places, f.slot("i32")]
    f.unit.externals[symbol] = 0
    f.unit.declarations.add(_FOUND.replace("SYMBOL", symbol))
    function = f.get(f"call ptr @{symbol}.found()")
    f.do(f"call void {function}({', '.join(f'ptr {place}' for place in order)})")
    return known(None)


_FOUND = """\
declare ptr @SYMBOL()
@SYMBOL.place = internal global [1 x ptr] zeroinitializer, align 8
define internal ptr @SYMBOL.found() nounwind {
begin:
  %last = load ptr, ptr @SYMBOL.place, align 8
  %known = icmp ne ptr %last, null
  br i1 %known, label %done, label %find
find:
  %function = call ptr @SYMBOL()
  store ptr %function, ptr @SYMBOL.place, align 8
  %found = icmp ne ptr %function, null
  br i1 %found, label %done, label %find
done:
  %result = phi ptr [ %last, %begin ], [ %function, %find ]
  ret ptr %result
}
"""
"""Where a function of LAPACK is: the first call asks for it, so that SciPy is loaded when it is
used. It asks again where a signal has come between, see `finder`."""


def _int_argument(f: Any, value: str) -> str:
    """Where the integer is, as Fortran's."""
    slot = f.slot("i32")
    f.store("i32", f.get(f"trunc i64 {value} to i32"), slot)
    return slot


def _letter(f: Any, letter: str) -> str:
    """Where the letter is."""
    slot = f.slot("i8")
    f.store("i8", str(ord(letter)), slot)
    return slot
