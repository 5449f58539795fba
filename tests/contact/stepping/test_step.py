# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a step of time stepping leaves: flight, energy, rebounds, and the torques reported."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import StepTooLargeError
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import G, ball, body, box, scene, touch

FAR = {"type": "plane", "point": [0.0, 0.0, -100.0]}


def run(mapping: dict[str, Any], step: float, duration: float) -> Any:
    options = {"method": "time_stepping", "step": step, "duration": duration, "rate": 1.0 / step}
    return Simulation(load_scene(mapping | {"simulation": options})).run(check=False)


@pytest.mark.parametrize("step", [0.01, 0.1])
def test_what_nothing_touches_falls_exactly(step: float) -> None:
    """Drifts at the old and the new velocity are the parabola; a spin keeps its energy."""
    start = {"linear_velocity": [0.3, -0.2, 1.0], "angular_velocity": [1.0, 2.0, -0.5]}
    thrown = box([0.1, 0.2, 0.4], [0.0, 0.0, 5.0], **start)
    found = run(scene(thrown, touch(surface=FAR)), step, 0.5)
    t = found.t[:, None]
    fall = np.array([0.0, 0.0, -9.81])
    way = [0.0, 0.0, 5.0] + t * np.array(start["linear_velocity"]) + 0.5 * t * t * fall
    assert_allclose(found.position["body"], way, atol=1e-12)
    assert_allclose(found.energy, found.energy[0], rtol=1e-9)


def test_two_balls_that_meet_in_a_long_step_are_moved_apart_by_their_masses() -> None:
    """They end side by side, and their common centre goes its way."""
    bodies = {
        "a": ball([0.0, 0.0, 0.0], linear_velocity=[1.0, 0.0, 0.0]),
        "b": ball([0.31, 0.08, 0.0], linear_velocity=[-2.0, 0.0, 0.0], mass=3.0),
    }
    meet = touch("b", parent="a", surface={"type": "shape"})
    found = run(scene(bodies, {"meet": meet}, gravity=False), 0.02, 0.2)
    a, b = found.position["a"], found.position["b"]
    apart = np.linalg.norm(b - a, axis=1) - 0.2
    assert apart.min() > -1e-12
    assert found.reaction["meet"].force.any()
    centre = 0.25 * a + 0.75 * b
    expected = centre[0] + found.t[:, None] * np.array([-1.25, 0.0, 0.0])
    assert_allclose(centre, expected, atol=1e-12)


def test_a_stack_that_is_dropped_flat_ends_without_overlap() -> None:
    """Of three bodies between each other, after an impact far longer than a step of its own."""
    bodies = {f"b{i}": ball([0.0, 0.0, 0.1 + 0.21 * i + 0.3]) for i in range(3)}
    on = {f"on{i}": touch(f"b{i}", parent=f"b{i - 1}", surface={"type": "shape"}) for i in (1, 2)}
    found = run(scene(bodies, {"floor": touch("b0")} | on), 0.05, 0.6)
    z = np.array([found.position[f"b{i}"][:, 2] for i in range(3)])
    assert z[0].min() > 0.1 - 1e-10
    assert np.diff(z, axis=0).min() > 0.2 - 1e-10
    assert_allclose(z[:, -1], [0.1, 0.3, 0.5], atol=1e-9)


def test_a_floor_holds_a_box_that_is_pushed_aside_with_force_and_torque() -> None:
    """All corners together: weight and push, and the torque of the push about the centre."""
    push = {"type": "wrench", "body": "body", "force": [1.0, 0.0, 0.0], "point_B": [0.0, 0.0, 0.15]}
    resting = scene(box([0.2, 0.2, 0.4], [0.0, 0.0, 0.2]), touch(mu=0.6), push=push)
    found = run(resting, 0.01, 0.2).reaction["floor"]
    about = found.torque[-1] + np.cross(found.anchor[-1] - [0.0, 0.0, 0.2], found.force[-1])
    assert_allclose(found.force[-1], [-1.0, 0.0, 9.81], atol=1e-9)
    assert_allclose(about, [0.0, -0.15, 0.0], atol=1e-9)


# Restitution and friction together create no energy in a step (Kane and Levinson 1985).


MU, E, STEP = 0.7, 0.95, 1e-3


STEPS = {"method": "time_stepping", "step": STEP}


def thrown(lean: float, speed: float, spin: float, **how: object) -> Simulation:
    """A rod whose lower end is about to strike the floor, in the plane of x and z."""
    body = {
        "mass": 1.0, "inertia": [1.0 / 12.0, 1.0 / 12.0, 1e-3],
        "position": [0.0, 0.0, 0.5 * np.cos(lean) + 0.004],
        "orientation": {"axis": [0.0, 1.0, 0.0], "angle": lean},
        "linear_velocity": [speed, 0.0, -1.0], "angular_velocity": [0.0, spin, 0.0],
    }  # fmt: skip
    end = {
        "type": "contact", "body": "rod", "points": [[0.0, 0.0, -0.5]],
        "friction": {"type": "coulomb", "static": MU}, "restitution": E,
    }  # fmt: skip
    times = {"duration": 0.02, "rate": 1.0 / STEP} | how
    scene = {"bodies": {"rod": body}, "constraints": {"floor": end}, "simulation": times}
    return Simulation(scene_from_mapping(scene))


@pytest.mark.parametrize("seed", range(4))
def test_no_impact_creates_energy(seed: int) -> None:
    """Without loads the contact's work is all there is."""
    rng, rebounds = np.random.default_rng(seed), 0
    for _ in range(10):
        lean, speed, spin = rng.uniform([-1.2, -3.0, -3.0], [1.2, 3.0, 3.0])
        found = thrown(lean, speed, spin, **STEPS).run(checks=False)
        assert np.diff(found.energy).max() <= 1e-12
        arm = -0.5 * np.array([np.sin(lean), np.cos(lean)])
        rises = found.linear_velocity["rod"][:, 2] - found.angular_velocity["rod"][:, 1] * arm[0]
        rebounds += rises[-1] > 0.0
    assert rebounds > 5


def test_a_rebound_that_creates_none_is_newtons() -> None:
    """Upright and without slip: v+ = -e v-."""
    found = thrown(0.0, 0.0, 0.0, **STEPS).run(checks=False)
    assert found.linear_velocity["rod"][-1, 2] == pytest.approx(E, abs=1e-9)


@pytest.mark.parametrize(
    "start", [(-0.527, -0.089, 2.884), (-0.572, -1.209, 1.885), (-0.927, -0.653, 0.1)]
)
def test_one_that_would_create_some_is_poissons(start: tuple[float, float, float]) -> None:
    """As in the run that locates the impact; Newton's law gave 1.08 times the energy."""
    ends = [thrown(*start, **how).run(checks=False).block for how in ({}, STEPS)]
    exact, found = (np.hstack([b.linear_velocity[-1], b.angular_velocity[-1]]) for b in ends)
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=5e-3)


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.6])
def test_a_box_that_lands_flat_with_e_1_keeps_its_energy(friction: float) -> None:
    """Its corners press against each other by friction; of the whole impact nothing is made."""
    box = {"mass": 1.0, "shape": {"type": "box", "size": [1.0, 0.8, 0.6]}}
    floor = {"type": "contact", "body": "box", "restitution": 1.0}
    if friction:
        floor["friction"] = {"type": "coulomb", "static": friction}
    scene = {
        "bodies": {"box": box | {"position": [0.0, 0.0, 2.0]}},
        "constraints": {"floor": floor},
        "effects": {"g": {"type": "gravity"}},
        "simulation": {"duration": 3.0, "rate": 100, "method": "time_stepping", "step": 1e-3},
    }
    found = Simulation(scene_from_mapping(scene)).run(checks=False)
    assert np.abs(found.angular_velocity["box"]).max() < 1e-3
    assert found.energy[-1] == pytest.approx(found.energy[0], rel=1e-4)


def test_friction_without_a_corner_is_that_of_the_normal_forces_of_its_step() -> None:
    """A table that turns as it slides presses on its front feet: in the very first step, too, the
    changes of its velocities are those of a run by events."""
    feet = [[x, y, -0.1] for x in (0.3, -0.3) for y in (0.2, -0.2)]
    friction = {"type": "regularised", "coefficient": 0.3, "speed": 0.5}
    moves = {"linear_velocity": [1.0, 0.3, 0.0], "angular_velocity": [0.0, 0.0, 4.0]}
    mapping = scene(
        box([0.6, 0.4, 0.2], [0.0, 0.0, 0.1], **moves), touch(points=feet) | {"friction": friction}
    )
    ends = []
    for how in ({"method": "time_stepping", "step": 1e-3}, {"method": "dopri853"}):
        mapping["simulation"] = {"duration": 1e-3, "rate": 1e3} | how
        block = Simulation(scene_from_mapping(mapping)).run(checks=False).block
        ends.append(np.hstack([block.linear_velocity[-1], block.angular_velocity[-1]])[0])
    began = np.array([1.0, 0.3, 0.0, 0.0, 0.0, 4.0])
    np.testing.assert_allclose(ends[0] - began, ends[1] - began, rtol=0.01, atol=1e-12)


# Loads that are no number: a step that is too long ends a run in one line, whoever meets them.


def pulled(speed: float) -> dict[str, Any]:
    """A ball that flies from 0.5 m to where a spring with a length is fixed, at 1 m."""
    spring = {
        "type": "spring", "body": "ball", "point_A": [0, 0, 1], "stiffness": 10.0,
        "rest_length": 0.2,
    }  # fmt: skip
    bodies = {"ball": ball([0, 0, 0.5], linear_velocity=[0, 0, speed])}
    mapping = scene(bodies, {"floor": touch("ball")}, gravity=False, spring=spring)
    run = {"method": "time_stepping", "step": 0.1, "duration": 0.1, "rate": 10.0}
    return mapping | {"simulation": run}


def test_a_spring_that_has_lost_its_direction_ends_the_run() -> None:
    """In the middle of the first step its ends meet exactly."""
    with pytest.raises(
        StepTooLargeError, match=r"no longer finite at t = 0 s: step 0\.1 s is too large"
    ):
        Simulation(pulled(10.0)).run(checks=False)
    assert np.isfinite(Simulation(pulled(10.1)).run(checks=False).energy).all()


# What keeps touching, or rolls, keeps its energy to second order in the step, and gains none.


BOWL = {"type": "sphere", "center": [0.0, 0.0, 1.0], "radius": 1.0, "side": "inside"}
HUMP = {"type": "sphere", "center": [0.0, 0.0, -1.0], "radius": 1.0}
STONE = body(
    {"type": "ellipsoid", "semi_axes": [0.13, 0.1, 0.08]},
    [0.0, 0.0, 0.08],
    linear_velocity=[0.2, 0.1, 0.0],
    angular_velocity=[-0.1 / 0.08, 0.2 / 0.08, 0.5],
)
"""It rolls on its flattest side."""
SCENES = {
    "slides in a bowl": (
        ball([0.0, 0.0, 0.1], linear_velocity=[3.0, 0.0, 0.0]),
        touch(surface=BOWL),
    ),
    "rolls in a bowl": (
        ball([0.0, 0.0, 0.1], linear_velocity=[2.0, 0.0, 0.0], angular_velocity=[0.0, 20.0, 0.0]),
        touch(mu=5.0, surface=BOWL),
    ),
    "slides off a hump": (
        ball([0.0, 0.0, 0.1], linear_velocity=[0.8, 0.0, 0.0]),
        touch(surface=HUMP),
    ),
    "rolls on a floor": (STONE, touch(mu=5.0)),
}


def run_of(name: str, **how: Any) -> Any:
    mapping = scene(*SCENES[name])
    mapping["simulation"] = {"duration": 0.4, "rate": 50.0} | how
    return Simulation(mapping).run(checks=False)


@pytest.mark.parametrize("name", list(SCENES))
def test_what_keeps_touching_moves_as_with_exact_events_to_second_order(name: str) -> None:
    """With the velocity along the normal, or of what sticks, zero in the middle of each step, it
    would do so to first order, and lose or gain some percent of its energy in steps of 2 ms."""
    exact = run_of(name, tolerance=1e-11)
    runs = [run_of(name, method="time_stepping", step=step) for step in (4e-3, 2e-3, 1e-3)]
    errors = [np.abs(run.block.position - exact.block.position).max() for run in runs]
    assert errors[1] < 1e-4
    assert 3.9 < errors[0] / errors[1] < 4.1
    assert 3.9 < errors[1] / errors[2] < 4.1
    energy = np.abs(runs[1].energy - runs[1].energy[0]).max()
    assert energy <= 1e-4 * (runs[1].block.kinetic_energy.max() + 0.1 * G)


def hopping(step: float) -> tuple[float, float]:
    """(energy at the start, the most that it rises by) of a ball that leaves a floor at less than
    its weight gives in a step."""
    start = ball([0.0, 0.0, 0.1], linear_velocity=[0.0, 0.0, 0.04])
    mapping = scene(start, touch())
    mapping["simulation"] = {"duration": 0.1, "rate": 1.0 / step}
    mapping["simulation"] |= {"method": "time_stepping", "step": step}
    run = Simulation(mapping).run(checks=False)
    return float(run.energy[0]), float((run.energy - np.minimum.accumulate(run.energy)).max())


def test_what_leaves_and_is_brought_back_in_a_step_gains_nothing() -> None:
    """Stopped where half of the step has carried it, it would keep that height for nothing: 2e-3 J,
    more than the 8e-4 J of its speed."""
    start, gained = hopping(1e-2)
    assert start > G * 0.1
    assert gained <= 1e-12


def stopped_on_a_slope(step: float) -> tuple[float, float, float]:
    """(energy made as it is told, gained over the run, closed form) of a block that slides up a
    slope and sticks within the step: stopped at once it has come g sin(lean) h/2 per speed, and
    lost its own energy."""
    lean, speed = 0.3, 0.01
    up = np.array([-np.cos(lean), 0.0, np.sin(lean)])
    normal = np.array([np.sin(lean), 0.0, np.cos(lean)])
    size = [0.2, 0.2, 0.2]
    block = body(
        {"type": "box", "size": size},
        0.1 * normal,
        orientation={"axis": [0.0, 1.0, 0.0], "angle": lean},
        linear_velocity=speed * up,
    )
    plane = {"type": "plane", "normal": normal.tolist()}
    mapping = scene(block, touch(mu=0.5, surface=plane))
    mapping["simulation"] = {"duration": step, "rate": 1.0 / step}
    mapping["simulation"] |= {"method": "time_stepping", "step": step}
    simulation = Simulation(mapping)
    run = simulation.run()
    expected = 0.5 * speed * (G * np.sin(lean) * step - speed)
    return simulation.made_energy, float(run.energy[-1] - run.energy[0]), expected


def test_energy_that_contacts_make_is_counted() -> None:
    made, gained, expected = stopped_on_a_slope(1e-2)
    assert expected > 9e-5
    assert abs(gained - expected) < 1e-9
    assert abs(made - expected) < 1e-9
