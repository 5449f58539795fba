# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed forms of motions in contact against the integrator, which knows nothing of them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rb_sim.accuracy.closed_forms import closed_form
from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.ladder import reference
from rb_sim.accuracy.runs import Runner, sample_times
from rb_sim.numerics.rotations import angle_between
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene, scene_from_mapping
from tests.contact.scenes import ball, box, scene, touch
from tests.contact_runs import contact_run

CONFIG = Path(__file__).resolve().parents[2] / "config"
ROUGH = {"type": "rough"}
AGREE = 1e-9
"""The runs are made with a local tolerance of 1e-12."""


def on_incline(slope: float, speed: float, static: float, kinetic: float) -> dict[str, Any]:
    """A box on a plane that falls towards +x, moving down it at `speed`."""
    n, down = (
        np.array([math.sin(slope), 0, math.cos(slope)]),
        [math.cos(slope), 0, -math.sin(slope)],
    )
    turned = {"axis": [0.0, 1.0, 0.0], "angle": slope}
    body = box([0.4, 0.3, 0.2], [0.1 * x for x in n], linear_velocity=[speed * x for x in down])
    plane = {"type": "plane", "normal": list(n)}
    return scene(body | {"orientation": turned}, touch(mu=static, kinetic=kinetic, surface=plane))


def tilted_floor() -> dict[str, Any]:
    n = [0.28, 0.0, 0.96]
    body = ball([0.168, 0.1, 0.576], linear_velocity=[0.2, -0.1, 0.4])
    spun = body | {"angular_velocity": [1.0, 2.0, -0.5]}
    return scene(spun, touch(surface={"type": "plane", "normal": n}, restitution=0.4))


def on_turntable() -> dict[str, Any]:
    """Rolling, spinning, on a table that turns about another point than the origin."""
    rate, point = -2.0, np.array([0.3, 0.1, 0.0])
    p, v = np.array([-0.1, 0.2, 0.1]), np.array([0.4, -0.2, 0.0])
    table = rate * np.array([-(p - point)[1], (p - point)[0], 0.0])
    slip = v - table
    w = [-slip[1] / 0.1, slip[0] / 0.1, 3.0]
    motion = {"type": "turntable", "rate": rate, "point": point.tolist()}
    body = ball(p.tolist(), linear_velocity=v) | {"angular_velocity": w}
    return scene(body, touch(friction=ROUGH, motion=motion))


def in_cylinder() -> dict[str, Any]:
    """Going round clockwise, downwards at first, with a spin about the radius as well."""
    w = [2.0, 0.5 / 0.1 * -1.0, 1.6 / 0.1]
    body = ball([0.4, 0.0, 0.0], linear_velocity=[0.0, -1.6, -0.5]) | {"angular_velocity": w}
    surface = {"type": "cylinder", "axis": [0.0, 0.0, 1.0], "radius": 0.5}
    return scene(body, touch(friction=ROUGH, surface=surface))


def off_sphere(friction: dict[str, Any], theta: float, speed: float) -> dict[str, Any]:
    """A ball at the angle theta from the top of a sphere, going down at `speed`."""
    down = np.array([math.cos(theta), 0.0, -math.sin(theta)])
    body = ball([0.6 * math.sin(theta), 0.0, 0.6 * math.cos(theta)], linear_velocity=speed * down)
    spin = speed / 0.1 if friction is ROUGH else 0.0
    surface = {"type": "sphere", "radius": 0.5}
    moving = body | {"angular_velocity": [0.0, spin, 0.0]}
    return scene(moving, touch(friction=friction, surface=surface))


MASSE = ball([0.0, 0.0, 0.1], linear_velocity=[1.0, 0.5, 0.0]) | {
    "angular_velocity": [4.0, -12.0, 20.0]
}
CASES = {
    "slips, the spin across its way": (scene(MASSE, touch(mu=0.3, kinetic=0.2)), [0.1, 0.4, 1.0]),
    "bounces on a tilted floor": (tilted_floor(), [0.1, 0.45, 0.8, 1.5]),
    "falls without rebound": (scene(ball([0.0, 0.0, 0.3]), touch()), [0.1, 0.5]),
    "turntable": (on_turntable(), [0.3, 1.1]),
    "cylinder": (in_cylinder(), [0.2, 0.6]),
    "rolls off a sphere": (off_sphere(ROUGH, 0.3, 0.5), [0.1, 0.3, 0.5]),
    "over the top and off": (off_sphere(ROUGH, -0.2, 0.9), [0.1, 0.3, 0.6]),
    "slides off a sphere": (off_sphere({"type": "smooth"}, 0.3, 0.5), [0.1, 0.3, 0.5]),
    "up, and back": (on_incline(0.5, -1.0, 0.4, 0.3), [0.05, 0.3]),
    "down, and stays": (on_incline(0.3, 0.5, 0.6, 0.5), [0.1, 1.0]),
    "begins to slide": (on_incline(0.5, 0.0, 0.4, 0.3), [0.1, 0.2]),
}


def exact_of(mapping: dict[str, Any]) -> Exact | None:
    return closed_form(compile_scene(scene_from_mapping(mapping)))


@pytest.mark.parametrize("name", CASES)
def test_closed_form_is_the_motion(name: str) -> None:
    mapping, times = CASES[name]
    times = [0.0, *times]
    exact = exact_of(mapping)
    assert exact is not None
    y = exact.coordinates(np.array(times))
    run = contact_run(mapping, times, tolerance=1e-12, duration=times[-1]).trajectory
    assert np.abs(run.position["body"] - y[:, 0:3]).max() < AGREE
    assert angle_between(run.orientation["body"], y[:, 3:7]).max() < AGREE
    assert np.abs(run.linear_velocity["body"] - y[:, 7:10]).max() < AGREE
    spin = np.abs(run.angular_velocity["body"] - y[:, 10:13]).max()
    assert spin * 0.1 < AGREE
    assert np.abs(run.contact_work - y[:, 13]).max() < AGREE


@pytest.mark.parametrize(
    "name",
    ["thrown_ball", "bouncing_ball", "turntable", "sphere_in_cylinder", "sphere_off_sphere",
     "incline_block"],
)  # fmt: skip
def test_shipped_scene_has_its_closed_form(name: str) -> None:
    assert closed_form(compile_scene(load_scene(CONFIG / f"{name}.yaml"))) is not None


def test_a_ladder_measures_contacts_by_their_closed_form() -> None:
    scene = load_scene(CONFIG / "bouncing_ball.yaml", duration=0.6)
    runner = Runner(compile_scene(scene), 0.6, sample_times(scene.simulation))
    true = reference(runner, 30.0)
    assert "closed form" in true.kind and true.agreement.pose < 1e-9


def test_what_is_beyond_the_closed_forms_is_not_taken_for_them() -> None:
    slipping = MASSE | {"shape": {"type": "sphere", "radius": 0.1}}
    drag = {"type": "linear_drag", "body": "body", "coefficient": 0.1}
    tall = box([0.1, 0.1, 1.0], [0.0, 0.0, 0.5], linear_velocity=[1.0, 0.0, 0.0])
    skew = on_incline(0.3, 0.5, 0.6, 0.5)
    skew["bodies"]["body"]["linear_velocity"][1] = 0.2
    for mapping in (
        scene(slipping, touch(mu=0.2, rolling_resistance=1e-3)),
        scene(slipping, touch(mu=0.2), drag=drag),
        scene(slipping | {"inertia": [0.004, 0.004, 0.005]}, touch(mu=0.2)),
        scene(slipping, touch(friction={"type": "viscous", "coefficient": 1.0})),
        scene(tall, touch(mu=0.4)),  # would tip
        skew,
        off_sphere(ROUGH, 0.3, 3.0),  # leaves at once
        on_turntable() | {"effects": {}},
    ):
        assert exact_of(mapping) is None
