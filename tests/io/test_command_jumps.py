# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Work in the plots where commands change at every sample: it is the change of energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.io.plots.panels import Balance
from rb_sim.mechanics.samples import concatenate

RATE = 100


@pytest.mark.parametrize("frame", ["world", "body"])
@pytest.mark.parametrize("together", [True, False], ids=["in one block", "sample by sample"])
def test_work_is_the_change_of_energy_though_commands_jump(frame: str, together: bool):
    """A controller that holds its command for a period; without the jumps it is another one."""
    simulation = Simulation("rolling_sphere_commanded")
    blocks = [simulation.sample().block]
    for k in range(1, 60):
        force, torque = (3.0 * np.sin(2.3 * k), 2.0 * np.cos(k), 0.0), (0.0, 0.1 * (-1) ** k, 0.02)
        simulation.apply_wrench("ball", force, torque, frame)
        simulation.advance(1 / RATE)
        blocks.append(replace(simulation.sample().block, inputs=simulation.take_inputs()))
    balance = Balance(simulation.scene, simulation.layout)
    parts = [concatenate(blocks, simulation.layout)] if together else blocks
    change, work = np.concatenate([balance(part) for part in parts]).T
    assert np.abs(change).max() > 0.005
    np.testing.assert_allclose(work, change, atol=2e-3 * np.abs(change).max())
