# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rims on circular cylinders: two points of one rim, each with a place of its own."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.contact.scenes import G, body, scene, touch
from tests.contact_runs import contact_run

R, RADIUS = 1.0, 0.3
TROUGH: dict[str, Any] = {"surface": {"type": "cylinder", "axis": [1, 0, 0], "radius": R}}


def across_the_trough(angle: float, **more: Any) -> dict[str, Any]:
    """A thin disk that lies across a trough, turned about its axis x by the angle."""
    low = -math.sqrt(R**2 - RADIUS**2)
    turned = {"axis": [1.0, 0.0, 0.0], "angle": angle}
    at = [0.0, -low * math.sin(angle), low * math.cos(angle)]
    return scene(
        body({"type": "disk", "radius": RADIUS}, at, orientation=turned), touch(**TROUGH, **more)
    )


def test_swings_on_two_points() -> None:
    """A pendulum, w^2 = g h / (h^2 + r^2/4), h from the trough's axis to the disk."""
    h, tilt = math.sqrt(R**2 - RADIUS**2), 1e-3
    rate = math.sqrt(G * h / (h**2 + 0.25 * RADIUS**2))
    t = np.linspace(0.0, 4.0 / rate, 9)
    found = contact_run(across_the_trough(tilt), t.tolist(), tolerance=1e-12)
    y = found.trajectory.position["body"][:, 1]
    assert_allclose(y / h, tilt * np.cos(rate * t), rtol=0.0, atol=1e-6 * tilt)
    for point in ("floor/1", "floor/2"):
        assert np.all(found.trajectory.contact_state[point] == 1.0)
    assert found.balance() <= 1e-12


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_falls_flat(mu: float) -> None:
    """Dropped nearly flat it strikes with both sides in turns and comes to lie on both: it neither
    sinks in nor gains, and the run ends."""
    falling = across_the_trough(0.0, mu=mu)
    falling["bodies"]["body"]["position"][2] += 0.02
    falling["bodies"]["body"]["orientation"]["angle"] = 0.05
    found = contact_run(falling, np.linspace(0.0, 0.6, 31).tolist(), tolerance=1e-10)
    closed = [found.trajectory.contact_state[point] > 0.0 for point in ("floor/1", "floor/2")]
    assert np.any(closed[0] & closed[1])
    assert found.trajectory.residual.max() <= 1e-10
    assert np.diff(found.trajectory.energy).max() <= 1e-9
    assert found.balance() <= 1e-9
