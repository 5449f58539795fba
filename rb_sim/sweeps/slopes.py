"""How the outputs of a plan change with what varies, at the middle of the plan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from rb_sim.errors import RbSimError
from rb_sim.sensitivity import TangentSimulation, changed_settings
from rb_sim.sweeps import samples
from rb_sim.sweeps.dual import Dual, functions
from rb_sim.sweeps.one_run import PlanRunner
from rb_sim.trajectory import Trajectory

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
    plain = samples.names(run)
    found = {}
    for name, block in zip(names, simulation.take_derivatives(), strict=True):
        duals = _paired(plain, samples.names(Trajectory(block, run.layout)))
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
