"""Exact derivatives of a graph, as graphs again: only entries that can differ from zero.

Forward over the operations, each with its derivatives by the arguments on which it depends; the
chain rule of each operation is one line of `RULES`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from rb_sim.graph.functions import cos, maximum, sin, where
from rb_sim.graph.symbols import INPUTS, Condition, Symbol, in_order


class Sparse(NamedTuple):
    """A matrix of graphs by its entries that can differ from zero, row by row."""

    shape: tuple[int, int]
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    values: tuple[Any, ...]
    """symbols or numbers."""


def jacobian(outputs: Sequence[Any], inputs: Sequence[Symbol]) -> Sparse:
    """d outputs[i] / d inputs[j] as graphs; inputs: arguments such as `graph.vector("y", n)`.

    A selection is differentiated on the side that holds, a step (floor) has the derivative zero.
    Raises TypeError for functions called by address that do not tell their slopes.
    """
    column = {x.number: j for j, x in enumerate(inputs)}
    known: dict[int, dict[int, Any]] = {}
    for x in in_order(outputs):
        known[x.number] = _of(x, column, known)
    rows, columns, values = [], [], []
    for i, x in enumerate(outputs):
        for j, value in sorted(_derivatives(x, known).items()):
            rows.append(i)
            columns.append(j)
            values.append(value)
    return Sparse((len(outputs), len(inputs)), tuple(rows), tuple(columns), tuple(values))


def _derivatives(x: Any, known: dict[int, dict[int, Any]]) -> dict[int, Any]:
    return known[x.number] if isinstance(x, Symbol) else {}


def _of(x: Symbol, column: dict[int, int], known: dict[int, dict[int, Any]]) -> dict[int, Any]:
    """The derivatives of one operation by column, exact zeros left out."""
    if x.op in INPUTS:
        return {column[x.number]: 1.0} if x.number in column else {}
    if isinstance(x, Condition) or x.op in ("floor", "call"):
        return {}
    if x.op == "item":
        found = _of_result(x, known)
        return {j: value for j, value in found.items() if isinstance(value, Symbol) or value != 0.0}
    inner = [_derivatives(o, known) for o in x.operands]
    touched = dict.fromkeys(j for d in inner for j in d)
    if not touched:
        return {}
    rule = RULES.get(x.op)
    if rule is None:
        raise TypeError(f"no derivative of {x.op}")
    found = {j: rule(x, *x.operands, *(d.get(j, 0.0) for d in inner)) for j in touched}
    return {j: value for j, value in found.items() if isinstance(value, Symbol) or value != 0.0}


def _of_result(x: Symbol, known: dict[int, dict[int, Any]]) -> dict[int, Any]:
    """The derivatives of a result of a function called by address."""
    _, *arguments = x.operands[0].operands
    inner = [_derivatives(o, known) for o in arguments]
    found: dict[int, Any] = {}
    if not any(inner):
        return found
    for derivatives, slope in zip(inner, slopes_of(x), strict=False):
        for j, value in derivatives.items():
            found[j] = found.get(j, 0.0) + slope * value
    return found


def slopes_of(x: Symbol) -> Sequence[Any]:
    """d x / d arguments, for x a result of a function called by address; () where x is stepwise.

    Raises TypeError where they are not known.
    """
    call, result = x.operands
    function, *arguments = call.operands
    if function.slopes is None:
        raise TypeError(f"no derivative: {function.name} does not tell its slopes")
    rows = function.slopes(*arguments)
    return rows[result] if rows else ()


def _quotient(x: Any, a: Any, b: Any, da: Any, db: Any) -> Any:
    """(a / b)' = (a' - (a / b) b') / b."""
    return (da - x * db) / b


def _root(x: Any, a: Any, da: Any) -> Any:
    """(sqrt a)' = a' / (2 sqrt a), and 0 where a' is 0 as well: a length |v| has no slope at v = 0,
    but |v| v has one there, which is 0."""
    return 0.5 * da / maximum(x, sys.float_info.min)


def _angle(x: Any, y: Any, z: Any, dy: Any, dz: Any) -> Any:
    """atan2(y, z)' = (y' z - y z') / (y^2 + z^2)."""
    return (dy * z - y * dz) / (y * y + z * z)


RULES: dict[str, Callable[..., Any]] = {
    "add": lambda x, a, b, da, db: da + db,
    "sub": lambda x, a, b, da, db: da - db,
    "mul": lambda x, a, b, da, db: da * b + a * db,
    "div": _quotient,
    "neg": lambda x, a, da: -da,
    "sqrt": _root,
    "sin": lambda x, a, da: cos(a) * da,
    "cos": lambda x, a, da: -(sin(a) * da),
    "atan2": _angle,
    "fabs": lambda x, a, da: where(a < 0.0, -da, da),
    "rarely": lambda x, c, a, b, dc, da, db: where(c, da, db),
    "select": lambda x, c, a, b, dc, da, db: where(c, da, db),
}


# The derivative of a graph along a direction: one number more for every operation.
#
# Where `derivative.jacobian` gives all entries of a matrix, this gives the matrix times a vector,
# and costs about as much as the graph itself whatever the size of the matrix.


def tangent(outputs: Sequence[Any], direction: Mapping[Symbol, Any]) -> list[Any]:
    """d outputs along a direction, given by the change of each argument (absent: none).

    Selections and steps as in `derivative.jacobian`.
    Raises TypeError for functions called by address that do not tell their slopes.
    """
    changes = {x.number: change for x, change in direction.items()}
    known: dict[int, Any] = {}
    for x in in_order(outputs):
        known[x.number] = _change_of(x, changes, known)
    return [known[x.number] if isinstance(x, Symbol) else 0.0 for x in outputs]


def _change_of(x: Symbol, changes: Mapping[int, Any], known: Mapping[int, Any]) -> Any:
    """The change of one operation."""
    if x.op in INPUTS:
        return changes.get(x.number, 0.0)
    if isinstance(x, Condition) or x.op in ("floor", "call"):
        return 0.0
    if x.op == "item":
        return _change_of_result(x, known)
    inner = [known[o.number] if isinstance(o, Symbol) else 0.0 for o in x.operands]
    if all(_is_zero(change) for change in inner):
        return 0.0
    rule = RULES.get(x.op)
    if rule is None:
        raise TypeError(f"no derivative of {x.op}")
    return rule(x, *x.operands, *inner)


def _change_of_result(x: Symbol, known: Mapping[int, Any]) -> Any:
    """The change of a result of a function called by address."""
    call, result = x.operands
    function, *arguments = call.operands
    changes = [known[o.number] if isinstance(o, Symbol) else 0.0 for o in arguments]
    if all(_is_zero(change) for change in changes):
        return 0.0
    if function.along is not None:
        return function.along(*arguments, *changes)[result]
    terms = [slope * change for slope, change in zip(slopes_of(x), changes, strict=False)]
    return sum(terms[1:], terms[0]) if terms else 0.0


def _is_zero(x: Any) -> bool:
    return not isinstance(x, Symbol) and x == 0.0
