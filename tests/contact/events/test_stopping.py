# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What is left of a slip that ends is taken away where it is, and stops nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.contact.scenes import box, scene, touch
from tests.runs import trajectory

CREEP = 1e-6
"""Slip at which the corner of the law is rounded that the other is compared with [m/s]."""
BOXES = {
    "tall": (
        box((0.113, 0.133, 0.192), [0.0, 0.0, 0.09552298875])
        | {
            "mass": 0.778,
            "orientation": {"axis": [-0.519, 0.158, 0.0], "angle": 7.66e-4},
            "linear_velocity": [4.09e-4, -3.67e-4, 4.72e-4],
            "angular_velocity": [-0.0152, -0.0158, -0.0106],
        },
        {"stiffness": 4000.0},
        0.368,
    ),
    "flat": (
        box((0.184, 0.122, 0.0936), [0.0, 0.0, 0.04664671875])
        | {
            "mass": 0.475,
            "orientation": {"axis": [0.919, 0.993, 0.0], "angle": 3.71e-4},
            "linear_velocity": [2.67e-4, 3.54e-4, 1.09e-3],
            "angular_velocity": [0.00683, 0.04, 0.00492],
        },
        {"stiffness": 7600.0},
        0.498,
    ),
}
"""(box, its support, coefficient of friction)."""


@pytest.mark.parametrize("name", BOXES)
def test_corners_that_creep_let_a_box_rock(name: str) -> None:
    """A box rocks on a floor that gives way, its corners creep.  Two of them at rest leave no
    rocking across the line through both: where the slip of one turned, it was ended, and the
    rocking with it, over and over, which left angular velocities wrong by a tenth."""
    moving, compliance, mu = BOXES[name]

    def of(friction: dict[str, Any]) -> Any:
        floor = touch(friction=friction, compliance=compliance)
        mapping = scene(moving, floor)
        return trajectory(mapping | {"simulation": {"duration": 0.01, "rate": 1000.0}})

    found = of({"type": "coulomb", "static": mu})
    rounded = of({"type": "regularised", "coefficient": mu, "speed": CREEP})
    for field in ("angular_velocity", "linear_velocity"):
        error = getattr(found, field) - getattr(rounded, field)
        np.testing.assert_allclose(error, 0.0, atol=1e-4, err_msg=field)
