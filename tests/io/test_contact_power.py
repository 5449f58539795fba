# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The power of contacts, from samples, is the rate of the work that the run integrates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.io.contact_power import contact_power, smooth_power

FRICTION = {"type": "coulomb", "static": 0.3}


def ball_on_plate(gives_way: bool, both: bool = True) -> dict[str, Any]:
    """A ball that slides, rolls and spins against resistance on a free plate that turns; both have
    their centre of mass beside their middle, and a spring presses them together."""
    plate = {
        "mass": 4.0,
        "inertia": [0.3, 0.4, 0.6],
        "center_of_mass": [0.04, -0.07, 0.02],
        "angular_velocity": [1.5, -1.0, 2.5],
    }
    ball = {
        "mass": 1.0,
        "shape": {"type": "sphere", "radius": 0.1},
        "inertia": [0.004, 0.0045, 0.005],
        "center_of_mass": [0.01, 0.004, -0.006],
        "position": [0.02, 0.05, 0.0995 if gives_way else 0.1],
        "linear_velocity": [1.0, 0.3, 0.0],
        "angular_velocity": [3.0, -4.0, 5.0],
    }
    contact: dict[str, Any] = {"type": "contact", "body": "ball", "friction": FRICTION}
    contact |= {"rolling_resistance": 0.01, "spinning_resistance": 0.02}
    if gives_way:
        contact["compliance"] = {"stiffness": 4e4, "damping": 40.0}
    spring = {"type": "spring", "body": "ball", "stiffness": 40.0, "rest_length": 0.0}
    spring |= {"point_A": [0.1, 0.0, -0.5]}
    bodies = {"ball": ball}
    if both:
        bodies["plate"] = plate
        contact["parent"] = spring["parent"] = "plate"
    return {
        "bodies": bodies,
        "constraints": {"rub": contact},
        "effects": {"pull": spring},
        "simulation": {"duration": 0.006, "rate": 10000.0, "project_initial": True},
    }


def pulled_by_string() -> dict[str, Any]:
    """Two bodies that turn, between points off their centres a string that gives way."""
    link = {"type": "string", "body": "b", "parent": "a", "length": 0.5}
    link |= {"point_A": [0.1, 0.05, 0.0], "point_B": [-0.08, 0.0, 0.06]}
    link["compliance"] = {"stiffness": 2000.0, "damping": 20.0}
    turns = {"inertia": [0.03, 0.04, 0.05], "mass": 1.5}
    return {
        "bodies": {
            "a": turns | {"angular_velocity": [4.0, -3.0, 2.0]},
            "b": turns | {"position": [0.75, 0.0, 0.0], "angular_velocity": [-1.0, 3.0, 6.0]},
        },
        "constraints": {"link": link},
        "simulation": {"duration": 0.006, "rate": 10000.0},
    }


SCENES = {
    "rigid": ball_on_plate(False),
    "gives way": ball_on_plate(True),
    "on the world": ball_on_plate(False, both=False),
    "string": pulled_by_string(),
}


@pytest.mark.parametrize("name", SCENES)
def test_it_is_the_rate_of_the_work(name: str) -> None:
    """The parent's spin takes part in both: without it the power is wrong by a tenth and more."""
    scene = load_scene(SCENES[name], method="dopri853", tolerance=1e-12)
    run = Simulation(scene).run(checks=False)
    block, layout = run.block, run.layout
    power = contact_power(block, scene, layout)
    work, h = block.contact_work, block.t[1] - block.t[0]
    inner = slice(2, -2)
    rate = (8.0 * (work[3:-1] - work[1:-3]) - (work[4:] - work[:-4])) / (12.0 * h)
    assert not block.events or max(e.t for e in block.events) == 0.0
    assert np.abs(power).min() > 0.01
    np.testing.assert_allclose(power[inner], rate, rtol=1e-6)
    smooth = smooth_power(block, scene, layout)
    np.testing.assert_allclose(smooth, block.power - power, rtol=0.0, atol=1e-12)
