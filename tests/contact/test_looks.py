# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sides are looked at between samples, too: nothing goes through a support where they are rare."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.catalogue.contacts.touching import Sides
from rb_sim.contact.tunnelling import SHARE, next_looks, speed_over, thickness
from tests.contact.scenes import box, scene, touch
from tests.contact.test_sides import ACROSS, LOG, OWN, held
from tests.contact_runs import contact_run

FALLEN = [5.0]
"""One sample, when what falls has long been through [s]."""


@pytest.mark.parametrize("name", ACROSS)
def test_going_through_between_samples_is_told(name: str) -> None:
    with pytest.raises(
        RbSimError,
        match=r"an edge of the body penetrates the support of contact floor by .* at t = 0\.",
    ):
        contact_run(ACROSS[name], FALLEN, tolerance=1e-8)


def test_going_through_is_told_where_nothing_is_sampled() -> None:
    simulation = Simulation(load_scene(ACROSS["rod on a log"]), announce=None)
    with pytest.raises(RbSimError, match="an edge of the body penetrates"):
        simulation._motion.run_to(FALLEN)


def test_going_through_between_samples_is_told_in_steps() -> None:
    steps = {"method": "time_stepping", "step": 1e-2, "tolerance": None}
    with pytest.raises(RbSimError, match=r"an edge of the body penetrates .* at t = 0\."):
        contact_run(ACROSS["rod on a log"], FALLEN, **steps)


def test_what_comes_at_speed_is_told() -> None:
    """A rod thrown at 300 m/s is through the log in 3 ms."""
    thrown = ACROSS["rod on a log"] | {
        "bodies": {
            "body": ACROSS["rod on a log"]["bodies"]["body"]
            | {"position": [0, 0, 60.0], "linear_velocity": [0, 0, -300.0]}
        }
    }
    with pytest.raises(RbSimError, match=r"an edge of the body penetrates .* at t = 0\.19[78]"):
        contact_run(thrown, [1.0], tolerance=1e-8)


def standing(**more: Any) -> dict[str, Any]:
    """A box that comes down on its corners upon a box."""
    under = held({"type": "box", "size": [1.0, 1.0, 0.4]}, 0.2)
    falling = box([0.3, 0.2, 0.1], [0, 0, 0.2], angular_velocity=[1.0, 0.5, 2.0]) | more
    made = scene({"body": falling, "a": under}, touch(**OWN, mu=0.5, restitution=0.3))
    made["effects"]["weight"] = made["effects"]["weight"] | {"bodies": ["body"]}
    return made


def test_looks_change_no_bit_of_a_motion() -> None:
    rare = contact_run(standing(), [0.6], tolerance=1e-9)
    often = contact_run(standing(), np.linspace(0.0, 0.6, 601).tolist(), tolerance=1e-9)
    for field in ("position", "orientation", "linear_velocity", "angular_velocity"):
        a, b = (getattr(run.trajectory, field)["body"][-1] for run in (rare, often))
        assert_array_equal(a, b)
    assert rare.times("impact") == often.times("impact")


def test_samples_are_those_asked_for() -> None:
    times = [0.0, 0.1, 0.1 + 1e-9, 0.35, 0.6]
    found = contact_run(standing(), times, tolerance=1e-9).trajectory
    alone = contact_run(standing(), [0.35], tolerance=1e-9).trajectory
    assert_array_equal(found.t, times)
    assert_array_equal(found.position["body"][3], alone.position["body"][0])


def test_far_away_nothing_is_looked_at() -> None:
    """The next look is when it can be there; from then on after a part of the thickness each."""
    from rb_sim.scene.compile import compile_scene

    high = scene(box([0.8, 0.8, 0.2], [0, 0, 20.0]), touch(**LOG))
    compiled = compile_scene(load_scene(high))
    (sides,), system = compiled.sides, compiled.system
    looks = next_looks(compiled.sides, system, 0.0, compiled.y)
    pull = system.speed**2 / system.length
    way = 20.0 - 0.5 - np.linalg.norm([0.4, 0.4, 0.1])
    ways = 0.5 * pull * looks**2
    assert way <= ways[0] <= way + 1.01 * SHARE * thickness(sides)
    assert np.diff(ways) == pytest.approx(SHARE * thickness(sides))
    assert thickness(sides) == 0.8


def test_no_point_moves_faster_over_the_support_than_is_said() -> None:
    """Against differences of the places of the points in the axes of a support that moves."""
    random = np.random.default_rng(3)
    for _ in range(50):
        y = random.normal(size=26)
        for i in (0, 13):
            y[i + 3 : i + 7] /= np.linalg.norm(y[i + 3 : i + 7])
        edges = random.normal(size=(12, 2, 3))
        fields: Any = dict.fromkeys(Sides._fields) | {"body": 1, "parent": 0, "edges": edges}
        sides = Sides(**fields)

        def seen(h: float, y: Any = y, edges: Any = edges) -> Any:
            p, turn = zip(
                *(
                    (
                        y[i : i + 3] + h * y[i + 7 : i + 10],
                        Rotation.from_quat(y[i + 3 : i + 7])
                        * Rotation.from_rotvec(h * y[i + 10 : i + 13]),
                    )
                    for i in (0, 13)
                ),
                strict=True,
            )
            return turn[0].inv().apply(turn[1].apply(edges.reshape(-1, 3)) + p[1] - p[0])

        speeds = np.linalg.norm(seen(1e-6) - seen(-1e-6), axis=1) / 2e-6
        bound = speed_over(sides, 0.0, y)
        assert 0.3 * bound < speeds.max() <= bound * (1.0 + 1e-8)


def test_a_rod_that_spins_about_itself_moves_no_side() -> None:
    """Only as fast as its centre, at whatever spin: it is looked at no more often for it."""
    edges = np.array([[[-0.3, 0.0, 0.0], [0.4, 0.0, 0.0]]])
    fields: Any = dict.fromkeys(Sides._fields) | {"body": 1, "parent": 0, "edges": edges}
    y = np.zeros(26)
    y[6] = y[19] = 1.0
    y[20:23], y[23] = [0.3, 0.0, -0.4], 1e6
    assert speed_over(Sides(**fields), 0.0, y) == pytest.approx(0.5, rel=1e-12)


def test_what_rests_is_looked_at_once_in_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A box that lies on a box for a minute: steps grow to seconds, and so does what is between."""
    under = held({"type": "box", "size": [1.0, 1.0, 0.4]}, 0.2)
    lying = box([0.3, 0.2, 0.1], [0, 0, 0.05])
    simulation = Simulation(
        load_scene(scene({"body": lying, "a": under}, touch(**OWN, mu=0.5))), announce=None
    )
    motion: Any = simulation._motion
    looked: list[int] = []
    carry = motion._carry
    monkeypatch.setattr(
        motion, "_carry", lambda times, out: looked.append(len(times)) or carry(times, out)
    )
    motion.run_to([60.0])
    assert sum(looked) <= motion.steps + 100
