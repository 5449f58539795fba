# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bodies on a sphere, and balls on bodies, against closed forms."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from tests.contact.scenes import G, ball, body, box, scene, touch
from tests.contact_runs import ContactRun, contact_run

R = 1.0
TOP = {"surface": {"type": "sphere", "radius": R}}
ROUGH = TOP | {"friction": {"type": "rough"}}


def run(mapping: Any, times: Any, **options: Any) -> ContactRun:
    return contact_run(mapping, np.atleast_1d(times).tolist(), **{"tolerance": 1e-12} | options)


def corners(x: float, y: float, z: float) -> list[list[float]]:
    return [[i * x, j * y, k * z] for i, j, k in itertools.product((-1, 1), repeat=3)]


# planks: flat below, rolled along x by the angle q; h from the flat to C, k^2 = I/m about y

PLANKS: dict[str, tuple[dict[str, Any], dict[str, Any], float, float]] = {
    "box": ({"type": "box", "size": [0.8, 0.6, 0.1]}, {}, 0.05, 0.65 / 12.0),
    "points of a box": (
        {"type": "box", "size": [0.8, 0.6, 0.1]},
        {"points": corners(0.4, 0.3, 0.05)},
        0.05,
        0.65 / 12.0,
    ),
    "points of a plate": (
        {"type": "disk", "radius": 0.4},
        {"points": [p for p in corners(0.4, 0.4, 0.0)[::2]]},
        0.0,
        0.04,
    ),
    "points of a line": (
        {"type": "rod", "length": 0.8, "axis_B": [1, 0, 0]},
        {"points": [[-0.4, 0.0, 0.0], [0.1, 0.0, 0.0], [0.4, 0.0, 0.0]]},
        0.0,
        0.64 / 12.0,
    ),
    "rod": ({"type": "rod", "length": 0.8, "axis_B": [1, 0, 0]}, {}, 0.0, 0.64 / 12.0),
    "disk on its face": ({"type": "disk", "radius": 0.4}, {}, 0.0, 0.04),
    "cylinder on its cap": (
        {"type": "cylinder", "radius": 0.4, "length": 0.1}, {}, 0.05, 0.04 + 0.01 / 12.0,
    ),
    "cylinder on its side": (
        {"type": "cylinder", "radius": 0.05, "length": 0.8, "axis_B": [1, 0, 0]},
        {},
        0.05,
        0.0025 / 4.0 + 0.64 / 12.0,
    ),
}  # fmt: skip


def plank(name: str, tilt: float, **more: Any) -> dict[str, Any]:
    """At rest on top of the sphere, rolled by the angle: the contact has moved by R tilt."""
    shape, contact, h, _ = PLANKS[name]
    along = np.array([math.cos(tilt), 0.0, -math.sin(tilt)])
    up = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
    turned = {"axis": [0.0, 1.0, 0.0], "angle": tilt}
    solid = body(shape, (R + h) * up - R * tilt * along, orientation=turned)
    return scene(solid, touch(**ROUGH, **contact, **more))


@pytest.mark.parametrize("name", PLANKS)
def test_small_oscillation(name: str) -> None:
    """w^2 = g (R - h)/(h^2 + k^2)."""
    *_, h, square = PLANKS[name]
    tilt, rate = 1e-4, math.sqrt(G * (R - h) / (h**2 + square))
    t = np.linspace(0.0, 2.0 * math.pi / rate, 9)
    found = run(plank(name, tilt), t, tolerance=1e-13)
    turned = 2.0 * found.trajectory.orientation["body"][:, 1]
    assert_allclose(turned, tilt * np.cos(rate * t), rtol=0.0, atol=1e-6 * tilt)
    assert [e.kind for e in found.events if e.t > 0.0] == []


@pytest.mark.parametrize("name", PLANKS)
def test_large_oscillation(name: str) -> None:
    """(h^2 + k^2 + R^2 q^2) q'^2 / 2 + g ((R + h) cos q + R q sin q) is constant (LL 38)."""
    *_, h, square = PLANKS[name]
    tilt = 0.3

    def height(q: Any) -> Any:
        return (R + h) * np.cos(q) + R * q * np.sin(q)

    def slowness(phase: float) -> float:
        q = tilt * math.sin(phase)
        fall = 2.0 * G * (height(tilt) - height(q)) / (h**2 + square + (R * q) ** 2)
        return tilt * math.cos(phase) / math.sqrt(fall)

    quarter = quad(slowness, 0.0, 0.5 * math.pi, epsabs=1e-13)[0]
    found = run(plank(name, tilt), np.array([0.0, 0.4, 1.0, 1.7, 2.0, 3.0]) * quarter)
    r = found.trajectory
    q = 2.0 * np.arctan2(r.orientation["body"][:, 1], r.orientation["body"][:, 3])
    inertia = h**2 + square + (R * q) ** 2
    energy = 0.5 * inertia * r.angular_velocity["body"][:, 1] ** 2 + G * height(q)
    assert_allclose(energy, G * height(tilt), rtol=0.0, atol=1e-9)
    assert_allclose(q[[2, 4, 5]], [0.0, -tilt, 0.0], rtol=0.0, atol=1e-8)
    assert_allclose(r.position["body"][:, 2], height(q), rtol=0.0, atol=1e-9)
    assert found.balance() <= 1e-9


@pytest.mark.parametrize(("mu", "y", "end"), [(0.0, -0.2, 0.5), (0.4, -0.06, 0.17)])
def test_points_are_the_box(mu: float, y: float, end: float) -> None:
    """Falling askew: without friction it slides off, at times on an edge; with it, it sticks."""
    start = {
        "angular_velocity": [0.4, 0.9, 0.5],
        "orientation": Rotation.from_rotvec([0.05, 0.1, 0.3]).as_quat(),
    }
    size = np.array([0.5, 0.3, 0.1])
    falling = box(size.tolist(), [0.1 if mu == 0.0 else 0.04, y, 1.1], **start)
    runs = [
        run(scene(falling, touch(mu=mu, **TOP, **listed)), np.linspace(0.0, end, 11))
        for listed in ({}, {"points": corners(*(0.5 * size).tolist())})
    ]
    a, b = runs
    assert [e.kind for e in a.events] == [e.kind for e in b.events]
    assert {"impact", "closes"} <= {e.kind for e in a.events}
    assert_allclose([e.t for e in b.events], [e.t for e in a.events], rtol=0.0, atol=1e-11)
    for field in ("position", "orientation", "linear_velocity"):
        x, y = (getattr(found.trajectory, field)["body"] for found in runs)
        assert_allclose(y, x, rtol=0.0, atol=1e-10)
    assert max(found.balance() for found in runs) <= 1e-9
    if mu == 0.0:
        turn = Rotation.from_quat(a.trajectory.orientation["body"])
        normal = turn.inv().apply(a.trajectory.reaction["floor"].force)
        steepest = np.abs(normal).max(axis=1) / np.linalg.norm(normal, axis=1).clip(1e-9)
        assert np.any(np.abs(steepest - 1.0) <= 1e-12)  # on a face
        assert np.any((steepest > 0.1) & (steepest < 0.999))  # on an edge


@pytest.mark.parametrize(
    ("shape", "x"),
    [
        ({"type": "disk", "radius": 0.4}, 0.2),
        ({"type": "cylinder", "radius": 0.4, "length": 0.2}, -0.3),
        ({"type": "cylinder", "radius": 0.1, "length": 0.8, "axis_B": [1, 0, 0]}, 0.3),
    ],
)
def test_face_falls_on_a_sphere(shape: dict[str, Any], x: float) -> None:
    """At a distance x from C along the face: impulse (1 + e) v / (1/m + x^2/I)."""
    half = {"disk": 0.0, "cylinder": 0.1}[shape["type"]]
    solid = body(shape, [x, 0.0, R + 0.3], linear_velocity=[0.0, 0.0, -0.5])
    speed = math.sqrt(0.5**2 + 2.0 * G * (0.3 - half))
    fall = (speed - 0.5) / G
    found = run(scene(solid, touch(restitution=0.5, **TOP)), [0.0, fall + 0.01])
    (hit,) = [e for e in found.events if e.kind == "impact"]
    assert abs(hit.t - fall) <= 1e-12
    long = shape.get("length", 0.0)
    inertia = 0.25 * shape["radius"] ** 2 + long**2 / 12.0
    assert_allclose(hit.impulse, [0, 0, 1.5 * speed / (1.0 + x * x / inertia)], atol=1e-11)


@pytest.mark.parametrize("aim", ["side", "cap"])
def test_ball_strikes_a_cylinder_head_on(aim: str) -> None:
    """Equal masses exchange velocities, at e = 1."""
    axis = [0, 0, 1] if aim == "side" else [1, 0, 0]
    near = 0.2 if aim == "side" else 0.25
    shape = {"type": "cylinder", "radius": 0.2, "length": 0.5, "axis_B": axis}
    bodies = {"a": body(shape, [0, 0, 0]), "b": ball([-1, 0, 0], linear_velocity=[2, 0, 0])}
    hit = touch("b", parent="a", surface={"type": "shape"}, restitution=1.0)
    found = run(scene(bodies, {"hit": hit}, gravity=False), [0.0, 1.0])
    assert_allclose(found.times("impact"), [0.5 * (0.9 - near)], rtol=0.0, atol=1e-13)
    v = found.trajectory.linear_velocity
    assert_allclose(v["a"][1], [2.0, 0.0, 0.0], atol=1e-13)
    assert_allclose(v["b"][1], [0.0, 0.0, 0.0], atol=1e-13)


def test_ball_and_roller() -> None:
    """A rough ball rolls off a cylinder that turns about its own fixed axis.

    The same friction T turns both: b w_b' = T/0.4 and a w_a' = T/0.5 for masses of 1, and their
    rims keep up with the ball, (a + b) q'' = b w_b' + a w_a', so that
    (1 + 1/(1/0.4 + 1/0.5)) (a + b) q'' = g sin q; it leaves where g cos q = (a + b) q'^2.
    """
    a, b, start = 0.5, 0.1, 0.2
    effective = 1.0 + 1.0 / (1.0 / 0.4 + 1.0 / 0.5)
    shape = {"type": "cylinder", "radius": a, "length": 2.0, "axis_B": [0, 1, 0]}
    place = (a + b) * np.array([math.sin(start), 0.0, math.cos(start)])
    bodies = {"roller": body(shape, [0, 0, 0]), "ball": ball(place, b)}
    on = touch("ball", parent="roller", surface={"type": "shape"}, friction={"type": "rough"})
    pin = {"type": "fixed_axis", "body": "roller", "axis_B": [0, 1, 0]}
    found = run(scene(bodies, {"on": on, "pin": pin}), [0.0, 0.3, 1.0])
    # g cos q = 2 g (cos q0 - cos q)/effective
    leaves = math.acos(2.0 * math.cos(start) / (2.0 + effective))

    def slowness(s: float) -> float:
        q = start + s * s
        fall = 2.0 * G * (math.cos(start) - math.cos(q)) / (effective * (a + b))
        return 2.0 * s / math.sqrt(fall)

    t = quad(slowness, 1e-12, math.sqrt(leaves - start), epsabs=1e-13, epsrel=1e-13)[0]
    assert_allclose(found.times("opens"), [t], rtol=0.0, atol=1e-9)
    assert found.balance() <= 1e-9
