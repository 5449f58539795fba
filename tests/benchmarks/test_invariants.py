# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The judges of random scenes find nothing in a good run, and what is done to it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.contact.invariants import broken, tensor
from benchmarks.contact.overlaps import overlap
from benchmarks.contact.shapes import depth_in_round
from benchmarks.contact.toss_verdicts import run
from rb_sim.simulation.trajectory import Trajectory
from tests.contact.scenes import ball, scene, touch


@pytest.fixture(scope="module")
def good() -> tuple[dict[str, Any], Trajectory]:
    """A ball with its centre of mass beside its middle slips on a turntable."""
    moving = {"linear_velocity": [1.0, 0.3, 0.0], "angular_velocity": [5.0, 0.0, 2.0]}
    thrown = ball([0, 0, 0.12], inertia=[4e-3, 5e-3, 6e-3], center_of_mass=[0, 0.02, 0], **moving)
    law = touch(mu=0.3, kinetic=0.2, motion={"type": "turntable", "rate": 3.0})
    settings = {"duration": 0.3, "rate": 2000.0, "tolerance": 1e-10}
    mapping = scene(thrown, law) | {"simulation": settings}
    return mapping, run(mapping)


def found(good: tuple[dict[str, Any], Trajectory], **changed: Any) -> str:
    """What is broken where arrays of the run are multiplied so."""
    mapping, trajectory = good
    block = trajectory.block
    arrays = {name: getattr(block, name) * np.array(factor) for name, factor in changed.items()}
    return "; ".join(broken(mapping, Trajectory(replace(block, **arrays), trajectory.layout)))


def test_the_judge_knows_the_inertia_of_rods_and_of_disks_about_any_axis() -> None:
    """A rod without a radius has 0.001 of its length; m r^2/2 is about the disk's own axis."""
    rod = {"type": "rod", "length": 2.0, "axis_B": [1.0, 0.0, 0.0]}
    across = 3.0 * (3.0 * 0.002**2 + 4.0) / 12.0
    expected = np.diag([3.0 * 0.002**2 / 2.0, across, across])
    np.testing.assert_allclose(
        tensor({"mass": 3.0, "shape": rod}), expected, rtol=1e-13, atol=1e-14
    )
    disk = {"type": "disk", "radius": 2.0, "axis_B": [0.0, 1.0, 0.0]}
    expected = np.diag([3.0, 6.0, 3.0])
    np.testing.assert_allclose(
        tensor({"mass": 3.0, "shape": disk}), expected, rtol=1e-13, atol=1e-14
    )


def test_nothing_is_broken_in_a_good_run(good: Any) -> None:
    assert found(good) == ""


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"contact_work": 1.01}, "energy changes"),
        ({"reaction_force": 1.02}, "linear momentum of body"),
        ({"reaction_force": [-1.0, -1.0, 1.0]}, "breaks its coulomb law"),
        ({"reaction_force": -1.0}, "pulls with"),
        ({"anchor": [1.1, 1.0, 1.0]}, "angular momentum of body"),
        ({"residual": 1e9}, "residual"),
        ({"position": [1.0, 1.0, 1.0 - 1e-5]}, "floor sinks by"),
    ],
)
def test_what_is_done_to_it_is_found(good: Any, changed: dict[str, Any], words: str) -> None:
    assert words in found(good, **changed)


# The judge of tosses sees overlaps of known depth, and none where bodies just touch.


BOX = {"type": "box", "size": [0.2, 0.3, 0.4]}
ROD = {"type": "rod", "length": 0.5, "axis_B": [0.0, 0.0, 1.0]}
DRUM = {"type": "cylinder", "radius": 0.5, "length": 1.0, "axis_B": [1.0, 0.0, 0.0]}
BALL = {"type": "sphere", "radius": 0.5}
EGG = {"type": "ellipsoid", "semi_axes": [0.1, 0.2, 0.3]}
DISK = {"type": "disk", "radius": 0.1, "axis_B": [0.0, 0.0, 1.0]}
EDGE = 0.5 * np.hypot(0.2, 0.3)
"""Reach of the box where one of its long edges points downwards."""
ACROSS = Rotation.from_euler("y", 0.5 * np.pi)
"""Lays what stands along z along x."""


def edge_down() -> Rotation:
    """Turns the box's edge towards +x, +y downwards."""
    corner = np.array([0.1, 0.15, 0.0]) / EDGE
    third = np.cross([0.0, 0.0, 1.0], corner)
    return Rotation.from_matrix(np.array([[0.0, 0.0, 1.0], third, -corner]))


@pytest.mark.parametrize(
    ("shape", "turn", "low", "other", "top"),
    [
        (BOX, Rotation.identity(), 0.2, BOX, 0.2),
        (BOX, edge_down(), EDGE, DRUM, 0.5),
        (BOX, edge_down(), EDGE, BALL, 0.5),
        (ROD, ACROSS, 0.0, DRUM, 0.5),
        (ROD, Rotation.identity(), 0.25, DRUM, 0.5),
        (DISK, ACROSS, 0.1, BALL, 0.5),
        (EGG, Rotation.identity(), 0.3, BALL, 0.5),
        (EGG, Rotation.identity(), 0.3, BOX, 0.2),
        (EGG, ACROSS, 0.1, DRUM, 0.5),
    ],
)
@pytest.mark.parametrize("depth", [1e-3, 0.0, -3e-9])
def test_overlap_is_as_deep_as_it_was_made(shape, turn, low, other, top, depth):
    """Side on side, edge on side, end on side: also where both are turned together."""
    whole = Rotation.from_rotvec([0.3, -0.7, 0.4])
    aside = 0.02 if shape in (BOX, ROD) and other is not BALL else 0.0
    p = whole.apply([[aside, 0.0, low + top - depth]])
    q, place = (whole * turn).as_quat()[None], (np.zeros((1, 3)), whole.as_quat()[None])
    found = overlap(shape, (p, q), other, place)[0]
    assert abs(found - depth) < 2e-11 + 0.02 * depth if depth >= 0.0 else found < 0.0


def test_a_rod_just_beside_an_edge_is_apart_from_it():
    """Only normals within a sliver between those of the edge's faces part them (toss 3176, where
    the grids end 0.3 rad from it); so it is at random edges and rods."""
    rng = np.random.default_rng(3)
    n, half = 200, 0.5 * np.array(BOX["size"])
    angle, height = rng.uniform(0.1, 1.4, n), rng.uniform(-0.15, 0.15, n)
    normal = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    level = np.stack([-np.sin(angle), np.cos(angle), np.zeros(n)], axis=1)
    lean = rng.uniform(0.2, 1.5, n)[:, None]
    along = np.cos(lean) * [0.0, 0.0, 1.0] + np.sin(lean) * level
    shift = rng.uniform(-0.24, 0.24, n)[:, None]
    edge = np.stack([np.full(n, half[0]), np.full(n, half[1]), height], axis=1)
    p = edge + 1e-10 * normal + shift * along
    turn = Rotation.concatenate([Rotation.align_vectors([a], [[0, 0, 1]])[0] for a in along])
    place = np.zeros((n, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    rows = [slice(i, i + 40) for i in range(0, n, 40)]
    found = [overlap(ROD, (p[r], turn[r].as_quat()), BOX, (place[0][r], place[1][r])) for r in rows]
    assert np.concatenate(found).max() < 0.0


def test_an_ellipsoid_that_reaches_out_of_a_bowl_is_seen():
    """Its farthest point from the middle lies along its longest axis."""
    bowl = {"type": "sphere", "radius": 3.0, "center": [0.0, 0.0, 3.0]}
    turn = Rotation.from_rotvec([0.5, 1.0, -0.3])
    p = np.array([0.0, 0.0, 3.0]) + turn.apply([0.0, 0.0, -2.7 - 1e-8])
    found = depth_in_round(EGG, p[None], turn.as_quat()[None], bowl)
    assert found[0] == pytest.approx(1e-8, abs=1e-13)
