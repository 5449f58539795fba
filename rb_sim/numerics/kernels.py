# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Kernels: decorators of functions that are compiled, called by address, or dispatched by class."""

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
from rb_sim.compiler.graph.machine import interpreted
from rb_sim.compiler.graph.symbols import explored
from rb_sim.compiler.program import Entry, ForC, on_compilation

# Calls in compiled loops: laws and steps are called by their address, vectors are pointers.
#
# A pointer to double in machine code is an array in plain Python (RB_SIM_INTERPRETED=1); both are
# indexed in the same way.


Function = Callable[..., Any]


def pointer(array):
    """Pointer to the elements of an array."""
    return array.reshape(-1)


@means(pointer)
def _pointer(f: Any, array: Value) -> Value:
    return arrays.first_of(f, array)


def integers(array):
    """Pointer to the integers of an array; if interpreted also laws, which are functions then."""
    return array.reshape(-1) if isinstance(array, np.ndarray) else array


@means(integers)
def _integers(f: Any, array: Value) -> Value:
    return Value(INTEGERS, (array.leaves[0],))


def pointer_to(places, i):
    """As `pointer`, for the array whose address is places[i]."""
    return places[i].reshape(-1)


@means(pointer_to)
def _pointer_to(f: Any, places: Value, i: Value) -> Value:
    return arrays.as_kind(f, arrays.entry(f, places, [i]), VECTOR)


def integers_to(places, i):
    """As `integers`, for the array whose address is places[i]."""
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
    """An array of `length` numbers of the vector from the element `first` on."""
    return vector[first : first + length]


@means(view)
def _view(f: Any, vector: Value, first: Value, length: Value) -> Value:
    begin = _part(f, vector, first)
    return arrays.shaped(begin.leaf, "real", [numbers.converted(f, length, INTEGER)])


def call_law(law, t, y, p, out):
    """Call a law: out = f(t, y, p)."""
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
    """Call a method's step: writes the increment dy of y over h; returns its error estimate."""
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
    """Address of a contiguous array, encoded as a float input of a law; see `table_at`.

    The array must stay alive as long as the law is called.
    """
    return float(np.array([array.ctypes.data], np.int64).view(np.float64)[0])


def table_at(place, length):
    """An array of `length` numbers at an address from `place_of`."""
    where = int(np.array([place]).view(np.int64)[0])
    return np.ctypeslib.as_array((ctypes.c_double * int(length)).from_address(where))


@means(table_at)
def _table_at(f: Any, place: Value, length: Value) -> Value:
    bits = f.get(f"bitcast double {place.leaf} to i64")
    begin = f.get(f"inttoptr i64 {bits} to ptr")
    return arrays.shaped(begin, "real", [numbers.integer(f, length)])


class ForPython:
    """A loop f(places) that Python calls with the address of its integers; see `where`.

    The GIL is held meanwhile, so that no other thread changes the data of the loop.
    """

    def __init__(self, function: Function) -> None:
        self.function, self._for_c = function, ForC(function, LOOP, INTEGER)
        self._call = function if interpreted() else None

    def __call__(self, places: Any) -> int:
        if self._call is None:
            self._call = _LOOP(self._for_c.address)
        return self._call(places)


def where(array: Any) -> Any:
    """Address of a contiguous array; if interpreted, the array as a vector."""
    return array.reshape(-1) if interpreted() else array.ctypes.data


_LOOP = ctypes.PYFUNCTYPE(ctypes.c_ssize_t, ctypes.c_void_p)


def for_python(function: Function) -> ForPython:
    """Decorator of a loop for calls from Python, see `ForPython`."""
    return ForPython(function)


class Routine(ForC):
    """A function void f(const double *arguments, double *results) that traced laws call."""

    def __init__(self, function: Function) -> None:
        super().__init__(function, ROUTINE, None)


def routine(function: Function) -> Routine:
    """Decorator of a function of two vectors that traced laws call: it is compiled."""
    return Routine(function)


def by_address(function: Function) -> ForC:
    """Decorator of a function f(t, y, p, out) with the signature of a law, for calls by its
    address."""
    return ForC(function, LAW, None)


class Step:
    """A method's step as loops call it; `reference` is its address, or the Python function."""

    series: Callable[[float], int] | None = None
    """order of the series for a tolerance, for a method that uses a Taylor series; else None."""

    def __init__(self, function: Function, stages: int, implicit: int) -> None:
        self.function, self.stages, self.implicit = function, stages, implicit
        self.traced: Function | None = None
        """the step as plain Python on tuples, f(rate, t, y, h, velocities) -> (dy, error), or None;
        traced with a small law, the whole step is one function."""
        self._for_c = ForC(function, STEP, REAL)

    def on_tuples(self, function: Function) -> Function:
        """Decorator that sets the function for `traced`."""
        self.traced = function
        return function

    @property
    def reference(self) -> Any:
        """Address of the step, compiled on first use."""
        return self._for_c.address


class SeriesStep(Step):
    """The step along the Taylor series of the motion, which the loop itself performs.

    order: function that returns the order of the series for a tolerance.
    """

    reference: Any = 0

    def __init__(self, order: Callable[[float], int]) -> None:
        super().__init__(lambda *arguments: 0.0, 1, 0)
        self.series = order


def step(stages: int, implicit: int = 0) -> Callable[[Function], Step]:
    """Decorator of the step of a method that calls its law about `stages` times.

    f(law, jacobian, n, t, y, h, p, dy, work) writes dy and returns the error relative to the
    tolerance 1 (0 without an estimate). y, dy: n coordinates; work: WORK_ROWS n numbers, of which
    the first rows are those of `integrate.layout`: which coordinates are velocities, and the error
    scales. For at most `implicit` coordinates it gets their Jacobian (n n numbers by rows) as a
    law, and 3 n more rows of work; otherwise jacobian is 0.
    """
    return lambda function: Step(function, stages, implicit)


# Functions whose kernel is selected by the class of their first argument.
#
# The selection is made at compile time, so that kernels that a scene does not use are not in its
# machine code.


Kernel = Callable[..., Any]


def dispatch(stub: Kernel) -> Any:
    """Decorator: the function calls the kernel registered for the class of its first argument.

    The decorator `name.register(*classes)` adds kernels; `name.kernels` maps the classes to them.
    The stub gives name, arguments and meaning.
    """
    kernels: dict[type, Any] = {}

    @functools.wraps(stub)
    def call(first: Any, *others: Any) -> Any:
        return kernels[type(first)](first, *others)

    def chosen(kinds: list[Kind]) -> Kernel:
        """The kernel for arguments of these kinds. Raises TypeError if there is none."""
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


# Decorators of functions of catalogue and contact.
#
# The functions stay plain Python, which traces of laws and RB_SIM_INTERPRETED=1 run as they are;
# those that compiled code calls are compiled with it and need no mark.


__all__ = ["branching", "by_address", "dispatch", "entry", "on_compilation"]


def branching(function: Kernel) -> Any:
    """Decorator of a short function that branches on numbers: a trace follows every path."""

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        return explored(function, *arguments)

    call.compiled_as = function  # type: ignore[attr-defined]
    return call


def entry(function: Kernel) -> Any:
    """Decorator of a function that Python calls with arrays, numbers and tuples: it is compiled."""
    return Entry(function)


def python_of(function: Any) -> Any:
    """The plain Python function behind a decorated one; nothing is compiled."""
    return getattr(function, "function", function)


# Wall-clock time without compiling, so that the first run of a scene is not charged for it.


class _Compiling(threading.local):
    """Time that a thread has spent compiling [s]; compilations may be nested."""

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
_LISTENING.__enter__()  # never left: it costs nothing without compilations


def own_time() -> float:
    """As `time.monotonic`, without the time that the calling thread has spent compiling [s].

    Must not be called within a compilation: one that is still open was interrupted by a signal.
    """
    if _COMPILING.depth:
        _COMPILING.depth = 1
        _COMPILING.end()
    return time.monotonic() - _COMPILING.total
