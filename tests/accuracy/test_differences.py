# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Measures of error between two runs."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.accuracy.choice import dividing
from rb_sim.accuracy.ladder import Reference
from rb_sim.accuracy.runs import Errors, compare, one_ulp_apart, pose_difference
from rb_sim.mechanics.samples import SampleLayout

ONE = SampleLayout(("b",), ("r",), ("b",), ())


def rows(count: int = 2) -> np.ndarray:
    out = np.zeros((count, 13 + 9 + 10))
    out[:, 6] = 1.0
    out[:, 13] = 4.0  # a force of 4 N
    out[:, 22] = 2.0  # kinetic energy of 2 J
    return out


def test_errors_are_the_largest_of_each_kind() -> None:
    other = rows()
    other[1, 0:3] = [0.0, 3e-3, 4e-3]
    other[1, 14] = 0.2
    other[1, 22] = 2.1
    assert compare(other, rows(), ONE) == pytest.approx((5e-3, 0.05, 0.05))


def test_a_run_that_ended_counts_as_infinitely_wrong() -> None:
    other = rows()
    other[1] = np.nan
    assert pose_difference(other, rows(), ONE)[1] == np.inf


def test_one_ulp_moves_every_coordinate_and_keeps_its_kind() -> None:
    random = np.random.default_rng(1)
    moved = one_ulp_apart((1.0, -3.0, 0.0), random)
    assert isinstance(moved, tuple) and all(
        a != b for a, b in zip(moved, (1.0, -3.0, 0.0), strict=True)
    )
    assert np.abs(np.array(moved) - [1.0, -3.0, 0.0]).max() <= 4.5e-16
    assert isinstance(one_ulp_apart(np.ones(3), random), np.ndarray)


def test_step_divides_the_duration() -> None:
    assert dividing(0.3, 1.0) == 0.25
    assert dividing(0.25, 1.0) == 0.25
    assert dividing(7.0, 1.0) == 1.0


def test_reactions_beside_a_jump_do_not_count_but_those_of_another_motion_do() -> None:
    """Open (0) in one run, slipping (1) in the other: at one instant of 100, or at all."""
    layout = ONE._replace(contacts=("r",))
    true = np.hstack([rows(100), np.zeros((100, 1)), np.ones((100, 1))])
    for apart, error in ((slice(50, 51), 0.0), (slice(None), 1.0)):
        other = true.copy()
        other[apart, 13] = other[apart, -1] = 0.0
        assert compare(other, true, layout).reaction == error


# What the floor of a ladder is, and what is said of it.


def of(agreement: float, grown: float, scatter: float) -> Reference:
    errors = [Errors(value, value, value) for value in (agreement, grown, scatter)]
    rows = np.zeros((1, 13))
    return Reference(rows, "one run", "another", errors[0], errors[1], 0.1, errors[2])


def test_two_runs_that_agree_by_luck_do_not_lower_the_floor() -> None:
    """Bounces too low to tell: the same run on another grid of steps changes by 4e-10."""
    true = of(1e-15, 5e-16, 4e-10)
    assert true.floor == 4e-10
    assert "errors below 4.0e-10 cannot be measured: events too close" in true.words
    assert "another agrees to 1.0e-15" in true.words


def test_rounding_and_chaos_are_named() -> None:
    assert "errors below 1.0e-12 cannot be measured (round-off)" in of(1e-12, 5e-13, 2e-13).words
    assert "cannot be measured (chaos or an instability)" in of(1e-5, 1e-5, 1e-5).words
    assert "no reference" in of(np.inf, 1e-12, 0.0).words
