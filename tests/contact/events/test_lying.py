# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rims that come to lie flat on a plane: they strike, rest, spin, tip as whole circles do."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.contact.assembly import velocities
from rb_sim.contact.events.instant import Instant, leap
from tests.contact.scenes import G, body, scene, touch
from tests.contact_runs import contact_run
from tests.interpreted import interpreted

RADIUS = 0.1
ROUGH = {"friction": {"type": "rough"}}


def disk(**more: Any) -> dict[str, Any]:
    return {"type": "disk", "radius": RADIUS} | more


def cylinder(length: float) -> dict[str, Any]:
    return {"type": "cylinder", "radius": RADIUS, "length": length}


def turned_about_vertical(angle: float, tilt: float) -> list[float]:
    """Quaternion [x, y, z, w] of a turn about z, then of a tilt about y."""
    a, b = 0.5 * angle, 0.5 * tilt
    return [
        math.sin(b) * math.sin(a),
        math.sin(b) * math.cos(a),
        math.cos(b) * math.sin(a),
        math.cos(b) * math.cos(a),
    ]


def leaning(shape: dict[str, Any], tilt: float, turn: float = 0.0, **more: Any) -> dict[str, Any]:
    """On the lowest point of its rim, its axis tilted about the world's y."""
    height = RADIUS * math.sin(tilt) + 0.5 * shape.get("length", 0.0) * math.cos(tilt)
    q = turned_about_vertical(turn, tilt)
    return body(shape, [0.0, 0.0, height], orientation=q, **more)


def test_disk_falls_flat_and_lies() -> None:
    """Smooth, from a tilt at rest: energy gives the rate on arrival, plastic impact stops all.

    Its centre falls straight down, h = a sin(tilt): m (h'^2 + (a/2)^2 tilt'^2)/2 + m g h = E.
    """
    start = 0.3

    def rate(tilt: float) -> float:
        fall = 2.0 * G * RADIUS * (math.sin(start) - math.sin(tilt))
        return math.sqrt(fall / ((RADIUS * math.cos(tilt)) ** 2 + 0.25 * RADIUS**2))

    found = contact_run(
        scene(leaning(disk(), start), touch(lies_flat=True)), [0.0, 0.5, 1.0], tolerance=1e-12
    )
    u = np.linspace(0.0, 1.0, 2001)[1:] - 0.5 / 2000.0  # tilt = start (1 - u^2) has no singularity
    fall = np.sum([2.0 * start * x / rate(start * (1.0 - x * x)) for x in u]) / 2000.0
    assert_allclose(found.times("impact"), fall, rtol=1e-6)
    assert_allclose(found.times("impact"), found.times("impact")[0], atol=1e-14)
    z = found.trajectory
    assert_allclose(z.position["body"][1:, 2], 0.0, atol=1e-14)
    assert np.abs(z.angular_velocity["body"][1:]).max() < 1e-12
    assert_allclose(z.reaction["floor"].force[1:], [[0.0, 0.0, G]] * 2, atol=1e-12)
    assert found.balance() < 1e-9


def test_standing_cylinder_rocks_over_onto_the_opposite_point() -> None:
    """Plastic impact on flat (Housner): angular momentum about the new lowest point is kept."""
    length, tilt, turn = 0.6, 0.1, 0.7
    shape = cylinder(length)
    inertia, h = RADIUS**2 / 4.0 + length**2 / 12.0, 0.5 * length
    kept = (inertia + h * h - RADIUS**2) / (inertia + h * h + RADIUS**2)
    found = contact_run(
        scene(leaning(shape, tilt, turn), touch(**ROUGH)),
        np.linspace(0.0, 0.6, 61),
        tolerance=1e-9,
    )
    t = found.times("impact")[0]
    first = [e for e in found.events if e.kind == "impact" and e.t == t]
    assert len(first) == 1
    energy = found.trajectory.energy
    lost = energy[0] - energy[np.searchsorted(found.trajectory.t, t) :][0]
    fell = G * (RADIUS * math.sin(tilt) + h * math.cos(tilt) - h)
    assert_allclose(lost, fell * (1.0 - kept**2), rtol=1e-7)
    # and up on the other side to the tilt that the energy allows
    tilts = [2.0 * math.asin(math.hypot(q[0], q[1])) for q in found.trajectory.orientation["body"]]
    left = fell * kept**2

    def high(angle: float) -> float:
        return G * (RADIUS * math.sin(angle) + h * math.cos(angle) - h)

    after = max(tilts[np.searchsorted(found.trajectory.t, t) :])
    assert_allclose(high(after), left, rtol=1e-2)


@pytest.mark.parametrize("turn", [0.3, 2.0])
def test_cylinder_stands_on_an_incline_until_its_weight_passes_the_rim(turn: float) -> None:
    """tan(slope) = radius / half length, in whichever direction its points happen to lie."""
    length = 0.5
    limit = math.atan(2.0 * RADIUS / length)
    for slope, stands in ((limit - 1e-6, True), (limit + 1e-4, False)):
        n = [math.sin(slope), 0.0, math.cos(slope)]
        start = body(
            cylinder(length),
            [0.5 * length * x for x in n],
            orientation=turned_about_vertical(turn, slope),
        )
        floor = touch(surface={"type": "plane", "normal": n}, **ROUGH)
        found = contact_run(scene(start, floor), [0.0, 0.02, 0.1], tolerance=1e-8)
        moved = np.linalg.norm(np.diff(found.trajectory.position["body"], axis=0), axis=1)
        assert (moved[1] < 1e-13) == stands
        assert stands or moved[1] > 1e-6
        if stands:
            total = found.trajectory.reaction["floor"]
            assert_allclose(total.force, [[0.0, 0.0, G]] * 3, atol=1e-10)
            assert_allclose(total.torque, 0.0, atol=1e-10)


def test_torque_tips_a_disk_over_the_point_ahead() -> None:
    """Smooth, T(t) = r t: it tips when T = m g a, over a point between those that hold it, and
    then turns as its energy says, T being as good as constant.

    tilt'' (m a^2 cos^2(tilt) + m a^2/4) = T - m g a at first: after s, tilt' = r s^2/2 over that.
    """
    rate, direction, short = 0.5, 0.4, 0.01
    about = np.array([-math.sin(direction), math.cos(direction), 0.0])
    table = {"times": [0.0, 10.0], "torques": [[0.0] * 3, (10.0 * rate * about).tolist()]}
    tips = G * RADIUS / rate
    found = contact_run(
        scene(
            body(disk(), [0.0, 0.0, 0.0]),
            touch(lies_flat=True),
            turn={"type": "wrench_table", "body": "body"} | table,
        ),
        [0.0, tips, tips + short],
        tolerance=1e-11,
    )
    assert_allclose(found.times("opens"), tips, atol=1e-10)
    assert len(found.times("opens")) == 5
    w = found.trajectory.angular_velocity["body"][2]
    assert_allclose(w, 0.5 * rate * short**2 / (1.25 * RADIUS**2) * about, rtol=1e-5, atol=1e-9)


def test_disk_that_spins_flat_is_braked_at_its_rim() -> None:
    """mu m g a against m a^2/2: the spin ends after w a/(2 mu g)."""
    mu, spin = 0.2, 6.0
    start = body(disk(), [0.0, 0.0, 0.0], angular_velocity=[0.0, 0.0, spin])
    ends = spin * RADIUS / (2.0 * mu * G)
    times = [0.0, 0.5 * ends, 2.0 * ends]
    found = contact_run(scene(start, touch(mu=mu, lies_flat=True)), times, tolerance=1e-11)
    w = found.trajectory.angular_velocity["body"]
    assert_allclose(w, [[0.0, 0.0, spin], [0.0, 0.0, 0.5 * spin], [0.0] * 3], atol=1e-9)
    assert_allclose(found.times("sticks"), ends, atol=1e-10)
    assert found.balance() < 1e-10


def test_disk_dropped_flat_bounces_to_rest() -> None:
    """As a ball: at rest after sqrt(2 h/g) (1 + e)/(1 - e)."""
    height, e = 0.2, 0.4
    start = body(disk(), [0.0, 0.0, height])
    rest = math.sqrt(2.0 * height / G) * (1.0 + e) / (1.0 - e)
    found = contact_run(
        scene(start, touch(restitution=e, lies_flat=True)), [0.0, 2.0 * rest], tolerance=1e-12
    )
    assert_allclose(found.times("rests"), rest, atol=1e-9)
    assert_allclose(found.trajectory.position["body"][1], 0.0, atol=1e-13)


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_disk_that_touches_with_one_point_says_that_it_cannot_lie(tilt: float) -> None:
    lies = scene(leaning(disk(), tilt), touch(mu=0.3))
    with pytest.raises(RbSimError, match=r"set constraints\.floor\.lies_flat to true"):
        contact_run(lies, [0.0, 1.0], tolerance=1e-9)


@pytest.mark.parametrize(
    ("shape", "contact", "allowed"),
    [
        ({"type": "sphere", "radius": RADIUS}, {}, "where lies_flat is given"),
        (disk(), {"mode": "bilateral"}, "lies_flat.* must be false for"),
        (disk(), {"points": [[0.0, 0.0, 0.0]]}, "where lies_flat is given"),
        (
            disk(),
            {"surface": {"type": "sphere", "radius": 1.0, "side": "inside"}},
            "where lies_flat is given",
        ),
    ],
)
def test_lies_flat_is_refused_where_nothing_can(shape: Any, contact: Any, allowed: str) -> None:
    start = body(shape, [0.0, 0.0, 0.3])
    with pytest.raises(RbSimError, match=rf"constraints\.floor.*{allowed}"):
        contact_run(scene(start, touch(lies_flat=True, **contact)), [0.0])


# What comes to lie is given no energy: its point runs around the rim, and pushes the harder the
# less the rim misses flat.


FALLEN: dict[str, tuple[list[float], list[float], float, float, float]] = {
    "leaps while its point runs around": (
        [-0.5657789498610037, 0.4114755998989118, 0.6172133998483676, 0.3600411499115478],
        [0, 0, 0], 0.3, 0.1, 3e-3,
    ),
    "a step cut where it misses flat": (
        [-0.4557751374461624, -0.2899082334779215, 0.5755462843119391, -0.6139777804305],
        [0, 0, 0], 0.8, 0.0, 3e-3,
    ),
    "samples where a slip has turned": (
        [0.5420314059089282, -0.08863364395539232, -0.15013221758244688, -0.8220744184143892],
        [24.494421571718647, -10.20614153575335, -5.959390222128942], 0.3, 0.1, 1e-3,
    ),
}  # fmt: skip
"""Orientation, rates [rad/s], friction, restitution and tolerance of disks that fall 0.2 m."""


@pytest.mark.parametrize("name", FALLEN)
def test_a_fallen_disk_is_given_no_energy(name: str) -> None:
    q, rates, mu, restitution, tolerance = FALLEN[name]
    disk = body(
        {"type": "disk", "radius": 0.05}, [0, 0, 0.2], orientation=q, angular_velocity=rates
    )
    made = scene(disk, touch(mu=mu, restitution=restitution))
    times = np.linspace(0.0, 1.2, 601).tolist()
    energy = contact_run(made, times, tolerance=tolerance).trajectory.energy
    assert float((energy - np.minimum.accumulate(energy)).max()) < 5e-3 * energy[0]


def near_flat(tilt: float, length: float) -> tuple[float, float]:
    """Energy before and after a leap of this length [s] of a disk that falls flat at 30 rad/s, and
    misses by a part of its tilt."""
    rates = [30.0, 3.0, 0.0]
    tilted = {"axis": [-1, 0, 0], "angle": tilt}
    disk = body({"type": "disk", "radius": 0.05}, [0, 0, 0.05 * tilt], orientation=tilted)
    moving = disk | {"angular_velocity": rates, "linear_velocity": [0, 0, -0.05 * rates[0]]}
    motion: Any = Simulation(load_scene(scene(moving, touch(mu=0.3), gravity=False)))._motion
    at = Instant(motion.laws, motion._call, 0.0, np.array(motion.compiled.y))
    before = kinetic_energy(at)
    passed = leap(at, length)
    assert passed is not None and 0.0 < passed <= length
    return before, kinetic_energy(at)


def kinetic_energy(at: Instant) -> float:
    u = velocities(at.system, at.y)
    return float(0.5 * u.ravel() @ np.linalg.solve(at.inverse_mass, u.ravel()))


@pytest.mark.parametrize("tilt", [1e-9, 1e-7, 1e-5])
def test_a_leap_is_shorter_than_a_point_takes_to_run_around(tilt: float) -> None:
    before, after = interpreted(near_flat, tilt, 1e-6)
    assert after <= 1.001 * before
