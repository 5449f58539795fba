# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Loads that are no number: a step that is too long ends a run in one line, whoever meets them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.base.errors import StepTooLargeError
from tests.contact.scenes import ball, scene, touch


def pulled(speed: float) -> dict[str, Any]:
    """A ball that flies from 0.5 m to where a spring with a length is fixed, at 1 m."""
    spring = {
        "type": "spring", "body": "ball", "point_A": [0, 0, 1], "stiffness": 10.0,
        "rest_length": 0.2,
    }  # fmt: skip
    bodies = {"ball": ball([0, 0, 0.5], linear_velocity=[0, 0, speed])}
    mapping = scene(bodies, {"floor": touch("ball")}, gravity=False, spring=spring)
    run = {"method": "time_stepping", "step": 0.1, "duration": 0.1, "rate": 10.0}
    return mapping | {"simulation": run}


def test_a_spring_that_has_lost_its_direction_ends_the_run() -> None:
    """In the middle of the first step its ends meet exactly."""
    with pytest.raises(
        StepTooLargeError, match=r"no longer finite at t = 0 s: step 0\.1 s is too large"
    ):
        Simulation(pulled(10.0)).run()
    assert np.isfinite(Simulation(pulled(10.1)).run().energy).all()
