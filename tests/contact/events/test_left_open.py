# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motions that the laws of contact leave open are told once, where other ends differ by more than
the setting tells apart."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.contact.events.shares import IMPACT, OPEN_SHARES
from tests.contact.events.test_undetermined_impacts import MU, brick
from tests.contact.scenes import box, scene, touch

SIZE, SLIP, SPIN, G = (0.3, 0.2, 0.1), 1.0, 5.0, 9.81
TIMES = {"duration": 0.01, "rate": 100.0, "method": "dopri853"}


def sliding(slip: float, spin: float, mu: float = MU) -> dict[str, Any]:
    """A box of 1 kg flat on a floor."""
    moves = {"linear_velocity": [slip, 0.0, 0.0], "angular_velocity": [0.0, 0.0, spin]}
    return scene(box(list(SIZE), [0.0, 0.0, 0.05]) | moves, touch(mu=mu))


def told(mapping: dict[str, Any], **setting: Any) -> tuple[Simulation, list[str]]:
    """The run, and its warnings of what is ambiguous."""
    simulation = Simulation(load_scene(mapping | {"simulation": TIMES | setting}), announce=None)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        simulation.run()
    lines = [str(warning.message) for warning in caught]
    return simulation, [line for line in lines if line.startswith("ambiguous")]


def apart_by_hand(slip: float, spin: float, length: float) -> float:
    """The largest change of a box's acceleration (v, length w) from that of the least pushes to
    that of others which push everywhere."""
    corners = np.array([[x, y, -0.05] for x in (-0.15, 0.15) for y in (-0.1, 0.1)])
    slips = np.array([slip, 0.0, 0.0]) + np.cross([0.0, 0.0, spin], corners)
    push = np.array([0.0, 0.0, 1.0]) - MU * slips / np.linalg.norm(slips, axis=1)[:, None]
    inertia = np.array([0.2**2 + 0.1**2, 0.3**2 + 0.1**2, 0.3**2 + 0.2**2]) / 12.0
    change = np.hstack([push, np.cross(corners, push) / inertia]).T
    held = change[[2, 3, 4]]  # heave, roll and pitch, which the floor stops
    least = np.linalg.lstsq(held, [G, 0.0, 0.0], rcond=None)[0]
    free = np.linalg.svd(held)[2][-1]
    ways = (free, -free)
    far = max(min(-n / z for n, z in zip(least, way, strict=True) if z < 0) for way in ways)
    weights = [1.0] * 3 + [length] * 3
    return far * float(np.linalg.norm(weights * (change @ free)))


def test_shares_of_a_face_that_slips_and_spins_are_told() -> None:
    simulation, lines = told(sliding(SLIP, SPIN), tolerance=1e-9)
    figure, t, contact, what, *_ = simulation.left_open
    assert (t, what, contact) == (0.0, OPEN_SHARES, "floor/1")
    length = simulation.compiled.system.length
    assert figure == pytest.approx(apart_by_hand(SLIP, SPIN, length) / G, rel=1e-6)
    assert len(lines) == 1
    assert "floor/1" in lines[0]


@pytest.mark.parametrize(
    ("slip", "spin", "mu"), [(SLIP, 0.0, MU), (0.0, SPIN, MU), (SLIP, SPIN, 0.0), (0.0, 0.0, MU)]
)
def test_shares_that_change_nothing_are_not_told(slip: float, spin: float, mu: float) -> None:
    """All rubs one way, or shares turn and push by the same, or nothing rubs or moves."""
    simulation, lines = told(sliding(slip, spin, mu), tolerance=1e-9)
    assert simulation.left_open.figure == 0.0
    assert not lines


def test_what_differs_by_less_than_the_setting_tells_apart_is_not_told() -> None:
    slow = sliding(SLIP, 0.3)
    assert len(told(slow, tolerance=1e-9)[1]) == 1
    assert not told(slow, tolerance=1e-3)[1]


def test_an_impact_of_a_face_that_spins_is_told_once_with_how_far_its_ends_are_apart() -> None:
    mapping = scene(brick([SLIP, 0.0], SPIN), touch(mu=MU, restitution=0.5))
    simulation, lines = told(mapping, tolerance=1e-9)
    figure, t, contact, what, *_ = simulation.left_open
    assert (what, contact) == (IMPACT, "floor/1")
    assert t == next(event.t for event in simulation.events if event.kind == "ambiguous")
    assert 1e-3 < figure < 0.1
    assert len(lines) == 1
    assert not told(scene(brick([SLIP, 0.0], 0.0), touch(mu=MU)), tolerance=1e-9)[1]


def test_a_new_start_forgets_what_was_left_open() -> None:
    simulation, _ = told(sliding(SLIP, SPIN), tolerance=1e-9)
    assert simulation.left_open.figure > 0.0
    simulation.set_state({"body": {"angular_velocity": [0.0, 0.0, 0.0]}})
    assert simulation.left_open.figure == 0.0


def test_a_box_without_weight_has_no_load_to_share() -> None:
    """It slides over the floor and pushes nowhere: a share of nothing was divided by nothing."""
    floating = sliding(SLIP, 0.0) | {"effects": {}}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation = Simulation(load_scene(floating | {"simulation": TIMES}), announce=None)
        run = simulation.run()
    assert simulation.left_open.figure == 0.0
    assert run.block.position[-1, 0] == pytest.approx([SLIP * 0.01, 0.0, 0.05], abs=1e-12)
