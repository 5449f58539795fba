# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a run may lose before a watch speaks, by the formulas of the bounds; and what is advised."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim.checks.check import Effort, finer_step


def adaptive(tolerance: float, steps: int) -> Effort:
    return Effort("dopri853", None, tolerance, steps)


def fixed(method: str, **more: Any) -> Effort:
    return Effort(method, 0.01, None, 100, **more)


@pytest.mark.parametrize(
    ("tolerance", "steps", "balance"),
    [(1e-12, 1, 1e-9), (1e-10, 50, 5e-8), (1e-8, 0, 1e-7), (1e-6, 10, 1e-4), (1e-6, 1000, 1e-3)],
)
def test_the_balance_of_an_adaptive_run(tolerance: float, steps: int, balance: float) -> None:
    """Ten times the tolerance in each step, but no less than 1e-9 and no more than 1e-3."""
    assert adaptive(tolerance, steps).balance == pytest.approx(balance, rel=1e-12)
    assert adaptive(tolerance, steps).outcome_bound == tolerance


def test_the_bounds_of_fixed_steps_by_the_order() -> None:
    first, higher, foreign = fixed("euler"), fixed("rk4"), fixed("heun of nobody")
    assert [e.balance for e in (first, higher, foreign)] == [2e-2, 1e-3, 1e-3]
    assert [e.bounds.local for e in (first, higher, foreign)] == [0.1, 1e-2, 1e-2]
    assert [e.bounds.grown for e in (first, higher, foreign)] == [0.5, 0.1, 0.1]
    assert higher.outcome_bound == 1e-3


def test_advice_by_what_was_set() -> None:
    """Half the figure's bound: a figure 8 times the bound asks for 16 times less, which is half a
    step of order four and a sixteenth of one of first order."""
    assert adaptive(1e-10, 1).finer_step(0.8, 0.1) is None
    assert "below 1e-10" in adaptive(1e-10, 1).advice(None)
    assert "step 0.005 s" in fixed("rk4").advice(0.005)
    assert fixed("rk4").finer_step(0.8, 0.1) == 0.005
    assert fixed("euler").finer_step(0.8, 0.1) == fixed("of nobody").finer_step(0.8, 0.1) == 5e-4


@pytest.mark.parametrize(
    ("figure", "order", "step"),
    [
        (0.1, 1, 0.05),  # at its bound: half of it
        (0.8, 1, 0.005),  # to 1/16
        (0.8, 2, 0.02),  # to 1/4
        (5.0, 1, 0.005),  # lost: as a figure of one
        (np.inf, 1, 0.005),
        (np.nan, 2, 0.02),
        (0.0, 1, 0.05),
    ],
)
def test_a_finer_step_by_the_order(figure: float, order: int, step: float) -> None:
    """A step of 0.1 s and a bound of 0.1: a figure of one asks for 1/20, or 1/4.5 of order two."""
    assert finer_step(0.1, figure, 0.1, order) == step
