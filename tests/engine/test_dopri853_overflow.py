"""A step so long that its estimates overflow is no step without an error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim.engine.methods.dopri853 import combined
from rb_sim.loops.methods.dopri853 import E3, E5, C, dopri853
from rb_sim.loops.rows import FLOOR, WORK_ROWS
from tests.interpreted import interpreted

STAGE = int(np.argmax(np.abs(E3) / np.maximum(np.abs(E5), 1e-30)))
RATES = [2e154 / abs(E3[STAGE]), 2e154 / abs(E5[STAGE])]
"""At one stage, so large that the square of the estimate of order 3 overflows alone, or both do."""


def errors(rate: float) -> list[float]:
    """What the loop and the traced step take such a step's error for."""

    def at(t: float) -> Any:
        return np.float64(rate if t == C[STAGE] else 0.0)

    def law(t: float, y: Any, p: Any, out: Any) -> None:
        out[0] = at(t)

    one, work = np.ones(1), np.zeros((WORK_ROWS, 1))
    work[FLOOR] = 1.0
    with np.errstate(over="ignore"):
        loop = dopri853.function(law, 0, 1, 0.0, one, 1.0, one, np.zeros(1), work.reshape(-1))
        traced: Any = dopri853.traced
        step = traced(lambda t, y: (at(t),), 0.0, (np.float64(1.0),), 1.0, (0.0,))
    return [float(loop), float(step[1])]


@pytest.mark.parametrize("rate", RATES)
def test_an_overflow_is_a_large_error(rate: float) -> None:
    assert min(interpreted(errors, rate)) > 1e9


@pytest.mark.parametrize("squares", [(1e200, np.inf), (np.inf, 1.0), (np.inf, np.inf)])
def test_squares_that_overflow(squares: tuple[float, float]) -> None:
    assert combined(*squares, 3) > 1e9
