"""Sums over the coordinates of a tuple y, written out by the compiler.

numba unrolls nothing over tuples by itself, so the expressions are generated as source for the
length at hand: no loop, no array, no allocation, zero coefficients left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from rb_sim.maths.jit import by_type

Term = tuple[int, float]


def linear(terms: Sequence[Term], i: int) -> str:
    """Source of sum coefficient * k<stage>_<i>."""
    return " + ".join(f"{value!r}*k{stage}_{i}" for stage, value in terms) or "0.0"


def unpacked(name: str, n: int, expression: str) -> str:
    """Source line that unpacks an n-tuple into the scalars <name>_0 ... <name>_<n-1>."""
    return f"    {', '.join(f'{name}_{i}' for i in range(n))}, = {expression}"


def vector(n: int, component: Callable[[int], str]) -> str:
    """Source of the n-tuple of the given component expressions."""
    return "(" + ", ".join(component(i) for i in range(n)) + ",)"


def compile_source(source: str, name: str, **names: Any) -> Any:
    """The function `name` that the source defines."""
    space = dict(names)
    exec(source, space)
    return space[name]


@cache
def _accumulate_source(n: int) -> Any:
    """Kahan's compensated y + dy: (sum, carry)."""
    lines = ["def implementation(y, dy, carry):"]
    for i in range(n):
        lines.append(f"    d{i} = dy[{i}] + carry[{i}]")
        lines.append(f"    s{i} = y[{i}] + d{i}")
    total = vector(n, lambda i: f"s{i}")
    lost = vector(n, lambda i: f"d{i} - (s{i} - y[{i}])")
    lines.append(f"    return {total}, {lost}")
    return compile_source("\n".join(lines), "implementation")


def _accumulate(y, dy, carry):
    """(y + dy, carry): compensated summation, so that rounding does not grow with the steps."""


def _accumulate_array(y, dy, carry):
    for i in range(y.shape[0]):
        d = dy[i] + carry[i]
        s = y[i] + d
        carry[i] = d - (s - y[i])
        y[i] = s
    return y, carry


def _is_array(y: Any) -> bool:
    return hasattr(y, "ndim")


accumulate = by_type(
    _accumulate,
    lambda y, dy, carry: _accumulate_array if _is_array(y) else _accumulate_source(len(y)),
    lambda y, dy, carry: (
        _accumulate_array(y, dy, carry)
        if _is_array(y)
        else _accumulate_source(len(y))(y, dy, carry)
    ),
)


def _copy(destination, source):
    """The values of `source`: itself for a tuple, `destination` overwritten for an array."""


def _copy_array(destination, source):
    """A loop: numba compiles the tests of `destination[:] = source` for some seconds."""
    for i in range(source.shape[0]):
        destination[i] = source[i]
    return destination


def _copy_tuple(destination, source):
    return source


@cache
def _finite_source(n: int) -> Any:
    """total - total == 0 for the sum of the coordinates."""
    total = " + ".join(f"y[{i}]" for i in range(n))
    source = f"def implementation(y):\n    total = {total}\n    return total - total == 0.0"
    return compile_source(source, "implementation")


def _finite(y):
    """True if no coordinate is NaN or infinite."""


def _finite_array(y):
    total = 0.0
    for value in y:
        total += value
    return total - total == 0.0


finite = by_type(
    _finite,
    lambda y: _finite_array if _is_array(y) else _finite_source(len(y)),
    lambda y: (_finite_array if _is_array(y) else _finite_source(len(y)))(y),
)


copy = by_type(
    _copy,
    lambda destination, source: _copy_array if _is_array(source) else _copy_tuple,
    lambda destination, source: _copy_array(destination, source) if _is_array(source) else source,
)
