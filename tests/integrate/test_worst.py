"""The worst residual that the loop tells of a block is the largest of its samples."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.integrate.layout import WORST
from rb_sim.mechanics.samples import SampleBlock


def blocks(monkeypatch: pytest.MonkeyPatch, asked: bool = False) -> list[SampleBlock]:
    """Seven of a coarse run, whose residuals differ; asked: somebody samples in between."""
    monkeypatch.setattr("rb_sim.simulation.simulation.BLOCK", 300)
    simulation = Simulation(load_scene("heavy_top", method="rk4", step=4e-3), announce=None)
    found = []
    for block in simulation.blocks(2.0, 1000.0, lambda _: True):
        found.append(block)
        if asked:
            simulation.sample()
    return found


@pytest.mark.parametrize("asked", [False, True])
def test_it_is_the_largest_of_each_block(monkeypatch: pytest.MonkeyPatch, asked: bool) -> None:
    found = blocks(monkeypatch, asked)
    assert len(found) == 7
    for block in found:
        assert block.worst is not None and block.worst[1] == block.residual.max() > 0.0
        assert block.worst_residual == block.residual.max()


def test_of_a_part_of_a_block_it_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    block = blocks(monkeypatch)[0]
    part = replace(block, residual=np.array([1e-3, np.nan, 0.0]))
    assert np.isnan(part.worst_residual)
    assert replace(block, residual=block.residual[:1]).worst_residual == block.residual[0]


def test_no_number_stays_one() -> None:
    """What is told after it hides none, until somebody has asked."""
    simulation = Simulation(load_scene("heavy_top", method="rk4", step=4e-3), announce=None)
    motion: Any = simulation._motion
    simulation.sample()
    motion.take_worst()
    for call in motion._stepper._calls.values():
        call[0].call[WORST] = np.nan
    simulation.sample()
    assert np.isnan(motion.take_worst())
    simulation.sample()
    assert motion.take_worst() >= 0.0
