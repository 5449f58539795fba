# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A block thrown across a slope sticks when and where the closed form says, by either kind of step.

Without `grid.longest_step` 34 of 40 such runs in steps of rk4 miss the stick."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.contact.turned_slips import case, closed_form, judged


@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("number", range(28, 40))
def test_a_slip_that_turns_aside_ends_as_the_closed_form_says(number: int, fixed: bool) -> None:
    assert judged(case(0, number, fixed))[0] == "fine"


def test_the_closed_form_of_a_slip_along_the_line_of_fall() -> None:
    """Almost straight downhill it is v / (k - a), and the way v^2 / 2 (k - a)."""
    slope, mu, v = 0.2, 0.5, 2.0
    slows = 9.81 * (mu * np.cos(slope) - np.sin(slope))
    stick, place = closed_form(slope, mu, v, 1e-7)
    assert stick == pytest.approx(v / slows)
    np.testing.assert_allclose(place, [v * v / (2.0 * slows), 0.0], rtol=1e-6, atol=1e-6)
