# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Problems between lines and laws as tests write them down, and their solution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rb_sim.numerics.complementarity import (
    BOUND_WIDTH,
    CONTRADICTION,
    EQUALITY,
    FRICTION,
    NORMAL,
    UNILATERAL,
    solve,
)


class Normal(NamedTuple):
    """One normal line: pushes only, with x >= least; or holds both ways if `bilateral`."""

    line: int
    bilateral: bool = False
    least: float = 0.0


class Bounded(NamedTuple):
    """Lines whose |x| is at most bound |x_normal|; bound inf: they hold where the normal pushes."""

    lines: tuple[int, ...]
    normal: int
    bound: float


class Solution(NamedTuple):
    """x and w = A x + b."""

    x: np.ndarray
    w: np.ndarray


def residual_of(
    A: np.ndarray, b: np.ndarray, normals: Sequence[Normal], bounded: Sequence[Bounded]
) -> tuple[float, np.ndarray]:
    """(residual, x); lines in no item are equalities w = 0."""
    n = len(b)
    rules, least, x = np.full(n, EQUALITY), np.zeros(n), np.zeros(n)
    bounds, limits = np.full((len(bounded), BOUND_WIDTH), -1), np.empty(len(bounded))
    for i, bound in enumerate(bounded):
        bounds[i, : len(bound.lines)] = bound.lines
        bounds[i, NORMAL], limits[i] = bound.normal, bound.bound
        rules[list(bound.lines)] = FRICTION
    for normal in normals:
        rules[normal.line] = EQUALITY if normal.bilateral else UNILATERAL
        least[normal.line] = normal.least
    return solve(np.ascontiguousarray(A), b, b, rules, least, bounds, limits, x), x


def solved(
    A: np.ndarray, b: np.ndarray, normals: Sequence[Normal], bounded: Sequence[Bounded]
) -> Solution | None:
    """A solution, or None where none is found."""
    residual, x = residual_of(A, b, normals, bounded)
    return Solution(x, A @ x + b) if residual <= CONTRADICTION else None
