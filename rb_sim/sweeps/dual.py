"""Numbers with a change along one direction, for the derivative of an output's expression."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np


class Dual:
    """An array and its change; numpy's arithmetic goes through both.

    value, change: arrays of one shape.
    """

    def __init__(self, value: Any, change: Any) -> None:
        self.value = np.asarray(value, dtype=float)
        self.change = np.asarray(change, dtype=float) + np.zeros(self.value.shape)

    @property
    def ndim(self) -> int:
        return self.value.ndim

    @property
    def shape(self) -> tuple[int, ...]:
        return self.value.shape

    def __getitem__(self, index: Any) -> Dual:
        return Dual(self.value[index], self.change[index])

    def together(self, elements: list[Any]) -> Dual:
        """A vector of these components."""
        duals = [_dual(x) for x in elements]
        parts = ([x.value for x in duals], [x.change for x in duals])
        return Dual(*(np.stack(np.broadcast_arrays(*part), axis=-1) for part in parts))

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **_: Any) -> Any:
        values = [x.value if isinstance(x, Dual) else x for x in inputs]
        if method != "__call__":
            return NotImplemented
        value = ufunc(*values)
        if np.asarray(value).dtype == bool:
            return value
        if ufunc not in RULES:
            return NotImplemented
        changes = [x.change if isinstance(x, Dual) else 0.0 for x in inputs]
        return Dual(value, RULES[ufunc](value, *values, *changes))


def _power(v: Any, a: Any, b: Any, da: Any, db: Any) -> Any:
    """(a^b)' = b a^(b-1) a' + a^b log(a) b', the last only where b changes."""
    change = b * np.power(a, b - 1.0) * da
    return change + v * np.log(a) * db if np.any(db) else change


RULES: dict[Any, Callable[..., Any]] = {
    np.add: lambda v, a, b, da, db: da + db,
    np.subtract: lambda v, a, b, da, db: da - db,
    np.multiply: lambda v, a, b, da, db: da * b + a * db,
    np.divide: lambda v, a, b, da, db: (da - v * db) / b,
    np.power: _power,
    np.remainder: lambda v, a, b, da, db: da - np.floor_divide(a, b) * db,
    np.negative: lambda v, a, da: -da,
    np.square: lambda v, a, da: 2.0 * a * da,
    np.sqrt: lambda v, a, da: 0.5 * da / v,
    np.absolute: lambda v, a, da: np.sign(a) * da,
    np.sign: lambda v, a, da: 0.0 * da,
    np.exp: lambda v, a, da: v * da,
    np.log: lambda v, a, da: da / a,
    np.sin: lambda v, a, da: np.cos(a) * da,
    np.cos: lambda v, a, da: -np.sin(a) * da,
    np.tan: lambda v, a, da: (1.0 + v * v) * da,
    np.arcsin: lambda v, a, da: da / np.sqrt(1.0 - a * a),
    np.arccos: lambda v, a, da: -da / np.sqrt(1.0 - a * a),
    np.arctan2: lambda v, a, b, da, db: (da * b - a * db) / (a * a + b * b),
}
"""The chain rule of each function: (its value, arguments ..., their changes ...)."""


def _dual(x: Any) -> Dual:
    return x if isinstance(x, Dual) else Dual(x, 0.0)


def _picked(which: Callable[[Any], Any]) -> Callable[[Any], Dual]:
    """The least or largest entry: its change is the change of the entry that it is."""

    def pick(x: Any) -> Dual:
        x = _dual(x)
        i = int(which(x.value))
        return Dual(x.value.flat[i], x.change.flat[i])

    return pick


def _mean(x: Any) -> Dual:
    x = _dual(x)
    return Dual(np.mean(x.value), np.mean(x.change))


def _std(x: Any) -> Dual:
    x = _dual(x)
    std = np.std(x.value)
    return Dual(std, np.mean((x.value - np.mean(x.value)) * x.change) / std)


def _norm(x: Any) -> Dual:
    x = _dual(x)
    size = np.sqrt(np.sum(np.square(x.value), axis=-1))
    return Dual(size, np.sum(x.value * x.change, axis=-1) / size)


def _sum(x: Any) -> Dual:
    x = _dual(x)
    return Dual(np.sum(x.value), np.sum(x.change))


def _where(condition: Any, a: Any, b: Any) -> Dual:
    a, b = _dual(a), _dual(b)
    return Dual(np.where(condition, a.value, b.value), np.where(condition, a.change, b.change))


def _truth(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda x: function(x.value if isinstance(x, Dual) else x)


def _no_derivative(*_: Any) -> Any:
    raise ValueError("an instant of a sample or an event has no derivative here")


def functions(t: np.ndarray) -> dict[str, Callable[..., Any]]:
    """The functions of expressions that are not numpy's arithmetic, on duals over the times t."""

    def integral(x: Any) -> Dual:
        x, steps = _dual(x), np.diff(t)
        halves = [np.sum(0.5 * (part[1:] + part[:-1]) * steps) for part in (x.value, x.change)]
        return Dual(*halves)

    return {
        "min": _picked(np.argmin),
        "max": _picked(np.argmax),
        "mean": _mean,
        "std": _std,
        "rms": lambda x: np.sqrt(_mean(np.square(_dual(x)))),
        "first": lambda x: _dual(x)[0],
        "last": lambda x: _dual(x)[-1],
        "norm": _norm,
        "any": _truth(np.any),
        "all": _truth(np.all),
        "where": _where,
        "sum": _sum,
        "integral": integral,
        "time_of": _no_derivative,
        "event_time": _no_derivative,
        "event_count": _no_derivative,
    }
