"""Impacts whose order hangs on the length of the steps are told, with a step that tells it."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.contact.events.left_open import ORDER
from rb_sim.finding import Finding
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.effort_watch import found_in
from tests.contact.events.test_missed import REACH, W, oscillator

AT, RADIUS = -0.1, 0.1
SPEED = W * (REACH**2 - AT**2) ** 0.5
LEAN = np.array([0.6, 0.8, 0.0])
LONG, SHORT = 2e-2, 1e-3
"""Steps [s]."""


def struck(late: float, step: float) -> tuple[Simulation, list[Finding]]:
    """The ball meets a wall at x = AT, and would meet another, which leans, `late` seconds later;
    and what is ambiguous of the order."""
    mapping = oscillator(method="rk4", step=step, duration=0.12)
    meets = np.array([AT, 0.0, RADIUS])
    upright = meets - RADIUS * np.array([1.0, 0.0, 0.0])
    leaning = meets - (RADIUS + late * SPEED * LEAN[0]) * LEAN
    for name, point, normal in (("wall", upright, [1.0, 0.0, 0.0]), ("lean", leaning, LEAN)):
        surface = {"type": "plane", "point": list(point), "normal": list(normal)}
        mapping["constraints"][name] = {"type": "contact", "body": "ball", "surface": surface}
    simulation = Simulation(load_scene(mapping))
    run = simulation.run(watched=False)
    found = found_in(run.block, effort_of(simulation), 100.0, 1.0)
    return simulation, [finding for finding in found if finding.what == ORDER]


def test_an_order_that_steps_decide_is_told_with_a_finer_step() -> None:
    """By the closed form x = REACH cos(W t) long steps are as late at the wall as `off`: what is to
    come half of that later is told, what is to come ten times later is not."""
    simulation, _ = struck(1e-2, LONG)
    (first,) = (event for event in simulation.events if event.kind == "impact")
    off = abs(first.t - np.arccos(AT / REACH) / W)
    assert off > 1e-5
    simulation, told = struck(0.5 * off, LONG)
    (finding,) = told
    assert finding.figure == pytest.approx(LEAN[0] * SPEED / simulation.compiled.system.speed, 1e-3)
    assert finding.t == first.t and finding.finer_step is not None
    assert finding.finer_step < LONG
    for late, step in ((10.0 * off, LONG), (0.5 * off, SHORT)):
        assert not struck(late, step)[1]
