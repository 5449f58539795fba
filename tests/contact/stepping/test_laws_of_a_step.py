# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One step of time stepping keeps the laws: those of Newton and Euler, and of each contact.

All is found from positions and velocities before and after one very short step, and the reactions
that it reports, by formulas of their own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.contact.stepping.step_workspace import IMPULSE, ROLL, SPIN, TWIST
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from tests.interpreted import interpreted

STEP, RADIUS, G, NEAR = 1e-6, 0.1, 9.81, 1e-4
"""Step [s], in which nothing moves by more than some um; radius [m]; weight [m/s^2]; part of the
largest velocity or impulse that those um make of it."""
MASSES, INERTIA = {"a": 1.3, "b": 0.7, "c": 2.1}, 0.01
LEAN = 0.4 * RADIUS
RAISED = (4.0 * RADIUS**2 - (RADIUS + 0.5 * LEAN) ** 2) ** 0.5
PLACES = {
    "a": np.array([0.0, 0.0, RADIUS]),
    "b": np.array([2.0 * RADIUS + LEAN, 0.0, RADIUS]),
    "c": np.array([RADIUS + 0.5 * LEAN, 0.0, RADIUS + RAISED]),
}
"""Two balls on a floor, apart from each other, and one upon both."""
KINETIC, STATIC, ROLLING, SPINNING, DRAG, ROUNDED, SPEED = 0.35, 0.5, 0.004, 0.003, 0.3, 0.25, 0.2
FALLS = {"a": [0.0, 0.0, -1.0], "b": [0.0, 0.0, -1.0], "c": [0.0, 0.0, -3.0]}
"""Velocities of approach [m/s], to which random ones are added."""
TURNS = np.array([0.0, 0.0, 1.7])
"""Of the floor under b [rad/s]."""


class ContactPoint(NamedTuple):
    """A contact: on body, from parent (None: the floor), e, and whether its support turns."""

    body: str
    parent: str | None
    bounces: float = 0.0
    turns: bool = False


TOUCHES = {
    "a_floor": ContactPoint("a", None),
    "b_floor": ContactPoint("b", None, 0.4, True),
    "c_a": ContactPoint("c", "a", 0.5),
    "c_b": ContactPoint("c", "b"),
}


def mapping(seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    bodies = {
        name: {
            "mass": MASSES[name],
            "inertia": [INERTIA * MASSES[name]] * 3,
            "shape": {"type": "sphere", "radius": RADIUS},
            "position": place.tolist(),
            "linear_velocity": (rng.normal(0.0, 0.2, 3) + FALLS[name]).tolist(),
            "angular_velocity": rng.normal(0.0, 3.0, 3).tolist(),
        }
        for name, place in PLACES.items()
    }
    floor = {"type": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}
    ball = {"type": "sphere", "radius": RADIUS}
    turning = {"type": "turntable", "rate": TURNS[2], "axis": [0, 0, 1], "point": [0, 0, 0]}
    laws = {
        "a_floor": {"friction": {"type": "coulomb", "static": STATIC, "kinetic": KINETIC}},
        "b_floor": {"friction": {"type": "coulomb", "static": STATIC, "kinetic": KINETIC}},
        "c_a": {"friction": {"type": "viscous", "coefficient": DRAG, "per_normal": True}},
        "c_b": {"friction": {"type": "regularised", "coefficient": ROUNDED, "speed": SPEED}},
    }
    laws["a_floor"] |= {"rolling_resistance": ROLLING, "spinning_resistance": SPINNING}  # type: ignore[dict-item]
    laws["b_floor"] |= {"motion": turning}
    constraints = {}
    for name, touch in TOUCHES.items():
        where = {"surface": floor} if touch.parent is None else {"surface": ball}
        if touch.parent is not None:
            where["parent"] = touch.parent  # type: ignore[assignment]
        made = {"type": "contact", "body": touch.body, "restitution": touch.bounces}
        constraints[name] = made | where | laws[name]
    return {
        "bodies": bodies,
        "constraints": constraints,
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}},
        "simulation": {"duration": 1.0, "method": "time_stepping", "step": STEP},
    }


class Step(NamedTuple):
    """Velocities before and after [m/s, rad/s], impulses [N s, N m s] and modes of the contacts."""

    before: dict[str, tuple[np.ndarray, np.ndarray]]
    after: dict[str, tuple[np.ndarray, np.ndarray]]
    impulses: dict[str, tuple[np.ndarray, np.ndarray]]
    modes: dict[str, float]
    turning: tuple[float, float]
    """modes of rolling and spinning of a on the floor."""
    energy: float
    work: float


def stepped(seed: int) -> Step:
    simulation = Simulation(load_scene(mapping(seed)))
    first = simulation.sample().block
    simulation.advance(STEP)
    last, names = simulation.sample().block, simulation.layout.bodies
    before, after = (
        {
            name: (block.linear_velocity[-1, i], block.angular_velocity[-1, i])
            for i, name in enumerate(names)
        }
        for block in (first, last)
    )
    memory: Any = simulation._motion._memory  # type: ignore[attr-defined]
    impulses, modes = {}, {}
    for k, name in enumerate(simulation.layout.reactions):
        normal = normal_of(TOUCHES[name])
        modes[name] = float(last.contact_state[-1, k])
        impulses[name] = (
            memory[k, IMPULSE : IMPULSE + 3].copy(),
            memory[k, TWIST : TWIST + 3].copy(),
        )
        reported = last.reaction_force[-1, k], last.reaction_torque[-1, k]
        for found, impulse in zip(reported, impulses[name], strict=True):
            assert_allclose(found, impulse / STEP, rtol=1e-12)
        body = PLACES[TOUCHES[name].body]
        assert_allclose(last.anchor[-1, k], body - RADIUS * normal, atol=NEAR * RADIUS)
    energy = float(last.energy[-1] - first.energy[-1])
    turning = float(memory[0, ROLL]), float(memory[0, SPIN])
    return Step(before, after, impulses, modes, turning, energy, float(last.contact_work[-1]))


def normal_of(touch: ContactPoint) -> np.ndarray:
    """From the support to the body."""
    if touch.parent is None:
        return np.array([0.0, 0.0, 1.0])
    way = PLACES[touch.body] - PLACES[touch.parent]
    return way / np.linalg.norm(way)


def relative(touch: ContactPoint, velocities: Any) -> tuple[np.ndarray, np.ndarray]:
    """(velocity of the body's surface over that of its support at their point, relative spin)."""
    normal = normal_of(touch)
    point = PLACES[touch.body] - RADIUS * normal
    v, w = velocities[touch.body]
    surface = v + np.cross(w, -RADIUS * normal)
    if touch.parent is not None:
        v, spin = velocities[touch.parent]
        return surface - v - np.cross(spin, RADIUS * normal), w - spin
    turns = TURNS if touch.turns else np.zeros(3)
    return surface - np.cross(turns, point), w - turns


def parts(x: np.ndarray, normal: np.ndarray) -> tuple[float, np.ndarray]:
    """(along the normal, across it)."""
    return float(x @ normal), x - (x @ normal) * normal


def obeys(force: np.ndarray, motion: np.ndarray, bound: float, still: float, size: float) -> bool:
    """|force| <= bound; where there is motion, `bound` against it. Returns whether not."""
    assert np.linalg.norm(force) <= bound + NEAR * size
    speed = float(np.linalg.norm(motion))
    if speed <= still:
        return True
    assert_allclose(force, -bound * motion / speed, atol=NEAR * size)
    return False


def bound_of(name: str, slip: float) -> float:
    """Of friction in an impact, per push; slip: before it [m/s]."""
    if name == "c_a":
        return DRAG * slip
    return ROUNDED * slip / float(np.hypot(slip, SPEED)) if name == "c_b" else KINETIC


SEEDS = range(12)


@pytest.fixture(scope="module")
def steps() -> list[Step]:
    return interpreted(all_steps)


def all_steps() -> list[Step]:
    return [stepped(seed) for seed in SEEDS]


def test_momenta_change_by_the_impulses_and_the_weight(steps: list[Step]) -> None:
    for step in steps:
        for name, mass in MASSES.items():
            (v0, w0), (v1, w1) = step.before[name], step.after[name]
            push, turn = np.array([0.0, 0.0, -mass * G * STEP]), np.zeros(3)
            for contact, touch in TOUCHES.items():
                sign = (touch.body == name) - float(touch.parent == name)
                impulse, torque = step.impulses[contact]
                arm = -sign * RADIUS * normal_of(touch)
                push = push + sign * impulse
                turn = turn + sign * (torque + np.cross(arm, impulse))
            assert_allclose(mass * (v1 - v0), push, atol=NEAR * mass)
            assert_allclose(INERTIA * mass * (w1 - w0), turn, atol=NEAR * RADIUS * mass)


def test_contacts_keep_their_laws(steps: list[Step]) -> None:
    """Newton's law of impact with Signorini's, and friction, for all contacts at once."""
    rest, slide = 0, 0
    for step in steps:
        for name, touch in TOUCHES.items():
            normal = normal_of(touch)
            (push, across), (v0, _) = (
                parts(step.impulses[name][0], normal),
                relative(touch, step.before),
            )
            v1, _ = relative(touch, step.after)
            (meets, slip), (leaves, motion) = parts(v0, normal), parts(v1, normal)
            assert meets < -NEAR and push >= 0.0
            assert leaves >= -touch.bounces * meets - NEAR
            if push > 0.0:
                assert_allclose(leaves, -touch.bounces * meets, atol=NEAR)
            bound = bound_of(name, float(np.linalg.norm(slip))) * push
            still = obeys(across, motion, bound, NEAR, push)
            rest, slide = rest + (still and push > 0.0), slide + (not still and push > 0.0)
    assert rest > 10 and slide > 10


def test_torques_of_resistance_keep_their_laws(steps: list[Step]) -> None:
    modes = set()
    for step in steps:
        for name, touch in TOUCHES.items():
            impulse, torque = step.impulses[name]
            normal = normal_of(touch)
            push, (spins, rolls) = float(impulse @ normal), parts(torque, normal)
            if name != "a_floor":
                assert_allclose([spins, *rolls], 0.0, atol=1e-15)
                continue
            turning, rolling = parts(relative(touch, step.after)[1], normal)
            size = push * RADIUS
            stays = obeys(rolls, rolling, ROLLING * push, 1e-3, size)
            spun = np.array([spins]), np.array([turning])
            kept = obeys(*spun, SPINNING * push, 1e-3, size)
            if step.modes[name]:
                expected = (STUCK if stays else SLIDING, STUCK if kept else SLIDING)
                assert step.turning == expected
                modes.add(expected)
    assert len(modes) > 1


def test_work_of_the_contacts_is_what_energy_changes_by(steps: list[Step]) -> None:
    for step in steps:
        assert abs(step.energy) > 0.1
        assert step.work == pytest.approx(step.energy, rel=NEAR)


def test_modes_tell_what_pushes_and_what_slips(steps: list[Step]) -> None:
    """0: it has left, or does not push; 1: it slips; 2: it does not."""
    seen = set()
    for step in steps:
        for name, touch in TOUCHES.items():
            normal = normal_of(touch)
            leaves, motion = parts(relative(touch, step.after)[0], normal)
            pushes = step.impulses[name][0] @ normal > 0.0 and leaves <= 1e-3
            slips = float(np.linalg.norm(motion)) > NEAR
            assert step.modes[name] == (1.0 + (not slips) if pushes else 0.0)
            seen.add(step.modes[name])
    assert seen == {0.0, 1.0, 2.0}
