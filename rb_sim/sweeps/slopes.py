# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How the outputs of a plan change with what varies, at the middle of the plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.simulation.sensitivity import TangentSimulation, changed_settings
from rb_sim.sweeps import expressions
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.trajectory.trajectory import Trajectory

# Numbers with a change along one direction, for the derivative of an output's expression.


class Dual:
    """An array and its change; numpy's arithmetic goes through both.

    value, change: arrays of one shape.
    """

    def __init__(self, value: Any, change: Any) -> None:
        self.value = np.asarray(value, dtype=float)
        self.change = np.asarray(change, dtype=float) + np.zeros(self.value.shape)

    @property
    def ndim(self) -> int:
        """Number of axes of the value."""
        return self.value.ndim

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the value, which is also that of its change."""
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


SIDE = 1e-4
"""Step of the central differences beside, of the spread of the number."""


class Slope(NamedTuple):
    """d output / d number, in their units."""

    exact: float
    """carried along the motion; NaN where that cannot be (see Slopes.why)."""
    difference: float
    """of two runs beside; NaN where one of them failed."""


class Slopes(NamedTuple):
    """The slopes of all outputs at one point."""

    point: dict[str, float]
    by_output: dict[str, dict[str, Slope]]
    why: str
    """why there are no exact ones; "" where there are."""


def slopes(runner: PlanRunner, point: Mapping[str, float], spread: Mapping[str, float]) -> Slopes:
    """Slopes of every output by every number of which a spread > 0 is given."""
    names = [name for name, width in spread.items() if width > 0.0]
    outputs = list(runner.expressions)
    smooth, why = _without_settings(runner, point, {name: spread[name] for name in names})
    exact = {}
    try:
        exact = _exact(runner, point, smooth) if smooth else {}
    except RbSimError as error:
        why = str(error)
    found: dict[str, dict[str, Slope]] = {output: {} for output in outputs}
    for name in names:
        differences = _difference(runner, point, name, SIDE * spread[name])
        for output in outputs:
            value = exact.get((output, name), float("nan"))
            found[output][name] = Slope(value, differences[output])
    return Slopes(dict(point), found, why)


def _without_settings(
    runner: PlanRunner, point: Mapping[str, float], spread: Mapping[str, float]
) -> tuple[dict[str, float], str]:
    """The numbers that leave duration, rate and method as they are, and why others are missing."""
    kept, missing = {}, []
    for name, width in spread.items():
        try:
            beside = runner.scene({**point, name: point[name] + SIDE * width})
            settings = changed_settings(runner.scene(point), beside)
        except RbSimError as error:  # a median at an end of what is allowed
            missing.append(f"{name}: {error}")
            continue
        if settings:
            missing.append(f"{name}: {settings} follows from it")
        else:
            kept[name] = width
    return kept, "; ".join(missing)


def _difference(
    runner: PlanRunner, point: Mapping[str, float], name: str, h: float
) -> dict[str, float]:
    """Central differences of all outputs; NaN where a run failed."""
    rows = [runner.run({**point, name: point[name] + side})[0] for side in (h, -h)]
    return {
        output: (rows[0][output] - rows[1][output]) / (2.0 * h) for output in runner.expressions
    }


def _exact(
    runner: PlanRunner, point: Mapping[str, float], spread: Mapping[str, float]
) -> dict[tuple[str, str], float]:
    """The derivatives carried along the motion, by output and number.

    An output that has none (the instant of a sample) is left out.
    """
    names = list(spread)

    def scene_at(x: Any) -> Any:
        return runner.scene({**point, **dict(zip(names, map(float, x), strict=True))})

    x = np.array([point[name] for name in names])
    simulation = TangentSimulation(scene_at, x, [spread[name] for name in names])
    run = simulation.run()
    plain = expressions.names(run)
    found = {}
    for name, block in zip(names, simulation.take_derivatives(), strict=True):
        duals = _paired(plain, expressions.names(Trajectory(block, run.layout)))
        duals |= {other: Dual(value, float(other == name)) for other, value in point.items()}
        for output, expression in runner.expressions.items():
            try:
                value = expression.value(duals, functions(run.t))
            except RbSimError:
                continue
            found[output, name] = float(value.change) if isinstance(value, Dual) else 0.0
    return found


def _paired(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Duals of arrays in nested mappings."""
    return {
        name: _paired(value, changes[name])
        if isinstance(value, Mapping)
        else Dual(value, changes[name])
        for name, value in values.items()
    }
