# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Methods: which suit a scene, how one is added, their coefficients, and their order."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate._ivp import dop853_coefficients as reference

from rb_sim import load_scene
from rb_sim.integrate.layout import FLOOR, SHARE_OF_WAY, WORK_ROWS
from rb_sim.integrate.methods import dopri853 as ours
from rb_sim.integrate.methods.dopri853 import E3, E5, AdaptiveDopri853, C, Dopri853, dopri853
from rb_sim.mechanics.methods import TimeStepping, build
from tests.interpreted import interpreted
from tests.one_body_scenes import EFFECTS, JOINTS, WEIGHT, scene


def test_a_method_is_asked_for_by_step_or_tolerance() -> None:
    assert build("dopri853", step=0.01, tolerance=None, largest_step=1.0) == Dopri853(0.01)
    adaptive = build("dopri853", step=None, tolerance=1e-9, largest_step=0.5)
    assert adaptive == AdaptiveDopri853(1e-9, 0.5)
    assert build("time_stepping", step=1, tolerance=None, largest_step=1.0) == TimeStepping(1.0)
    with pytest.raises(ValueError, match="method rk4 takes no tolerance"):
        build("rk4", step=None, tolerance=1e-9, largest_step=1.0)
    with pytest.raises(ValueError, match="method taylor takes no fixed step"):
        build("taylor", step=0.1, tolerance=None, largest_step=1.0)


# A method is one file and one line: Heun's is added here.


ROOT = Path(__file__).resolve().parents[2]

PROGRAM = """
from rb_sim.mechanics.methods import METHODS, MethodEntry
from tests.mechanics.heun import Heun, heun

METHODS["heun"] = MethodEntry(Heun, None, 2, "Heun's method", loop=heun)

from rb_sim import Simulation, load_scene
import math

def error(steps, coordinates):
    # x = cos 2 t on a spring without rest length
    ball = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": [1.0, 0.0, 0.0]}
    scene = {
        "bodies": {"ball": ball},
        "effects": {"spring": {"type": "spring", "body": "ball", "stiffness": 4.0}},
        "simulation": {"method": "heun", "step": 1.0 / steps, "duration": 1.0},
    }
    simulation = Simulation(load_scene(scene), coordinates=coordinates)
    simulation.advance(1.0)
    return abs(simulation.sample().position["ball"][0, 0] - math.cos(2.0))

for coordinates in ("auto", "maximal"):
    coarse, fine = error(100, coordinates), error(200, coordinates)
    print(math.log2(coarse / fine))
"""


def printed(program: str) -> list[float]:
    """The numbers that a program prints, in a process of its own."""
    environment = os.environ | {"RB_SIM_INTERPRETED": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", program]
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=ROOT, check=False
    )
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


def test_heuns_method_is_one_file_and_one_line() -> None:
    """Named by a scene, in both kinds of coordinates, it converges with its order."""
    orders = printed(PROGRAM)
    assert len(orders) == 2
    assert all(abs(order - 2.0) < 0.05 for order in orders), orders


# The coefficients of DOP853 are those of scipy's copy.


STAGES = 12


def test_same_as_scipy():
    for i, row in enumerate(ours.PUBLISHED_A):
        np.testing.assert_array_equal(row, reference.A[i, :i])
    np.testing.assert_array_equal(ours.PUBLISHED_B, reference.B)
    np.testing.assert_array_equal(ours.PUBLISHED_C, reference.C[:STAGES])
    np.testing.assert_array_equal(ours.PUBLISHED_E5, reference.E5[:STAGES])
    np.testing.assert_array_equal(ours.PUBLISHED_E3, reference.E3[:STAGES])


# A step so long that its estimates overflow is no step without an error.


STAGE = int(np.argmax(np.abs(E3) / np.maximum(np.abs(E5), 1e-30)))
"""A stage that counts in the estimate of order 3 above all."""


def errors(rate: float) -> list[float]:
    """The error of a step with this slope at that stage, as the loop and as the trace have it."""

    def at(t: float) -> Any:
        return np.float64(rate if t == C[STAGE] else 0.0)

    def law(t: float, y: Any, p: Any, out: Any) -> None:
        out[0] = at(t)

    one, work = np.ones(1), np.zeros((WORK_ROWS, 1))
    work[FLOOR] = work[SHARE_OF_WAY] = 1.0
    with np.errstate(over="ignore"):
        loop = dopri853.function(law, 0, 1, 0.0, one, 1.0, one, np.zeros(1), work.reshape(-1))
        traced: Any = dopri853.traced
        step = traced(lambda t, y: (at(t),), 0.0, (np.float64(1.0),), 1.0, (0.0,))
    return [float(loop), float(step[1])]


@pytest.mark.parametrize("scale", [E3[STAGE], E5[STAGE]], ids=["of order 3", "both"])
def test_an_overflow_is_a_large_error(scale: float) -> None:
    assert min(interpreted(errors, 2e154 / abs(scale))) > 1e9


# The error of every method falls with the power of the step that theory says.
#
# Measured in position, orientation, velocity and reaction, at grid points and half way between
# them: the samples that the user sees have the method's full order wherever they lie.


WITHIN = 0.1
FLOOR_ORDER = 2e-12
"""Relative error below which the reference's own error and rounding take part."""
USED = 4
"""The slope is that of the finest steps above the floor: there it is closest to asymptotic."""
METHODS_ORDER = {
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
COLUMNS = ("position", "orientation", "linear_velocity", "angular_velocity", "reaction_force")


def state_at_end(mapping: Any, coordinates: str, end: float, **options: Any) -> list[np.ndarray]:
    from rb_sim import Simulation

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
    order, starts, counts = METHODS_ORDER[method]
    mapping, coordinates, end = SCENES[name]
    steps = end / (np.array(counts) + offset)
    found = ladder(mapping, coordinates, end, method, steps.tolist(), starts)
    measured = [slope(e, steps, FLOOR_ORDER, USED) for e in found.T if e.max() > FLOOR_ORDER]
    assert len(measured) >= 2
    assert max(abs(order - m) for m in measured) <= WITHIN, (measured, found)
