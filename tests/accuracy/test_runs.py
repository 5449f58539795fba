# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs of a scene that take too long are broken off, and count as failed."""

from __future__ import annotations

import math

import numpy as np

from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.runs import Runner
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import ball, scene, touch
from tests.interpreted import interpreted


def run_with(limit: float) -> tuple[bool, float]:
    """(whether the run came to its end, its cost) of a ball that bounces a few times."""
    mapping = scene(ball([0.0, 0.0, 0.2]), touch(restitution=0.2))
    compiled = compile_scene(scene_from_mapping(mapping))
    runner = Runner(compiled, 0.5, np.array([0.0, 0.5]))
    runner.limit = limit
    setting = Setting("rk4", step=0.1)
    rows, _ = runner.sampled(setting)
    return bool(np.isfinite(rows[-1]).all()), runner.cost(setting, 1e-6)


def test_a_run_from_event_to_event_is_broken_off_at_the_limit() -> None:
    done, cost = interpreted(run_with, math.inf)
    assert done and math.isfinite(cost)
    done, cost = interpreted(run_with, 0.0)
    assert not done and cost == math.inf
