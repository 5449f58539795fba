# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Points that lift off together open once each, whatever they stand on."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.contact.scenes import G, body, box, scene, touch
from tests.contact_runs import contact_run

AMPLITUDE, RATE = 0.03, 10.0 * math.pi
SHAKEN = {"type": "shaken", "direction": [0, 0, 1], "amplitude": AMPLITUDE, "frequency": 5.0}
LEAVES = math.asin(G / (AMPLITUDE * RATE**2)) / RATE
"""Where the floor falls as fast as the weight asks for: a w^2 sin(w t) = g."""
PLATE = {"type": "disk", "radius": 0.2}
FEET = {
    "two": [[0.1, 0.0, -0.05], [-0.1, 0.0, -0.05]],
    "three": [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]],
    "five": [[0.1, 0.1, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05], [0.1, -0.1, -0.05]]
    + [[0.0, 0.0, -0.05]],
}
SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "loose": {"tolerance": 1e-4},
    "sharp": {"tolerance": 1e-13},
    "rk4": {"method": "rk4", "step": 1e-3, "tolerance": None},
    "coarse rk4": {"method": "rk4", "step": 1e-2, "tolerance": None},
    "gauss6": {"method": "gauss6", "step": 2e-3, "tolerance": None},
}


def thrown_off(solid: dict[str, Any], **contact: Any) -> dict[str, Any]:
    """What stands on a floor that rises first and then falls away under it."""
    moving = solid | {"linear_velocity": [0.0, 0.0, AMPLITUDE * RATE]}
    return scene(moving, touch(motion=SHAKEN, **contact))


def assert_lifts_once(mapping: dict[str, Any], **setting: Any) -> None:
    found = contact_run(mapping, [0.0, LEAVES + 1e-3], **setting)
    after = [e for e in found.events if e.t > 0.0]
    assert {e.kind for e in after} == {"opens"}
    assert set(Counter(e.contact for e in after).values()) == {1}
    assert {e.contact for e in after} == {e.contact for e in found.events if e.kind == "closes"}
    assert_allclose([e.t for e in after], LEAVES, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("setting", SETTINGS)
@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_a_box_is_thrown_off(mu: float, setting: str) -> None:
    """Its corners opened and closed 52 times, by rounding, and the run leapt over the rest."""
    beside = {"center_of_mass": [0.03, 0.02, 0.01], "inertia": [0.01, 0.012, 0.02]}
    thrown = box([0.3, 0.2, 0.1], [0, 0, 0.05]) | beside
    assert_lifts_once(thrown_off(thrown, mu=mu), **SETTINGS[setting])


@pytest.mark.parametrize("feet", FEET)
def test_feet_are_thrown_off(feet: str) -> None:
    standing = body(PLATE, [0, 0, 0.05])
    assert_lifts_once(thrown_off(standing, mu=0.4, kinetic=0.3, points=FEET[feet]))


def test_a_cylinder_on_its_end_is_thrown_off() -> None:
    shape = {"type": "cylinder", "radius": 0.1, "length": 0.2}
    assert_lifts_once(thrown_off(body(shape, [0, 0, 0.1]), mu=0.4))


def test_an_edge_that_is_lifted_leaves_the_other_down() -> None:
    """A force F = c t at the middle of an edge, a half width b off C: the other edge bears until
    c t b = m g b - c t b, and the corners under the force leave at c t = m g / 2, both at once."""
    pull = {"type": "wrench_table", "body": "body", "times": [0.0, 1.0], "point_B": [0.15, 0, 0.05]}
    pull |= {"forces": [[0.0, 0.0, 0.0], [0.0, 0.0, 10.0 * G]]}
    standing = scene(box([0.3, 0.2, 0.1], [0, 0, 0.05]), touch(mu=0.5), pull=pull)
    found = contact_run(standing, np.linspace(0.0, 0.06, 7).tolist())
    opened = [e for e in found.events if e.t > 0.0 and e.kind == "opens"]
    assert_allclose([e.t for e in opened], [0.05, 0.05], rtol=0.0, atol=1e-9)
    states = found.trajectory.contact_state
    down = [name for name in states if name.startswith("floor/") and states[name][-1] > 0.0]
    assert len(down) == 2
    assert not set(down) & {e.contact for e in opened}


@pytest.mark.parametrize("mu", [0.859, 0.8589195577097951, 0.762, 0.3])
def test_a_box_on_a_slope_at_its_very_bound_stays(mu: float) -> None:
    """tan(slope) = mu. At the begin of a step a push that falls by rounding is no lift-off."""
    lean, half = math.atan(mu), 0.1
    normal = [math.sin(lean), 0.0, math.cos(lean)]
    placed = box([2 * half] * 3, [half * x for x in normal])
    placed["orientation"] = {"axis": [0, 1, 0], "angle": lean}
    plane = {"type": "plane", "normal": normal}
    found = contact_run(scene(placed, touch(mu=mu, surface=plane)), [0.0, 0.1, 0.2], tolerance=1e-9)
    assert not [e for e in found.events if e.kind in ("opens", "impact")]
    moved = found.trajectory.block.position - found.trajectory.block.position[0]
    assert np.abs(moved).max() < 1e-12
