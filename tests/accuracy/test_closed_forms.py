# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Closed forms against the equations of motion, a Taylor series in 192 bits, and quadrature."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from benchmarks.peers import scenes
from benchmarks.peers.reference import Reference, pose_error
from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.closed_forms import closed_form
from rb_sim.accuracy.closed_forms.rotors import (
    Exact,
    about,
    long,
)
from rb_sim.accuracy.ladder import reference
from rb_sim.accuracy.runs import Runner, sample_times
from rb_sim.mechanics.compiled import Compiled
from rb_sim.numerics.rotations import angle_between, product, rotate
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import load_scene, scene_from_mapping
from tests.contact.scenes import ball, box, scene, touch
from tests.contact_runs import contact_run

CONFIG = Path(__file__).resolve().parents[2] / "config"
GRAVITY = {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}}


def compiled_of(body: dict, constraints: dict | None = None, effects: dict | None = None):
    mapping = {"bodies": {"b": body}, "constraints": constraints or {}, "effects": effects or {}}
    return compile_scene(scene_from_mapping(mapping))


def exact_of(compiled: Compiled) -> Exact:
    exact = closed_form(compiled)
    assert exact is not None
    return exact


@pytest.mark.parametrize("name", ["free_tumble", "gazebo_boxes", "rolling_sphere"])
def test_coordinates_agree_with_a_taylor_series_in_192_bits(name: str) -> None:
    scene = scenes.load(name)._replace(duration=4.0)
    y = exact_of(compile_scene(load_scene(CONFIG / f"{name}.yaml"))).coordinates(scene.times)
    true = Reference(scene).pose(scene.times)
    # gazebo_boxes: its moments are rounded once more on the way through the shape
    assert pose_error(y[:, 0:3], y[:, 3:7], *true).max() < 2e-14


def test_pendulum_agrees_with_a_taylor_series_in_192_bits() -> None:
    scene = scenes.load("pendulum")._replace(duration=5.0)
    compiled = compile_scene(load_scene(CONFIG / "pendulum.yaml"))
    system: Any = compiled.system
    phi = long(exact_of(compiled).coordinates(scene.times)[:, 0])
    q = product(long(system.q_0), about(long(system.axis_B), phi))
    p = long(system.point) + rotate(q, long(system.rho))
    true = Reference(scene).pose(scene.times)
    assert pose_error(p.astype(float), q.astype(float), *true).max() < 5e-15


def rates(system: Any, y: np.ndarray) -> np.ndarray:
    """dq/dt and dw/dt of a free body without torque: Euler's equations in plain numpy."""
    inertia = np.array(system.body.inertia[:3])
    q, w = y[3:7], y[10:13]
    spin = np.append(w, 0.0)
    return np.concatenate(
        [
            0.5 * np.asarray(product(long(q), long(spin)), dtype=float),
            -np.cross(w, inertia * w) / inertia,
        ]
    )


def slope(exact: Exact, t: float, step: float = 1e-3) -> np.ndarray:
    """dy/dt by central differences of order 6."""
    at = exact.coordinates(np.array([0.0, *(t + k * step for k in (-3, -2, -1, 1, 2, 3))]))[1:]
    weights = np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0
    return weights @ at / step


@pytest.mark.parametrize("order", list(itertools.permutations([1.0, 2.0, 2.6])))
@pytest.mark.parametrize("spin", [(0.3, 2.0, -0.2), (-1.5, 0.4, 0.1), (0.1, -0.3, -1.2)])
def test_free_body_satisfies_eulers_equations_whatever_the_order_of_its_axes(order, spin) -> None:
    """Six orders of the axes, both sides of the separatrix, both signs."""
    body = {"mass": 1.0, "inertia": list(order), "angular_velocity": list(spin)}
    compiled = compiled_of(body)
    exact = exact_of(compiled)
    start = exact.coordinates(np.array([0.0, 1.0]))[0]
    assert np.abs(start - np.array(compiled.y)).max() < 4e-16
    for t in (0.7, 3.1):
        y = exact.coordinates(np.array([0.0, t]))[1]
        derivative = slope(exact, t)[[3, 4, 5, 6, 10, 11, 12]]
        assert np.abs(derivative - rates(compiled.system, y)).max() < 1e-11


@pytest.mark.parametrize(
    ("inertia", "spin"),
    [
        ([2.0, 2.0, 1.0], (0.5, 0.2, 3.0)),
        ([3.0, 2.0, 3.0], (0.5, 0.2, 3.0)),
        ([2.0, 2.0, 2.0], (0.5, 0.2, 3.0)),
        ([1.0, 2.0, 2.5], (0.0, -2.0, 0.0)),
        ([1.0, 2.0, 2.5], (0.0, 0.0, 0.0)),
    ],
)
def test_symmetric_or_steady_body_satisfies_eulers_equations(inertia, spin) -> None:
    body = {"mass": 2.0, "inertia": inertia, "angular_velocity": list(spin)}
    compiled = compiled_of(body, effects=GRAVITY)
    exact = exact_of(compiled)
    assert "symmetric" in exact.name
    y = exact.coordinates(np.array([0.0, 1.3]))[1]
    derivative = slope(exact, 1.3)
    own = derivative[[3, 4, 5, 6, 10, 11, 12]]
    assert np.abs(own - rates(compiled.system, y)).max() < 1e-11
    assert derivative[7:10] == pytest.approx([0.0, 0.0, -9.81], abs=1e-10)


def pendulum_of(angle: float, speed: float) -> Compiled:
    body = {
        "mass": 2.0,
        "inertia": [0.1, 0.12, 0.05],
        "center_of_mass": [0.0, 0.0, -0.7],
        "orientation": {"axis": [0.0, 1.0, 0.0], "angle": angle},
        "angular_velocity": [0.0, speed, 0.0],
    }
    axis = {"type": "fixed_axis", "body": "b", "axis_B": [0.0, 1.0, 0.0], "bearing_distance": 0.2}
    return compiled_of(body, {"hinge": axis}, GRAVITY)


@pytest.mark.parametrize(
    ("angle", "speed"),
    [(0.4, 1.0), (2.9, -0.3), (-1.0, -2.0), (0.3, 12.0), (-1.0, -11.0)],
)
def test_pendulum_takes_the_time_that_the_energy_integral_says(angle: float, speed: float) -> None:
    """t = integral of d theta / theta', with theta'^2 from the conservation of energy."""
    exact = exact_of(pendulum_of(angle, speed))
    frequency2 = 2.0 * 9.81 * 0.7 / (0.12 + 2.0 * 0.7**2)
    t = 0.11
    (_, _), (phi, rate) = exact.coordinates(np.array([0.0, t]))

    def slowness(theta: float) -> float:
        energy = speed**2 + 2.0 * frequency2 * (np.cos(theta) - np.cos(angle))
        return 1.0 / np.sqrt(energy)

    elapsed, _ = quad(slowness, angle, angle + phi, epsabs=1e-14, epsrel=1e-13)
    assert abs(elapsed) == pytest.approx(t, rel=1e-11)
    assert abs(rate) == pytest.approx(1.0 / slowness(angle + phi), rel=1e-12)


def test_pendulum_that_turns_over_counts_its_turns() -> None:
    exact = exact_of(pendulum_of(0.0, 20.0))
    t = np.linspace(0.0, 5.0, 5001)
    phi, rate = exact.coordinates(t).T
    assert phi[-1] > 10.0 * np.pi
    assert np.abs(np.diff(phi) - 1e-3 * 0.5 * (rate[1:] + rate[:-1])).max() < 1e-5


def test_rolling_sphere_that_already_turns_keeps_rolling() -> None:
    w, a = 3.0, 0.1
    body = {
        "mass": 2.0,
        "shape": {"type": "sphere", "radius": a},
        "position": [0.0, 0.0, a],
        "linear_velocity": [w * a, 0.0, 0.0],
        "angular_velocity": [0.0, w, 0.0],
    }
    push = {"type": "wrench", "body": "b", "force": [1.0, 0.0, 0.0]}
    floor = {"type": "rolling", "body": "b", "normal_A": [0.0, 0.0, 1.0]}
    exact = exact_of(compiled_of(body, {"floor": floor}, {**GRAVITY, "push": push}))
    y = exact.coordinates(np.array([0.0, 2.0]))[1]
    # LL 38 problem 1: dV/dt = 5 F / (7 m)
    assert y[0] == pytest.approx(w * a * 2.0 + 0.5 * 5.0 / 14.0 * 4.0, rel=1e-15)
    assert y[8] == pytest.approx(w + 5.0 / 14.0 * 2.0 / a, rel=1e-15)
    assert np.abs(y[[1, 7, 9]]).max() < 1e-16


def test_rolling_sphere_that_turns_aside_is_known_too() -> None:
    """Spun about all axes and pushed across its way: a run of it is what the closed form says."""
    w, a = np.array([1.0, 2.0, 3.0]), 0.1
    body = {
        "mass": 2.0,
        "shape": {"type": "sphere", "radius": a},
        "position": [0.0, 0.0, a],
        "linear_velocity": [w[1] * a, -w[0] * a, 0.0],
        "angular_velocity": w.tolist(),
    }
    push = {"type": "wrench", "body": "b", "force": [1.0, 0.5, 0.0], "torque": [0.0, 0.1, 0.05]}
    floor = {"type": "rolling", "body": "b", "normal_A": [0.0, 0.0, 1.0]}
    compiled = compiled_of(body, {"floor": floor}, {**GRAVITY, "push": push})
    times = np.linspace(0.0, 2.0, 21)
    runner = Runner(compiled, 2.0, times)
    rows, _ = runner.sampled(Setting("dopri853", tolerance=1e-14))
    y = exact_of(compiled).coordinates(times)
    assert np.abs(rows[:, :3] - y[:, :3]).max() < 1e-12
    assert angle_between(rows[:, 3:7], y[:, 3:7]).max() < 1e-11
    assert np.abs(rows[:, 10:13] - y[:, 7:10]).max() < 1e-11


def top_of(precession: float) -> Compiled:
    """Top with I1 = 0.5 and I3 = 0.2 about its point, leaning 30 degrees, in steady precession."""
    lean, mass, length = np.pi / 6.0, 1.5, 0.4
    spin = (mass * 9.81 * length / precession + 0.5 * precession * np.cos(lean)) / 0.2
    body = {
        "mass": mass,
        "inertia": [0.5 - mass * length**2, 0.5 - mass * length**2, 0.2],
        "center_of_mass": [0.0, 0.0, length],
        "orientation": {"axis": [1.0, 0.0, 0.0], "angle": lean},
        "angular_velocity": [0.0, precession * np.sin(lean), spin],
    }
    return compiled_of(body, {"tip": {"type": "fixed_point", "body": "b"}}, GRAVITY)


def test_steady_top_precesses_at_its_rate_and_lean() -> None:
    exact = exact_of(top_of(1.7))
    t = np.linspace(0.0, 3.0, 7)
    y = exact.coordinates(t)
    axis = np.asarray(rotate(long(y[:, :4]), long([0.0, 0.0, 1.0])), dtype=float)
    assert axis[:, 2] == pytest.approx(np.cos(np.pi / 6.0), abs=1e-15)
    turned_by = np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
    assert turned_by - turned_by[0] == pytest.approx(1.7 * t, abs=1e-14)


@pytest.mark.parametrize("name", ["heavy_top", "rolling_disk"])
def test_a_scene_without_a_closed_form_has_none(name: str) -> None:
    assert closed_form(compile_scene(load_scene(CONFIG / f"{name}.yaml"))) is None


def test_drag_or_a_tilted_inertia_has_no_closed_form() -> None:
    drag = {"drag": {"type": "linear_drag", "body": "b", "coefficient": 0.1}}
    body = {"mass": 1.0, "inertia": [1.0, 2.0, 2.5], "angular_velocity": [0.1, 1.0, 0.2]}
    assert closed_form(compiled_of(body, effects=drag)) is None
    tilted = {**body, "inertia": [[1.0, 0.1, 0.0], [0.1, 2.0, 0.0], [0.0, 0.0, 2.5]]}
    assert closed_form(compiled_of(tilted)) is None


# Closed forms of motions in contact against the integrator, which knows nothing of them.


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


def exact_of_contact(mapping: dict[str, Any]) -> Exact | None:
    return closed_form(compile_scene(scene_from_mapping(mapping)))


@pytest.mark.parametrize("name", CASES)
def test_closed_form_is_the_motion(name: str) -> None:
    mapping, times = CASES[name]
    times = [0.0, *times]
    exact = exact_of_contact(mapping)
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
        assert exact_of_contact(mapping) is None
