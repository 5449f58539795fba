# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A motion on traced laws can be kept and come back; what loops are told of a method."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim.contact.choose_motion import motion_of
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.mechanics.bennett import Bennett

HANGING = {"type": "fixed_axis", "body": "b", "axis_B": [0.0, 1.0, 0.0], "point_B": [0.3, 0, 0.1]}
WAYS: dict[str, dict[str, Any]] = {
    "rk4": {"step": 0.01},
    "dopri853": {"tolerance": 1e-8},
    "taylor": {"tolerance": 1e-8},
    "radau5": {"tolerance": 1e-6},
    "gauss6": {"step": 0.02},
}


def swinging(method: str, linkage: bool = False) -> Any:
    """A pendulum, or a linkage whose lines are chosen anew after every step, and which a table
    pushes; its numbers and the choice are inputs of the laws."""
    body = {"mass": 2.0, "inertia": [0.2, 0.3, 0.4]}
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    mapping: dict[str, Any] = {"bodies": {"b": body}, "constraints": {"axle": HANGING}}
    mapping |= {"effects": {"weight": weight}}
    if linkage:
        mapping = Bennett(2).scene(4.0)
        push = {"type": "wrench_table", "body": "bar1", "times": [0.1, 0.5, 0.9]}
        push |= {"forces": [[1.0, 2.0, 0.0], [0.0, 3.0, 1.0], [0.0, 0.0, 2.0]]}
        mapping["effects"] = {"push": push}
    mapping["simulation"] = {"duration": 1.0, "method": method} | WAYS[method]
    scene = scene_from_mapping(mapping)
    return motion_of(compile_scene(scene), compile_method(scene.simulation, 1.0))


@pytest.mark.parametrize(
    ("method", "linkage"), [*((method, False) for method in WAYS), ("rk4", True), ("taylor", True)]
)
def test_what_is_kept_goes_on_again_to_the_last_bit(method: str, linkage: bool) -> None:
    """From between two points of the grid, twice, whatever has happened since."""
    motion = swinging(method, linkage)
    times = np.array([0.4137, 0.6, 0.8])
    rows = np.zeros((3, 3, motion.width))
    motion.run_to(np.array([0.2053]))
    kept = motion.keep()
    counts = []
    for out in rows:
        motion.run_to(times, out)
        counts.append((motion.steps, motion.rejected_steps, motion.frontier, motion.time))
        motion.run_to(np.array([0.95]))
        motion.back_to(kept)
        assert motion.time == 0.2053
    assert rows[0].any() and rows[0].tobytes() == rows[1].tobytes() == rows[2].tobytes()
    assert counts[0] == counts[1] == counts[2]


@pytest.mark.parametrize("method", WAYS)
def test_a_motion_that_starts_again_is_a_new_one(method: str) -> None:
    """Of its grid, its series and its counts nothing is left, though a state was no number."""
    motion, out = swinging(method), np.zeros((2, 1, swinging(method).width))
    assert motion.take_worst() == 0.0
    motion.run_to(np.array([0.5]), out[0])
    steps = motion.steps, motion.rejected_steps, motion.frontier
    with pytest.raises(Exception, match="finite|small enough|Taylor|singular"):
        motion.reset((float("nan"), 1.0))
        motion.run_to(np.array([0.1]))
    motion.reset()
    assert motion.steps == motion.rejected_steps == 0 and motion.frontier == (0.0, 0.0)
    motion.run_to(np.array([0.5]), out[1])
    assert out[0].tobytes() == out[1].tobytes()
    assert (motion.steps, motion.rejected_steps, motion.frontier) == steps
