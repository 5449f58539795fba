# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Linear models of scenes that are held more than they need be, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.linear import LinearModel

LEAF, MASSES, MOMENTS, STIFFNESS = 0.8, (3.0, 2.0), (0.16, 0.11), (40.0, 15.0)


def model(at: float = 0.0, **scene: Any) -> LinearModel:
    """Of the scene at that time."""
    simulation = Simulation(load_scene(scene), announce=None)
    if at:
        simulation.advance(at)
    return simulation.linearize()


def hinges(leaf: str, parent: str | None) -> dict[str, Any]:
    """Three of a leaf, one above the other: ten of fifteen lines too many."""
    axis = {"type": "fixed_axis", "body": leaf, "axis_B": [0, 0, 1], "bearing_distance": 0.1}
    axis |= {"parent": parent} if parent else {}
    heights = (-0.5, 0.0, 0.7)
    points = [{"point_B": [-0.5 * LEAF, 0, z]} for z in heights]
    return {f"{leaf}{k}": axis | point for k, point in enumerate(points)}


@pytest.mark.parametrize("at", [0.0, 0.5])
def test_a_folding_door_on_three_hinges_each_swings_as_two_rods_do(at: float) -> None:
    """det(K - w^2 M) = 0 with the springs of its hinges; at rest it stays where it is."""
    bodies, joints, springs = {}, {}, {}
    for k, (leaf, parent) in enumerate((("a", None), ("b", "a"))):
        inertia = [0.1, 0.12, MOMENTS[k]]
        place = [(k + 0.5) * LEAF, 0, 0]
        bodies[leaf] = {"mass": MASSES[k], "inertia": inertia, "position": place}
        joints |= hinges(leaf, parent)
        spring = {"type": "torsion_spring", "body": leaf, "axis_B": [0, 0, 1]}
        springs[leaf] = (
            spring | {"stiffness": STIFFNESS[k]} | ({"parent": parent} if parent else {})
        )
    found = model(at, bodies=bodies, constraints=joints, effects=springs)
    (m1, m2), (j1, j2), (k1, k2) = MASSES, MOMENTS, STIFFNESS
    mixed = 0.5 * m2 * LEAF**2
    first, second = j1 + 0.25 * m1 * LEAF**2 + m2 * LEAF**2, j2 + 0.25 * m2 * LEAF**2
    masses = np.array([[first, mixed], [mixed, second]])
    squared = np.linalg.eigvals(np.linalg.solve(masses, [[k1 + k2, -k2], [-k2, k2]]))
    assert len(found.states) == 4
    np.testing.assert_allclose(np.real(found.eigenvalues), 0.0, atol=1e-9)
    pairs = np.sort(np.abs(np.imag(found.eigenvalues)))
    np.testing.assert_allclose(pairs, np.sort(np.repeat(np.sqrt(squared), 2)), rtol=1e-9)


@pytest.mark.parametrize("at", [0.0, 0.3])
@pytest.mark.parametrize("share", [0.5, 0.999, 2.0])
def test_a_top_that_stands_on_two_balls_and_a_rod_sleeps_from_its_threshold_on(
    share: float, at: float
) -> None:
    """Growth sqrt(4 I1 m g l - M3^2) / 2 I1 below it, none above (LL section 35, problem 2)."""
    mass, lever, across, axial, g = 1.3, 0.4, 0.05, 0.02, 9.81
    about = across + mass * lever**2
    threshold = math.sqrt(4.0 * about * mass * g * lever) / axial
    body = {"mass": mass, "inertia": [across, across, axial], "position": [0, 0, lever]}
    ball = {"type": "fixed_point", "body": "top", "point_B": [0, 0, -lever]}
    rod = {"type": "distance", "body": "top", "point_A": [0, 0, 0]}
    found = model(
        at,
        bodies={"top": body | {"angular_velocity": [0, 0, share * threshold]}},
        constraints={"ball": ball, "again": ball, "rod": rod},
        effects={"weight": {"type": "gravity"}},
    )
    growth = math.sqrt(max(0.0, 1.0 - share**2)) * axial * threshold / (2.0 * about)
    assert len(found.states) == 6
    assert np.real(found.eigenvalues).max() == pytest.approx(growth, abs=1e-8)
