# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The way back to the manifold of many bodies, law by law, beside dense linear algebra.

Errors and slips, one step of Newton's iteration, the nearest velocities, and what the start of a
scene is told of its lines: in numbers, traced and over tables, at states near the manifold.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg.lapack import dpstrf
from scipy.spatial.transform import Rotation

from tests.interpreted import interpreted
from tests.mechanics.test_many_body_laws import (
    INSTANT,
    compiled_state,
    dense,
    solution,
    velocities_of,
)
from tests.mechanics.test_tables import outputs

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


def displaced(y: np.ndarray, push: np.ndarray) -> np.ndarray:
    """The places shifted, and the attitudes turned about axes of the bodies, by a little."""
    found, push = y.copy().reshape(-1, 13), push.reshape(-1, 6)
    found[:, :3] += push[:, :3]
    for own, turn in zip(found, push[:, 3:], strict=True):
        q = own[3:7]
        w = np.array([*turn, 0.0])
        change = 0.5 * np.array(
            [*(q[3] * w[:3] + np.cross(q[:3], w[:3])), -float(q[:3] @ w[:3])],
        )
        own[3:7] = (q + change) / np.linalg.norm(q + change)
    return found.ravel()


def arms(system: Any) -> np.ndarray:
    """Of each line the length [m] by which its error becomes one: angles have that of the scene."""
    from rb_sim.catalogue.constraints.rows import COUNT, LockRow, ParallelRow

    found = []
    for placed in system.constraints:
        angle = isinstance(placed.row, ParallelRow | LockRow)
        found += [system.length if angle else 1.0] * COUNT[type(placed.row)]
    return np.array(found)


def by_laws(name: str) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """(what, expected, found)."""
    from rb_sim.mechanics.multibody_laws import MultiBodyLaws
    from rb_sim.mechanics.tables.table_laws import TableLaws

    made, off = near(name)
    system, y = made.system, with_units(off)
    of, n = dense(system, y), len(off)
    held, still = of.holonomic == 1.0, np.zeros(6 * (n // 13))
    of_positions = of._replace(rows=of.rows[held])
    push, _ = solution(of_positions, -of.error[held], still)
    faster, _ = solution(of, of.rate, of.mass @ velocities_of(y))
    worst = np.abs(of.error * of.holonomic * arms(system)).max()
    found = []
    for kind in (MultiBodyLaws, TableLaws):
        law = kind(system, 0, made.redundant, (), made.dependent)
        p = np.array([*law.inputs.values(system, INSTANT), 0.0])
        for what, at, count, expected in (
            ("settle", off, n, y),
            ("gap", y, 1, np.array([worst])),
            ("position", y, n, displaced(y, push)),
            ("velocity", y, n, np.hstack([y.reshape(-1, 13)[:, :7], faster.reshape(-1, 6)])),
        ):
            told = outputs(getattr(law, what), INSTANT, at, p, count)
            found.append((f"{kind.__name__}.{what}", expected.ravel(), told))
    return found


@pytest.mark.parametrize("name", ["tree", "spare line", "cross", "rod", "two stars"])
def test_each_law_of_the_way_back(name: str) -> None:
    """Not of a loop, whose spare lines contradict the others where it is off the manifold."""
    for what, expected, found in interpreted(by_laws, name):
        assert_allclose(found, expected, rtol=0.0, atol=1e-11, err_msg=what)


def residuals(name: str, slow: bool) -> tuple[float, list[float]]:
    """The worst gap over the scene's length or slip over its speed: by hand, and as reported."""
    from rb_sim.mechanics.multibody_laws import MultiBodyLaws
    from rb_sim.mechanics.samples import row_width
    from rb_sim.mechanics.tables.table_laws import TableLaws

    made, y = near(name)
    system = made.system._replace(length=2.0, speed=0.25 if slow else 1e3)
    of, width = dense(system, y), row_width(made.layout)
    gaps = np.abs(of.error) * of.holonomic * arms(system) / system.length
    slips = np.abs(of.rows @ velocities_of(y) - of.rate) * arms(system) / system.speed
    told = []
    for kind in (MultiBodyLaws, TableLaws):
        law = kind(system, width, made.redundant, (), made.dependent)
        p = np.array([*law.inputs.values(system, INSTANT), 0.0])
        told.append(float(outputs(law.sample, INSTANT, y, p, width)[-1]))
    assert (slips.max() > gaps.max()) == slow
    return float(max(gaps.max(), slips.max())), told


@pytest.mark.parametrize("slow", [False, True])
@pytest.mark.parametrize("name", ["tree", "loop", "rod"])
def test_the_residual_is_the_worst_violation(name: str, slow: bool) -> None:
    expected, told = interpreted(residuals, name, slow)
    assert told == pytest.approx([expected] * 2, rel=1e-9)


def both_ways(name: str) -> list[tuple[str, float, float]]:
    """(law, residual of the state that `back` and that the loops' way give, gap reported)."""
    from rb_sim.mechanics.multibody_laws import MultiBodyLaws
    from rb_sim.mechanics.tables.table_laws import TableLaws

    made, y = near(name)
    of = dense(made.system, with_units(y))
    worst, found = float(np.abs(of.error * arms(made.system)).max()), []
    for kind in (MultiBodyLaws, TableLaws):
        law = kind(made.system, 0, made.redundant, (), made.dependent)
        p = np.array([*law.inputs.values(made.system, INSTANT), 0.0])
        *moved, gap = outputs(law.back, INSTANT, y, p, len(y) + 1)
        after = dense(made.system, np.array(moved))
        slip = np.abs(after.rows @ velocities_of(np.array(moved)) - after.rate).max()
        found += [(f"{kind.__name__} error", 0.0, float(np.abs(after.error).max()))]
        found += [(f"{kind.__name__} slip", 0.0, float(slip)), (kind.__name__, worst, gap)]
    return found


@pytest.mark.parametrize("name", ["spare line", "loop", "cross", "rod", "two stars"])
def test_one_step_back_leaves_what_is_of_second_order(name: str) -> None:
    """Places by Newton's step, and velocities with the factors of the place before."""
    for what, expected, found in interpreted(both_ways, name):
        close = 1e-12 if expected else 100.0 * NEAR**2
        assert abs(found - expected) <= close, what


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


def rod_off(by: float) -> tuple[float, float]:
    """Of one rod that is too long by so much: its error before and after."""
    from rb_sim.mechanics.initial_projection import start_on_manifold

    made, y = compiled_state("rod", 4)
    of = dense(made.system, y)
    along = of.rows[0] @ of.rows[0]
    y = displaced(y, by * of.rows[0] / along)
    before, after, rank = start_on_manifold(made.system, INSTANT, y)
    assert rank == 1
    assert abs(dense(made.system, y).error[0]) < 1e-14
    return before[0, 0], after[0, 0]


@pytest.mark.parametrize("by", [1e-3, -1e-3])
def test_errors_of_either_sign_are_taken_away(by: float) -> None:
    before, after = interpreted(rod_off, by)
    assert before == pytest.approx(1e-3, rel=1e-2)
    assert after < 1e-14


def chosen(name: str) -> tuple[list[int], np.ndarray, np.ndarray]:
    """(lines that are chosen among, their scaled A, what the law chooses)."""
    from rb_sim.mechanics.initial_projection import changing_in
    from rb_sim.mechanics.multibody_laws import MultiBodyLaws

    made, y = compiled_state(name, 4)
    rows = changing_in(made.system, made.dependent)
    law = MultiBodyLaws(made.system, 0, made.redundant, (), made.dependent, rows)
    p = np.array([*law.inputs.values(made.system, INSTANT), 0.0])
    found = outputs(law.choice, INSTANT, y, p, len(rows) + 2)
    of = dense(made.system, y)
    A = (of.rows @ np.linalg.inv(of.mass) @ of.rows.T)[np.ix_(rows, rows)]
    sizes = np.sqrt(np.diag(A))
    return rows, A / np.outer(sizes, sizes), found


def test_the_lines_that_a_loop_chooses_are_independent_and_as_many_as_the_rank() -> None:
    """In turn the largest pivot: the least of them is that of the last line chosen."""
    rows, scaled, found = interpreted(chosen, "loop")
    take = np.flatnonzero(found[:-2])
    rank = np.linalg.matrix_rank(scaled, tol=1e-8)
    assert 0 < rank < len(rows) and len(take) == rank
    last = int(found[-1])
    assert last in take
    before = [k for k in take if k != last]
    A, b = scaled[np.ix_(before, before)], scaled[before, last]
    assert found[-2] == pytest.approx(1.0 - b @ np.linalg.solve(A, b), rel=1e-6)
    factors, order, _, _ = dpstrf(scaled, lower=1, tol=1e-10)
    assert found[-2] == pytest.approx(factors[rank - 1, rank - 1] ** 2, rel=1e-5)


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


def test_turned_is_what_a_small_push_turns() -> None:
    """`displaced` beside SciPy: to the third order of the turn."""
    rng = np.random.default_rng(1)
    y, push = with_units(rng.normal(size=13)), 1e-4 * rng.normal(size=6)
    turn = Rotation.from_quat(y[3:7]) * Rotation.from_rotvec(push[3:])
    found = Rotation.from_quat(displaced(y, push)[3:7])
    assert (turn.inv() * found).magnitude() < 1e-12
