# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Coming to rest and leaving it, where several contacts share a load that they do not determine."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.contact.scenes import G, body, box, scene, touch
from tests.contact_runs import contact_run

WALL = {"type": "plane", "normal": [1.0, 0.0, 0.0]}


def ladder(angle: float, floor: float, wall: float) -> dict[str, Any]:
    """A homogeneous rod of 1 m and 1 kg between a floor and a wall, at an angle to the floor."""
    c, s = 0.5 * math.cos(angle), 0.5 * math.sin(angle)
    turn = {"axis": [0.0, 1.0, 0.0], "angle": angle - 0.5 * math.pi}
    rod = body({"type": "rod", "length": 1.0}, [c, 0.0, s], orientation=turn)
    rod["inertia"] = [1.0 / 12.0, 1.0 / 12.0, 1e-3]
    contacts = {"floor": touch(mu=floor), "wall": touch(mu=wall, surface=WALL)}
    return scene({"body": rod}, contacts)


@pytest.mark.parametrize(("floor", "wall"), [(0.4, 0.3), (0.7, 0.05), (0.2, 0.9)])
def test_ladder_rests_down_to_its_least_angle(floor: float, wall: float) -> None:
    """Both ends at their bounds: tan(least angle) = (1 - mu_floor mu_wall)/(2 mu_floor)."""
    least = math.atan((1.0 - floor * wall) / (2.0 * floor))
    rests = contact_run(ladder(least + 1e-7, floor, wall), [0.0, 100.0], tolerance=1e-9)
    assert {e.kind for e in rests.events} <= {"closes", "sticks"}
    moved = np.diff(rests.trajectory.position["body"], axis=0)
    assert np.abs(moved).max() <= 1e-14
    for name, mu, n in (("floor", floor, 2), ("wall", wall, 0)):
        force = rests.trajectory.reaction[name].force[1]
        along = np.delete(force, n)
        assert np.linalg.norm(along) <= mu * force[n] * (1.0 + 1e-12)
    slides = contact_run(ladder(least - 1e-7, floor, wall), [0.0, 1.0], tolerance=1e-9)
    height = slides.trajectory.position["body"][:, 2]
    assert height[1] < height[0] - 1e-8


def test_corners_share_a_pull_until_none_can_take_more() -> None:
    """A block pulled off its middle by a growing force: its four corners give way as one.

    The pull F = r t at height z above the base tips the load to the front corners; all slip when
    F = mu m g, wherever the load is, and move on under what kinetic friction leaves of F.
    """
    mu, kinetic, rate, high = 0.4, 0.3, 2.0, 0.05
    table = {"times": [0.0, 10.0], "forces": [[0.0] * 3, [10.0 * rate, 0.0, 0.0]]}
    pull = {"type": "wrench_table", "body": "body"} | table
    start = box([0.4, 0.2, 2.0 * high], [0.0, 0.0, high])
    slip = mu * G / rate
    floor, times = touch(mu=mu, kinetic=kinetic), [0.0, slip + 0.01]
    found = contact_run(scene(start, floor, pull=pull), times, tolerance=1e-10)
    began = [e for e in found.events if e.kind == "slips"]
    assert len({e.contact for e in began}) == 4
    assert_allclose([e.t for e in began], slip, atol=1e-9)
    v = (mu - kinetic) * G * 0.01 + rate * 0.01**2 / 2.0
    assert_allclose(found.trajectory.linear_velocity["body"][1], [v, 0.0, 0.0], atol=1e-9)


def test_rocking_comes_to_rest() -> None:
    """A body on two feet: each impact of one lifts the other, ever less.

    With k^2 = I/m and feet at +-a below C, without rebound, an impact leaves the part
    (k^2 - a^2)/(k^2 + a^2) of the turning: after n impacts nothing is left, in finite time.
    """
    a, k2 = 0.1, 0.04
    feet = [[-a, 0.0, -1e-3], [a, 0.0, -1e-3]]
    tilt = 0.02
    start = body(
        {"type": "sphere", "radius": 0.1},
        [0.0, 0.0, a * math.sin(tilt) + 1e-3 * math.cos(tilt)],
        inertia=[k2] * 3,
        orientation={"axis": [0.0, 1.0, 0.0], "angle": tilt},
    )
    found = contact_run(
        scene(start, touch(mu=0.5, points=feet)), np.linspace(0.0, 1.0, 51).tolist(), tolerance=1e-9
    )
    spin = np.abs(found.trajectory.angular_velocity["body"][:, 1])
    assert found.trajectory.contact_state["floor/1"][-1] == 2.0
    assert found.trajectory.contact_state["floor/2"][-1] == 2.0
    assert spin[-1] <= 1e-12
    impacts = found.times("impact")
    assert len(impacts) < 60
    assert max(impacts) < 0.9
    assert (np.diff(found.trajectory.energy) <= 1e-12).all()
    assert found.balance() <= 1e-10


def test_tall_box_jams_at_both_front_corners() -> None:
    """Painleve's paradox of an edge: of its two corners each alone could slide on."""
    start = box([0.3, 0.3, 0.9], [0.0, 0.0, 0.45], linear_velocity=[2.0, 0.0, 0.0])
    found = contact_run(scene(start, touch(mu=1.5)), [0.0, 0.05, 0.1], tolerance=1e-9)
    r = found.trajectory
    assert np.isfinite(r.position["body"]).all()
    assert (np.diff(r.energy) <= 1e-9).all()
    assert r.energy[0] - G * 0.45 < 2.0 - 0.1  # the stop has cost energy
    assert {"leaps", "jams"} & {e.kind for e in found.events}


def test_slip_as_slow_as_the_errors_of_the_method_ends() -> None:
    """A disk that has come to rest from its bounces, still rolling: what slip is left is rounding.

    Resolved, its direction would turn about zero without end, in steps of 1e-10 s.
    """
    disk = {
        "mass": 0.13652604719427208,
        "shape": {"type": "disk", "radius": 0.12373983764073569},
        "position": [0.5091760505955326, -0.18167770225150276, -0.02310028943720267],
        "orientation": [
            -0.10858750190453277,
            0.10695259530424513,
            -0.9637660125608265,
            0.2189177238608706,
        ],
        "linear_velocity": [-0.5458750960665818, -0.4610594139438497, -0.15950382686065395],
        "angular_velocity": [-2.969927352898657, 13.950939297959163, 5.646110245688995],
    }
    slope = {"type": "plane", "normal": [0.09983341664682815, 0.0, 0.9950041652780258]}
    contact = touch(mu=1.5, kinetic=1.2, surface=slope, restitution=0.8)
    found = contact_run(scene(disk, contact), [0.0, 1e-4], tolerance=1e-9)
    assert found.times("rests")
    assert found.trajectory.contact_state["floor"][1] == 2.0
