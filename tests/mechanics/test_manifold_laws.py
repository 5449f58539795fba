# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors and slips near the manifold of many bodies beside dense linear algebra: what the residual
reports, what the start of a scene is told of its lines, and the Jacobian of the rate."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.interpreted import interpreted
from tests.mechanics.test_many_body_laws import (
    INSTANT,
    compiled_state,
    dense,
    velocities_of,
)
from tests.numbers import outputs

NEAR = 1e-4
"""How far from the manifold the states are; quaternions are off their length by as much."""


def near(name: str) -> tuple[Any, np.ndarray]:
    """A compiled scene and a state near its manifold."""
    made, y = compiled_state(name, 4)
    return made, y + NEAR * np.random.default_rng(4).normal(size=len(y))


def arms(system: Any) -> np.ndarray:
    """Of each line the length [m] by which its error becomes one: angles have that of the scene."""
    from rb_sim.catalogue.constraints.rows import COUNT, LockRow, ParallelRow

    found = []
    for placed in system.constraints:
        angle = isinstance(placed.row, ParallelRow | LockRow)
        found += [system.length if angle else 1.0] * COUNT[type(placed.row)]
    return np.array(found)


def residuals(name: str, slow: bool) -> tuple[float, list[float]]:
    """The worst gap over the scene's length or slip over its speed: by hand, and as reported."""
    from rb_sim.mechanics.multibody_laws import MultiBodyLaws
    from rb_sim.mechanics.samples import row_width
    from rb_sim.mechanics.table_laws import TableLaws

    made, y = near(name)
    system = made.system._replace(length=2.0, speed=0.25 if slow else 1e3)
    of, width = dense(system, y), row_width(made.layout)
    gaps = np.abs(of.error) * of.holonomic * arms(system) / system.length
    slips = np.abs(of.rows @ velocities_of(y) - of.rate) * arms(system) / system.speed
    reported = []
    for kind in (MultiBodyLaws, TableLaws):
        law = kind(system, width, made.redundant, (), made.dependent)
        p = np.array([*law.inputs.values(system, INSTANT), 0.0])
        reported.append(float(outputs(law.sample, INSTANT, y, p, width)[-1]))
    assert (slips.max() > gaps.max()) == slow
    return float(max(gaps.max(), slips.max())), reported


@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize("name", ["tree", "loop", "rod"])
def test_the_residual_is_the_worst_violation(name: str, slow: bool) -> None:
    expected, reported = interpreted(residuals, name, slow)
    assert reported == pytest.approx([expected] * 2, rel=1e-9)


def slopes(name: str) -> tuple[np.ndarray, np.ndarray]:
    """d(dy/dt)/dy as a law and by differences."""
    from rb_sim.mechanics.multibody_laws import MultiBodyLaws

    made, y = near(name)
    law = MultiBodyLaws(made.system, 0, made.redundant, (), made.dependent)
    p, n, h = np.array([*law.inputs.values(made.system, INSTANT), 0.0]), len(y), 1e-5
    found = outputs(law.jacobian, INSTANT, y, p, n * n).reshape(n, n)
    columns = []
    for k in range(n):
        e = h * np.eye(n)[k]
        there, back = (outputs(law.rate, INSTANT, at, p, n) for at in (y + e, y - e))
        columns.append((there - back) / (2.0 * h))
    return np.array(columns).T, found


def test_the_jacobian_is_the_derivative_of_the_rate() -> None:
    expected, found = interpreted(slopes, "tree")
    assert_allclose(found, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())
