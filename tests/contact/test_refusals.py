# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a contact cannot be is refused in one line; overlaps at the start are moved apart."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SceneError
from rb_sim.scene.compile import compile_scene
from tests.contact.scenes import ball, body, box, scene, touch

BALL = ball([0, 0, 0.1])
TURNTABLE = {"type": "turntable", "rate": 1.0}
CYLINDER = {"type": "cylinder", "radius": 0.1, "length": 0.2}
PARENT = {"body": BALL, "a": box([1, 1, 1], [0, 0, -0.5])}
COULOMB = {"type": "coulomb", "static": 0.3}

REFUSED: dict[str, tuple[Any, Any, tuple[str, ...]]] = {
    "penetrates": (
        ball([0, 0, 0.05]), touch(),
        ("floor", "overlap of 0.05 m at the start", "use position [0, 0, 0.1] for body"),
    ),
    "rough but slips": (
        ball([0, 0, 0.1], linear_velocity=[1, 0, 0]),
        touch(friction={"type": "rough"}),
        ("floor", "slips at 1 m/s at the start", "rough"),
    ),
    "tilted below the floor": (
        box([0.4, 0.4, 0.2], [0, 0, 0.1], orientation={"axis": [0, 1, 0], "angle": 0.5}), touch(),
        ("floor", f"use position [0, 0, {0.2 * math.sin(0.5) + 0.1 * math.cos(0.5):.6g}] for body"),
    ),
    "bilateral but apart": (
        ball([0, 0, 0.2]), touch(mode="bilateral"),
        ("floor", "gap of 0.1 m at the start", "use position [0, 0, 0.1] for body"),
    ),
    "unknown surface": (BALL, touch(surface={"type": "cone"}), ("cone", "plane", "cylinder")),
    "unknown friction": (BALL, touch(friction={"type": "sticky"}), ("sticky", "coulomb")),
    "unknown motion": (BALL, touch(motion={"type": "flown"}), ("flown", "turntable")),
    "motion of a body": (PARENT, touch(parent="a", motion=TURNTABLE), ("motion", "parent")),
    "shape of the world": (BALL, touch(surface={"type": "shape"}), ("shape", "parent")),
    "bounces up": (BALL, touch(restitution=1.1), ("restitution", "1.1")),
    "pulls back": (BALL, touch(restitution=-0.1), ("restitution", "-0.1")),
    "kinetic above static": (
        BALL, touch(friction=COULOMB | {"kinetic": 0.4}), ("kinetic", "0.3"),
    ),
    "negative friction": (BALL, touch(friction={"type": "coulomb", "static": -1}), ("static",)),
    "infinite friction": (
        BALL, touch(friction={"type": "coulomb", "static": float("inf")}), ("static",),
    ),
    "soft and bilateral": (
        BALL, touch(mode="bilateral", compliance={"stiffness": 1.0}), ("mode", "compliant"),
    ),
    "too large for the pipe": (
        BALL,
        touch(surface={"type": "cylinder", "radius": 0.1, "side": "inside"}),
        ("smaller", "cylinder"),
    ),
    "flatter than the bowl": (
        body({"type": "ellipsoid", "semi_axes": [0.5, 0.5, 0.05]}, [0, 0, 0.9]),
        touch(surface={"type": "sphere", "center": [0, 0, 1], "radius": 0.6, "side": "inside"}),
        ("largest radius of curvature", "0.6 m", "5 m", "two of its points"),
    ),
    "flatter than the pipe": (
        body({"type": "ellipsoid", "semi_axes": [0.5, 0.5, 0.25]}, [0, 0, 0.1]),
        touch(surface={"type": "cylinder", "axis": [1, 0, 0], "radius": 1.0}),
        ("largest radius of curvature", "1 m", "two of its points"),
    ),
    "cylinder on a cylinder": (
        body(CYLINDER, [0, 0, 1]),
        touch(surface={"type": "cylinder", "radius": 0.5, "side": "outside"}),
        ("points", "one of plane, sphere, sphere from inside, cylinder from inside, which its cyl"),
    ),
    "upright in a bowl": (
        body(CYLINDER, [0, 0, 0.5]),
        touch(surface={"type": "sphere", "center": [0, 0, 1], "radius": 1.0, "side": "inside"}),
        ("rim lies all round", "bodies.body.position"),
    ),
    "in the middle of a bowl": (
        body({"type": "ellipsoid", "semi_axes": [0.1, 0.12, 0.14]}, [0, 0, 1]),
        touch(surface={"type": "sphere", "center": [0, 0, 1], "radius": 1.0, "side": "inside"}),
        ("at the centre, or its rim", "bodies.body.position"),
    ),
    "on a parent without shape": (
        {"body": BALL, "a": {"mass": 1.0, "inertia": [1, 1, 1]}},
        touch(parent="a", surface={"type": "shape"}),
        ("sphere, box or cylinder", "none"),
    ),
    "no shape at all": (
        {"mass": 1.0, "inertia": [1, 1, 1]}, touch(), ("points", "none"),
    ),
    "too many points": (BALL, touch(points=[[0, 0, 0.01 * i] for i in range(65)]), ("64",)),
    "parent is itself": (BALL, touch(parent="body"), ("parent", "body")),
    "parent is nobody": (BALL, touch(parent="nobody"), ("nobody",)),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_one_clear_line(name: str) -> None:
    bodies, contact, words = REFUSED[name]
    with pytest.raises(SceneError) as caught:
        compile_scene(load_scene(scene(bodies, contact)))
    text = str(caught.value)
    assert "\n" not in text
    assert "floor" in text
    for word in words:
        assert word in text, text


def test_penetration_may_be_projected_away() -> None:
    mapping = scene(ball([0, 0, 0.0999]), touch())
    mapping["simulation"]["project_initial"] = True
    compile_scene(load_scene(mapping))


def test_a_soft_support_may_be_pressed_in_at_the_start() -> None:
    compile_scene(load_scene(scene(ball([0, 0, 0.09]), touch(compliance={"stiffness": 1e3}))))


# With `project_initial` bodies that overlap at the start are moved apart, whatever their velocity.
#
# Without mass elsewhere, least mass-weighted way means: two free bodies keep their centre of mass
# and part along the normal; what nobody pushes stays where it is.


BALL_START = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}
G = 9.81


def scene_of_start(bodies: Any, constraints: Any, gravity: float = G, **options: Any) -> Any:
    return load_scene(
        {
            "bodies": bodies,
            "constraints": constraints,
            "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -gravity]}},
            "simulation": {"duration": 0.02, "rate": 100.0, "project_initial": True} | options,
        }
    )


@pytest.mark.parametrize("rise", [1.0, -1.0])
def test_a_ball_in_the_floor_starts_on_it(rise: float) -> None:
    """z = r + v t - g t^2 / 2 from there; what falls bounces at once."""
    bodies = {"b": BALL_START | {"position": [0.0, 0.0, 0.05], "linear_velocity": [0.0, 0.0, rise]}}
    floor = {"floor": {"type": "contact", "body": "b", "restitution": 0.5}}
    found = Simulation(scene_of_start(bodies, floor)).run(checks=False)
    v = 1.0 if rise > 0.0 else 0.5
    expected = 0.1 + v * found.t - 0.5 * G * found.t**2
    np.testing.assert_allclose(found.position["b"][:, 2], expected, rtol=0.0, atol=1e-11)
    assert float(found.residual.max()) < 1e-12


def test_a_string_that_starts_too_long_draws_its_ends_together() -> None:
    """Masses 1 and 3, 0.8 m apart on a string of 0.5 m, recede at 1 m/s: their centre stays, and
    the string, with a restitution of 0.5, lets them approach at 0.5 m/s."""
    bodies = {
        "a": BALL_START | {"mass": 3.0},
        "b": BALL_START | {"position": [0.8, 0.0, 0.0], "linear_velocity": [1.0, 0.0, 0.0]},
    }
    rope = {"type": "string", "body": "b", "parent": "a", "point_A": [0.0] * 3, "length": 0.5}
    rope |= {"restitution": 0.5}
    found = Simulation(scene_of_start(bodies, {"rope": rope}, gravity=0.0)).run(checks=False)
    centre, apart = 0.2 + 0.25 * found.t, 0.5 - 0.5 * found.t
    np.testing.assert_allclose(found.position["a"][:, 0], centre - 0.25 * apart, atol=1e-12)
    np.testing.assert_allclose(found.position["b"][:, 0], centre + 0.75 * apart, atol=1e-12)


def test_the_joints_hold_while_bodies_are_moved_apart() -> None:
    """A ball on an arm of 0.4 m about a fixed point, in a wall at x = 0.3 by 5 cm: it starts on its
    sphere about the point and beside the wall, moving on the sphere."""
    arm = {"type": "fixed_point", "body": "b", "point_B": [-0.4, 0.0, 0.0]}
    wall = {"type": "plane", "point": [0.3, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0]}
    turn = np.arccos(0.25 / 0.4)
    ball = BALL_START | {
        "position": [0.25, 0.0, -0.4 * np.sin(turn)],
        "orientation": {"axis": [0.0, 1.0, 0.0], "angle": turn},
    }
    constraints = {
        "arm": arm,
        "wall": {"type": "contact", "body": "b", "surface": wall, "restitution": 1.0},
    }
    found = Simulation(scene_of_start({"b": ball}, constraints)).run(checks=False)
    p = found.position["b"]
    np.testing.assert_allclose(np.linalg.norm(p, axis=1), 0.4, rtol=0.0, atol=1e-10)
    assert p[0, 0] == pytest.approx(0.2, abs=1e-12)
    assert float(found.residual.max()) < 1e-10


def test_a_gap_that_is_too_narrow_is_refused() -> None:
    """A ball of 0.2 m between a floor and a ceiling 0.15 m apart."""
    ceiling = {"type": "plane", "point": [0.0, 0.0, 0.15], "normal": [0.0, 0.0, -1.0]}
    constraints = {
        "floor": {"type": "contact", "body": "b"},
        "ceiling": {"type": "contact", "body": "b", "surface": ceiling},
    }
    body = {"b": BALL_START | {"position": [0.0, 0.0, 0.1]}}
    with pytest.raises(SceneError) as caught:
        Simulation(scene_of_start(body, constraints))
    text = str(caught.value)
    assert "has an overlap" in text and "\n" not in text


ROUNDING = (0.0, 1e-13, -1e-13, 1e-12, -1e-12)
"""Gaps [m] of what touches, as rounding leaves them."""
SETTINGS = {
    "dopri853": {"method": "dopri853", "tolerance": 1e-10},
    "rk4": {"method": "rk4", "step": 1e-3},
    "time_stepping": {"method": "time_stepping", "step": 1e-3},
}


@pytest.mark.parametrize("method", SETTINGS)
@pytest.mark.parametrize("gap", ROUNDING)
def test_a_start_that_overlaps_or_grazes_by_rounding_touches(method: str, gap: float) -> None:
    """What rubs rolls after 2 v / (7 mu g), at 5/7 of its speed; what falls bounces at once, to e v
    and mu (1 + e) v less along; what rises is free."""
    mu, e = 0.3, 0.5
    late = 1e-3 if method == "time_stepping" else 0.0  # of first order: by a step of speed or way
    floor = {"type": "contact", "body": "b", "restitution": e}
    contact = {"floor": floor | {"friction": {"type": "coulomb", "static": mu}}}
    cases = (
        (0.0, G, [5.0 / 7.0, 0.0], 0.0),
        (-0.5, 0.0, [1.0 - mu * (1.0 + e) * 0.5, 0.5 * e], 0.2 * 0.5 * e),
        (0.5, 0.0, [1.0, 0.5], 0.2 * 0.5),
    )
    for v, gravity, expected, rise in cases:
        bodies = {
            "b": BALL_START | {"position": [0, 0, 0.1 + gap], "linear_velocity": [1.0, 0.0, v]}
        }
        options = SETTINGS[method] | {"duration": 0.2}
        found = Simulation(scene_of_start(bodies, contact, gravity=gravity, **options)).run(
            checks=False
        )
        velocity = found.linear_velocity["b"][-1, [0, 2]]
        np.testing.assert_allclose(velocity, expected, rtol=0.0, atol=1e-9)
        height = found.position["b"][-1, 2] - 0.1
        np.testing.assert_allclose(height, rise, rtol=0.0, atol=1e-9 + late)
        assert float(found.residual.max()) <= 1e-11
