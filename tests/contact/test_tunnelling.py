# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sides of bodies in supports: at samples, between them, and how deep they are."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.catalogue.contact import Sides, edges_of_box
from rb_sim.catalogue.geometry.pairs import BallOnCylinder
from rb_sim.catalogue.geometry.solids import Box, Cylinder
from rb_sim.contact.tunnelling import (
    SHARE,
    deepest_of_edges,
    depth_in,
    entering,
    least_along,
    moved,
    next_looks,
    speed_over,
    thickness,
)
from tests.contact.scenes import body, box, scene, touch
from tests.contact_runs import contact_run

FALLEN = [5.0]
"""One sample, when what falls has long been through [s]."""

LOG: dict[str, Any] = {
    "surface": {"type": "cylinder", "axis": [1, 0, 0], "radius": 0.5, "side": "outside"}
}
ROD: dict[str, Any] = {"type": "rod", "length": 0.8, "axis_B": [0, 1, 0]}
DRUM = {"type": "cylinder", "radius": 0.5, "length": 0.6, "axis_B": [1, 0, 0]}
LEANING = {"axis": [0, 1, 0], "angle": 1}
OWN: dict[str, Any] = {"parent": "a", "surface": {"type": "shape"}}


def held(shape: dict[str, Any], top: float) -> dict[str, Any]:
    """A heavy body whose top is at the origin, far heavier than what falls on it."""
    return body(shape, [0, 0, -top], mass=1e6)


ACROSS: dict[str, Any] = {
    "rod on a log": scene(body(ROD, [0, 0, 0.6]), touch(**LOG)),
    "box on a log": scene(box([0.8, 0.8, 0.2], [0, 0, 0.7]), touch(**LOG)),
    "rod on a box": scene(
        {"body": body(ROD, [0, 0, 0.1]), "a": held({"type": "box", "size": [0.4, 0.4, 0.4]}, 0.2)},
        touch(**OWN),
    ),
    "box on a box": scene(
        {
            "body": box([0.8, 0.1, 0.2], [0, 0, 0.2]),
            "a": held({"type": "box", "size": [0.4, 0.4, 0.4]}, 0.2),
        },
        touch(**OWN),
    ),
    "box on the rim of a drum": scene(
        {
            "body": box([0.8, 0.8, 0.2], [0.25, 0, 0.2], orientation=LEANING),
            "a": held(DRUM, 0.5),
        },
        touch(**OWN),
    ),
    "a corner below a box": scene(
        {
            "body": box([0.8, 0.8, 0.2], [0, 0, 0.35]),
            "a": body({"type": "box", "size": [0.3, 0.3, 0.3]}, [0, 0, -0.15], mass=1e6)
            | {"orientation": {"axis": [1, 0.2, 0], "angle": 0.6}},
        },
        touch(**OWN),
    ),
}  # fmt: skip
for mapping in ACROSS.values():
    mapping["effects"]["weight"] = mapping["effects"]["weight"] | {"bodies": ["body"]}


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


# Sides between the points with which a body touches: never in a support without a word.


@pytest.mark.parametrize("name", ACROSS)
def test_sinking_is_told(name: str) -> None:
    with pytest.raises(
        RbSimError,
        match=r"an edge of the body penetrates the support of contact floor by .* at t = ",
    ):
        contact_run(ACROSS[name], np.linspace(0.0, 0.35, 36).tolist(), tolerance=1e-8)


def test_sinking_is_told_in_steps() -> None:
    with pytest.raises(RbSimError, match="an edge of the body penetrates"):
        contact_run(
            ACROSS["rod on a log"],
            [0.1, 0.2, 0.3],
            method="time_stepping",
            step=1e-2,
            tolerance=None,
        )


def test_corners_and_ends_that_touch_are_no_sides() -> None:
    """A box that stands on a box, and a rod that lies along a log."""
    under = held({"type": "box", "size": [1.0, 1.0, 0.4]}, 0.2)
    standing = scene({"body": box([0.3, 0.2, 0.1], [0, 0, 0.05]), "a": under}, touch(**OWN, mu=0.5))
    standing["effects"]["weight"] = standing["effects"]["weight"] | {"bodies": ["body"]}
    along = ROD | {"axis_B": [1, 0, 0]}
    slides = body(along, [0, 0.5 * math.sin(0.1), 0.5 * math.cos(0.1)])
    for mapping in (standing, scene(slides, touch(**LOG))):
        found = contact_run(mapping, np.linspace(0.0, 0.2, 9).tolist(), tolerance=1e-8)
        assert found.trajectory.residual.max() <= 1e-10


def test_poses_in_which_no_end_has_moved_are_looked_at_once() -> None:
    edges = np.repeat(np.arange(24.0).reshape(1, 4, 2, 3), 5, axis=0)
    edges[3, 2, 1, 0] += 2e-9
    edges[4] += 0.5e-9
    assert moved(edges, 1e-9).tolist() == [0, 3]
    assert moved(edges, 1e-10).tolist() == [0, 3, 4]


# How deep sides lie in supports: beside distances in closed form and points one by one.


BOX = Box((1.0, 2.0, 3.0), (0.5, 0.3, 0.2))
DRUM_SIDES = Cylinder((1.0, 2.0, 3.0), 0.4, 0.25, (0.0, 0.6, 0.8))
LOG_DEPTHS = BallOnCylinder((9.0,) * 3, 0.0, (1.0, 2.0, 3.0), (0.0, 0.6, 0.8), 0.4, 1.0)
CENTRE, E, ACROSS_DEPTHS = (
    np.array([1.0, 2.0, 3.0]),
    np.array([0.0, 0.6, 0.8]),
    np.array([1.0, 0.0, 0.0]),
)


def test_depths_in_a_box() -> None:
    """Beside a face, an edge, a corner, and within, below the nearest face."""
    places = np.array([[0.7, 0.1, 0.1], [0.8, -0.7, 0.0], [-0.6, 0.5, 0.4], [0.4, 0.1, 0.0],
                       [0.1, -0.05, 0.12], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])  # fmt: skip
    wanted = [0.2, 0.5, 0.3, -0.1, -0.08, -0.2, 0.0]
    assert_allclose(depth_in(BOX, CENTRE + places), wanted, atol=1e-15)


def test_depths_in_a_cylinder_and_in_one_without_ends() -> None:
    """Beside its mantle, an end, a rim, and within."""
    at = np.array(
        [[0.6, 0.1], [0.1, -0.45], [0.7, 0.65], [-0.35, 0.0], [0.1, 0.2]]
    )  # across, along
    places = CENTRE + at[:, :1] * ACROSS_DEPTHS + at[:, 1:] * E
    assert_allclose(depth_in(DRUM_SIDES, places), [0.2, 0.2, 0.5, -0.05, -0.05], atol=1e-15)
    assert_allclose(depth_in(LOG_DEPTHS, places), [0.2, -0.3, 0.3, -0.05, -0.3], atol=1e-15)


@pytest.mark.parametrize("support", [BOX, DRUM_SIDES, LOG_DEPTHS], ids=["box", "drum", "log"])
def test_edges_are_as_deep_as_the_deepest_of_their_points(support: Any) -> None:
    """A thousand of them, one by one; also those whose ends are out of it."""
    rng = np.random.default_rng(5)
    edges = CENTRE + rng.normal(size=(40, 3, 2, 3)) * 0.5
    share = np.linspace(0.0, 1.0, 1001)[:, None]
    start, end = edges[:, :, None, 0], edges[:, :, None, 1]
    depths = depth_in(support, start + share * (end - start))
    least, ends = deepest_of_edges(support, edges)
    assert_allclose(ends, depths[:, :, [0, -1]].min(axis=(1, 2)), rtol=1e-14)
    wanted = depths.min(axis=(1, 2))
    assert ((least <= wanted + 1e-12) | (wanted > 0.0)).all()
    assert_allclose(least[wanted < 0.0], wanted[wanted < 0.0], atol=3e-3)
    assert ((wanted < -0.01) & (ends > 0.01)).any()
    one = least_along(support, edges[:, 0, 0], edges[:, 0, 1] - edges[:, 0, 0])
    assert_allclose(one, depths[:, 0].min(axis=1), atol=3e-3)


def sides(support: Any, **more: Any) -> Any:
    return SimpleNamespace(own=BOX, support=support, **more)


def test_rims_and_edges_of_the_support_that_enter_the_body() -> None:
    """A drum whose end, or whose mantle, reaches 0.05 m into a face of the body's box; a box that
    does so with an edge; of a log nothing is asked."""
    turn = Rotation.from_rotvec([[0.3, -0.2, 0.1]] * 2)
    drum = Cylinder((0.0, 0.0, 0.0), 0.1, 0.25, (0.0, 0.0, 1.0))
    stands = Rotation.identity(2).as_quat(), CENTRE + [[0.1, 0.0, 0.4], [0.1, 0.0, 0.46]]
    assert_allclose(entering(sides(drum), *stands), [-0.05, 0.01], atol=1e-14)
    lies = (
        Rotation.from_rotvec([[0.0, 0.5 * np.pi, 0.0]] * 2).as_quat(),
        CENTRE + [[0, 0, 0.25], [0, 0, 0.31]],
    )
    assert_allclose(entering(sides(drum), *lies), [-0.05, 0.01], atol=1e-14)
    leans = turn.as_quat(), CENTRE + [[0.0, 0.0, 0.4], [0.2, 0.1, 0.35]]
    angles = np.linspace(0.0, 2.0 * np.pi, 20001)
    rim = 0.1 * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    for k, found in enumerate(entering(sides(drum), *leans)):
        points = [turn[k].apply(rim + [0, 0, z]) + leans[1][k] for z in (0.25, -0.25)]
        assert_allclose(found, min(depth_in(BOX, p).min() for p in points), atol=1e-8)
    small = Box((0.0, 0.0, 0.0), (0.2, 0.2, 0.2))
    edges = edges_of_box(small)
    share = np.linspace(0.0, 1.0, 401)[:, None, None]
    at = turn[0].apply((edges[:, 0] + share * (edges[:, 1] - edges[:, 0])).reshape(-1, 3))
    shift = CENTRE + [[0.5, 0.2, 0.25], [0.4, 0.1, 0.1]]
    for k, found in enumerate(entering(sides(small), turn.as_quat(), shift)):
        assert_allclose(found, depth_in(BOX, at + shift[k]).min(), atol=2e-3)
    assert np.isinf(entering(sides(LOG_DEPTHS), turn.as_quat(), shift)).all()
