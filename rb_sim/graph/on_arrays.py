"""A graph evaluated on arrays: the same operations, for many instants at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rb_sim.graph.symbols import INPUTS, Symbol, in_order

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
