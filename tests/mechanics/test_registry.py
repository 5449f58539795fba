# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which methods integrate what, which of them `auto` begins with, and how they are asked for."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.many_body_scenes import chain
from rb_sim import load_scene
from rb_sim.integrate.methods.dopri853 import AdaptiveDopri853, Dopri853
from rb_sim.mechanics.methods import METHODS, TimeStepping, build, tried
from rb_sim.scene.compile import compile_scene
from tests.mechanics.test_guides import VALLEY, sliding
from tests.one_body_scenes import JOINTS

ALWAYS = {"euler", "rk4", "dopri853", "gauss6"}
"""What integrates every scene."""
BALL = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [0.0, 0.0, 1.0]}
FLOOR = {"type": "contact", "body": "b", "surface": {"type": "plane"}}


def system_of(mapping: dict[str, Any], coordinates: str = "auto") -> Any:
    return compile_scene(load_scene(mapping), coordinates=coordinates).system


SYSTEMS: dict[str, tuple[Any, set[str], set[str]]] = {
    "one body": (lambda: system_of(JOINTS["fixed_point"]), {"radau5", "taylor"}, {"taylor"}),
    "the same, maximal": (
        lambda: system_of(JOINTS["fixed_point"], "maximal"),
        {"radau5", "taylor"},
        set(),
    ),
    "many bodies": (lambda: system_of(chain(3)), {"radau5", "taylor"}, set()),
    "along a spline": (
        lambda: system_of(sliding(VALLEY, 0.3, 1.0)),
        {"radau5", "taylor"},
        {"taylor"},
    ),
    "along a spline, maximal": (
        lambda: system_of(sliding(VALLEY, 0.3, 1.0), "maximal"),
        {"radau5"},
        set(),
    ),
    "in contact": (
        lambda: system_of({"bodies": {"b": BALL}, "constraints": {"floor": FLOOR}}),
        {"time_stepping"},
        {"time_stepping"},
    ),
}
"""Of each: what integrates it besides, and what of the series and of time stepping is tried."""


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_suits_a_system(name: str) -> None:
    make, besides, weighed = SYSTEMS[name]
    system = make()
    suiting = {method for method, entry in METHODS.items() if entry.suits(system)}
    assert suiting == ALWAYS | besides
    assert set(tried(system)) == ALWAYS | (besides - {"taylor"}) | weighed


def test_a_method_is_asked_for_by_step_or_tolerance() -> None:
    assert build("dopri853", step=0.01, tolerance=None, largest_step=1.0) == Dopri853(0.01)
    adaptive = build("dopri853", step=None, tolerance=1e-9, largest_step=0.5)
    assert adaptive == AdaptiveDopri853(1e-9, 0.5)
    assert build("time_stepping", step=1, tolerance=None, largest_step=1.0) == TimeStepping(1.0)
    with pytest.raises(ValueError, match="method rk4 takes no tolerance"):
        build("rk4", step=None, tolerance=1e-9, largest_step=1.0)
    with pytest.raises(ValueError, match="method taylor takes no fixed step"):
        build("taylor", step=0.1, tolerance=None, largest_step=1.0)
