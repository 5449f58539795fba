# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How deep sides lie in supports: beside distances in closed form and points one by one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.contacts.touching import edges_of_box
from rb_sim.catalogue.geometry.pairs import BallOnCylinder
from rb_sim.catalogue.geometry.solids import Box, Cylinder
from rb_sim.contact.tunnelling import deepest_of_edges, depth_in, entering, least_along

BOX = Box((1.0, 2.0, 3.0), (0.5, 0.3, 0.2))
DRUM = Cylinder((1.0, 2.0, 3.0), 0.4, 0.25, (0.0, 0.6, 0.8))
LOG = BallOnCylinder((9.0,) * 3, 0.0, (1.0, 2.0, 3.0), (0.0, 0.6, 0.8), 0.4, 1.0)
CENTRE, E, ACROSS = np.array([1.0, 2.0, 3.0]), np.array([0.0, 0.6, 0.8]), np.array([1.0, 0.0, 0.0])


def test_depths_in_a_box() -> None:
    """Beside a face, an edge, a corner, and within, below the nearest face."""
    places = np.array([[0.7, 0.1, 0.1], [0.8, -0.7, 0.0], [-0.6, 0.5, 0.4], [0.4, 0.1, 0.0],
                       [0.1, -0.05, 0.12], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])  # fmt: skip
    wanted = [0.2, 0.5, 0.3, -0.1, -0.08, -0.2, 0.0]
    assert_allclose(depth_in(BOX, CENTRE + places), wanted, atol=1e-15)


def test_depths_in_a_cylinder_and_in_one_without_ends() -> None:
    """Beside its mantle, an end, a rim, and within."""
    at = np.array(
        [[0.6, 0.1], [0.1, -0.45], [0.7, 0.65], [-0.35, 0.0], [0.1, 0.2]]
    )  # across, along
    places = CENTRE + at[:, :1] * ACROSS + at[:, 1:] * E
    assert_allclose(depth_in(DRUM, places), [0.2, 0.2, 0.5, -0.05, -0.05], atol=1e-15)
    assert_allclose(depth_in(LOG, places), [0.2, -0.3, 0.3, -0.05, -0.3], atol=1e-15)


@pytest.mark.parametrize("support", [BOX, DRUM, LOG], ids=["box", "drum", "log"])
def test_edges_are_as_deep_as_the_deepest_of_their_points(support: Any) -> None:
    """A thousand of them, one by one; also those whose ends are out of it."""
    rng = np.random.default_rng(5)
    edges = CENTRE + rng.normal(size=(40, 3, 2, 3)) * 0.5
    share = np.linspace(0.0, 1.0, 1001)[:, None]
    start, end = edges[:, :, None, 0], edges[:, :, None, 1]
    depths = depth_in(support, start + share * (end - start))
    least, ends = deepest_of_edges(support, edges)
    assert_allclose(ends, depths[:, :, [0, -1]].min(axis=(1, 2)), rtol=1e-14)
    wanted = depths.min(axis=(1, 2))
    assert ((least <= wanted + 1e-12) | (wanted > 0.0)).all()
    assert_allclose(least[wanted < 0.0], wanted[wanted < 0.0], atol=3e-3)
    assert ((wanted < -0.01) & (ends > 0.01)).any()
    one = least_along(support, edges[:, 0, 0], edges[:, 0, 1] - edges[:, 0, 0])
    assert_allclose(one, depths[:, 0].min(axis=1), atol=3e-3)


def sides(support: Any, **more: Any) -> Any:
    return SimpleNamespace(own=BOX, support=support, **more)


def test_rims_and_edges_of_the_support_that_enter_the_body() -> None:
    """A drum whose end, or whose mantle, reaches 0.05 m into a face of the body's box; a box that
    does so with an edge; of a log nothing is asked."""
    turn = Rotation.from_rotvec([[0.3, -0.2, 0.1]] * 2)
    drum = Cylinder((0.0, 0.0, 0.0), 0.1, 0.25, (0.0, 0.0, 1.0))
    stands = Rotation.identity(2).as_quat(), CENTRE + [[0.1, 0.0, 0.4], [0.1, 0.0, 0.46]]
    assert_allclose(entering(sides(drum), *stands), [-0.05, 0.01], atol=1e-14)
    lies = (
        Rotation.from_rotvec([[0.0, 0.5 * np.pi, 0.0]] * 2).as_quat(),
        CENTRE + [[0, 0, 0.25], [0, 0, 0.31]],
    )
    assert_allclose(entering(sides(drum), *lies), [-0.05, 0.01], atol=1e-14)
    leans = turn.as_quat(), CENTRE + [[0.0, 0.0, 0.4], [0.2, 0.1, 0.35]]
    angles = np.linspace(0.0, 2.0 * np.pi, 20001)
    rim = 0.1 * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    for k, found in enumerate(entering(sides(drum), *leans)):
        points = [turn[k].apply(rim + [0, 0, z]) + leans[1][k] for z in (0.25, -0.25)]
        assert_allclose(found, min(depth_in(BOX, p).min() for p in points), atol=1e-8)
    small = Box((0.0, 0.0, 0.0), (0.2, 0.2, 0.2))
    edges = edges_of_box(small)
    share = np.linspace(0.0, 1.0, 401)[:, None, None]
    at = turn[0].apply((edges[:, 0] + share * (edges[:, 1] - edges[:, 0])).reshape(-1, 3))
    shift = CENTRE + [[0.5, 0.2, 0.25], [0.4, 0.1, 0.1]]
    for k, found in enumerate(entering(sides(small), turn.as_quat(), shift)):
        assert_allclose(found, depth_in(BOX, at + shift[k]).min(), atol=2e-3)
    assert np.isinf(entering(sides(LOG), turn.as_quat(), shift)).all()
