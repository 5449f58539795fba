# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The error of every method falls with the power of the step that theory says.

Measured in position, orientation, velocity and reaction, at grid points and half way between them:
the samples that the user sees have the method's full order wherever they lie.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.interpreted import interpreted
from tests.one_body_scenes import EFFECTS, JOINTS, LOAD, WEIGHT, scene

WITHIN = 0.1
FLOOR = 2e-12
"""Relative error below which the reference's own error and rounding take part."""
USED = 4
"""The slope is that of the finest steps above the floor: there it is closest to asymptotic."""
METHODS = {
    "euler": (1, 1, (400, 560, 800, 1120)),
    "rk4": (4, 1, (170, 240, 340, 480, 680)),
    "gauss6": (6, 3, (28, 34, 40, 48, 58, 70, 84, 100, 120)),
    "radau5": (5, 2, (60, 75, 94, 118, 147)),
}
"""Theoretical order, starts, and a ladder of numbers of steps."""
DRIVEN = scene(
    {"type": "fixed_point", "point_B": [0.1, -0.2, 0.3]},
    {"weight": WEIGHT, "drive": EFFECTS["harmonic wrench"]},
)
SCENES = {
    "free": (JOINTS["free"], "auto", 2.0),
    "fixed_point": (JOINTS["fixed_point"], "auto", 1.0),
    "fixed_axis": (JOINTS["fixed_axis, B floats"], "auto", 2.0),
    "rolling": (JOINTS["rolling sphere"], "auto", 1.0),
    "driven": (DRIVEN, "auto", 1.0),
    "multipliers": (JOINTS["fixed_point"], "maximal", 1.0),
}
"""Scene, coordinates, duration [s]."""
DRAGGED = JOINTS["fixed_axis, B floats"] | {
    "effects": {
        "weight": WEIGHT,
        "load": LOAD,
        "drag": EFFECTS["linear_drag"] | {"coefficient": 3.0},
    }
}
"""Without the drag phi'' depends on phi alone, and the leading term of DOP853 nearly vanishes."""
EIGHT = {
    "free": (JOINTS["free"], 1.3, 4, (75, 84, 94, 105, 117)),
    "fixed_point": (JOINTS["fixed_point"], 0.8, 2, (44, 51, 58, 67, 77)),
    "fixed_axis": (DRAGGED, 2.0, 2, (60, 69, 79, 91, 105)),
    "rolling": (JOINTS["rolling sphere"], 0.7, 4, (86, 96, 106, 118, 131)),
    "driven": (DRIVEN, 0.8, 2, (60, 70, 81, 94, 109)),
}
"""Scene, duration [s], starts, steps of dopri853 where its leading term is alone."""
EIGHT_FLOOR = 5e-18
"""Relative error below which the rounding of long doubles takes part."""
COLUMNS = ("position", "orientation", "linear_velocity", "angular_velocity", "reaction_force")


def state_at_end(mapping: Any, coordinates: str, end: float, **options: Any) -> list[np.ndarray]:
    from rb_sim import Simulation, load_scene

    mapping = mapping | {"simulation": {"project_initial": True, "duration": end} | options}
    simulation = Simulation(load_scene(mapping), coordinates=coordinates)
    simulation.advance(end)
    last = simulation.sample().block
    return [getattr(last, name)[0, 0] for name in COLUMNS if getattr(last, name).size]


def turned(mapping: Any, start: int) -> Any:
    """The scene with another initial spin for every start but 0."""
    if start == 0:
        return mapping
    w = np.random.default_rng(start).normal(size=3) * 2.2
    body = mapping["bodies"]["body"] | {"angular_velocity": w.tolist()}
    return mapping | {"bodies": {"body": body}}


def relative_errors(mapping: Any, coordinates: str, end: float, method: str, steps: Any) -> Any:
    """Relative error of each column for each step, shape (steps, columns)."""
    exact = state_at_end(mapping, "auto", end, method="dopri853", tolerance=1e-15)
    size = [max(1.0, float(np.linalg.norm(column))) for column in exact]
    found = [state_at_end(mapping, coordinates, end, method=method, step=h) for h in steps]
    return np.array(
        [
            [np.linalg.norm(a - b) / s for a, b, s in zip(run, exact, size, strict=True)]
            for run in found
        ]
    )


def ladder(
    mapping: Any, coordinates: str, end: float, method: str, steps: Any, starts: int
) -> np.ndarray:
    """Root mean square over the starts of the relative errors."""
    squares = [
        relative_errors(turned(mapping, start), coordinates, end, method, steps) ** 2
        for start in range(starts)
    ]
    return np.sqrt(np.mean(squares, axis=0))


def slope(errors: np.ndarray, steps: np.ndarray, floor: float, used: int) -> float:
    """Order measured on the finest steps whose error is above the floor."""
    above = int(np.count_nonzero(errors > floor))
    assert above >= used and np.all(errors[:above] > floor), errors
    window = slice(above - used, above)
    return float(np.polyfit(np.log(steps[window]), np.log(errors[window]), 1)[0])


PLACES = pytest.mark.parametrize("offset", [0.0, 0.5], ids=["on the grid", "between grid points"])


@PLACES
@pytest.mark.parametrize(
    ("method", "name"),
    [(method, name) for method in ("euler", "rk4", "gauss6") for name in SCENES]
    + [("radau5", "rolling"), ("radau5", "multipliers")],
)
def test_order(method: str, name: str, offset: float) -> None:
    """In every column that the method does not get exact."""
    order, starts, counts = METHODS[method]
    mapping, coordinates, end = SCENES[name]
    steps = end / (np.array(counts) + offset)
    found = ladder(mapping, coordinates, end, method, steps.tolist(), starts)
    measured = [slope(e, steps, FLOOR, USED) for e in found.T if e.max() > FLOOR]
    assert len(measured) >= 2
    assert max(abs(order - m) for m in measured) <= WITHIN, (measured, found)


def long_errors(mapping: Any, end: float, counts: list[float], starts: int) -> np.ndarray:
    """Relative errors as of `ladder`, by dopri853 in long doubles, against a run of finer steps.

    Half of the finest step leaves 1/256 of its error: 0.01 of the slope.
    """
    from rb_sim import load_scene
    from rb_sim.scene.compile import compile_scene
    from tests.extended import long_end

    options = {"simulation": {"project_initial": True}}
    squares = []
    for start in range(starts):
        compiled = compile_scene(load_scene(turned(mapping, start) | options))
        runs = [long_end(compiled, end, n) for n in (2 * max(counts), *counts)]
        exact, *found = [
            [getattr(run, name)[0, 0] for name in COLUMNS if getattr(run, name).size]
            for run in runs
        ]
        sizes = [max(1.0, size(column)) for column in exact]
        squares.append(
            [[(size(a - b) / s) ** 2 for a, b, s in zip(run, exact, sizes, strict=True)]
             for run in found]
        )  # fmt: skip
    return np.sqrt(np.mean(squares, axis=0))


def size(column: np.ndarray) -> float:
    return float(np.sqrt((column * column).sum()))


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no long doubles here")
@pytest.mark.parametrize(
    ("name", "offset"),
    [("free", 0.0), ("fixed_point", 0.5), ("fixed_axis", 0.0), ("rolling", 0.5), ("driven", 0.5)],
)
def test_order_eight(name: str, offset: float) -> None:
    """In every column that the method does not get exact, in long doubles.

    The leading term of DOP853 is small by design; in doubles the next one shows nearly down to
    round-off.
    """
    mapping, end, starts, ladder_counts = EIGHT[name]
    counts = np.array(ladder_counts) + offset
    found = interpreted(long_errors, mapping, end, counts.tolist(), starts)
    steps = end / counts
    measured = [slope(e, steps, EIGHT_FLOOR, USED) for e in found.T if e.max() > EIGHT_FLOOR]
    assert len(measured) >= 2
    assert max(abs(8 - m) for m in measured) <= WITHIN, (measured, found)
