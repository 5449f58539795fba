# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Time stepping: bounded whatever the step, of order 1, and with the forces of the exact motion."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.accuracy.closed_forms import closed_form
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import G, ball, body, box, scene, shipped, touch
from tests.contact_runs import ContactRun, contact_run


def stepped(mapping: Any, step: float, times: Any) -> ContactRun:
    options = {"method": "time_stepping", "step": step, "tolerance": None}
    return contact_run(mapping, np.atleast_1d(times).tolist(), **options)


def tumbling_box(e: float = 0.2) -> Any:
    start = box(
        [0.2, 0.3, 0.1],
        [0, 0, 0.3],
        orientation=[0.18257419, 0.36514837, 0.54772256, 0.73029674],
        linear_velocity=[0.5, 0, -1.0],
        angular_velocity=[3, 1, 2],
    )
    return scene(start, touch(mu=0.4, restitution=e))


def test_box_comes_to_rest_as_it_does_with_events() -> None:
    """Flat on a face, four corners carrying the weight."""
    found = stepped(tumbling_box(0.0), 0.01, [0.0, 1.6])
    r = found.trajectory
    assert np.abs(r.linear_velocity["body"][1]).max() <= 1e-9
    assert np.abs(r.angular_velocity["body"][1]).max() <= 1e-9
    assert_allclose(r.reaction["floor"].force[1], [0, 0, G], atol=1e-6)
    assert min(abs(r.position["body"][1, 2] - h) for h in (0.05, 0.1, 0.15)) <= 1e-9


@pytest.mark.parametrize("step", [1e-3, 1e-2])
def test_what_slides_has_the_kinetic_coefficient(step: float) -> None:
    """Thrown along the floor; and pulled beyond what friction at rest can hold: from the first step
    on that it moves, kinetic friction acts.  The force is constant, and so exact in any step."""
    t, pull = 0.3, 0.6 * G
    thrown = box([0.2, 0.2, 0.1], [0, 0, 0.05], linear_velocity=[2.0, 0, 0])
    r = stepped(scene(thrown, touch(mu=0.5, kinetic=0.2)), step, [0.0, t]).trajectory
    assert_allclose(r.linear_velocity["body"][1, 0], 2.0 - 0.2 * G * t, atol=1e-9)
    assert_allclose(r.reaction["floor"].force[1], [-0.2 * G, 0, G], atol=1e-6)
    load = {"type": "wrench", "body": "body", "frame": "world", "force": [pull, 0.0, 0.0]}
    resting = box([0.2, 0.2, 0.1], [0, 0, 0.05])
    load["torque"] = [0.0, 0.05 * -0.2 * G, 0.0]
    r = stepped(scene(resting, touch(mu=0.5, kinetic=0.2), load=load), step, [0.0, t]).trajectory
    late = 1.01 * 0.3 * G * step  # the first step is from rest, with friction at rest
    assert_allclose(r.linear_velocity["body"][1, 0], (pull - 0.2 * G) * t, atol=late + 1e-9)


def test_order_one() -> None:
    """A ball that slips until it rolls, and one that bounces."""
    slip = scene(ball([0, 0, 0.1], linear_velocity=[2.0, 0, 0]), touch(mu=0.3))
    t = 2.0 * 2.0 / (7.0 * 0.3 * G)
    exact = 2.0 * t - 0.5 * 0.3 * G * t * t + 5.0 / 7.0 * 2.0 * (1.0 - t)
    errors = [
        abs(stepped(slip, h, [0.0, 1.0]).trajectory.position["body"][1, 0] - exact)
        for h in (0.04, 0.02, 0.01)
    ]
    assert errors[-1] <= 0.01
    assert errors[0] / errors[-1] >= 2.0
    bounce = scene(ball([0, 0, 0.5]), touch(restitution=0.7))
    best = contact_run(bounce, [0.0, 0.7], tolerance=1e-10).trajectory.position["body"][1, 2]
    errors = [
        abs(stepped(bounce, h, [0.0, 0.7]).trajectory.position["body"][1, 2] - best)
        for h in (8e-3, 4e-3, 2e-3, 1e-3)
    ]
    assert errors[-1] <= 4.0 * 1e-3
    assert max(errors[2:]) < max(errors[:2])


def test_leaves_a_sphere_where_nothing_presses_it_any_more() -> None:
    """From theta0 = 0.6 at rest the ball leaves at cos(theta) = 2/3 cos(theta0); of order 1."""
    theta, R = 0.6, 1.1
    start = ball([R * math.sin(theta), 0.0, R * math.cos(theta)])
    surface = {"type": "sphere", "radius": 1.0}
    mapping = scene(start, touch(friction={"type": "smooth"}, surface=surface))
    exact = closed_form(compile_scene(scene_from_mapping(mapping)))
    assert exact is not None
    end = exact.coordinates(np.array([0.6]))[0, 0:3]
    assert np.linalg.norm(end) > R + 0.01  # has left by then
    errors = []
    for step in (0.02, 0.005):
        r = stepped(mapping, step, [0.0, 0.6]).trajectory
        errors.append(np.abs(r.position["body"][1] - end).max())
    assert errors[0] < 5e-3 and errors[1] < 0.3 * errors[0]


def test_huge_spin() -> None:
    """1000 turns per step."""
    start = box([0.2, 0.3, 0.1], [0, 0, 0.5], angular_velocity=[3e5, 5e5, 2e5])
    found = stepped(scene(start, touch(mu=0.4)), 0.01, np.linspace(0, 1, 11))
    assert np.isfinite(found.trajectory.energy).all()
    assert found.trajectory.energy.max() <= found.trajectory.energy[0] * (1.0 + 1e-6)


@pytest.mark.parametrize(("step", "end"), [(0.01, 0.25), (0.11, 4.4)])
def test_samples_do_not_change_the_motion(step: float, end: float) -> None:
    """Bit for bit, though a sample between grid points is a step of its own; the long step sticks
    and slips within steps that are sampled."""
    block = box([0.2, 0.2, 0.1], [0, 0, 0.05])
    pull = {"type": "spring", "body": "body", "stiffness": 60.0, "rest_length": 0.0}
    mapping = scene(block, touch(mu=0.5, kinetic=0.2), pull=pull | {"point_A": [0.3, 0, 0.05]})
    ends = [
        stepped(mapping, step, np.linspace(0.0, end, n)).trajectory.position["body"][-1].tolist()
        for n in (2, 8, 27)
    ]
    assert ends[1] == ends[0]
    assert ends[2] == ends[0]
    assert math.isfinite(ends[0][0])


@pytest.mark.parametrize(("step", "steps"), [(1e-3, 1700), (1e-2, 200), (0.1, 20)])
def test_disk_comes_to_lie_flat(step: float, steps: int) -> None:
    """It wobbles down to the floor; its six points never ask for what cannot be.  In short steps it
    goes on wobbling, as it does with exact events, where it keeps 0.244 J."""
    shape = {"type": "disk", "radius": 0.1}
    lean = {"axis": [0.0, 1.0, 0.0], "angle": 0.5}
    start = body(shape, [0.0, 0.0, 0.3], orientation=lean, angular_velocity=[3.0, 1.0, 2.0])
    floor = touch(mu=0.4, restitution=0.3, lies_flat=True)
    mapping = scene(start, floor)
    options = {"method": "time_stepping", "step": step, "tolerance": None}
    r = contact_run(mapping, (np.arange(0, steps + 1, 10) * step).tolist(), **options).trajectory
    assert np.isfinite(r.position["body"]).all()
    assert r.energy.max() <= r.energy[0] + 1.1 * G * step * 2.0
    if step > 1e-3:
        assert abs(r.position["body"][-1, 2]) < 1e-3
    else:
        assert 0.05 < r.energy[-1] < 0.244


OUTSIDE = {"ball_on_block": (5.0, 0.0), "stick_slip": (0.0, 5.0)}
"""A load without potential pushes `block` along x: force [N] at first, and its rate [N/s]."""
SHIPPED = (
    "ball_on_block", "bouncing_ball", "colliding_spheres", "dropped_box", "incline_block",
    "rattleback", "rocking_block", "sphere_in_cylinder", "sphere_off_sphere", "stick_slip",
    "thrown_ball", "tippe_top", "turntable",
)  # fmt: skip
OVERLAP = 1e-12
"""Relative to the scene's length, that is left after a step."""


@pytest.mark.parametrize("step", [1e-5, 1e-2, 0.1])
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_scene_at_any_step(name: str, step: float) -> None:
    """Finite, no overlap, and no more energy than at first and has been put in, but for what the
    weight gives in one step: m (g h)^2 / 2."""
    steps = 5 if step == 1e-5 else 10
    found = stepped(shipped(name), step, step * np.arange(steps + 1))
    r = found.trajectory
    mass = sum(body["mass"] for body in shipped(name)["bodies"].values())
    put_in = np.maximum(r.contact_work, 0.0)
    if name in OUTSIDE:
        force, rate = OUTSIDE[name]
        middle = step * (np.arange(steps) + 0.5)
        moved = np.diff(r.position["block"][:, 0])
        put_in[1:] += np.cumsum((force + rate * middle) * moved)
    assert np.isfinite(r.block.position).all()
    growth = r.energy - r.energy[0] - put_in
    assert growth.max() <= 0.5 * mass * (G * step) ** 2 + 1e-12 * np.abs(r.energy).max()
    assert r.residual.max() <= OVERLAP


def test_compliant_support_carries() -> None:
    """A ball dropped on a damped spring comes to rest m g / k deep, and on the way it moves as it
    does with events, but for the first order of the step."""
    mapping = scene(ball([0, 0, 0.15]), touch(compliance={"stiffness": 1e3, "damping": 20.0}))
    rest = stepped(mapping, 0.01, [0.0, 4.0]).trajectory
    assert_allclose(rest.position["body"][1, 2], 0.1 - G / 1e3, atol=1e-9)
    assert_allclose(rest.reaction["floor"].force[1], [0, 0, G], atol=1e-6)
    exact = contact_run(mapping, [0.0, 0.2]).trajectory.position["body"][1, 2]
    errors = [
        abs(stepped(mapping, h, [0.0, 0.2]).trajectory.position["body"][1, 2] - exact)
        for h in (2e-3, 5e-4)
    ]
    assert errors[1] <= 1e-3
    assert errors[0] / errors[1] >= 2.0


def test_work_of_a_moving_support_is_reported() -> None:
    """A ball on a turntable: energy less that work is constant at any step, and the work tends to
    that of the exact motion."""
    surface = {"friction": {"type": "rough"}, "motion": {"type": "turntable", "rate": 3.0}}
    moving = ball([0.2, 0.0, 0.1], linear_velocity=[0.0, 0.3, 0.0])
    mapping = scene(moving | {"angular_velocity": [3.0, 0.0, 0.0]}, touch(**surface))
    mapping["simulation"] = {"duration": 1.0}
    exact = contact_run(mapping, [0.0, 1.0]).trajectory.contact_work[-1]
    assert exact > 0.02
    errors = []
    for step in (0.02, 0.01, 0.005):
        run = contact_run(mapping, [0.0, 1.0], method="time_stepping", step=step)
        assert run.balance() <= 1e-12
        errors.append(abs(run.trajectory.contact_work[-1] - exact))
    assert errors[1] < 0.6 * errors[0] and errors[2] < 0.6 * errors[1] < 0.05 * exact


def test_a_contact_that_holds_both_ways_pulls() -> None:
    """A ball below a plane on which it slides: its weight is held, and what pushes it up."""
    below = {"surface": {"type": "plane", "normal": [0, 0, -1]}, "mode": "bilateral"}
    hangs = ball([0.0, 0.0, -0.1], linear_velocity=[0.3, 0.0, 0.0])
    for up in (0.0, 15.0):
        lift = {"type": "wrench", "body": "body", "force": [0.0, 0.0, up]}
        found = stepped(scene(hangs, touch(**below), lift=lift), 0.01, [0.05, 0.5]).trajectory
        assert_allclose(found.position["body"][:, 2], -0.1, atol=1e-9)
        assert_allclose(found.reaction["floor"].force[:, 2], G - up, atol=1e-9)


@pytest.mark.parametrize("setting", [{"method": "time_stepping", "step": 0.1}, {"tolerance": 1e-9}])
def test_a_load_that_jumps_within_a_step_acts_from_then_on(setting: dict[str, Any]) -> None:
    """Held values of a table, to its last instant, on what flies: v is their sum over time."""
    push = {"type": "wrench_table", "body": "body", "interpolation": "hold"}
    push |= {"times": [0.0, 0.153, 0.31], "forces": [[1, 0, 0], [-20, 0, 0], [0, 0, 0]]}
    mapping = scene(ball([0.0, 0.0, 9.0]), touch(), push=push)
    mapping["simulation"] = {"duration": 0.5} | setting
    found = contact_run(mapping, [0.25, 0.5]).trajectory
    expected = [0.153 - 20.0 * 0.097, 0.153 - 20.0 * 0.157]
    assert_allclose(found.linear_velocity["body"][:, 0], expected, rtol=1e-12)
