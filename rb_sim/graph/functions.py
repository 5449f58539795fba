# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a law may call besides arithmetic: on floats the plain function, on symbols an operation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from rb_sim.graph.symbols import Condition, External, Graph, Path, Symbol, graph_of


def sqrt(x: Any) -> Any:
    """The square root; NaN below zero, as machine code has it."""
    if isinstance(x, Symbol):
        return x.graph.node("sqrt", x)
    return math.sqrt(x) if x >= 0.0 else math.nan


def sin(x: Any) -> Any:
    """The sine of x [rad]; NaN of what is not finite."""
    if isinstance(x, Symbol):
        return x.graph.node("sin", x)
    return math.sin(x) if math.isfinite(x) else math.nan


def cos(x: Any) -> Any:
    """The cosine of x [rad]; NaN of what is not finite."""
    if isinstance(x, Symbol):
        return x.graph.node("cos", x)
    return math.cos(x) if math.isfinite(x) else math.nan


def floor(x: Any) -> Any:
    """The largest whole number up to x, as a float."""
    if isinstance(x, Symbol):
        return x.graph.node("floor", x)
    return float(math.floor(x)) if math.isfinite(x) else x


def atan2(y: Any, x: Any) -> Any:
    """The angle of the point (x, y) [rad], in [-pi, pi]."""
    graph = graph_of((y, x))
    return math.atan2(y, x) if graph is None else graph.node("atan2", y, x)


def divide(a: Any, b: Any) -> Any:
    """a / b by IEEE 754: infinite or NaN where b is zero."""
    if isinstance(a, Symbol) or isinstance(b, Symbol) or b != 0.0:
        return a / b
    if a == 0.0 or a != a:
        return math.nan
    return math.copysign(math.inf, a) * math.copysign(1.0, b)


def where(condition: Any, a: Any, b: Any) -> Any:
    """a where the condition holds, else b; numbers, or tuples of them alike.

    On symbols both are computed and one is selected, so neither may raise.
    """
    if not isinstance(condition, Condition):
        return a if condition else b
    if isinstance(a, tuple):
        entries = [where(condition, x, y) for x, y in zip(a, b, strict=True)]
        return a._make(entries) if hasattr(a, "_make") else tuple(entries)  # type: ignore[attr-defined]
    if a is b or (not isinstance(a, Symbol) and not isinstance(b, Symbol) and a == b):
        return a
    return condition.graph.node("select", condition, a, b)


def rarely(condition: Any, a: Any, b: Any) -> Any:
    """As `where` on numbers, for a condition that hardly ever holds: machine code branches on it,
    so that what follows does not wait for a.
    """
    if not isinstance(condition, Condition):
        return a if condition else b
    return condition.graph.node("rarely", condition, a, b)


def maximum(a: Any, b: Any) -> Any:
    """The larger of two, as Python's max: a where they are equal or one is NaN."""
    return where(b > a, b, a)


def minimum(a: Any, b: Any) -> Any:
    """The smaller of two, as Python's min: a where they are equal or one is NaN."""
    return where(b < a, b, a)


def call(function: External, *arguments: Any) -> tuple[Any, ...]:
    """Call a function that is compiled once; returns what it gives for the arguments."""
    graph = graph_of(arguments)
    return tuple(function.plain(*arguments)) if graph is None else graph.call(function, arguments)


def leaves(x: Any) -> Iterator[Any]:
    """The entries of nested tuples."""
    if isinstance(x, tuple):
        for entry in x:
            yield from leaves(entry)
    else:
        yield x


def explored(function: Callable[..., Any], *arguments: Any) -> Any:
    """function(*arguments), where the function may branch on symbols.

    It runs once for every way through it; what the ways give is selected by their conditions.  So
    loops that end on a condition, and long chains of branches, do not belong in it.  On floats it
    runs once, as it is.
    """
    graph = graph_of(leaves(arguments))
    if graph is None:
        return function(*arguments)
    outer = graph.path
    try:
        return _from(graph, function, arguments, [])
    finally:
        graph.path = outer


def _from(
    graph: Graph,
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
    given: list[tuple[Condition, bool]],
) -> Any:
    """What the ways give that begin with these decisions."""
    path = graph.path = Path(given)
    result = function(*arguments)
    for i in range(len(path.decisions) - 1, len(given) - 1, -1):
        condition = path.decisions[i][0]
        other = _from(graph, function, arguments, [*path.decisions[:i], (condition, False)])
        result = where(condition, result, other)
    return result
