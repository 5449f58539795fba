"""What a run may lose before a watch speaks, by the formulas of the bounds; and what is advised."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.checks.check import Effort, below, effort_of, finer_step, round_down
from rb_sim.checks.imbalance import CLOSER, INTERVALS, closer_samples
from rb_sim.checks.step_doubling import LocalError
from tests.checks.blocks import Block


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


def test_where_the_effort_of_a_run_comes_from() -> None:
    options = SimpleNamespace(method="rk4", step=0.01, tolerance=None, duration=3.0)
    run: dict[str, Any] = {
        "choice": None,
        "scene": SimpleNamespace(simulation=options),
        "steps": 40,
        "unsolved_steps": (3, 0.5),
        "circling_steps": 5,
        "paradox_steps": 6,
        "slipping_steps": 6.5,
        "restruck_energy": 7.0,
        "made_energy": 7.5,
        "astray": (8.0, 0.1, "floor"),
        "local_error": LocalError(share=0.2),
        "left_open": None,
        "ahead": None,
    }
    told = effort_of(SimpleNamespace(**run))
    assert told[:4] == ("rk4", 0.01, None, 40)
    assert told[4:12] == (3, 0.5, 5, 6, 6.5, 7.0, 7.5, (8.0, 0.1, "floor"))
    assert told.local.share == 0.2
    assert told.asked is None and told.kept_to == 0.0
    chosen = SimpleNamespace(
        method="dopri853", step=None, tolerance=1e-9, target=1e-10, reached=False
    )
    run["choice"] = chosen
    told = effort_of(SimpleNamespace(**run))
    assert told[:3] == ("dopri853", None, 1e-9)
    assert told.asked == 1e-10 and told.kept_to == 0.0
    chosen.reached = True
    told = effort_of(SimpleNamespace(**run))
    assert told.kept_to == 3.0


@pytest.mark.parametrize(
    ("step", "rounded", "half"),
    [
        (0.01, 0.01, 0.005),
        (0.0099, 0.005, 0.002),
        (0.0051, 0.005, 0.002),
        (0.0049, 0.002, 0.002),
        (2.0, 2.0, 1.0),
        (1.99, 1.0, 0.5),
        (1e-3, 1e-3, 5e-4),
        (float(np.nextafter(1e-3, 0.0)), 5e-4, 2e-4),  # its logarithm is that of 1e-3
    ],
)
def test_steps_that_are_named(step: float, rounded: float, half: float) -> None:
    assert round_down(step) == rounded
    assert below(step) == half


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


def test_samples_taken_closer_are_of_the_length_of_a_usual_interval() -> None:
    asked = []
    effort = adaptive(1e-10, 1)._replace(ahead=lambda *span: asked.append(span))
    for t in ([4.0, 4.5], [4.0, 4.1, 4.7, 5.5]):
        closer_samples(Block(t), effort)
    assert asked == [(INTERVALS * 0.5, INTERVALS * CLOSER)] * 2
    assert closer_samples(Block([4.0]), effort) is None and len(asked) == 2
    assert closer_samples(Block([4.0, 4.5]), effort._replace(ahead=None)) is None
