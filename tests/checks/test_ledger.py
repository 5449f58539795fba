"""The ledger of a run, on samples by hand: what is rounding, and where a balance breaks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rb_sim.checks.balance import Ledger
from rb_sim.mechanics.samples import SampleBlock, SampleLayout, empty_block
from rb_sim.scene.load import scene_from_mapping

NAMES = SampleLayout(("a",), ("one", "two"), ("a", "a"), ())


def ledger() -> Ledger:
    """Of a body of 2 kg with two joints to the world."""
    pin = {"type": "fixed_point", "body": "a"}
    body = {"mass": 2.0, "inertia": [0.1, 0.2, 0.25]}
    scene = {"bodies": {"a": body}, "constraints": {"one": pin, "two": pin}}
    return Ledger(scene_from_mapping(scene), NAMES)


def samples(t: list[float], speed: float, force: float = 3.0, **columns: Any) -> SampleBlock:
    """Of the body that drifts along x while both joints push against each other at x = 5 m."""
    block = empty_block(len(t), NAMES)
    block.t[:] = t
    block.linear_velocity[:, 0, 0], block.momentum[:, 0] = speed, 2.0 * speed
    block.orientation[:, 0, 3] = 1.0
    block.reaction_force[:, 0, 2], block.reaction_force[:, 1, 2] = force, -force
    block.anchor[:, :, 0] = 5.0
    return replace(block, **{name: np.array(values) for name, values in columns.items()})


@pytest.mark.parametrize(("part", "known"), [(0.97, False), (1.03, True)])
def test_momentum_that_may_be_rounding_of_impulses_has_no_scale(part: float, known: bool) -> None:
    """1e-13 of 6 N over 20 s, from the first sample of the run to the last of the block, is
    1.2e-11 N s."""
    speed = part * 0.5 * 1.2e-11
    book = ledger()
    book.add(samples([10.0, 11.0, 12.0, 13.0], speed))
    book.add(samples([14.0, 20.0, 25.0, 30.0], speed))
    balances = book.momentum()
    assert balances is not None
    assert (balances["linear"]["relative"] is not None) is known
    assert balances["angular"]["relative"] is None  # nothing turns


@pytest.mark.parametrize(("lost", "first"), [(0.0, 4), (0.1, 3), (1.0, 2)])
def test_where_energy_breaks_its_balance_in_a_block(lost: float, first: int) -> None:
    """Of 10 J at the start with a power of 2 W: from the third sample on some are lost, more from
    the fourth on; the bound is a hundredth of what is exchanged, 18 J. The last where none is."""
    t = np.arange(5.0)
    kinetic = 10.0 + 2.0 * t - lost * np.array([0.0, 0.0, 0.5, 5.0, 5.0])
    book = ledger()
    block = samples(t.tolist(), 1.0, kinetic_energy=kinetic, power=np.full(5, 2.0))
    book.add(block)
    energy = book.energy()
    assert energy is not None and energy["work"] == pytest.approx(8.0)
    assert energy["scale"] == pytest.approx(18.0)
    assert energy["error"] == pytest.approx(-5.0 * lost, abs=1e-12)
    assert book.first_beyond(block, 0.01) == first
