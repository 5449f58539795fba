# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tens of balls by events: each keeps the closed form of its own fall and bounce."""

from __future__ import annotations

import numpy as np

from rb_sim import Simulation, load_scene

G, R, E, END = 9.81, 0.1, 0.9, 0.29
HEIGHTS = 0.1 + 0.009 * np.arange(32)
"""Of the lowest points [m]; every ball bounces once before END."""


def balls():
    names = [f"b{i}" for i in range(len(HEIGHTS))]
    shape = {"type": "sphere", "radius": R}
    bodies = {
        name: {"mass": 1.0, "shape": shape, "position": [float(i), 0.0, R + float(height)]}
        for i, (name, height) in enumerate(zip(names, HEIGHTS, strict=True))
    }
    floor = {"type": "contact", "restitution": E}
    return {
        "bodies": bodies,
        "constraints": {f"floor_{name}": floor | {"body": name} for name in names},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": END, "method": "rk4", "step": 0.05, "rate": 1.0 / END},
    }


def test_thirty_two_balls_bounce_at_their_own_instants():
    run = Simulation(load_scene(balls())).run()
    falls = np.sqrt(2.0 * HEIGHTS / G)
    struck = {event.contact: event.t for event in run.events if event.kind == "impact"}
    assert len(struck) == len([e for e in run.events if e.kind == "impact"]) == 32
    found = np.array([struck[f"floor_b{i}"] for i in range(32)])
    np.testing.assert_allclose(found, falls, atol=1e-12)
    up = END - falls
    heights = R + E * G * falls * up - 0.5 * G * up**2
    ends = np.array([run.position[f"b{i}"][-1, 2] for i in range(32)])
    np.testing.assert_allclose(ends, heights, atol=1e-12)
