# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Event functions that pass through zero and come back within a step: none is missed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from benchmarks.contact.shapes import depth_below
from benchmarks.contact.stick_slips import Block, judged, pulled
from tests.contact.scenes import body, scene, touch
from tests.contact_runs import contact_run

DISK = {"type": "disk", "radius": 0.1, "axis_B": [0.0, 0.0, 1.0]}


HASTY = Block(w=10.0, d=0.1, ratio=0.15, mass=1.0, kinetic=0.3)
"""It is pulled so fast that its slip falls below zero by 1 % only, for a twentieth of a period."""


def stick_slip(options: dict[str, Any]) -> str:
    return judged(pulled(HASTY, 1, options, ""))[0]


OPTIONS: dict[str, dict[str, Any]] = {
    "loose": {"method": "dopri853", "tolerance": 1e-4},
    "tight": {"method": "dopri853", "tolerance": 1e-9},
    "a tenth of a period": {"method": "rk4", "step": 0.0628},
}


@pytest.mark.parametrize("name", OPTIONS)
def test_no_stick_is_missed(name: str) -> None:
    """Piecewise sinusoids: a slip that dips below zero for a moment within a step."""
    assert stick_slip(OPTIONS[name]) == "fine"


def tossed(**contact: Any) -> dict[str, Any]:
    """A disk tossed up with spin and a wobble: in one long step its lean turns right round."""
    start = body(
        DISK,
        [0.0, 0.0, 0.12],
        orientation={"axis": [0.0198, 0.0189, 0.0], "angle": 0.02736},
        angular_velocity=[0.3147, -1.607, 25.36],
        linear_velocity=[0.2, 0.0, 1.0942],
    )
    return scene(start, touch(mu=0.3, **contact))


def test_tossed_disk_does_not_sink() -> None:
    """Its low point follows from the state alone while it is in flight."""
    times = np.linspace(0.0, 0.33, 100)
    found = contact_run(tossed(restitution=0.4), times, tolerance=1e-6)
    r = found.trajectory
    depth = depth_below(DISK, r.position["body"], r.orientation["body"], [0.0, 0.0, 1.0])
    assert depth.max() <= 1e-10
    assert found.times("impact")
    assert np.diff(r.energy).max() <= 1e-9


def test_tossed_disk_finds_soft_ground() -> None:
    """The support pushes exactly where the rim is below it."""
    soft = {"compliance": {"stiffness": 2000.0}}
    times = np.linspace(0.2, 0.3, 60)
    r = contact_run(tossed(**soft), times, tolerance=1e-9).trajectory
    depth = depth_below(DISK, r.position["body"], r.orientation["body"], [0.0, 0.0, 1.0])
    assert depth.max() > 1e-4
    push = r.reaction["floor"].force[:, 2]
    assert_allclose(push, 2000.0 * np.maximum(0.0, depth), atol=1e-8)


def overlap_seen() -> float:
    """What the residual of a sample tells of a ball set 1 mm into the floor, its contact open."""
    from rb_sim import load_scene
    from rb_sim.mechanics.contact.contact_bodies import CLOSED
    from rb_sim.mechanics.system import sample
    from rb_sim.motion.motion import row_width
    from rb_sim.scene.compile import compile_scene

    ball = body({"type": "sphere", "radius": 0.5}, [0.0, 0.0, 0.5])
    compiled = compile_scene(load_scene(scene(ball, touch())))
    y, out = compiled.y.copy(), np.zeros(row_width(compiled.layout))
    y[2] -= 1e-3
    compiled.system.touch[:, CLOSED] = 0.0
    sample(compiled.system, 0.0, y, out)
    return float(out[-1 - len(compiled.layout.contacts) - 1])


def test_residual_sees_the_gap_of_an_open_contact() -> None:
    assert_allclose(overlap_seen(), 1e-3 / 0.5, rtol=1e-9)


def past_corner(depth: float, speed: float, spin: float) -> tuple[dict[str, Any], float]:
    """(A rod whose lower end goes in by the top of a fixed cube and out by its side, the time at
    which it is at the top).

    At 0.3 s it stands upright, its end below the edge along y by `depth` in x and z; it moves
    straight, and turns about y.
    """
    half, length, when = 0.5, 0.3, 0.3
    velocity = speed * np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0)
    centre = np.array([half - depth, 0.0, half - depth + 0.5 * length])

    def end(t: float) -> Any:
        angle = spin * (t - when)
        arm = 0.5 * length * np.array([np.sin(angle), 0.0, np.cos(angle)])
        return centre + velocity * (t - when) - arm

    def inside(t: float) -> float:
        return float(max(end(t)[0], end(t)[2]) - half)

    before = next(t for t in when - np.arange(0.0, 0.3, 1e-5) if inside(t) > 0.0)
    rod = body(
        {"type": "rod", "length": length},
        (centre - velocity * when).tolist(),
        orientation={"axis": [0.0, 1.0, 0.0], "angle": -spin * when},
        angular_velocity=[0.0, spin, 0.0],
        linear_velocity=velocity.tolist(),
    )
    cube = {"mass": 1.0, "shape": {"type": "box", "size": [2.0 * half] * 3}}
    contact = touch(parent="cube", surface={"type": "shape"}, restitution=0.5)
    mapping = scene(rod, contact, gravity=False)
    mapping["bodies"]["cube"] = cube
    return mapping, float(brentq(inside, before, when, xtol=1e-14))


@pytest.mark.parametrize("spin", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("speed", [1.0, 12.0])
@pytest.mark.parametrize("depth", [1e-4, 1e-3, 1e-2])
def test_no_point_cuts_through_a_corner(depth: float, speed: float, spin: float) -> None:
    """In by one face and out by the next, the gap to a solid has a kink between, in one step."""
    mapping, hit = past_corner(depth, speed, spin)
    found = contact_run(mapping, np.array([0.0, 0.8]), tolerance=1e-10)
    assert_allclose(found.times("impact")[0], hit, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("setting", [{"tolerance": 1e-3}, {"tolerance": 1e-4}, {"tolerance": 1e-6}])
@pytest.mark.parametrize("start", [-0.6, 0.2, 0.6, 1.0])
def test_a_soft_floor_is_met_within_a_long_step(start: float, setting: dict[str, Any]) -> None:
    """The end of a rod that spins at w, h above a soft floor, is at h - (l/2) sin(w t - start): no
    loose tolerance may step over the time in which it is below."""
    h, half, w, stiffness = 0.08, 0.085, 40.0, 1e4
    shape = {"type": "rod", "length": 2.0 * half, "axis_B": [1.0, 0.0, 0.0]}
    spinning = body(shape, [0.0, 0.0, h], angular_velocity=[0.0, w, 0.0])
    spinning["orientation"] = {"axis": [0.0, 1.0, 0.0], "angle": -start}
    soft = touch(compliance={"stiffness": stiffness})
    meets = (start + math.asin(h / half)) / w
    found = contact_run(scene(spinning, soft, gravity=False), [0.0, 1.5 * meets], **setting)
    assert_allclose(found.times("closes")[:1], [meets], rtol=0.0, atol=1e-3)
