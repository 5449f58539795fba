# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Two ways to the same motion and the same reactions: reduced coordinates, explicit multipliers.

Reduced coordinates integrate the free directions of a joint and find its reaction from Newton-Euler
afterwards; maximal ones integrate all six and find it from the multipliers.  They share no
equation of motion.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from tests.oracles.to_scene import scene_of
from tests.runs import trajectory


def test_multiplier_of_lagranges_equations(cases: dict[str, Any]) -> None:
    """A knife edge on an incline by LL 38.5, in generalised coordinates (x, y, phi).

    L = m (x'^2 + y'^2)/2 + J phi'^2/2 + m g x sin(alpha), x down the slope, and
    x' sin(phi) - y' cos(phi) = 0 give  m x'' = m g sin(alpha) + lambda sin(phi),
    m y'' = -lambda cos(phi), and with the constraint differentiated once more
    lambda = -m (g sin(alpha) sin(phi) + phi' (x' cos(phi) + y' sin(phi))).
    """
    case = cases["knife_edge_incline"]
    m, g = case["body"]["mass"], -case["gravity"][2]
    normal = np.array(case["constraint"]["plane_normal"])
    down = np.array([normal[2], 0.0, -normal[0]])
    across = np.cross(normal, down)
    run = trajectory(scene_of(case), duration=3.0, rate=20.0, tolerance=1e-13)
    blade = Rotation.from_quat(run.orientation[:, 0]).apply([1.0, 0.0, 0.0])
    phi = np.arctan2(blade @ across, blade @ down)
    speed = run.linear_velocity[:, 0]
    along = speed @ down * np.cos(phi) + speed @ across * np.sin(phi)
    spin = run.angular_velocity[:, 0, 2]
    multiplier = -m * (g * math.sin(math.atan2(normal[0], normal[2])) * np.sin(phi) + spin * along)
    expected = multiplier[:, None] * (np.sin(phi)[:, None] * down - np.cos(phi)[:, None] * across)
    force = run.reaction_force[:, 2]
    assert_allclose(force, expected, rtol=0.0, atol=1e-11 * np.abs(force).max())
