# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Energy against work in the plots where a run is reset or a state is set: both begin anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.io.plots.panels import Balance
from rb_sim.io.sink import stretches
from rb_sim.mechanics.samples import SampleBlock, concatenate

RATE, RESET, SET, END = 100, 40, 70, 100
"""Samples per second; the sample that shows the reset, the one of the state, and how many."""
A = 0.1
"""[m], the sphere's radius."""
ROLLING = {
    "position": (3.0, 0.0, A),
    "linear_velocity": (2.0, 0.0, 0.0),
    "angular_velocity": (0.0, 2.0 / A, 0.0),
}


def run() -> tuple[Simulation, list[SampleBlock]]:
    """The sphere, pushed; what it has gained is taken away, then it is put elsewhere and rolls.
    Stamps go on, as a node's do."""
    simulation = Simulation("rolling_sphere_commanded")
    blocks = [simulation.sample().block]
    simulation.apply_wrench("ball", (3.0, 1.0, 0.0), (0.0, 0.1, 0.02))
    for k in range(1, END):
        if k == RESET:
            simulation.reset()
        elif k == SET:
            simulation.set_state({"ball": ROLLING})
        else:
            if k == RESET + 1:
                simulation.apply_wrench("ball", (-2.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            simulation.advance(1 / RATE)
        block = replace(simulation.sample().block, inputs=simulation.take_inputs())
        blocks.append(replace(block, t=np.array([k / RATE])))
    return simulation, blocks


@pytest.mark.parametrize("together", [True, False], ids=["in one block", "sample by sample"])
def test_a_reset_is_no_lost_energy_and_a_new_state_no_work(together: bool):
    simulation, blocks = run()
    balance = Balance(simulation.scene, simulation.layout)
    parts = [concatenate(blocks, simulation.layout)] if together else blocks
    change, work = np.concatenate([balance(part) for part in parts]).T
    assert change[RESET - 1] > 0.2 and change[SET - 1] > 0.05 and change[END - 1] < -0.5
    assert change[RESET] == work[RESET] == change[SET] == work[SET] == 0.0
    np.testing.assert_allclose(work, change, atol=2e-3 * np.abs(change).max())


def test_a_block_is_cut_where_the_run_begins_anew():
    simulation, blocks = run()
    cut = list(stretches(concatenate(blocks, simulation.layout)))
    assert [len(part) for part, _ in cut] == [RESET, SET - RESET, END - SET]
    assert [given and bool(given.state) for _, given in cut] == [None, False, True]
    again = np.concatenate([part.t for part, _ in cut])
    np.testing.assert_array_equal(again, np.arange(END) / RATE)
