"""LAPACK for compiled functions: what SciPy offers to C, by its address.

`eigenvectors` and `singular_vectors` work in place on vectors that the caller has; interpreted they
are numpy's.
"""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
import threading
import traceback
from functools import cache
from typing import Any

import numpy as np

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler.arrays import counted, first_of
from rb_sim.compiler.builder import Value, known
from rb_sim.compiler.calls import means
from rb_sim.compiler.kinds import INTEGER


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
    rows, workspace = _int(f, size), _int(f, f.get(f"mul i64 {size}, {WORK}"))
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
    rows, workspace = _int(f, size), _int(f, count)
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


def _int(f: Any, value: str) -> str:
    """Where the integer is, as Fortran's."""
    slot = f.slot("i32")
    f.store("i32", f.get(f"trunc i64 {value} to i32"), slot)
    return slot


def _letter(f: Any, letter: str) -> str:
    """Where the letter is."""
    slot = f.slot("i8")
    f.store("i8", str(ord(letter)), slot)
    return slot
