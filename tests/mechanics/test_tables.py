# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Stars of many arms: their laws grow with the arms, and each arm swings as if alone."""

from __future__ import annotations

import math

import pytest
from numpy.testing import assert_allclose

from benchmarks.many_body_scenes import star
from rb_sim.compiler.graph.symbols import operations
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.table_laws import BODIES
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping


def test_the_laws_of_a_star_grow_with_its_arms():
    sizes = []
    for arms in (8, 16):
        compiled = compile_scene(scene_from_mapping(star(arms)))
        laws = MultiBodyLaws(compiled.system, 0, compiled.redundant, (), compiled.dependent)
        sizes.append(operations(laws.outputs(laws.slopes)))
    assert sizes[1] < 2.2 * sizes[0]


def test_a_star_swings_as_its_arms_alone_would_on_a_heavy_hub():
    """A hub a thousand million times as heavy does not move: each arm is a pendulum of its own."""
    from rb_sim import Simulation

    scene = star(BODIES)
    scene["bodies"]["hub"] |= {"mass": 1e9, "inertia": [1e9, 1e9, 1e9]}
    scene["effects"] = {
        "g": {
            "type": "gravity",
            "bodies": [f"a{i}" for i in range(BODIES)],
            "acceleration": [0.0, 0.0, -9.81],
        }
    }
    run = Simulation(scene_from_mapping(scene)).run(checks=False)
    heights = run.block.position[-1, 1:, 2]
    assert_allclose(heights, heights[0], atol=1e-7)
    moment, length = 0.09 + 0.25, 0.5
    period = 2.0 * math.pi * math.sqrt(moment / (9.81 * length))
    assert heights[0] == pytest.approx(-0.5 * math.sin(angle_from_level(0.2, period)), abs=1e-6)


def angle_from_level(t: float, period: float) -> float:
    """Angle through which a pendulum released level has turned at t, by its elliptic integral."""
    from scipy.special import ellipj, ellipk

    k = math.sin(math.pi / 4)
    sn = float(ellipj(float(ellipk(k * k)) - 2.0 * math.pi * t / period, k * k)[0])
    return math.pi / 2 - 2.0 * math.asin(k * sn)
