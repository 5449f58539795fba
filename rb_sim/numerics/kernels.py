# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Kernels: functions marked to be compiled, called by address, dispatched by class."""

from __future__ import annotations

import ctypes
import functools
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler import arrays
from rb_sim.compiler.builder import (
    INTEGER,
    INTEGERS,
    REAL,
    VECTOR,
    Kind,
    Pointer,
    Tuple,
    Value,
    known,
)
from rb_sim.compiler.calls import means
from rb_sim.compiler.program import Entry, ForC, on_compilation
from rb_sim.graph.machine import interpreted
from rb_sim.graph.symbols import explored

# How loops are compiled: laws and steps are called by their address, vectors are pointers.
#
# A pointer to double in machine code is an array in plain Python (RB_SIM_INTERPRETED=1); both are
# indexed alike.


Function = Callable[..., Any]


def pointer(array):
    """Where the numbers of an array are."""
    return array.reshape(-1)


@means(pointer)
def _pointer(f: Any, array: Value) -> Value:
    return arrays.first_of(f, array)


def integers(array):
    """Where the integers of an array are; interpreted also laws, which are functions there."""
    return array.reshape(-1) if isinstance(array, np.ndarray) else array


@means(integers)
def _integers(f: Any, array: Value) -> Value:
    return Value(INTEGERS, (array.leaves[0],))


def pointer_to(places, i):
    """As `pointer`, of the array whose address is among the `places`, at i."""
    return places[i].reshape(-1)


@means(pointer_to)
def _pointer_to(f: Any, places: Value, i: Value) -> Value:
    return arrays.as_kind(f, arrays.entry(f, places, [i]), VECTOR)


def integers_to(places, i):
    """As `integers`, of the array whose address is among the `places`, at i."""
    return places[i]


@means(integers_to)
def _integers_to(f: Any, places: Value, i: Value) -> Value:
    return arrays.as_kind(f, arrays.entry(f, places, [i]), INTEGERS)


def part(vector, first):
    """The vector from the element `first` on."""
    return vector[first:]


@means(part)
def _part(f: Any, vector: Value, first: Value) -> Value:
    at = numbers.converted(f, first, INTEGER).leaf
    begin = arrays.first_of(f, vector)
    assert isinstance(begin.kind, Pointer)
    return Value(begin.kind, (f.place(arrays.ELEMENTS[begin.kind.element], begin.leaf, at),))


def view(vector, first, length):
    """An array on `length` numbers of the vector."""
    return vector[first : first + length]


@means(view)
def _view(f: Any, vector: Value, first: Value, length: Value) -> Value:
    begin = _part(f, vector, first)
    return arrays.shaped(begin.leaf, "real", [numbers.converted(f, length, INTEGER)])


def call_law(law, t, y, p, out):
    """Call the law: out = f(t, y, p)."""
    law(t, y, p, out)


LAW = (REAL, VECTOR, VECTOR, VECTOR)
STEP = (INTEGER, INTEGER, INTEGER, REAL, VECTOR, REAL, VECTOR, VECTOR, VECTOR)
ROUTINE = (VECTOR, VECTOR)
LOOP = (INTEGERS,)


@means(call_law)
def _call_law(f: Any, law: Value, t: Value, *places: Value) -> Value:
    vectors = ", ".join(f"ptr {place.leaves[0]}" for place in places)
    at = f.get(f"inttoptr i64 {law.leaf} to ptr")
    f.do(f"call void {at}(double {numbers.real(f, t).leaf}, {vectors})")
    return known(None)


def call_step(step, law, jacobian, n, t, y, h, p, dy, work):
    """Call a method's step: dy, the increment of y over h; returns its error estimate."""
    return step(law, jacobian, n, t, y, h, p, dy, work)


@means(call_step)
def _call_step(f: Any, step: Value, *arguments: Value) -> Value:
    typed = []
    for kind, value in zip(STEP, arguments, strict=True):
        leaf = value.leaves[0] if kind == VECTOR else numbers.converted(f, value, kind).leaf
        typed.append(f"{kind.leaves[0]} {leaf}")
    at = f.get(f"inttoptr i64 {step.leaf} to ptr")
    return Value(REAL, (f.get(f"call double {at}({', '.join(typed)})"),))


def place_of(array: Any) -> float:
    """Where the numbers of a contiguous array are, as an input of a law; see `table_at`.

    The array must live as long as the law is called.
    """
    return float(np.array([array.ctypes.data], np.int64).view(np.float64)[0])


def table_at(place, length):
    """An array on `length` numbers at a place given by `place_of`."""
    where = int(np.array([place]).view(np.int64)[0])
    return np.ctypeslib.as_array((ctypes.c_double * int(length)).from_address(where))


@means(table_at)
def _table_at(f: Any, place: Value, length: Value) -> Value:
    bits = f.get(f"bitcast double {place.leaf} to i64")
    begin = f.get(f"inttoptr i64 {bits} to ptr")
    return arrays.shaped(begin, "real", [numbers.integer(f, length)])


def loop(function: Function) -> Any:
    """Compile a function that Python calls with arrays and numbers."""
    return Entry(function)


def helper(function: Function) -> Any:
    """Mark a function that loops call, which is compiled with them; it stays plain Python."""
    return function


class ForPython:
    """A loop f(places) that Python calls with the address of its integers; see `where`.

    Python's lock is kept meanwhile: nobody else changes what the loop works on.
    """

    def __init__(self, function: Function) -> None:
        self.function, self._for_c = function, ForC(function, LOOP, INTEGER)
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


class Routine(ForC):
    """A function void f(const double *arguments, double *results) that traced laws call."""

    def __init__(self, function: Function) -> None:
        super().__init__(function, ROUTINE, None)


def routine(function: Function) -> Routine:
    """Compile a function of two vectors for calls from traced laws."""
    return Routine(function)


def by_address(function: Function) -> ForC:
    """Compile a function void f(t, y, p, out), as laws have it, for calls by its address."""
    return ForC(function, LAW, None)


class Step:
    """A method's step as loops call it: `reference` is its address, or the Python function."""

    series: Callable[[float], int] | None = None
    """Of a method that steps along a Taylor series, its order for a tolerance."""

    def __init__(self, function: Function, stages: int, implicit: int) -> None:
        self.function, self.stages, self.implicit = function, stages, implicit
        self.traced: Function | None = None
        """The same as plain Python on tuples, or None: f(rate, t, y, h, velocities) gives
        (dy, error); traced together with a small law, the whole step is one function."""
        self._for_c = ForC(function, STEP, REAL)

    def on_tuples(self, function: Function) -> Function:
        """Take the function for `traced`."""
        self.traced = function
        return function

    @property
    def reference(self) -> Any:
        """Compiles the step where it is not yet."""
        return self._for_c.address


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


# Functions whose kernel is chosen by the class of their first argument.
#
# What a scene does not name is not in its machine code: the choice is made while compiling.


Kernel = Callable[..., Any]


def dispatch(stub: Kernel) -> Any:
    """A function that calls the kernel registered for the class of its first argument.

    Kernels are added by the decorator `name.register(*classes)`; `name.kernels` maps the classes
    to them.  The stub gives name, arguments and meaning.
    """
    kernels: dict[type, Any] = {}

    @functools.wraps(stub)
    def call(first: Any, *others: Any) -> Any:
        return kernels[type(first)](first, *others)

    def chosen(kinds: list[Kind]) -> Kernel:
        """The kernel for arguments of these kinds."""
        kind = kinds[0]
        of = kind.of if isinstance(kind, Tuple) else type(kind)
        if of not in kernels:
            raise TypeError(f"{stub.__name__}: no kernel for {of}")
        return kernels[of]

    def register(*kinds: type) -> Callable[[Kernel], Any]:
        def add(kernel: Kernel) -> Any:
            for kind in kinds:
                kernels[kind] = kernel
            return kernel

        return add

    of_stub: Any = call
    of_stub.kernels, of_stub.register, of_stub.chosen = kernels, register, chosen
    return call


# How functions of catalogue and contact are marked: what is compiled, and how it is chosen.
#
# Functions stay plain Python, which the trace of a law and RB_SIM_INTERPRETED=1 run as they are;
# what compiled code calls is compiled with it.


__all__ = ["branching", "by_address", "dispatch", "entry", "inline", "on_compilation"]


def inline(function: Kernel) -> Any:
    """Mark a function that is compiled with its callers; called from Python it is as it is."""
    return function


def branching(function: Kernel) -> Any:
    """As `inline`, for a short function that branches on numbers: traced, every way is taken."""

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        return explored(function, *arguments)

    call.compiled_as = function  # type: ignore[attr-defined]
    return call


def entry(function: Kernel) -> Any:
    """Compile a function for calls from Python with arrays, numbers and tuples of them."""
    return Entry(function)


def python_of(function: Any) -> Any:
    """The plain Python function of what is called: it compiles nothing."""
    return getattr(function, "function", function)


# Wall time without that of compiling: what a run costs, not what its first use does.


class _Compiling(threading.local):
    """Time that a thread has spent in compiling [s]; compilations begin inside others."""

    def __init__(self) -> None:
        self.total, self.since, self.depth = 0.0, 0.0, 0

    def begin(self) -> None:
        if self.depth == 0:
            self.since = time.monotonic()
        self.depth += 1

    def end(self) -> None:
        self.depth -= 1
        if self.depth == 0:
            self.total += time.monotonic() - self.since


_COMPILING = _Compiling()
_LISTENING = on_compilation(_COMPILING.begin, _COMPILING.end)
_LISTENING.__enter__()  # for good: it costs nothing where nothing is compiled


def own_time() -> float:
    """As `time.monotonic`, but it stands still while the calling thread compiles [s].

    Called where nothing compiles: a compilation that never ended was broken off by a signal.
    """
    if _COMPILING.depth:
        _COMPILING.depth = 1
        _COMPILING.end()
    return time.monotonic() - _COMPILING.total
