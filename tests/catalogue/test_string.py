# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Light strings: taut they pull, slack they do nothing, and the instants of both are exact."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

from rb_sim import SceneError, load_scene
from tests.contact.scenes import G, ball, box, scene
from tests.contact_runs import contact_run

LENGTH = 0.8


def string(**more: Any) -> dict[str, Any]:
    return {"type": "string", "body": "body", "point_A": [0.0, 0.0, 0.0], "length": LENGTH} | more


def test_falling_stone_is_jerked_onto_its_circle() -> None:
    """Straight down to the circle; then the speed along the string is gone, that across stays."""
    x = 0.5
    drop = math.sqrt(LENGTH**2 - x**2)
    falls = math.sqrt(2.0 * drop / G)
    speed = G * falls
    along = speed * drop / LENGTH
    found = contact_run(scene(ball([x, 0, 0]), string()), [0.9 * falls, falls + 1e-9, 2.0])
    kinds = [(e.kind, e.contact) for e in found.events]
    assert kinds[:2] == [("impact", "floor"), ("taut", "floor")]
    assert_allclose(found.events[0].t, falls, rtol=0.0, atol=1e-12)
    toward = np.array([-x, 0.0, drop]) / LENGTH
    assert_allclose(found.events[0].impulse, along * toward, atol=1e-10)
    block = found.trajectory.block
    assert_allclose(block.reaction_force[0, 0], 0.0, atol=0.0)
    assert_allclose(block.linear_velocity[1, 0], [0, 0, -speed] + along * toward, atol=1e-7)
    assert_allclose(np.linalg.norm(block.position[2, 0]), LENGTH, atol=1e-12)
    assert_allclose(found.balance(), 0.0, atol=1e-9)


def test_looping_stone_leaves_its_circle_and_returns_to_it() -> None:
    """Slack where v^2 = g l sin(height); the parabola meets the circle after 4 v cos / g."""
    fast = math.sqrt(3.5 * G * LENGTH)
    start = ball([0, 0, -LENGTH], linear_velocity=[fast, 0, 0])
    angle = math.asin(0.5)  # (v0^2 - 2 g l) / (3 g l) above the horizontal
    rate = lambda a: math.sqrt(fast**2 - 2.0 * G * LENGTH * (1.0 - math.cos(a))) / LENGTH  # noqa: E731
    slack = quad(lambda a: 1.0 / rate(a), 0.0, 0.5 * math.pi + angle, epsabs=1e-13)[0]
    flight = 4.0 * math.sqrt(G * LENGTH * math.sin(angle)) * math.cos(angle) / G
    found = contact_run(scene(start, string()), [0.1, slack + 0.5 * flight], tolerance=1e-12)
    assert_allclose(found.times("slack"), [slack], rtol=0.0, atol=1e-9)
    after = contact_run(scene(start, string()), [slack + flight + 0.01], tolerance=1e-12)
    assert_allclose(after.times("taut"), [0.0, slack + flight], rtol=0.0, atol=1e-9)
    tension = found.trajectory.block.reaction_force[0, 0]
    place = found.trajectory.block.position[0, 0]
    speed = np.linalg.norm(found.trajectory.block.linear_velocity[0, 0])
    assert_allclose(
        tension, -(speed**2 / LENGTH - G * place[2] / LENGTH) * place / LENGTH, atol=1e-9
    )
    assert_allclose(found.trajectory.block.reaction_force[1, 0], 0.0, atol=0.0)


@pytest.mark.parametrize("e", [0.0, 0.6])
def test_jerk_between_two_bodies_that_turn_keeps_momentum(e: float) -> None:
    """Off-centre ends: the speed of parting is reversed by e, linear and angular momentum stay."""
    bodies = {
        "a": box(
            [0.2, 0.3, 0.4], [0, 0, 0], linear_velocity=[-1, 0.2, 0], angular_velocity=[1, 2, -1]
        ),
        "b": box(
            [0.3, 0.2, 0.1], [1, 0, 0], linear_velocity=[1, 0, 0.3], angular_velocity=[-2, 1, 1]
        )
        | {"mass": 2.5, "center_of_mass": [0.02, -0.01, 0.03], "inertia": [0.05, 0.08, 0.09]},
    }
    tie = {"type": "string", "body": "b", "parent": "a", "length": 1.1, "restitution": e}
    tie |= {"point_B": [-0.1, 0.05, 0.04], "point_A": [0.1, 0.1, -0.2]}
    mapping = scene(bodies, {"tie": tie}, gravity=False)
    found = contact_run(mapping, [0.0, 0.3, 0.6], tolerance=1e-12)
    assert len(found.times("impact")) >= 1
    t = found.times("impact")[0]
    near = contact_run(mapping, [t - 1e-7, t + 1e-7], tolerance=1e-12).trajectory
    before, after = parting(near, 0), parting(near, 1)
    assert before > 0.1
    assert_allclose(after, -e * before, atol=1e-5)
    for momentum in (near.momentum, near.angular_momentum):
        assert_allclose(momentum[1], momentum[0], atol=1e-12)
    whole = found.trajectory
    assert_allclose(whole.angular_momentum, whole.angular_momentum[[0, 0, 0]], atol=1e-11)
    assert found.balance() < 1e-10


def parting(run: Any, k: int) -> float:
    """Rate of the distance of the string's ends at sample k [m/s]."""
    from scipy.spatial.transform import Rotation

    ends = []
    for name, point in (("b", [-0.12, 0.06, 0.01]), ("a", [0.1, 0.1, -0.2])):
        turn = Rotation.from_quat(run.orientation[name][k])
        arm = turn.apply(point)
        spin = turn.apply(run.angular_velocity[name][k])
        ends.append(
            (run.position[name][k] + arm, run.linear_velocity[name][k] + np.cross(spin, arm))
        )
    (p, v), (q, u) = ends
    return float((p - q) @ (v - u) / np.linalg.norm(p - q))


def test_elastic_string_stretches_as_a_spring_and_lets_go() -> None:
    """A bungee: taut at sqrt(2 l / g), an oscillation about m g / k, slack again at its end."""
    k, m = 40.0, 1.0
    bungee = string(compliance={"stiffness": k})
    w, speed = math.sqrt(k / m), math.sqrt(2.0 * G * LENGTH)
    taut = speed / G
    lasts = (2.0 * math.pi - 2.0 * math.atan2(speed / w, m * G / k)) / w
    deepest = LENGTH + m * G / k + math.hypot(m * G / k, speed / w)
    down = taut + 0.5 * lasts
    found = contact_run(scene(ball([0, 0, 0]), bungee), [down, taut + lasts + 0.05])
    assert_allclose(found.times("taut"), [taut], rtol=0.0, atol=1e-9)
    assert_allclose(found.times("slack"), [taut + lasts], rtol=0.0, atol=1e-9)
    assert_allclose(found.trajectory.block.position[0, 0, 2], -deepest, atol=1e-9)
    assert_allclose(
        found.trajectory.block.reaction_force[0, 0, 2], k * (deepest - LENGTH), atol=1e-7
    )


def test_string_without_a_length_is_just_taut_at_the_start() -> None:
    """A simple pendulum of that length: the tension at the start is m g cos."""
    hung = string()
    del hung["length"]
    found = contact_run(scene(ball([0.3, 0, -0.4]), hung), [0.0])
    assert_allclose(
        np.linalg.norm(found.trajectory.block.reaction_force[0, 0]), 0.8 * G, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"length": -1.0}, "length: got -1.0"),
        ({"length": 0.1}, "stretch of 0.4 m at the start"),
        ({"restitution": 0.5, "compliance": {"stiffness": 1.0}}, "omitted for an elastic string"),
        ({"point_A": [0.5, 0.0, 0.0], "length": None}, "its points coincide"),
    ],
)
def test_bad_strings_are_refused(change: dict[str, Any], words: str) -> None:
    from rb_sim.scene.compile import compile_scene

    with pytest.raises(SceneError, match=words):
        compile_scene(load_scene(scene(ball([0.5, 0, 0]), string(**change))))
