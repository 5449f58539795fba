# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where contacts do not change for long, a fault that comes late is told."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.diagnostic import Finding
from rb_sim.checks.check import Effort
from rb_sim.checks.check_list import CheckList
from rb_sim.checks.steps import CHATTER
from rb_sim.mechanics.samples import ContactEvent, SampleBlock, SampleLayout
from tests.checks.test_pace import after, pieces

LATE = 20 * 1024 + 300
"""A sample in a block in which nothing happens: the ball has rolled for long."""
TIGHT = Effort("dopri853", None, 1e-10, 100)
RATE = 1000.0


@cache
def run() -> tuple[SampleBlock, SampleLayout]:
    """A ball thrown along the floor, which slips, then rolls."""
    simulation = Simulation(load_scene("thrown_ball", duration=30.0, rate=RATE), announce=None)
    return simulation.run().block, simulation.layout


def found(**columns: np.ndarray) -> tuple[dict[str, Finding], CheckList]:
    block, layout = run()
    check_list = CheckList(load_scene("thrown_ball", rate=RATE), layout)
    for piece in pieces(replace(block, **columns)):
        here = tuple(e for e in block.events if piece.t[0] - 1.0 / RATE < e.t <= piece.t[-1])
        check_list.add(replace(piece, events=here), TIGHT)
    return {finding.watch: finding for finding in check_list.findings}, check_list


def test_a_ball_that_rolls_on_ends_without_a_word() -> None:
    told, check_list = found()
    block, _ = run()
    assert told == {} and check_list.ledger.samples == len(block)
    energy = check_list.ledger.energy()
    assert energy is not None and energy["relative"] < 1e-9
    assert energy["work"] == pytest.approx(block.contact_work[-1], rel=1e-12)


@pytest.mark.parametrize("column", ["kinetic_energy", "contact_work"])
def test_energy_or_work_that_jumps_while_it_rolls_is_told_with_its_time(column: str) -> None:
    block, _ = run()
    values = getattr(block, column)
    told, _ = found(**{column: after(values, values + 1e-3)})
    assert set(told) == {"energy"} and told["energy"].t == block.t[LATE]


def test_a_sample_that_sinks_in_is_told_with_its_time() -> None:
    block, _ = run()
    residual = block.residual.copy()
    residual[LATE] = 1e-4
    told, _ = found(residual=residual)
    assert set(told) == {"residual"} and told["residual"].t == block.t[LATE]


def test_events_are_counted_however_late_they_come() -> None:
    block, layout = run()
    check_list = CheckList(load_scene("thrown_ball", rate=RATE), layout)
    for i, piece in enumerate(pieces(block)):
        contact = layout.contacts[0]
        many = (ContactEvent(float(piece.t[0]), contact, "impact"),) * (2000 * CHATTER)
        check_list.add(replace(piece, events=many if i == 20 else ()), TIGHT)
    assert {finding.watch for finding in check_list.findings} == {"events"}
