# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The table of contacts: each number has a name, and what a sample writes no step reads."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.contact import contact_bodies
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import load_scene

SCENES = ("dropped_box", "ball_on_block", "stick_slip", "sphere_in_cylinder")


@pytest.mark.parametrize("name", SCENES)
def test_what_an_evaluation_leaves_behind_disturbs_no_step(name: str) -> None:
    scene = load_scene(name)
    compiled = compile_scene(scene)
    plain, spoilt = (motion_of(compiled, compile_method(scene.simulation, 1.0)) for _ in "ab")
    times = np.linspace(0.0, min(scene.simulation.duration, 1.0), 41)
    a, b = np.empty((2, 1, plain.width))
    for t in times:
        plain.run_to(np.array([t]), a)
        kept = spoilt.system.touch[:, : contact_bodies.FIRST_OF_SCRATCH].copy()
        spoilt.system.touch[:, contact_bodies.FIRST_OF_SCRATCH :] = np.nan
        spoilt.run_to(np.array([t]), b)
        assert a.tobytes() == b.tobytes(), t
    assert len(plain.events) == len(spoilt.events) > 0
    assert not np.array_equal(kept, spoilt.system.touch[:, : contact_bodies.FIRST_OF_SCRATCH])
