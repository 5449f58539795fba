# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Symbols and the graph of their operations; what a law may call besides arithmetic.

Symbols stand for floats while a law runs once; what it did with them is its graph. The functions
give the plain value on floats and an operation of the graph on symbols.

Equal parts are one node, constants fold, exact zeros vanish. Nothing is reordered: the graph gives
bit for bit what plain Python gives on floats, except that x * 0 is 0 and x - x is 0 even where x is
not finite. A graph belongs to one trace and to one thread; different threads trace different
graphs at the same time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

# The conditions on which a function branches while it runs on symbols.


class Path:
    """One way through a function that branches on symbols: what its conditions were taken to be."""

    def __init__(self, given: list[tuple[Condition, bool]]) -> None:
        self.decisions = list(given)
        """in the order in which they were asked, each condition once."""
        self._known = {condition.number: value for condition, value in given}

    def taken(self, condition: Condition) -> bool:
        """Whether the condition holds on this way; True where it has not been asked yet."""
        if condition.number not in self._known:
            self._known[condition.number] = True
            self.decisions.append((condition, True))
        return self._known[condition.number]


INPUTS = ("t", "y", "p")
"""Nodes that are arguments: the time, a coordinate, an input that may change between steps."""


class External(NamedTuple):
    """A function compiled once that traced code calls by its address.

    For what iterates or decides by pivots: void f(const double *arguments, double *results).
    """

    name: str
    """its symbol in machine code; changes when its meaning does."""
    results: int
    plain: Callable[..., Any]
    """the same as plain Python: floats to a tuple of floats."""
    address: Callable[[], int]
    """compiles it where it is not yet, and gives its address."""
    slopes: Callable[..., Sequence[Sequence[Any]]] | None = None
    """traced: the arguments to d results / d arguments, row by row; None: not known."""
    along: Callable[..., Sequence[Any]] | None = None
    """traced: the arguments, then their changes, to the changes of the results; where slopes would
    be too many to be written one by one. None: by slopes."""


def stepwise(*arguments: Any) -> tuple[()]:
    """The slopes of what is constant but for jumps: none."""
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
        raise TypeError("a law may not read the value of a symbol: use rb_sim.graph.symbols")

    __bool__ = __int__ = __index__ = __float__


class Condition(Symbol):
    """A comparison of symbols; `where` selects by it."""

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
    """True if x is a number equal to the value."""
    return not isinstance(x, Symbol) and x == value


class Graph:
    """All operations of one trace."""

    def __init__(self) -> None:
        self._known: dict[tuple[Any, ...], Symbol] = {}
        self.path: Path | None = None
        """while a function that may branch runs."""

    def __len__(self) -> int:
        return len(self._known)

    def _find(self, kind: type[Symbol], op: str, operands: tuple[Any, ...]) -> Any:
        key = (op, *map(_key, operands))
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = kind(self, len(self._known), op, operands)
        return found

    def node(self, op: str, *operands: Any) -> Any:
        """The operation on symbols and numbers; the one that is there if it is known."""
        return self._find(Symbol, op, tuple(_operand(self, x) for x in operands))

    def pair(self, op: str, a: Any, b: Any) -> Any:
        """As `node`, of two operands: nearly all of a law is made here, so nothing is generic."""
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
        """As `pair`, with operands in one order."""
        if not isinstance(b, Symbol) or a.number > b.number:
            return self.pair(op, b, a)
        return self.pair(op, a, b)

    def condition(self, op: str, *operands: Any) -> Any:
        """A comparison, or conditions joined."""
        return self._find(Condition, op, tuple(_operand(self, x) for x in operands))

    def input(self, kind: str, index: int = 0) -> Any:
        """The time "t", coordinate y[index] or input p[index]."""
        return self._find(Symbol, kind, (index,))

    def vector(self, kind: str, count: int, first: int = 0) -> tuple[Any, ...]:
        """`count` neighbouring inputs."""
        return tuple(self.input(kind, first + i) for i in range(count))

    def call(self, function: External, arguments: Iterable[Any]) -> tuple[Any, ...]:
        """The symbols of what the function gives for the arguments."""
        operands = tuple(_operand(self, x) for x in arguments)
        call = self._find(Symbol, "call", (function, *operands))
        return tuple(self._find(Symbol, "item", (call, i)) for i in range(function.results))


def _operand(graph: Graph, x: Any) -> Any:
    """A symbol of this graph, or a float."""
    if isinstance(x, Symbol):
        if x.graph is not graph:
            raise ValueError(OTHER_GRAPH)
        return x
    return float(x)


def _key(x: Any) -> Any:
    """What tells operands apart; 0.0 and -0.0 differ."""
    if isinstance(x, Symbol):
        return x.number
    if isinstance(x, float):
        return (x, math.copysign(1.0, x))
    return x


def graph_of(values: Iterable[Any]) -> Graph | None:
    """The graph of the first symbol among the values; None where all are numbers."""
    return next((x.graph for x in values if isinstance(x, Symbol)), None)


def in_order(outputs: Iterable[Any]) -> list[Symbol]:
    """All nodes that the outputs need, operands before their users."""
    seen: set[int] = set()
    order: list[Symbol] = []
    stack: list[Symbol | None] = [x for x in reversed(list(outputs)) if isinstance(x, Symbol)]
    while stack:
        x = stack.pop()
        if x is None:  # the operands of the one below are done
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
    """How many operations the outputs need, arguments not counted."""
    return sum(x.op not in INPUTS for x in in_order(outputs))


# A graph evaluated on arrays: the same operations, for many instants at once.


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
    """The outputs, symbols of one graph and numbers, at n instants.

    `law(t, y)` with t of shape (n,) and y of shape (n, coordinates) gives shape (n, outputs).
    What machine code would make infinite or NaN is so here, too, without a warning.
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
