# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The Taylor series of dy/dt = f(t, y) from the graph of f: one recurrence for each operation.

With x_k for the coefficient of order k of the operation x, a product is a convolution.  The part of
it that is known before order k, S(a, b) = sum of a_j b_(k-j) for 0 < j < k, is apart from the two
terms that are new, so that all sums of an order come first and the rest is a law like any other:

    c = a b      c_k = S(a, b) + a_0 b_k + a_k b_0
    c = a / b    c_k = (a_k - S(c, b) - c_0 b_k) / b_0
    r = sqrt a   r_k = (a_k - S(r, r)) / (2 r_0)
    s = sin a    s_k = S(a', c) / k + c_0 a_k            with c = cos a and a'_j = j a_j
    c = cos a    c_k = -S(a', s) / k - s_0 a_k
    g = angle of (x, y)   g_k = ((S(y', x) - S(x', y) - S(g', r)) / k + x_0 y_k - y_0 x_k) / r_0
                          with r = x^2 + y^2

(Jorba & Zou, Experimental Mathematics 14, 2005, section 2; Griewank & Walther, Evaluating
Derivatives, chapter 13.)  A selection has the series of the side that holds at order 0.

The sum of a factor that is a polynomial in time ends with its degree (`graph.taylor`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from rb_sim.compiler.graph.symbols import (
    INPUTS,
    Condition,
    Graph,
    Symbol,
    cos,
    in_order,
    sin,
    stepwise,
    where,
)

# Operations of dy/dt = f(t, y) that are polynomials in time along any motion, and their degrees.
#
# A coordinate whose rate has degree d has degree d + 1: a rotation at constant rate, a fall or a
# guided motion is known in advance. All other operations have degree infinity.


PASSES = 3
"""Number of updates of the coordinates' degrees from those of their rates: constant, linear and
quadratic rates. Sums of more terms gain little by ending early."""


def degrees(
    outputs: Sequence[Any], nodes: Iterable[Symbol], moving: Collection[int]
) -> Callable[[Symbol], float]:
    """Function that returns the degree of each of `nodes`, which are in order of evaluation.

    outputs: dy/dt. moving: numbers of the operations that depend on t or y.
    """
    of_y: list[float] = [math.inf] * len(outputs)
    found: dict[int, float] = {}

    def degree(x: Any) -> float:
        return found[x.number] if isinstance(x, Symbol) and x.number in moving else 0

    ordered = [x for x in nodes if x.number in moving]
    for _ in range(PASSES):
        for x in ordered:
            found[x.number] = _degree(x, of_y, degree)
        before, of_y = of_y, [1 + degree(output) for output in outputs]
        if of_y == before:
            break
    return degree


def _degree(x: Symbol, of_y: Sequence[float], degree: Callable[[Any], float]) -> float:
    """Degree of an operation from those of its operands."""
    if x.op == "t":
        return 1
    if x.op == "y":
        return of_y[x.operands[0]]
    if x.op in ("floor", "call", "item"):  # stepwise constant; steps end at the jumps
        return 0
    if x.op in ("add", "sub", "neg", "fabs"):
        return max(map(degree, x.operands))
    if x.op in ("select", "rarely"):
        return max(map(degree, x.operands[1:]))
    if x.op == "mul":
        return sum(map(degree, x.operands))
    if x.op == "div" and degree(x.operands[1]) == 0:
        return degree(x.operands[0])
    return math.inf


# The sums S(a, b) of the recurrences of a series: their factors and their layout.


LANES = 4
"""The number of sums is rounded up to a multiple of this."""


class Pair(NamedTuple):
    """The factors of a sum S."""

    left: Symbol
    right: Symbol
    derived: bool
    """whether coefficient j of the left factor is multiplied by j."""


class Convolution(NamedTuple):
    """A sum in the layout: the factor of lower degree is first."""

    pair: Pair
    turned: bool
    """whether the right factor is first."""
    degree: float
    """degree of the first factor: its coefficients of higher order are zero."""


def laid_out(pairs: Iterable[Pair], degree: Callable[[Symbol], float]) -> list[Convolution]:
    """The sums sorted by number of terms, as LANES neighbours are computed together."""
    sums = []
    for pair in pairs:
        left, right = degree(pair.left), degree(pair.right)
        sums.append(Convolution(pair, right < left, min(left, right)))
    return sorted(sums, key=lambda one: one.degree)


def companions(nodes: Iterable[Symbol], moving: set[int]) -> Iterator[Symbol]:
    """Further operations that the recurrences of these operations need."""
    for x in nodes:
        if x.number in moving:
            if x.op == "sin":
                yield cos(x.operands[0])
            elif x.op == "cos":
                yield sin(x.operands[0])
            elif x.op == "atan2":
                yield square_of(x)


def square_of(x: Symbol) -> Any:
    """r = x^2 + y^2 of an angle."""
    a, b = x.operands
    return a * a + b * b


def pairs_of(x: Symbol, moving: set[int]) -> Iterator[Pair]:
    """The sums of an operation whose factors both depend on t or y."""
    for pair in _factors(x):
        if all(isinstance(o, Symbol) and o.number in moving for o in pair[:2]):
            yield pair


def _factors(x: Symbol) -> tuple[Pair, ...]:
    if x.op == "mul":
        left, right = x.operands
        return (Pair(left, right, False),)
    if x.op == "div":
        return (Pair(x, x.operands[1], False),)
    if x.op == "sqrt":
        return (Pair(x, x, False),)
    if x.op == "sin":
        return (Pair(x.operands[0], cos(x.operands[0]), True),)
    if x.op == "cos":
        return (Pair(x.operands[0], sin(x.operands[0]), True),)
    if x.op == "atan2":
        b, a = x.operands
        return Pair(b, a, True), Pair(a, b, True), Pair(x, square_of(x), True)
    return ()


class NoSeriesError(TypeError):
    """Raised for an operation without a Taylor series; the text names it."""


class Series:
    """The series of y from dy/dt, as two laws.

    `start`, with the arguments of dy/dt, gives the `numbers` of order 0 that the other law needs,
    and the n coefficients of order 1 of y. `order` takes the order k as its t, the coefficients of
    order k of y as its y, the `sums` and the numbers of order 0 as its p; it gives the coefficients
    of order k of the `events`, the first and then the second factors of the sums, and the
    coefficients of order k + 1 of y.

    An event must keep its sign along a step: first the `roots`, then the differences that decide
    selections; the numbers of order 0 begin with them.

    Raises NoSeriesError for operations without a series, and for a selection between numbers: a
    step.
    """

    def __init__(self, outputs: Sequence[Any]) -> None:
        self.n = len(outputs)
        nodes = in_order(outputs)
        moving = _moving(nodes)
        roots = [x for x in nodes if x.op == "sqrt" and x.number in moving]
        events = list(dict.fromkeys([*roots, *_events(nodes, moving)]))
        nodes = in_order([*outputs, *events, *companions(nodes, moving)])
        moving = _moving(nodes)
        pairs = [pair for x in nodes if x.number in moving for pair in pairs_of(x, moving)]
        laid = laid_out(dict.fromkeys(pairs), degrees(outputs, nodes, moving))
        self.events, self.roots = len(events), len(roots)
        self.sums = -(-len(laid) // LANES) * LANES
        self.terms = [
            max(one.degree for one in laid[i : i + LANES]) for i in range(0, self.sums, LANES)
        ]
        """largest number of terms of the sums of each vector."""
        orders = _Orders(laid, self.sums, moving)
        for event in events:
            orders.zero(event)
        for x in nodes:
            if x.number in moving and not isinstance(x, Condition):
                orders.add(x)
        self.order: list[Any] = orders.outputs(outputs, events)
        self.start: list[Any] = [*orders.kept, *outputs]
        self.numbers = len(orders.kept)

    @property
    def width(self) -> int:
        """Numbers of one order: coefficients of y, events, first factors, second factors."""
        return self.n + self.events + 2 * self.sums


def _moving(nodes: Iterable[Symbol]) -> set[int]:
    """Numbers of the operations that depend on t or y."""
    found: set[int] = set()
    for x in nodes:
        if x.op in INPUTS:
            depends = x.op != "p"
        else:
            depends = any(isinstance(o, Symbol) and o.number in found for o in x.operands)
        if depends:
            found.add(x.number)
    return found


def _events(nodes: Iterable[Symbol], moving: set[int]) -> Iterator[Symbol]:
    """Differences that decide selections, and arguments of absolute values.

    Without those of `rarely`: it guards a singularity, which itself limits the convergence.
    """
    for x in nodes:
        if x.op == "fabs" and x.number in moving:
            yield x.operands[0]
        elif x.op == "select" and x.operands[0].number in moving:
            for condition in in_order([x.operands[0]]):
                if condition.op in ("lt", "le") and condition.number in moving:
                    yield condition.operands[0] - condition.operands[1]


class _Orders:
    """Tracer of the law of order k, operation by operation, from its sums."""

    def __init__(self, laid: list[Convolution], sums: int, moving: set[int]) -> None:
        self._graph, self._laid, self._sums, self._moving = Graph(), laid, sums, moving
        self._numbered = {one.pair: i for i, one in enumerate(laid)}
        self.k = self._graph.input("t")
        self.share = 1.0 / self.k
        self.kept: list[Any] = []
        self._places: dict[int, int] = {}
        self._now: dict[int, Any] = {}

    def zero(self, x: Any) -> Any:
        """Coefficient of order 0."""
        if not isinstance(x, Symbol):
            return x
        if x.number not in self._places:
            self._places[x.number] = len(self.kept)
            self.kept.append(x)
        return self._graph.input("p", self._sums + self._places[x.number])

    def now(self, x: Any) -> Any:
        """Coefficient of order k; 0.0 for a constant."""
        return self._now[x.number] if isinstance(x, Symbol) and x.number in self._moving else 0.0

    def sum(self, left: Any, right: Any, derived: bool = False) -> Any:
        """S of the factors; 0.0 if one is constant."""
        place = self._numbered.get(Pair(left, right, derived))
        return 0.0 if place is None else self._graph.input("p", place)

    def y(self, index: int) -> Any:
        return self._graph.input("y", index)

    def add(self, x: Symbol) -> None:
        """Add the operation's coefficient; those of its operands must exist."""
        rule = RULES.get(x.op)
        if rule is None:
            raise NoSeriesError(f"{x.op} has no Taylor series")
        self._now[x.number] = rule(self, x, *x.operands)

    def outputs(self, slopes: Sequence[Any], events: Sequence[Symbol]) -> list[Any]:
        """Outputs of the law of order k."""
        idle = [0.0] * (self._sums - len(self._laid))
        first, second = [], []
        for one in self._laid:
            left, right = self.now(one.pair.left), self.now(one.pair.right)
            factors = (self.k * left if one.pair.derived else left, right)
            first.append(factors[one.turned])
            second.append(factors[not one.turned])
        following = 1.0 / (self.k + 1.0)
        last = [following * self.now(x) for x in slopes]
        return [*(self.now(x) for x in events), *first, *idle, *second, *idle, *last]


def _product(orders: _Orders, x: Symbol, a: Any, b: Any) -> Any:
    if a is b:
        return orders.sum(a, b) + 2.0 * orders.zero(a) * orders.now(a)
    new = orders.zero(a) * orders.now(b) + orders.now(a) * orders.zero(b)
    return orders.sum(a, b) + new


def _quotient(orders: _Orders, x: Symbol, a: Any, b: Any) -> Any:
    known = orders.now(a) - orders.sum(x, b)
    return (known - orders.zero(x) * orders.now(b)) * orders.zero(1.0 / b)


def _root(orders: _Orders, x: Symbol, a: Any) -> Any:
    return (orders.now(a) - orders.sum(x, x)) * orders.zero(0.5 / x)


def _sine(orders: _Orders, x: Symbol, a: Any) -> Any:
    other = cos(a)
    return orders.share * orders.sum(a, other, True) + orders.zero(other) * orders.now(a)


def _cosine(orders: _Orders, x: Symbol, a: Any) -> Any:
    other = sin(a)
    return -(orders.share * orders.sum(a, other, True) + orders.zero(other) * orders.now(a))


def _angle(orders: _Orders, x: Symbol, b: Any, a: Any) -> Any:
    square = square_of(x)
    known = orders.sum(b, a, True) - orders.sum(a, b, True) - orders.sum(x, square, True)
    new = orders.zero(a) * orders.now(b) - orders.zero(b) * orders.now(a)
    return (orders.share * known + new) * orders.zero(1.0 / square)


def _selected(orders: _Orders, x: Symbol, condition: Any, a: Any, b: Any) -> Any:
    holds = orders.zero(where(condition, 1.0, 0.0)) > 0.5
    return where(holds, orders.now(a), orders.now(b))


def _size(orders: _Orders, x: Symbol, a: Any) -> Any:
    return orders.zero(where(a < 0.0, -1.0, 1.0)) * orders.now(a)


def _result(orders: _Orders, x: Symbol, call: Any, index: int) -> Any:
    """0.0 for a stepwise constant function; steps end at its jumps (SHARE)."""
    function = call.operands[0]
    if function.slopes is not stepwise:
        raise NoSeriesError(f"{function.name} has no Taylor series")
    return 0.0


RULES: dict[str, Callable[..., Any]] = {
    "y": lambda orders, x, index: orders.y(index),
    "t": lambda orders, x, index: where(orders.k < 1.5, 1.0, 0.0),
    "add": lambda orders, x, a, b: orders.now(a) + orders.now(b),
    "sub": lambda orders, x, a, b: orders.now(a) - orders.now(b),
    "neg": lambda orders, x, a: -orders.now(a),
    "mul": _product,
    "div": _quotient,
    "sqrt": _root,
    "sin": _sine,
    "cos": _cosine,
    "atan2": _angle,
    "fabs": _size,
    "select": _selected,
    "rarely": _selected,
    "floor": lambda orders, x, a: 0.0,
    "call": lambda orders, x, function, *arguments: 0.0,
    "item": _result,
}
"""Recurrence of each operation: its coefficient of order k."""
