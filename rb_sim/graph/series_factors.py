"""The sums S(a, b) that the recurrences of a series need: their factors, and how they lie."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from rb_sim.graph.functions import cos, sin
from rb_sim.graph.symbols import Symbol

LANES = 4
"""The number of sums is rounded up to a multiple of this."""


class Pair(NamedTuple):
    """The factors of a sum S."""

    left: Symbol
    right: Symbol
    derived: bool
    """whether the left one's coefficient j counts j times."""


class Convolution(NamedTuple):
    """A sum as it is laid out: the factor of lower degree first."""

    pair: Pair
    turned: bool
    """whether the right factor comes first."""
    degree: float
    """of the first factor: its coefficients of higher order are zero."""


def laid_out(pairs: Iterable[Pair], degree: Callable[[Symbol], float]) -> list[Convolution]:
    """Sums of few terms next to each other, as four of them go through the orders together."""
    sums = []
    for pair in pairs:
        left, right = degree(pair.left), degree(pair.right)
        sums.append(Convolution(pair, right < left, min(left, right)))
    return sorted(sums, key=lambda one: one.degree)


def companions(nodes: Iterable[Symbol], moving: set[int]) -> Iterator[Symbol]:
    """What the recurrences of these operations need beside their operands."""
    for x in nodes:
        if x.number in moving:
            if x.op == "sin":
                yield cos(x.operands[0])
            elif x.op == "cos":
                yield sin(x.operands[0])
            elif x.op == "atan2":
                yield square_of(x)


def square_of(x: Symbol) -> Any:
    """r of an angle."""
    a, b = x.operands
    return a * a + b * b


def pairs_of(x: Symbol, moving: set[int]) -> Iterator[Pair]:
    """The sums of an operation; only those whose factors both move."""
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
