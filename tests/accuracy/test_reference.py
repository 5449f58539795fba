# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the floor of a ladder is, and what is said of it."""

from __future__ import annotations

import numpy as np

from rb_sim.accuracy.differences import Errors
from rb_sim.accuracy.ladder import Reference


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
