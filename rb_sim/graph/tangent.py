"""The derivative of a graph along a direction: one number more for every operation.

Where `derivative.jacobian` gives all entries of a matrix, this gives the matrix times a vector, and
costs about as much as the graph itself whatever the size of the matrix.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rb_sim.graph.derivative import RULES, slopes_of
from rb_sim.graph.symbols import INPUTS, Condition, Symbol, in_order


def tangent(outputs: Sequence[Any], direction: Mapping[Symbol, Any]) -> list[Any]:
    """d outputs along a direction, given by the change of each argument (absent: none).

    Selections and steps as in `derivative.jacobian`.
    Raises TypeError for functions called by address that do not tell their slopes.
    """
    changes = {x.number: change for x, change in direction.items()}
    known: dict[int, Any] = {}
    for x in in_order(outputs):
        known[x.number] = _of(x, changes, known)
    return [known[x.number] if isinstance(x, Symbol) else 0.0 for x in outputs]


def _of(x: Symbol, changes: Mapping[int, Any], known: Mapping[int, Any]) -> Any:
    """The change of one operation."""
    if x.op in INPUTS:
        return changes.get(x.number, 0.0)
    if isinstance(x, Condition) or x.op in ("floor", "call"):
        return 0.0
    if x.op == "item":
        return _of_result(x, known)
    inner = [known[o.number] if isinstance(o, Symbol) else 0.0 for o in x.operands]
    if all(_is_zero(change) for change in inner):
        return 0.0
    rule = RULES.get(x.op)
    if rule is None:
        raise TypeError(f"no derivative of {x.op}")
    return rule(x, *x.operands, *inner)


def _of_result(x: Symbol, known: Mapping[int, Any]) -> Any:
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
