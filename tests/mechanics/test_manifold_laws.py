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
HELD = ("tree", "spare line", "loop", "double", "cranks", "rod")


def near(name: str) -> tuple[Any, np.ndarray]:
    """A compiled scene and a state near its manifold."""
    made, y = compiled_state(name, 4)
    return made, y + NEAR * np.random.default_rng(4).normal(size=len(y))


def with_units(y: np.ndarray) -> np.ndarray:
    found = y.copy().reshape(-1, 13)
    found[:, 3:7] /= np.linalg.norm(found[:, 3:7], axis=1)[:, None]
    return found.ravel()


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


def at_start(name: str) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """(what, expected, found) of errors, rank and lines that depend on others."""
    from rb_sim.mechanics.initial_projection import (
        dependent_rows,
        relative,
        rows_matrix,
        start_on_manifold,
    )

    made, y = near(name)
    y = with_units(y)
    system, of, moved = made.system, dense(made.system, y), y.copy()
    before, after, rank = start_on_manifold(system, INSTANT, moved)
    slips = np.abs(of.rows @ velocities_of(y) - of.rate)
    A = of.rows @ np.linalg.inv(of.mass) @ of.rows.T
    expected_rank = int(np.linalg.matrix_rank(dense(system, moved).rows, tol=1e-7))
    two = system._replace(length=2.0)
    scaled = np.array([np.abs(of.error) * arms(two) / 2.0, slips * arms(two) / 3.0])
    found = [
        ("gaps", np.abs(of.error), before[0]),
        ("slips", slips, before[1]),
        ("after", np.zeros_like(after), after),
        ("rank", np.array(expected_rank), np.array(rank)),
        ("matrix", A, rows_matrix(system, INSTANT, y)),
        ("relative", scaled, relative(two, before, 2.0, 3.0)),
    ]
    left_out = dependent_rows(system, moved)
    kept = [k for k in range(len(of.error)) if k not in left_out.rows]
    kept_rank = np.linalg.matrix_rank(dense(system, moved).rows[kept], tol=1e-7)
    found.append(("independent", np.array(len(kept)), np.array(kept_rank)))
    found.append(("of them all", np.array(expected_rank), np.array(len(kept))))
    return found


@pytest.mark.parametrize("name", HELD)
def test_what_the_start_is_told_of_its_lines(name: str) -> None:
    for what, expected, own in interpreted(at_start, name):
        size = 1.0 + float(np.abs(expected).max())
        assert_allclose(own, expected, rtol=0.0, atol=1e-12 * size, err_msg=what)


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
