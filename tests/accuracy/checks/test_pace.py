# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What goes wrong late in a long run is told with its time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.accuracy.checks.check import Effort
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.accuracy.checks.step_checks import CHATTER
from rb_sim.base.errors import Finding
from rb_sim.mechanics.samples import ARRAYS, ContactEvent, SampleBlock, SampleLayout
from rb_sim.scene.load import scene_from_mapping
from tests.accuracy.checks.test_check_list import SWING
from tests.accuracy.checks.test_singular_configuration import driven_to_the_end

BLOCK = 1024
BLOCKS = 60
LATE = 20 * BLOCK + 300
"""A sample far from the start."""

ROD: dict[str, Any] = SWING | {
    "effects": SWING["effects"] | {"air": SWING["effects"]["air"] | {"coefficient": 1e-3}},
    "simulation": {"duration": BLOCKS * BLOCK / 200.0, "rate": 200.0, "tolerance": 1e-13},
}
TIGHT = Effort("dopri853", None, 1e-11, 100)


@cache
def run_of(damped: bool) -> tuple[SampleBlock, SampleLayout]:
    """The long run of the rod, with the air or without."""
    simulation = Simulation(scene_from_mapping(mapping_of(damped)), announce=None)
    return simulation.run(checks=False).block, simulation.layout


def mapping_of(damped: bool) -> dict[str, Any]:
    weight = {"weight": ROD["effects"]["weight"]}
    return ROD if damped else ROD | {"effects": weight}


def pieces(block: SampleBlock, size: int = BLOCK) -> Iterator[SampleBlock]:
    for first in range(0, len(block), size):
        part = {name: getattr(block, name)[first : first + size] for name in ARRAYS}
        yield replace(block, **part)


def found(
    damped: bool, effort: Effort = TIGHT, **columns: np.ndarray
) -> tuple[dict[str, Finding], CheckList]:
    block, layout = run_of(damped)
    check_list = CheckList(scene_from_mapping(mapping_of(damped)), layout)
    for piece in pieces(replace(block, **columns)):
        check_list.add(piece, lambda: effort)
    return {finding.check: finding for finding in check_list.findings}, check_list


def after(values: np.ndarray, changed: np.ndarray | float) -> np.ndarray:
    """The values, from the sample LATE on others."""
    late = np.arange(len(values)) >= LATE
    return np.where(late.reshape(-1, *[1] * (values.ndim - 1)), changed, values)


@pytest.mark.parametrize("damped", [False, True])
def test_a_long_run_without_fault_ends_without_a_word(damped: bool) -> None:
    reported, check_list = found(damped)
    assert reported == {}
    block, _ = run_of(damped)
    energy = check_list.ledger.energy()
    assert energy is not None and energy["relative"] < 1e-9
    assert check_list.ledger.samples == len(block)
    momentum = check_list.ledger.momentum()
    if damped:
        assert momentum is None and energy["work"] < -0.1
    else:
        assert momentum is not None and momentum["linear"]["relative"] < 1e-7


def test_energy_that_jumps_late_is_reported_with_its_time() -> None:
    block, _ = run_of(False)
    reported, _ = found(
        False, kinetic_energy=after(block.kinetic_energy, block.kinetic_energy + 1e-3)
    )
    assert set(reported) == {"energy"}
    assert reported["energy"].t == block.t[LATE] and reported["energy"].where == "rod"


def test_a_singular_configuration_late_in_a_run_is_reported() -> None:
    """Its drive becomes impossible at 1.6 s; 20,000 samples at rest come before that."""
    mapping = driven_to_the_end()
    mapping["simulation"] |= {"rate": 1000.0}
    scene = scene_from_mapping(mapping)
    simulation = Simulation(scene, announce=None)
    block = simulation.run(checks=False).block
    start = replace(block, **{name: getattr(block, name)[:1] for name in ARRAYS})
    still = replace(start, **{name: np.repeat(getattr(start, name), BLOCK, 0) for name in ARRAYS})
    check_list = CheckList(scene, simulation.layout)
    for k in range(20):
        check_list.add(replace(still, t=still.t + (k - 20.0 + np.arange(BLOCK) / BLOCK)), TIGHT)
    for piece in pieces(block, 100):
        check_list.add(piece, TIGHT)
    reported = {finding.check: finding for finding in check_list.findings}
    assert reported["singular configuration"].t == pytest.approx(1.6, abs=2e-3)


# Where contacts do not change for long, a fault that comes late is told.


LATE_CONTACTS = 20 * 1024 + 300
"""A sample in a block in which nothing happens: the ball has rolled for long."""
TIGHT_CONTACTS = Effort("dopri853", None, 1e-10, 100)
RATE = 1000.0


@cache
def run() -> tuple[SampleBlock, SampleLayout]:
    """A ball thrown along the floor, which slips, then rolls."""
    simulation = Simulation(load_scene("thrown_ball", duration=30.0, rate=RATE), announce=None)
    return simulation.run(checks=False).block, simulation.layout


def found_of_contacts(**columns: np.ndarray) -> tuple[dict[str, Finding], CheckList]:
    block, layout = run()
    check_list = CheckList(load_scene("thrown_ball", rate=RATE), layout)
    for piece in pieces(replace(block, **columns)):
        here = tuple(e for e in block.events if piece.t[0] - 1.0 / RATE < e.t <= piece.t[-1])
        check_list.add(replace(piece, events=here), TIGHT_CONTACTS)
    return {finding.check: finding for finding in check_list.findings}, check_list


def test_a_ball_that_rolls_on_ends_without_a_word() -> None:
    reported, check_list = found_of_contacts()
    block, _ = run()
    assert reported == {} and check_list.ledger.samples == len(block)
    energy = check_list.ledger.energy()
    assert energy is not None and energy["relative"] < 1e-9
    assert energy["work"] == pytest.approx(block.contact_work[-1], rel=1e-12)


@pytest.mark.parametrize("column", ["kinetic_energy", "contact_work"])
def test_energy_or_work_that_jumps_while_it_rolls_is_reported_with_its_time(column: str) -> None:
    block, _ = run()
    values = getattr(block, column)
    reported, _ = found_of_contacts(**{column: after(values, values + 1e-3)})
    assert set(reported) == {"energy"} and reported["energy"].t == block.t[LATE_CONTACTS]


def test_events_are_counted_however_late_they_come() -> None:
    block, layout = run()
    check_list = CheckList(load_scene("thrown_ball", rate=RATE), layout)
    for i, piece in enumerate(pieces(block)):
        contact = layout.contacts[0]
        many = (ContactEvent(float(piece.t[0]), contact, "impact"),) * (2000 * CHATTER)
        check_list.add(replace(piece, events=many if i == 20 else ()), TIGHT_CONTACTS)
    assert {finding.check for finding in check_list.findings} == {"events"}
