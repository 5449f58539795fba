# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""When Newton's iteration on the positions ends, whoever has the lines."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from rb_sim.integrate.attempt import (
    LOST,
    NEAR,
    POSITION_SWEEPS,
    correct_positions,
    position_error,
    return_to_positions,
)
from rb_sim.numerics.kernels import entry


class Root(NamedTuple):
    """The line y^2 = 2, whose corrections are `share` of Newton's."""

    share: Any
    count: Any
    """of measurements and of corrections."""


@position_error.register(Root)
def error_of_root(way, t, y):
    way.count[0] += 1.0
    return abs(y[0] * y[0] - 2.0), 1


@correct_positions.register(Root)
def correct_root(way, t, y, lines):
    way.count[1] += 1.0
    y[0] -= way.share * (y[0] * y[0] - 2.0) / (2.0 * y[0])


def returned(share: float, start: float, near: float = 0.0) -> tuple[float, bool, float, list]:
    """(error met last, whether of y, y, counts)."""
    y, count = np.array([start]), np.zeros(2)
    worst, current = return_to_positions(Root(share, count), 0.0, y, 1.0, near)
    return worst, current, float(y[0]), count.tolist()


def test_it_comes_to_round_off_and_tells_the_error_where_it_is() -> None:
    worst, current, y, (measured, corrected) = returned(1.0, 1.5)
    assert y == pytest.approx(math.sqrt(2.0), abs=3e-16)
    assert current and worst == abs(y * y - 2.0)
    assert measured == corrected + 1 <= POSITION_SWEEPS


def test_from_near_by_one_step_is_the_last_and_its_error_is_not_measured() -> None:
    worst, current, y, counts = returned(1.0, math.sqrt(2.0) + 0.3 * NEAR, NEAR)
    assert 0.0 < worst <= NEAR and not current
    assert counts == [1.0, 1.0]
    assert y == pytest.approx(math.sqrt(2.0), abs=3e-16)


def test_it_ends_where_a_step_gains_nothing() -> None:
    worst, current, _, (measured, corrected) = returned(2.5, 1.5)  # overshoots, further each time
    assert current and worst > 0.0
    assert (measured, corrected) == (2.0, 1.0)


def test_it_ends_at_once_where_nothing_is_a_number() -> None:
    worst, _, _, counts = returned(1.0, math.nan)
    assert math.isnan(worst) and not worst <= LOST
    assert counts == [1.0, 0.0]


@entry
def returned_by_code(share, y, count):
    worst, current = return_to_positions(Root(share, count), 0.0, y, 1.0, 0.0)
    return worst if current else -worst


@pytest.mark.parametrize(("share", "start"), [(1.0, 1.5), (0.1, 1.5), (2.5, 1.5)])
def test_compiled_it_is_the_same(share: float, start: float) -> None:
    y, count = np.array([start]), np.zeros(2)
    signed = returned_by_code(share, y, count)
    worst, current, at, counts = returned(share, start)
    assert (signed, float(y[0]), count.tolist()) == (worst if current else -worst, at, counts)
