# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Derivatives of the outputs of a plan with respect to the varied numbers, at its medians."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.simulation.sensitivity import TangentSimulation, changed_settings
from rb_sim.simulation.trajectory import Trajectory
from rb_sim.sweeps import expressions
from rb_sim.sweeps.expressions import Expression
from rb_sim.sweeps.one_run import PlanRunner

Long = np.longdouble

SIDE = 1e-4
"""Step of the central differences, relative to the spread of the number."""
LEAST_SIDE = 1e-6
"""Step along the derivative of the samples, relative to the spread of the number: in extended
precision the difference of an expression then gives its derivative to twelve digits."""


class Slope(NamedTuple):
    """d output / d number, in their units."""

    exact: float
    """by integrated sensitivities; NaN if not available (see Slopes.why)."""
    difference: float
    """central difference of two runs; NaN if one of them failed."""

    def texts(self) -> tuple[str, ...]:
        """The exact derivative and the difference; "not known" instead of NaN."""
        return tuple("not known" if math.isnan(of) else f"{of:.9g}" for of in self)


class Slopes(NamedTuple):
    """Derivatives of all outputs at one point."""

    point: dict[str, float]
    by_output: dict[str, dict[str, Slope]]
    why: str
    """why there are no exact derivatives; "" if there are."""


def slopes(runner: PlanRunner, point: Mapping[str, float], spread: Mapping[str, float]) -> Slopes:
    """Derivatives of every output by every number with a spread > 0."""
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
    """Numbers that do not affect duration, rate and method; and why others are excluded."""
    kept, missing = {}, []
    for name, width in spread.items():
        try:
            beside = runner.scene({**point, name: point[name] + SIDE * width})
            settings = changed_settings(runner.scene(point), beside)
        except RbSimError as error:  # the median is at a limit of the allowed range
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
    """Central differences of all outputs; NaN if a run failed."""
    rows = [runner.run({**point, name: point[name] + side})[0] for side in (h, -h)]
    return {
        output: (rows[0][output] - rows[1][output]) / (2.0 * h) for output in runner.expressions
    }


def _exact(
    runner: PlanRunner, point: Mapping[str, float], spread: Mapping[str, float]
) -> dict[tuple[str, str], float]:
    """Derivatives by integrated sensitivities, by output and number.

    Outputs without a derivative (e.g. the time of a sample) are omitted.
    """
    names = list(spread)

    def scene_at(x: Any) -> Any:
        return runner.scene({**point, **dict(zip(names, map(float, x), strict=True))})

    x = np.array([point[name] for name in names])
    simulation = TangentSimulation(scene_at, x, [spread[name] for name in names])
    run = simulation.run()
    values = {**expressions.names(run), **point}
    found = {}
    for name, block in zip(names, simulation.take_derivatives(), strict=True):
        changes = expressions.names(Trajectory(block, run.layout))
        changes |= {other: float(other == name) for other in point}
        h = LEAST_SIDE * spread[name]
        for output, expression in runner.expressions.items():
            with suppress(RbSimError):
                found[output, name] = change_of(expression, values, changes, run, h)
    return found


def change_of(
    expression: Expression,
    values: Mapping[str, Any],
    changes: Mapping[str, Any],
    run: Trajectory,
    h: float,
) -> float:
    """Derivative of an expression along `changes` of its input values.

    h: step of the central difference. Raises RbSimError for expressions of instants.
    """
    functions = expressions.functions(run) | dict.fromkeys(INSTANTS, _no_derivative)
    high, low = (expression.value(_moved(values, changes, s), functions) for s in (h, -h))
    return float((Long(high) - Long(low)) / (2.0 * Long(h)))


INSTANTS = ("time_of", "event_time", "event_count")


def _no_derivative(*_: Any) -> Any:
    raise ValueError("an instant of a sample or an event has no derivative here")


def _moved(values: Mapping[str, Any], changes: Mapping[str, Any], s: float) -> dict[str, Any]:
    """values + s changes for arrays in nested mappings, in extended precision."""
    return {
        name: _moved(value, changes[name], s)
        if isinstance(value, Mapping)
        else np.asarray(value, Long) + Long(s) * np.asarray(changes[name], Long)
        for name, value in values.items()
    }
