# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Symbols and the graph of their operations; functions that a law may call besides arithmetic.

Symbols replace floats while a law runs once; the recorded operations are its graph. The functions
return a value for floats and an operation of the graph for symbols.

Equal parts are one node, constants are folded, exact zeros removed. Nothing is reordered: the graph
gives bit for bit the result of Python on floats, except that x * 0 and x - x are 0 also for x that
is not finite. A graph belongs to one trace and one thread; several threads may trace different
graphs at the same time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

# Conditions on which a function branches while it runs on symbols.


class Path:
    """One path through a function that branches on symbols: the assumed values of its
    conditions."""

    def __init__(self, given: list[tuple[Condition, bool]]) -> None:
        self.decisions = list(given)
        """(condition, assumed value), in the order of first evaluation."""
        self._known = {condition.number: value for condition, value in given}

    def taken(self, condition: Condition) -> bool:
        """Assumed value of the condition on this path; True at its first evaluation."""
        if condition.number not in self._known:
            self._known[condition.number] = True
            self.decisions.append((condition, True))
        return self._known[condition.number]


INPUTS = ("t", "y", "p")
"""Kinds of argument nodes: time, coordinate, input that may change between steps."""


class External(NamedTuple):
    """An external function, compiled once, that traced code calls by its address.

    For iterations and pivoting by value: void f(const double *arguments, double *results).
    """

    name: str
    """its symbol in machine code; it changes when its meaning does."""
    results: int
    plain: Callable[..., Any]
    """the function in Python: floats to a tuple of floats."""
    address: Callable[[], int]
    """returns its address, compiling it if necessary."""
    slopes: Callable[..., Sequence[Sequence[Any]]] | None = None
    """traced: arguments -> d results / d arguments, row by row; None: not known."""
    along: Callable[..., Sequence[Any]] | None = None
    """traced: arguments and their changes -> changes of the results, if slopes would be too many to
    be written one by one; None: by slopes."""


def stepwise(*arguments: Any) -> tuple[()]:
    """Slopes of a stepwise constant function: empty."""
    return ()


OTHER_GRAPH = "symbols of two graphs in one law"


class Symbol:
    """One operation of a graph; arithmetic on it adds operations."""

    __slots__ = ("graph", "number", "op", "operands")

    def __init__(self, graph: Graph, number: int, op: str, operands: tuple[Any, ...]) -> None:
        self.graph, self.number, self.op, self.operands = graph, number, op, operands

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Symbol):
            if other.op == "neg":
                return self - other.operands[0]
        elif other == 0.0:
            return self
        return self.graph.commutative("add", self, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Symbol):
            if other is self:
                return 0.0
            if other.op == "neg":
                return self + other.operands[0]
        elif other == 0.0:
            return self
        return self.graph.pair("sub", self, other)

    def __rsub__(self, other: Any) -> Any:
        return -self if _is(other, 0.0) else self.graph.pair("sub", other, self)

    def __mul__(self, other: Any) -> Any:
        if not isinstance(other, Symbol):
            if other == 0.0:
                return 0.0
            if other == 1.0:
                return self
            if other == -1.0:
                return -self
        return self.graph.commutative("mul", self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if _is(other, 1.0):
            return self
        if _is(other, -1.0):
            return -self
        return self.graph.pair("div", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return 0.0 if _is(other, 0.0) else self.graph.pair("div", other, self)

    def __neg__(self) -> Any:
        if self.op == "neg":
            return self.operands[0]
        return self.graph.node("neg", self)

    def __pos__(self) -> Symbol:
        return self

    def __abs__(self) -> Any:
        return self.graph.node("fabs", self)

    def __pow__(self, power: Any) -> Any:
        if power == 0.5:
            return self.graph.node("sqrt", self)
        if isinstance(power, int) and 0 < power < 5:
            result = self
            for _ in range(power - 1):
                result = result * self
            return result
        raise TypeError(f"a symbol to the power {power}: must be 0.5 or 1 to 4")

    def __lt__(self, other: Any) -> Any:
        return self.graph.condition("lt", self, other)

    def __le__(self, other: Any) -> Any:
        return self.graph.condition("le", self, other)

    def __gt__(self, other: Any) -> Any:
        return self.graph.condition("lt", other, self)

    def __ge__(self, other: Any) -> Any:
        return self.graph.condition("le", other, self)

    def __eq__(self, other: Any) -> Any:
        if isinstance(other, Symbol):
            return self is other
        return (self <= other) & (self >= other)

    def __ne__(self, other: Any) -> Any:
        equal = self == other
        return ~equal if isinstance(equal, Condition) else not equal

    __hash__ = object.__hash__

    def __float__(self) -> float:
        raise TypeError(
            "a law may not read the value of a symbol: use rb_sim.compiler.graph.symbols"
        )

    __bool__ = __int__ = __index__ = __float__


class Condition(Symbol):
    """A comparison of symbols, or a combination of conditions; argument of `where`."""

    __slots__ = ()

    def __and__(self, other: Any) -> Any:
        if isinstance(other, Condition):
            return self.graph.condition("and", self, other)
        return self if other else False

    __rand__ = __and__

    def __or__(self, other: Any) -> Any:
        if isinstance(other, Condition):
            return self.graph.condition("or", self, other)
        return True if other else self

    __ror__ = __or__

    def __invert__(self) -> Any:
        return self.graph.condition("not", self)

    def __bool__(self) -> bool:
        if self.graph.path is None:
            raise TypeError("a law may not branch on a symbol: use where() or branching()")
        return self.graph.path.taken(self)


def _is(x: Any, value: float) -> bool:
    """True if x is a number (not a symbol) equal to the value."""
    return not isinstance(x, Symbol) and x == value


class Graph:
    """All operations of one trace."""

    def __init__(self) -> None:
        self._known: dict[tuple[Any, ...], Symbol] = {}
        self.path: Path | None = None
        """the current path while a function that may branch runs; else None."""

    def __len__(self) -> int:
        return len(self._known)

    def _find(self, kind: type[Symbol], op: str, operands: tuple[Any, ...]) -> Any:
        key = (op, *map(_key, operands))
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = kind(self, len(self._known), op, operands)
        return found

    def node(self, op: str, *operands: Any) -> Any:
        """The node of an operation on symbols and numbers, new or existing."""
        return self._find(Symbol, op, tuple(_operand(self, x) for x in operands))

    def pair(self, op: str, a: Any, b: Any) -> Any:
        """As `node`, for two operands; specialised, as nearly all nodes of a law are made here."""
        if isinstance(a, Symbol):
            left: Any = a.number
            if a.graph is not self:
                raise ValueError(OTHER_GRAPH)
        else:
            a = float(a)
            left = _key(a)
        if isinstance(b, Symbol):
            right: Any = b.number
            if b.graph is not self:
                raise ValueError(OTHER_GRAPH)
        else:
            b = float(b)
            right = _key(b)
        known, key = self._known, (op, left, right)
        found = known.get(key)
        if found is None:
            found = known[key] = Symbol(self, len(known), op, (a, b))
        return found

    def commutative(self, op: str, a: Symbol, b: Any) -> Any:
        """As `pair`, for a commutative operation: operands in a canonical order."""
        if not isinstance(b, Symbol) or a.number > b.number:
            return self.pair(op, b, a)
        return self.pair(op, a, b)

    def condition(self, op: str, *operands: Any) -> Any:
        """The node of a comparison or of a combination of conditions."""
        return self._find(Condition, op, tuple(_operand(self, x) for x in operands))

    def input(self, kind: str, index: int = 0) -> Any:
        """The time "t", coordinate y[index] or input p[index]."""
        return self._find(Symbol, kind, (index,))

    def vector(self, kind: str, count: int, first: int = 0) -> tuple[Any, ...]:
        """`count` consecutive inputs."""
        return tuple(self.input(kind, first + i) for i in range(count))

    def call(self, function: External, arguments: Iterable[Any]) -> tuple[Any, ...]:
        """Symbols of the results of an external function."""
        operands = tuple(_operand(self, x) for x in arguments)
        call = self._find(Symbol, "call", (function, *operands))
        return tuple(self._find(Symbol, "item", (call, i)) for i in range(function.results))


def _operand(graph: Graph, x: Any) -> Any:
    """x as a symbol of this graph or a float. Raises ValueError for a symbol of another graph."""
    if isinstance(x, Symbol):
        if x.graph is not graph:
            raise ValueError(OTHER_GRAPH)
        return x
    return float(x)


def _key(x: Any) -> Any:
    """Hash key of an operand; 0.0 and -0.0 differ."""
    if isinstance(x, Symbol):
        return x.number
    if isinstance(x, float):
        return (x, math.copysign(1.0, x))
    return x


def graph_of(values: Iterable[Any]) -> Graph | None:
    """Graph of the first symbol among the values; None if all are numbers."""
    return next((x.graph for x in values if isinstance(x, Symbol)), None)


def in_order(outputs: Iterable[Any]) -> list[Symbol]:
    """All nodes on which the outputs depend, operands before their users."""
    seen: set[int] = set()
    order: list[Symbol] = []
    stack: list[Symbol | None] = [x for x in reversed(list(outputs)) if isinstance(x, Symbol)]
    while stack:
        x = stack.pop()
        if x is None:  # the operands of the next one are done
            order.append(stack.pop())  # type: ignore[arg-type]
        elif x.number not in seen:
            seen.add(x.number)
            stack.append(x)
            stack.append(None)
            for o in reversed(x.operands):
                if isinstance(o, Symbol) and o.number not in seen:
                    stack.append(o)
    return order


def operations(outputs: Iterable[Any]) -> int:
    """Number of operations on which the outputs depend, without arguments."""
    return sum(x.op not in INPUTS for x in in_order(outputs))


# A graph evaluated on arrays: the same operations for several instants at once.


Array = NDArray[np.float64]

OPERATIONS: dict[str, Any] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "fabs": np.abs,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "floor": np.floor,
    "atan2": np.arctan2,
    "lt": np.less,
    "le": np.less_equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "not": np.logical_not,
    "select": np.where,
    "rarely": np.where,
}


class ArrayLaw:
    """Outputs, symbols of one graph and numbers, evaluated at n instants.

    `law(t, y)` with t of shape (n,) and y of shape (n, coordinates) returns shape (n, outputs).
    Results are infinite or NaN as in machine code, without a warning.
    """

    def __init__(self, outputs: Sequence[Any]) -> None:
        self._outputs = tuple(outputs)
        self._order = in_order(self._outputs)

    def __call__(self, t: Array, y: Array) -> Array:
        """The outputs at all instants, shape (n, outputs)."""
        values: dict[int, Any] = {}

        def value(x: Any) -> Any:
            return values[x.number] if isinstance(x, Symbol) else x

        with np.errstate(all="ignore"):
            for x in self._order:
                values[x.number] = _value(x, value, t, y)
        columns = [np.broadcast_to(value(x), t.shape) for x in self._outputs]
        return np.stack(columns, axis=1) if columns else np.empty((len(t), 0))


def _value(x: Symbol, value: Any, t: Array, y: Array) -> Any:
    if x.op in INPUTS:
        if x.op == "t":
            return t
        if x.op == "y":
            return y[:, x.operands[0]]
        raise TypeError(f"the input {x.op} has no value over time")
    if x.op == "call":
        function, *arguments = x.operands
        each = np.broadcast_arrays(t, *map(value, arguments))[1:]
        rows = [tuple(function.plain(*row)) for row in np.stack(each, axis=1).tolist()]
        return np.array(rows, dtype=float).reshape(len(t), function.results)
    if x.op == "item":
        return value(x.operands[0])[:, x.operands[1]]
    return OPERATIONS[x.op](*map(value, x.operands))


def sqrt(x: Any) -> Any:
    """The square root; NaN for negative x, as in machine code."""
    if isinstance(x, Symbol):
        return x.graph.node("sqrt", x)
    return math.sqrt(x) if x >= 0.0 else math.nan


def sin(x: Any) -> Any:
    """The sine of x [rad]; NaN if x is not finite."""
    if isinstance(x, Symbol):
        return x.graph.node("sin", x)
    return math.sin(x) if math.isfinite(x) else math.nan


def cos(x: Any) -> Any:
    """The cosine of x [rad]; NaN if x is not finite."""
    if isinstance(x, Symbol):
        return x.graph.node("cos", x)
    return math.cos(x) if math.isfinite(x) else math.nan


def floor(x: Any) -> Any:
    """The largest whole number <= x, as a float."""
    if isinstance(x, Symbol):
        return x.graph.node("floor", x)
    return float(math.floor(x)) if math.isfinite(x) else x


def atan2(y: Any, x: Any) -> Any:
    """The angle of the point (x, y) [rad], in [-pi, pi]."""
    graph = graph_of((y, x))
    return math.atan2(y, x) if graph is None else graph.node("atan2", y, x)


def divide(a: Any, b: Any) -> Any:
    """a / b by IEEE 754: infinite or NaN if b is zero."""
    if isinstance(a, Symbol) or isinstance(b, Symbol) or b != 0.0:
        return a / b
    if a == 0.0 or a != a:
        return math.nan
    return math.copysign(math.inf, a) * math.copysign(1.0, b)


def where(condition: Any, a: Any, b: Any) -> Any:
    """a if the condition holds, else b; numbers, or tuples of equal structure.

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
    """As `where` on numbers, for a condition that seldom holds.

    Machine code branches on it, so that later operations do not wait for a.
    """
    if not isinstance(condition, Condition):
        return a if condition else b
    return condition.graph.node("rarely", condition, a, b)


def maximum(a: Any, b: Any) -> Any:
    """The larger of two, as Python's max: a if they are equal or one is NaN."""
    return where(b > a, b, a)


def minimum(a: Any, b: Any) -> Any:
    """The smaller of two, as Python's min: a if they are equal or one is NaN."""
    return where(b < a, b, a)


def call(function: External, *arguments: Any) -> tuple[Any, ...]:
    """Results of an external function for the arguments."""
    graph = graph_of(arguments)
    return tuple(function.plain(*arguments)) if graph is None else graph.call(function, arguments)


def leaves(x: Any) -> Iterator[Any]:
    """The entries of nested tuples."""
    if isinstance(x, tuple):
        for entry in x:
            yield from leaves(entry)
    else:
        yield x


def graph_within(values: tuple[Any, ...]) -> Graph | None:
    """Graph of the first symbol in nested tuples; None if there are only numbers."""
    for x in values:
        if isinstance(x, Symbol):
            return x.graph
        if isinstance(x, tuple) and (graph := graph_within(x)) is not None:
            return graph
    return None


def explored(function: Callable[..., Any], *arguments: Any) -> Any:
    """function(*arguments), where the function may branch on symbols.

    It runs once for every path through it; the results are selected by the conditions of the paths.
    So it must not contain loops that end on a condition, or long chains of branches. On floats it
    runs once, unchanged.
    """
    graph = graph_within(arguments)
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
    """Result of the paths that begin with these decisions."""
    path = graph.path = Path(given)
    result = function(*arguments)
    for i in range(len(path.decisions) - 1, len(given) - 1, -1):
        condition = path.decisions[i][0]
        other = _from(graph, function, arguments, [*path.decisions[:i], (condition, False)])
        result = where(condition, result, other)
    return result
