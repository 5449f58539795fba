# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A jointed body beside a bystander moves as alone: reduced coordinates alone, maximal ones beside.

The two are independent derivations, so what they share at 1e-11 is the motion, not an error.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from rb_sim import Simulation
from rb_sim.scene.load import scene_from_mapping

CONFIG = Path(__file__).parents[2] / "config"
OPTIONS = {"duration": 2.0, "rate": 10.0, "method": "dopri853", "tolerance": 1e-13}
BYSTANDER = {
    "mass": 1.0,
    "inertia": [0.1, 0.2, 0.3],
    "position": [50.0, 0.0, 0.0],
    "angular_velocity": [0.3, 0.2, 1.0],
}


def run(mapping: dict[str, Any]) -> Any:
    return (
        Simulation(scene_from_mapping(mapping | {"simulation": OPTIONS})).run(watched=False).block
    )


@pytest.mark.parametrize("name", ["heavy_top", "pendulum", "rolling_disk", "rolling_sphere"])
def test_a_bystander_changes_nothing(name):
    scene = yaml.safe_load((CONFIG / f"{name}.yaml").read_text())
    alone = run(scene)
    beside = run(scene | {"bodies": scene["bodies"] | {"bystander": BYSTANDER}})
    assert beside.position.shape[1] == 2, "the stranger is there"
    for field in ("position", "orientation", "linear_velocity", "angular_velocity"):
        expected, found = getattr(alone, field)[:, 0], getattr(beside, field)[:, 0]
        size = max(1.0, float(np.abs(expected).max()))
        assert np.abs(found - expected).max() < 1e-11 * size, field
    weight = float(np.abs(alone.reaction_force).max())
    for field in ("reaction_force", "reaction_torque"):
        expected, found = getattr(alone, field), getattr(beside, field)
        assert np.abs(found - expected).max() < 1e-11 * weight, field
