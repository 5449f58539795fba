"""What loops see of numba: compiled once, kept on disk, laws and steps called by their address.

Vectors are pointers to double in machine code and arrays in plain Python (NUMBA_DISABLE_JIT=1);
both are indexed alike.
"""

from __future__ import annotations

import ctypes
import pathlib
from collections.abc import Callable
from functools import cache
from typing import Any

import llvmlite
import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from rb_sim.graph import store
from rb_sim.graph.machine import interpreted, target_data
from rb_sim.loops.kept import keep, kept

REAL = types.float64
VECTOR = types.CPointer(types.float64)
INTEGERS = types.CPointer(types.int64)
_OPTIONS: Any = {"error_model": "numpy"}
INNER: Any = {**_OPTIONS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of overloads, which only compiled code can call: Python and C need no way into them. A
function that Python can name keeps its way in: without one, a call from there ends the process."""
_intrinsic: Any = intrinsic
_carray: Any = numba.carray  # pyright: ignore[reportPrivateImportUsage]

Function = Callable[..., Any]


def pointer(array):
    """Where the numbers of an array are."""
    return array.reshape(-1)


def integers(array):
    """Where the integers of an array are; interpreted also laws, which are functions there."""
    return array


def pointer_to(places, i):
    """As `pointer`, of the array whose address is among the `places`, at i."""
    return places[i].reshape(-1)


def integers_to(places, i):
    """As `integers`, of the array whose address is among the `places`, at i."""
    return places[i]


def part(vector, first):
    """The vector from the element `first` on."""
    return vector[first:]


def call_law(law, t, y, p, out):
    """Call the law: out = f(t, y, p)."""
    law(t, y, p, out)


def call_step(step, law, jacobian, n, t, y, h, p, dy, work):
    """Call a method's step: dy, the increment of y over h; returns its error estimate."""
    return step(law, jacobian, n, t, y, h, p, dy, work)


def _pointer_from(kind: Any) -> Function:
    """The code that takes an address for a pointer of this numba type."""

    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(kind))

    return generate


@_intrinsic
def _as_pointer(context, address):
    return VECTOR(types.uintp), _pointer_from(VECTOR)


@_intrinsic
def _as_integers(context, address):
    return INTEGERS(types.uintp), _pointer_from(INTEGERS)


@_intrinsic
def _shifted(context, vector, first):
    def generate(context, builder, signature, arguments):
        return builder.gep(arguments[0], [arguments[1]])

    return VECTOR(VECTOR, types.intp), generate


def _by_address(kind: Any) -> Function:
    """The code of a call of a function of this numba signature, whose address comes first."""

    def generate(context, builder, signature, arguments):
        values = [context.get_value_type(argument) for argument in kind.args]
        result = ir.VoidType() if kind.return_type is types.void else ir.DoubleType()
        function = ir.FunctionType(result, values).as_pointer()
        value = builder.call(builder.inttoptr(arguments[0], function), arguments[1:])
        return context.get_dummy_value() if kind.return_type is types.void else value

    return generate


LAW = types.void(REAL, VECTOR, VECTOR, VECTOR)
STEP = REAL(types.intp, types.intp, types.intp, REAL, VECTOR, REAL, VECTOR, VECTOR, VECTOR)


@_intrinsic
def _call_law(context, law, t, y, p, out):
    return types.void(types.intp, *LAW.args), _by_address(LAW)


@_intrinsic
def _call_step(context, step, law, jacobian, n, t, y, h, p, dy, work):
    return REAL(types.intp, *STEP.args), _by_address(STEP)


@overload(pointer, jit_options=INNER)
def _pointer_of(array):
    if isinstance(array, types.CPointer):
        return lambda array: array
    if isinstance(array, types.Array):
        return lambda array: _as_pointer(array.ctypes.data)
    return None


@overload(integers, jit_options=INNER)
def _integers_of(array):
    return lambda array: _as_integers(array.ctypes.data)


@overload(pointer_to, jit_options=INNER)
def _pointer_to(places, i):
    return lambda places, i: _as_pointer(places[i])


@overload(integers_to, jit_options=INNER)
def _integers_to(places, i):
    return lambda places, i: _as_integers(places[i])


@overload(part, jit_options=INNER)
def _part_of(vector, first):
    return lambda vector, first: _shifted(vector, first)


@overload(call_law, jit_options=INNER)
def _call_law_of(law, t, y, p, out):
    return lambda law, t, y, p, out: _call_law(law, t, y, p, out)


@overload(call_step, jit_options=INNER)
def _call_step_of(step, law, jacobian, n, t, y, h, p, dy, work):
    return lambda step, law, jacobian, n, t, y, h, p, dy, work: _call_step(
        step, law, jacobian, n, t, y, h, p, dy, work
    )


@cache
def folder() -> pathlib.Path | None:
    """The folder of compiled loops for exactly these sources, on this processor; None if it cannot
    be written.

    numba does not notice a change in a file that a cached function only calls into, so the
    folder's name is a hash of all sources. Machines of a cluster may share it.
    """
    sources = sorted(pathlib.Path(__file__).parent.rglob("*.py"))
    versions = (numba.__version__, llvmlite.__version__, *target_data())
    return store.version_folder("loops", "\n".join((*versions, *(s.read_text() for s in sources))))


def _cached(compile_with: Callable[[bool], Any]) -> Any:
    """compile_with(True) with numba's cache in our folder, compile_with(False) without a folder."""
    place = folder()
    if place is None:
        return compile_with(False)
    previous, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(place)  # type: ignore[attr-defined]
    try:
        return compile_with(True)
    except (OSError, RuntimeError):  # the folder went away: compile in every process
        return compile_with(False)
    finally:
        numba.config.CACHE_DIR = previous  # type: ignore[attr-defined]


def loop(function: Function) -> Any:
    """Compile a function that Python and other loops call."""
    if interpreted():
        return function
    return _cached(lambda kept: numba.njit(cache=kept, **_OPTIONS)(function))


def helper(function: Function) -> Any:
    """Compile a function that only loops call with them; from Python it stays plain Python."""
    if not interpreted():
        overload(function, strict=False, jit_options=INNER)(lambda *arguments: function)
    return function


class ForC:
    """A function for calls by its address; kind: its signature for numba."""

    def __init__(self, function: Function, kind: Any) -> None:
        self.function, self.kind = function, kind
        self._code: Any = None

    @property
    def address(self) -> int:
        """Compiles it where it is not yet."""
        if self._code is None:
            name = f"{self.function.__module__}.{self.function.__qualname__}.code"
            self._code = kept(folder(), name) or self._compiled(name)
        return self._code.address

    def _compiled(self, name: str) -> Any:
        """By numba, from its own cache where it is there; kept where it needs no numba."""
        made = _cached(lambda kept: numba.cfunc(self.kind, cache=kept, **_OPTIONS)(self.function))
        if made.cache_hits:  # has no IR
            return made
        return keep(folder(), name, made.inspect_llvm(), made.native_name) or made


LOOP = types.intp(INTEGERS)


class ForPython:
    """A loop f(places) that Python calls with the address of its integers; see `where`.

    Python's lock is kept meanwhile: nobody else changes what the loop works on.
    """

    def __init__(self, function: Function) -> None:
        self.function, self._for_c = function, ForC(function, LOOP)
        self._call = function if interpreted() else None

    def __call__(self, places: Any) -> int:
        if self._call is None:
            self._call = _LOOP(self._for_c.address)
        return self._call(places)


def where(array: Any) -> Any:
    """The address of a contiguous array; interpreted, the array as a vector."""
    return array.reshape(-1) if interpreted() else array.ctypes.data


_LOOP = ctypes.PYFUNCTYPE(ctypes.c_ssize_t, ctypes.c_void_p)


def for_python(function: Function) -> ForPython:
    """Compile a loop for calls from Python, see `ForPython`."""
    return ForPython(function)


ROUTINE = types.void(VECTOR, VECTOR)


class Routine(ForC):
    """A function void f(const double *arguments, double *results) that traced laws call."""

    def __init__(self, function: Function) -> None:
        super().__init__(function, ROUTINE)


def routine(function: Function) -> Routine:
    """Compile a function of two vectors for calls from traced laws."""
    return Routine(function)


def view(vector, first, length):
    """An array on `length` numbers of the vector."""
    return vector[first : first + length]


@overload(view, jit_options=INNER)
def _view_of(vector, first, length):
    return lambda vector, first, length: _carray(_shifted(vector, first), (length,))


def place_of(array: Any) -> float:
    """Where the numbers of a contiguous array are, as an input of a law; see `table_at`.

    The array must live as long as the law is called.
    """
    return float(np.array([array.ctypes.data], np.int64).view(np.float64)[0])


def table_at(place, length):
    """An array on `length` numbers at a place given by `place_of`."""
    where = int(np.array([place]).view(np.int64)[0])
    return np.ctypeslib.as_array((ctypes.c_double * int(length)).from_address(where))


@_intrinsic
def _place(context, number):
    def generate(context, builder, signature, arguments):
        bits = builder.bitcast(arguments[0], ir.IntType(64))
        return builder.inttoptr(bits, context.get_value_type(VECTOR))

    return VECTOR(REAL), generate


@overload(table_at, jit_options=INNER)
def _table_at(place, length):
    return lambda place, length: _carray(_place(place), (length,))


class Step:
    """A method's step as loops call it: `reference` is its address, or the Python function."""

    series: Callable[[float], int] | None = None
    """Of a method that steps along a Taylor series, its order for a tolerance."""

    def __init__(self, function: Function, stages: int, implicit: int) -> None:
        self.function, self.stages, self.implicit = function, stages, implicit
        self.traced: Function | None = None
        """The same as plain Python on tuples, or None: f(rate, t, y, h, velocities) gives
        (dy, error); traced together with a small law, the whole step is one function."""
        self._for_c = ForC(function, STEP)

    def on_tuples(self, function: Function) -> Function:
        """Take the function for `traced`."""
        self.traced = function
        return function

    @property
    def reference(self) -> Any:
        """Compiles the step where it is not yet."""
        return self.function if interpreted() else self._for_c.address


class SeriesStep(Step):
    """The step along the Taylor series of the motion: the loop itself takes it.

    order: of the series for a tolerance.
    """

    reference: Any = 0

    def __init__(self, order: Callable[[float], int]) -> None:
        super().__init__(lambda *arguments: 0.0, 1, 0)
        self.series = order


def step(stages: int, implicit: int = 0) -> Callable[[Function], Step]:
    """The step of a method that calls its law about `stages` times.

    f(law, jacobian, n, t, y, h, p, dy, work) writes dy and returns the error, relative to the
    tolerance 1 (0 where it estimates none).  y, dy: n coordinates; work: WORK_ROWS n numbers, of
    which the first are those of `rows`: which coordinates are velocities, and what their errors
    are relative to; up to `implicit`
    coordinates it gets their Jacobian (n n numbers by rows) as a law, and 3 n rows of work more;
    otherwise 0.
    """
    return lambda function: Step(function, stages, implicit)
