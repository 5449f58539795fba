# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The judge of random scenes with contacts finds nothing in a good run, and what is done to it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.contact.invariants import broken, tensor
from benchmarks.contact.toss_verdicts import run
from rb_sim.trajectory.trajectory import Trajectory
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
