# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Impacts of a face, whose corners may share the push in many ways: one way, told if it matters."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.contact.coupled_scenes import coupled_scene
from rb_sim import Simulation, load_scene
from tests.contact.scenes import box, scene, touch

TIMES = {"duration": 0.01, "rate": 100.0, "method": "dopri853", "tolerance": 1e-12}
MU = 0.3


def landed(thing: dict[str, Any], mu: float = MU) -> Simulation:
    mapping = scene(thing, touch(mu=mu)) | {"simulation": TIMES}
    simulation = Simulation(load_scene(mapping), announce=None)
    simulation.run()
    return simulation


def told(simulation: Simulation) -> int:
    return sum(event.kind == "ambiguous" for event in simulation.events)


def brick(slip: list[float], spin: float, tilt: float = 0.0) -> dict[str, Any]:
    """It comes down flat, but for the tilt [rad], slipping and spinning about the vertical."""
    moves = {"linear_velocity": [*slip, -1.0], "angular_velocity": [0.0, 0.0, spin]}
    turn = {"axis": [0.6, 0.8, 0.0], "angle": tilt}
    return box([0.3, 0.2, 0.1], [0.0, 0.0, 0.051], orientation=turn) | moves


def test_a_face_whose_corners_slip_apart_is_told_and_no_rounding_decides() -> None:
    """Which corner bears more turns the slip; a tilt of rounding has no part in it."""
    ends = []
    for tilt in (0.0, 1e-15, -1e-15, 1e-13):
        simulation = landed(brick([1.0, 0.0], 5.0, tilt))
        assert told(simulation) == 1
        ends.append(simulation.sample().block.linear_velocity)
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], atol=1e-9)


@pytest.mark.parametrize(
    ("slip", "spin", "mu"), [([1.0, 0.5], 0.0, MU), ([0.0, 0.0], 0.0, MU), ([1.0, 0.0], 5.0, 0.0)]
)
def test_a_face_whose_shares_change_nothing_is_not_told(
    slip: list[float], spin: float, mu: float
) -> None:
    """All corners slip one way, or stick, or none rubs: the motion is unique."""
    assert told(landed(brick(slip, spin), mu)) == 0


def test_three_points_share_a_push_in_one_way() -> None:
    feet = [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]]
    mapping = scene(brick([1.0, 0.0], 5.0), touch(mu=MU, points=feet)) | {"simulation": TIMES}
    simulation = Simulation(load_scene(mapping), announce=None)
    simulation.run()
    assert told(simulation) == 0
    assert sum(event.kind == "impact" for event in simulation.events) == 3


def test_a_box_that_tips_over_an_edge_ends_alike_at_every_tolerance() -> None:
    """On a belt: two corners bear when the other two strike, and all slip in several directions.
    Rounding chose the corners that had a part in it, and the ends were 5e-3 apart."""
    mapping = dict(coupled_scene(777, 63).mapping)
    ends = []
    for tolerance in (1e-10, 1e-11, 1e-12):
        times = {"duration": 0.5, "rate": 20.0, "method": "dopri853", "tolerance": tolerance}
        simulation = Simulation(load_scene(mapping | {"simulation": times}), announce=None)
        ends.append(simulation.run().position["b"][-1])
        assert told(simulation) == 1
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], atol=1e-8)
