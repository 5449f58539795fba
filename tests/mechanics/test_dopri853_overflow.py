# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A step so long that its estimates overflow is no step without an error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim.integrate.layout import FLOOR, SHARE_OF_WAY, WORK_ROWS
from rb_sim.integrate.methods.dopri853 import E3, E5, C, dopri853
from tests.interpreted import interpreted

QUOTIENTS = np.abs(E3) / np.maximum(np.abs(E5), 1e-30)
MOST = int(np.argmax(QUOTIENTS))
LEAST = int(np.argmin(np.where(E3 == 0.0, np.inf, QUOTIENTS)))
CASES = {
    "of order 3": (MOST, 2e154 / abs(E3[MOST])),
    "of order 5": (LEAST, 2e154 / abs(E5[LEAST])),
    "both": (MOST, 2e154 / abs(E5[MOST])),
}
"""A stage and its slope, so large that the square of this estimate overflows."""


def errors(stage: int, rate: float) -> list[float]:
    """What the loop and the traced step take such a step's error for."""

    def at(t: float) -> Any:
        return np.float64(rate if t == C[stage] else 0.0)

    def law(t: float, y: Any, p: Any, out: Any) -> None:
        out[0] = at(t)

    one, work = np.ones(1), np.zeros((WORK_ROWS, 1))
    work[FLOOR] = work[SHARE_OF_WAY] = 1.0
    with np.errstate(over="ignore"):
        loop = dopri853.function(law, 0, 1, 0.0, one, 1.0, one, np.zeros(1), work.reshape(-1))
        traced: Any = dopri853.traced
        step = traced(lambda t, y: (at(t),), 0.0, (np.float64(1.0),), 1.0, (0.0,))
    return [float(loop), float(step[1])]


@pytest.mark.parametrize("case", CASES)
def test_an_overflow_is_a_large_error(case: str) -> None:
    assert min(interpreted(errors, *CASES[case])) > 1e9
