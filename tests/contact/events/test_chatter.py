# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Slips that rounding begins and ends: friction at its very bound holds, and soon."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from tests.contact.scenes import box, scene, touch


@pytest.mark.parametrize("mu", [0.2585755739915971, 0.6630037871702823])
def test_a_box_at_the_very_threshold_of_slipping_rests(mu: float) -> None:
    """A slope of atan(mu), to the last digit: rounding let it slip, by 1e-20 m each time, 900
    times. From the start on its corners share the load within their cones, up to rounding: the
    upper ones bear less, and may hold less."""
    angle = math.atan(mu)
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    start = box([0.2, 0.2, 0.2], (0.1 * normal).tolist())
    start |= {"orientation": {"axis": [0, 1, 0], "angle": angle}}
    mapping = scene(start, touch(mu=mu, surface={"type": "plane", "normal": normal.tolist()}))
    mapping["simulation"] = {"duration": 0.1, "rate": 100.0, "tolerance": 1e-9}
    simulation = Simulation(load_scene(mapping))
    run = simulation.run()
    assert np.abs(run.position["body"] - run.position["body"][0]).max() <= 1e-15
    assert {event.kind for event in simulation.events} <= {"closes", "sticks"}
    corners = [run.reaction[name].force for name in run.layout.reactions if "/" in name]
    pushes = np.array([force @ normal for force in corners])
    across = [np.linalg.norm(f - np.outer(f @ normal, normal), axis=1) for f in corners]
    assert np.all(np.array(across) <= mu * pushes + 1e-12 * pushes.sum(axis=0))
