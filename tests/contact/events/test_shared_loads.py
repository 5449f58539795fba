"""Several points that hold one body: their shares keep to the laws, and nothing creeps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.contact.scenes import G, ball, body, box, scene, touch
from tests.contact_runs import contact_run


def tilted(angle: float) -> tuple[np.ndarray, dict[str, Any]]:
    """(normal, surface) of a plane that falls towards +x."""
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    return normal, {"type": "plane", "normal": normal.tolist()}


@pytest.mark.parametrize("margin", [0.2, 1e-6])
def test_box_on_its_four_corners_does_not_creep(margin: float) -> None:
    """Friction above tan(tilt) by this part of it, for 1000 s; the shares of least norm would not
    keep to the friction bound at every corner."""
    normal, surface = tilted(0.4)
    turn = {"axis": [0, 1, 0], "angle": 0.4}
    start = box([0.2, 0.3, 0.1], 0.05 * normal, orientation=turn)
    mapping = scene(start, touch(mu=math.tan(0.4) * (1.0 + margin), surface=surface))
    mapping["simulation"]["duration"] = 1000.0
    found = contact_run(mapping, [0.0, 1000.0])
    r = found.trajectory
    assert (r.position["body"][1] == r.position["body"][0]).all()
    assert (r.linear_velocity["body"] == 0.0).all()
    assert_allclose(r.reaction["floor"].force, [[0, 0, G]] * 2, atol=1e-12)
    assert {e.kind for e in found.events} == {"closes", "sticks"}


def test_cylinder_rolls_down_on_both_ends() -> None:
    """a = g sin / (1 + 1/2), T = m g sin / 3; the ends share both."""
    angle = 0.3
    normal, surface = tilted(angle)
    along = np.array([math.cos(angle), 0.0, -math.sin(angle)])
    shape = {"type": "cylinder", "radius": 0.1, "length": 0.3, "axis_B": [0, 1, 0]}
    mapping = scene(body(shape, 0.1 * normal), touch(mu=0.5, surface=surface))
    times = np.array([0.0, 0.5, 1.0])
    r = contact_run(mapping, times.tolist(), tolerance=1e-12).trajectory
    fallen = 0.5 * (G * math.sin(angle) / 1.5) * times**2
    assert_allclose(r.position["body"], 0.1 * normal + fallen[:, None] * along, atol=1e-11)
    share = 0.5 * G * (math.cos(angle) * normal - math.sin(angle) / 3.0 * along)
    for i in (1, 2):
        assert_allclose(r.reaction[f"floor/{i}"].force, [share] * 3, atol=1e-10)


def ladder(angle: float, floor: float, wall: float) -> dict[str, Any]:
    """A rod of 2 m that leans against a wall, with these friction coefficients."""
    x, z = math.cos(angle), math.sin(angle)
    turn = {"axis": [0, 1, 0], "angle": 0.5 * math.pi - angle}
    shape = {"type": "rod", "length": 2.0}
    inertia = [1.0 / 3.0, 1.0 / 3.0, 1e-3]
    side = {"type": "plane", "normal": [-1, 0, 0], "point": [2.0 * x, 0, 0]}
    constraints = {
        "floor": touch(mu=floor, points=[[0, 0, -1.0]]),
        "wall": touch(mu=wall, points=[[0, 0, 1.0]], surface=side),
    }
    return scene(body(shape, [x, 0, z], inertia=inertia, orientation=turn), constraints)


@pytest.mark.parametrize("beyond", [1e-3, 1e-6])
def test_ladder_stands_and_slides_as_statics_says(beyond: float) -> None:
    """tan = (1 - mu_floor mu_wall) / (2 mu_floor) is the limit of equilibrium."""
    floor, wall = 0.4, 0.3
    limit = math.atan((1.0 - floor * wall) / (2.0 * floor))
    held = contact_run(ladder(limit + beyond, floor, wall), [0.0, 10.0])
    r = held.trajectory
    assert (r.position["body"][1] == r.position["body"][0]).all()
    for name, mu, (push, *along) in (("floor", floor, (2, 0, 1)), ("wall", wall, (0, 1, 2))):
        force = r.reaction[name].force
        rub = np.linalg.norm(force[:, along], axis=1)
        assert (rub <= mu * np.abs(force[:, push]) * (1.0 + 1e-9)).all()
    slid = contact_run(ladder(limit - beyond, floor, wall), [0.0, 0.1])
    assert np.ptp(slid.trajectory.position["body"][:, 0]) >= 1e-3 * beyond
    assert slid.times("slips") == [0.0, 0.0]


SIDES = {"left": 1, "right": -1}


def test_ball_between_two_walls_falls_freely() -> None:
    """Smooth walls that it just fills do not hold it."""
    walls = {
        name: touch(surface={"type": "plane", "normal": [i, 0, 0], "point": [-0.1 * i, 0, 0]})
        for name, i in SIDES.items()
    }
    r = contact_run(scene(ball([0, 0, 1.0]), walls), [0.0, 0.5]).trajectory
    assert_allclose(r.position["body"][1], [0, 0, 1.0 - 0.125 * G], atol=1e-13)
    assert_allclose(r.reaction["left"].force, np.zeros((2, 3)), atol=1e-13)


def test_ball_slips_until_it_rolls_in_a_groove() -> None:
    """Walls at 45 degrees, N = m g / sqrt 2 each; it rolls on circles of r / sqrt 2, so its slip
    falls by sqrt 2 mu g (1 + 5/4) per second, its speed by 4/9 of that.  Both stick at once."""
    s, v, mu = math.sqrt(0.5), 1.0, 0.5
    walls = {
        name: touch(mu=mu, surface={"type": "plane", "normal": [i * s, 0, s]})
        for name, i in SIDES.items()
    }
    start = ball([0, 0, 0.1 / s], linear_velocity=[0, v, 0])
    found = contact_run(scene(start, walls), [0.0, 1.0], tolerance=1e-12)
    assert_allclose(found.times("sticks"), [v / (2.25 * math.sqrt(2.0) * mu * G)] * 2, atol=1e-12)
    assert [e.kind for e in found.events if e.t > 0.0] == ["sticks", "sticks"]
    assert_allclose(found.trajectory.linear_velocity["body"][1], [0, v / 1.8, 0], atol=1e-11)
