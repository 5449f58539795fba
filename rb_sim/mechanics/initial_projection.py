# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Projection of the start of N bodies onto the constraint manifold, by elimination on numbers.

It runs once, as plain Python, at a cost that grows with the nonzero entries only.
"""

from __future__ import annotations

import math

import numpy as np

from rb_sim.catalogue.constraints.rows import ERROR, HOLONOMIC, RATE
from rb_sim.integrate.attempt import LOST, correct_positions, position_error, return_to_positions
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.systems.elimination import (
    Dependent,
    changing_rows,
    dense_matrix,
    factored,
    hasten,
    with_object_tables,
)
from rb_sim.mechanics.systems.many_bodies import MULTIPLIERS, MultiBody, arms
from rb_sim.mechanics.systems.multibody import (
    add_multipliers,
    clear_response,
    move_by_response,
    row_velocity,
    write_rows,
)


def relative(system: MultiBody, violations: np.ndarray, length: float, speed: float) -> np.ndarray:
    """|g| and |G u - b| of each row, (2, n), relative to the scene's length [m] and speed [m/s]."""
    arm = np.array(arms([c.row for c in system.constraints], length))
    return violations * arm / np.array([[length], [speed]])


class Manifold:
    """The constraint rows of a system, evaluated for states given as numbers."""

    def __init__(self, system: MultiBody) -> None:
        self.system = with_object_tables(system)
        self.laws = MultiBodyLaws(system, 0, redundant=False)
        self.n = system.row_table.shape[0]
        self.arms = arms([c.row for c in system.constraints], system.length)

    def violations(self, t: float, y: list[float]) -> tuple[np.ndarray, int]:
        """|g| and |G u - b| of each row at (t, y), shape (2, n), and the rank of G."""
        system = self.system
        write_rows(system, t, y)
        found = np.zeros((2, self.n))
        for k in range(self.n):
            found[0, k] = abs(system.rows[k, ERROR]) * system.rows[k, HOLONOMIC]
            found[1, k] = abs(row_velocity(system, y, k) - system.rows[k, RATE])
        return found, int(factored(system, self.laws.order).rank)

    def project(self, t: float, y: list[float]) -> None:
        """Normalise quaternions and project y onto the manifold, in place; NaN if that fails."""
        clear_response(self.system)
        move_by_response(self.system, y)
        if not self.n:
            return
        length = self.system.length
        if not return_to_positions(self, t, y, length, 0.0)[0] <= LOST * length:
            y[0] = math.nan
        write_rows(self.system, t, y)
        rows = self.system.rows
        self.response({k: rows[k, RATE] - row_velocity(self.system, y, k) for k in self.laws.order})
        hasten(self.system, y)

    def response(self, right: dict[int, float]) -> None:
        """response = M^-1 G^T lambda, with lambda for these right sides by row."""
        system = self.system
        found = factored(system, list(right)).solve(right)
        for k in range(self.n):
            system.vectors[MULTIPLIERS, k] = found.get(k, 0.0)
        clear_response(system)
        add_multipliers(system)


@position_error.register(Manifold)
def error_on_numbers(way: Manifold, t: float, y: list[float]) -> tuple[float, list[int]]:
    """(largest error of the holonomic rows that are eliminated [m], indices of these rows)."""
    rows = way.system.rows
    write_rows(way.system, t, y)
    held = [k for k in way.laws.order if rows[k, HOLONOMIC]]
    return max((abs(rows[k, ERROR]) * way.arms[k] for k in held), default=0.0), held


@correct_positions.register(Manifold)
def correct_on_numbers(way: Manifold, t: float, y: list[float], held: list[int]) -> None:
    """Displace the bodies by the correction of these rows' errors."""
    way.response({k: -way.system.rows[k, ERROR] for k in held})
    move_by_response(way.system, y)


def start_on_manifold(
    system: MultiBody, t: float, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Violations of the rows at (t, y); then y is projected onto the manifold in place.

    Returns |g| and |G u - b| of each row before and after, each of shape (2, n), and the rank of G
    after.
    """
    manifold, at = Manifold(system), y.tolist()
    before, _ = manifold.violations(t, at)
    manifold.project(t, at)
    y[:] = at
    after, rank = manifold.violations(t, at)
    return before, after, rank


def rows_matrix(system: MultiBody, t: float, y: np.ndarray) -> np.ndarray:
    """A = G M^-1 G^T at (t, y), (n, n)."""
    made = with_object_tables(system)
    write_rows(made, t, y.tolist())
    return dense_matrix(made, range(system.row_table.shape[0]))


def dependent_rows(system: MultiBody, y: np.ndarray) -> Dependent:
    """The rows that depend on other rows at y, a state on the manifold."""
    manifold = Manifold(system)
    write_rows(manifold.system, 0.0, y.tolist())
    order = manifold.laws.order
    placed = [k for k in order if manifold.laws.holonomic[k]]
    left_out = (
        frozenset(some) - frozenset(factored(manifold.system, some).kept)
        for some in (order, placed)
    )
    return Dependent(*left_out)


def changing_in(system: MultiBody, dependent: Dependent) -> list[int]:
    """Rows in loops whose choice is repeated during the motion (see `changing_rows`)."""
    if not dependent.rows:
        return []
    return changing_rows(system, dependent, MultiBodyLaws(system, 0, redundant=True).holonomic)
