# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction that a run reports lies in Coulomb's cone, whatever is done to bodies after the step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.heaps import scenes
from rb_sim import Simulation, load_scene


def beyond_cone(mapping: dict[str, Any], duration: float) -> float:
    """By how much friction on planes exceeds mu N at most, over the largest N of the run."""
    options = mapping["simulation"] | {"duration": duration, "rate": 1000.0, "step": 1e-3}
    run = Simulation(load_scene(mapping | {"simulation": options})).run(check=False)
    worst, largest = 0.0, 0.0
    for name, one in mapping["constraints"].items():
        surface = one.get("surface", {"type": "plane"})
        if one["type"] != "contact" or "parent" in one or surface["type"] != "plane":
            continue
        mu = one["friction"]["static"]
        normal = np.array(surface.get("normal", [0.0, 0.0, 1.0]))
        force = run.reaction[name].force
        push = force @ normal
        across = np.linalg.norm(force - np.outer(push, normal), axis=1)
        worst, largest = max(worst, (across - mu * push).max()), max(largest, push.max())
    assert largest > 0.0
    return worst / largest


@pytest.mark.parametrize(("name", "duration"), [("piled_balls", 1.0), ("dominoes", 0.9)])
def test_in_heaps(name: str, duration: float) -> None:
    """Balls in a bin and slabs, which overlap, are moved apart and come to rest."""
    assert beyond_cone(getattr(scenes, name)(), duration) < 1e-12
