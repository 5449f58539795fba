# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A run of time stepping: what the tables do not have, the grid of steps, samples on the way."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.contact.stepping import step_workspace
from rb_sim.contact.stepping.step_workspace import GAP
from rb_sim.contact.stepping.stepping_motion import SteppedContacts
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import G, ball, body, scene, touch
from tests.interpreted import interpreted

STIFFNESS, DAMPING, LENGTH, RATE = 10.0, 3.0, 0.4, 0.7
ON_EGG, ON_SLEDGE = np.array([0.05, 0.02, 0.1]), np.array([0.1, -0.2, 0.3])
"""Ends of the spring, in axes of their bodies."""
MASSES = {"dome": 3.0, "egg": 0.8, "sledge": 2.0, "ball": 1.0}
MOMENTS = {
    "dome": (0.3, 0.4, 0.5), "egg": (0.02, 0.03, 0.04), "sledge": (0.2, 0.3, 0.4),
    "ball": (0.004, 0.004, 0.004),
}  # fmt: skip
PIN = np.array([0.0, 0.3, -0.2])
"""Of the dome, which turns about it."""


def mixed(**run: Any) -> dict[str, Any]:
    """An egg slides on a dome that is pinned, a spring pulls it to a sledge that is driven, and a
    ball slides on a floor."""
    w = np.array([0.2, -0.1, 0.3])
    spin = {"dome": w, "egg": np.array([0.5, 0.4, -0.3]), "sledge": np.zeros(3)}
    velocity = {"dome": -np.cross(w, PIN), "sledge": np.array([RATE, 0.1, 0.0])}
    velocity["egg"] = velocity["dome"] + np.cross(w, [0, 0, 0.7]) + [0.2, 0.1, 0.0]
    at = {"dome": [0.0, 0.0, 0.0], "egg": [0.0, 0.0, 0.7], "sledge": [0.9, 0.2, 0.3]}
    shapes: dict[str, Any] = {
        "dome": {"type": "sphere", "radius": 0.5},
        "egg": {"type": "ellipsoid", "semi_axes": [0.3, 0.25, 0.2]},
    }
    bodies = {
        name: {
            "mass": MASSES[name], "inertia": list(MOMENTS[name]), "position": at[name],
            "linear_velocity": velocity[name].tolist(), "angular_velocity": spin[name].tolist(),
        }
        | ({"shape": shapes[name]} if name in shapes else {})
        for name in at
    }  # fmt: skip
    bodies["ball"] = ball([3.0, 0.0, 0.1], linear_velocity=[0.5, 0.2, 0.0])
    axis = {"type": "velocity", "body": "sledge", "linear": [1, 0, 0], "rate": RATE}
    own = {"parent": "dome", "surface": {"type": "shape"}}
    constraints = {
        "pin": {"type": "fixed_point", "body": "dome", "point_B": PIN.tolist()},
        "drive": axis,
        "on": touch("egg", mu=0.2, **own),
        "floor": touch("ball", mu=0.3),
    }
    spring = {
        "type": "spring", "body": "egg", "point_B": ON_EGG.tolist(), "parent": "sledge",
        "point_A": ON_SLEDGE.tolist(), "stiffness": STIFFNESS, "damping": DAMPING,
        "rest_length": LENGTH,
    }  # fmt: skip
    mapping = scene(bodies, constraints, spring=spring)
    options = {"duration": 1.0, "method": "time_stepping", "step": 1e-6}
    return mapping | {"simulation": options | run}


def motion_of(mapping: dict[str, Any]) -> SteppedContacts:
    loaded = scene_from_mapping(mapping)
    return SteppedContacts(compile_scene(loaded), compile_method(loaded.simulation, 1.0))


class Seen(NamedTuple):
    """Of samples one step apart."""

    names: tuple[str, ...]
    reactions: tuple[str, ...]
    rows: np.ndarray


def seen(*times: float) -> Seen:
    motion = motion_of(mixed())
    out = np.zeros((len(times), motion.width))
    motion.run_to(np.array(times), out)
    return Seen(motion.layout.bodies, motion.layout.reactions, out)


def spring_on_egg(y: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, float]:
    """(force on the egg, point there, energy) of the spring."""
    ends, speeds = [], []
    for name, at in (("egg", ON_EGG), ("sledge", ON_SLEDGE)):
        turn = Rotation.from_quat(y[name][3:7])
        arm = turn.apply(at)
        ends.append(y[name][:3] + arm)
        speeds.append(y[name][7:10] + np.cross(turn.apply(y[name][10:13]), arm))
    way = ends[0] - ends[1]
    size = float(np.linalg.norm(way))
    e = way / size
    pull = STIFFNESS * (size - LENGTH) + DAMPING * float((speeds[0] - speeds[1]) @ e)
    return -pull * e, ends[0], 0.5 * STIFFNESS * (size - LENGTH) ** 2


def states(found: Seen, k: int) -> dict[str, np.ndarray]:
    return {name: found.rows[k, 13 * i : 13 * i + 13] for i, name in enumerate(found.names)}


def test_newton_and_euler_with_the_reactions_that_are_told() -> None:
    """Of weight, spring, joints and contacts, those of the parent the other way round."""
    found = interpreted(seen, 1e-6, 2e-6)
    before, after = states(found, 0), states(found, 1)
    at = 13 * len(found.names)
    loads = {name: [np.array([0.0, 0.0, -G * MASSES[name]]), np.zeros(3)] for name in found.names}

    def act(name: str, force: Any, torque: Any, point: Any, sign: float) -> None:
        loads[name][0] += sign * force
        arm = point - before[name][:3]
        loads[name][1] = loads[name][1] + sign * (torque + np.cross(arm, force))

    pull, there, _ = spring_on_egg(before)
    act("egg", pull, np.zeros(3), there, 1.0)
    act("sledge", pull, np.zeros(3), there, -1.0)
    owners = {"pin": ("dome",), "drive": ("sledge",), "on": ("egg", "dome"), "floor": ("ball",)}
    for o, name in enumerate(found.reactions):
        force, torque, point = found.rows[1, at + 9 * o : at + 9 * o + 9].reshape(3, 3)
        for owner, sign in zip(owners[name], (1.0, -1.0), strict=False):
            act(owner, force, torque, point, sign)
        assert np.linalg.norm(force) > 0.1, name
    for name in found.names:
        force, torque = loads[name]
        gained = MASSES[name] * (after[name][7:10] - before[name][7:10]) / 1e-6
        assert_allclose(gained, force, atol=2e-4, err_msg=name)
        inertia, w = np.diag(MOMENTS[name]), before[name][10:13]
        turned = Rotation.from_quat(before[name][3:7])
        rate = inertia @ (after[name][10:13] - w) / 1e-6 + np.cross(w, inertia @ w)
        assert_allclose(turned.apply(rate), torque, atol=2e-4, err_msg=name)


def test_energy_changes_by_the_power_that_is_told() -> None:
    """Of the damper, the drive and friction; in the spring and in gravity it is kept."""
    found = interpreted(seen, 1e-6, 2e-6)
    at = 13 * len(found.names) + 9 * len(found.reactions)
    for k in range(2):
        height = sum(MASSES[name] * y[2] for name, y in states(found, k).items())
        stored = spring_on_egg(states(found, k))[2]
        assert found.rows[k, at + 1] == pytest.approx(G * height + stored, rel=1e-12)
    energy, power = found.rows[:, at : at + 2].sum(axis=1), found.rows[:, at + 2]
    assert (energy[1] - energy[0]) / 1e-6 == pytest.approx(power[1], abs=2e-4)
    assert abs(power[1]) > 0.1


FORCE, OMEGA, PHASE = 2.0, 90.0, 0.4
SHAKE, RATTLE = 1e-3, 12.0
"""A force along x on what is in flight, a support that goes up and down [N, rad/s; m, rad/s]."""


def had_impulse(start: float, steps: int) -> float:
    """Velocity along x of what flies, after so many steps of 10 ms."""
    push = {
        "type": "wrench", "body": "body", "sine_force": [FORCE, 0, 0],
        "angular_frequency": OMEGA, "phase": PHASE,
    }  # fmt: skip
    mapping = scene(ball([5.0, 0.0, 9.0]), touch(), push=push)
    run = {"duration": 1.0, "method": "time_stepping", "step": 0.01}
    motion = motion_of(mapping | {"simulation": run})
    motion.reset(np.array(motion.compiled.y), start)
    motion.run_to(np.array([start + 0.01 * steps]))
    return float(motion.coordinates[7])


def carried(shape: str, start: float, steps: int) -> tuple[float, float, float]:
    """(velocity of a ball of 0.2 m on a support that goes up and down, height of its centre over
    that, overlap [m]) after so many steps of 10 ms."""
    solids = {"ball": {"type": "sphere", "radius": 0.2}}
    solids["egg"] = {"type": "ellipsoid", "semi_axes": [0.2, 0.2, 0.2]}
    at, end = RATTLE * start, RATTLE * (start + 0.01 * steps)
    moves = [0.0, 0.0, SHAKE * RATTLE * math.cos(at)]
    shaken = {
        "type": "shaken", "direction": [0, 0, 1], "amplitude": SHAKE,
        "frequency": RATTLE / (2.0 * math.pi),
    }  # fmt: skip
    dome = {"type": "sphere", "center": [0, 0, -1], "radius": 1.0}
    run = {"duration": 1.0, "method": "time_stepping", "step": 0.01}
    body_on_it = body(solids[shape], [0, 0, 0.2], linear_velocity=moves)
    mapping = scene(body_on_it, touch(surface=dome, motion=shaken)) | {"simulation": run}
    motion = motion_of(mapping)
    y = np.array(motion.compiled.y)
    y[2] += SHAKE * math.sin(at)
    motion.reset(y, start)
    motion.run_to(np.array([start + 0.01 * steps]))
    height = motion.coordinates[2] - SHAKE * math.sin(end)
    return float(motion.coordinates[9]), float(height), -float(motion._workspace.spots[0, GAP])


@pytest.mark.parametrize("start", [0.0, 0.55])
def test_loads_are_those_of_the_middle_of_a_step(start: float) -> None:
    for steps in (1, 4):
        middles = start + 0.01 * (np.arange(steps) + 0.5)
        force = FORCE * np.sin(OMEGA * middles + PHASE)
        found = interpreted(had_impulse, start, steps)
        assert found == pytest.approx(0.01 * force.sum(), rel=1e-9)


@pytest.mark.parametrize("shape", ["ball", "egg"])
@pytest.mark.parametrize("start", [0.0, 0.55])
def test_bodies_go_as_their_support_does_at_the_end_of_a_step(start: float, shape: str) -> None:
    """By what both have gained in its first half: they lie on what slows down by less than g."""
    for steps in (1, 4):
        wanted = SHAKE * RATTLE * math.cos(RATTLE * (start + 0.01 * steps))
        assert interpreted(carried, shape, start, steps)[0] == pytest.approx(wanted, abs=5e-5)


@pytest.mark.parametrize("shape", ["ball", "egg"])
def test_bodies_lie_on_their_support_as_it_is_at_the_end_of_a_step(shape: str) -> None:
    """What overlaps there by 1e-6 m is moved apart."""
    _, height, overlap = interpreted(carried, shape, 0.3, 1)
    assert height == pytest.approx(0.2, abs=1e-10)
    assert abs(overlap) < 1e-10


def bouncing(**more: Any) -> dict[str, Any]:
    """A ball that lands, in steps of 10 ms; with what the tables do not have, if asked for."""
    thrown = ball([0, 0, 0.12], linear_velocity=[0.4, 0, -0.3], angular_velocity=[1.0, 2.0, 0.5])
    mapping = scene(thrown, touch(mu=0.3, restitution=0.5), **more)
    return mapping | {"simulation": {"duration": 1.0, "method": "time_stepping", "step": 0.01}}


SPRING: dict[str, Any] = {
    "type": "spring", "body": "body", "point_A": [0.0, 0.0, 1.0], "stiffness": 3.0,
    "rest_length": 0.5,
}  # fmt: skip
WAYS = {"plain": {}, "with a spring": {"spring": SPRING}}


def sampled(way: str, upto: float, *times: float) -> tuple[Any, ...]:
    """(state at the end, steps, frontier, rows of the samples, notes, memory)."""
    motion = motion_of(bouncing(**WAYS[way]))
    out = np.zeros((len(times), motion.width))
    motion.run_to(np.array(times), out)
    motion.run_to(np.array([upto]))
    kept = motion._workspace.notes.copy(), motion._memory.copy()
    return motion.coordinates.copy(), motion.steps, motion.frontier, out, *kept


def one_step(way: str, h: float, start: float, y: Any, memory: Any) -> np.ndarray:
    """The sample after one step of length h of a motion that stands there."""
    motion = motion_of(bouncing(**WAYS[way]))
    motion.method = motion.method._replace(step=h)
    motion.reset(y, start)
    motion._memory[:] = memory
    motion._workspace.notes[step_workspace.FRESH] = 0.0
    out = np.zeros((1, motion.width))
    motion.run_to(np.array([start + h]), out)
    return out[0]


@pytest.mark.parametrize("way", WAYS)
def test_a_sample_between_two_points_is_a_step_of_its_own(way: str) -> None:
    """From the point before, with what the contacts knew there; also the forces are its own."""
    y, _, _, _, _, memory = interpreted(sampled, way, 0.1)
    (row,) = interpreted(sampled, way, 0.2, 0.1037)[3]
    assert_allclose(row, interpreted(one_step, way, 0.0037, 0.1, y, memory), atol=1e-12)


@pytest.mark.parametrize("way", WAYS)
def test_the_sample_at_the_start_has_the_forces_of_the_first_step(way: str) -> None:
    """And the state of the start."""
    start, first = interpreted(sampled, way, 0.2, 0.0, 0.01)[3]
    mapping = bouncing(**WAYS[way])
    y = compile_scene(scene_from_mapping(mapping)).y
    assert np.array_equal(start[:13], y[:13])
    assert_allclose(start[13:16], first[13:16], atol=1e-12)


def at_rest(way: str) -> np.ndarray:
    mapping = bouncing(**WAYS[way])
    mapping["bodies"]["body"] = ball([0, 0, 0.1])
    motion = motion_of(mapping)
    return motion.sample()[0]


@pytest.mark.parametrize("way", WAYS)
def test_a_ball_on_its_floor_bears_its_weight_from_the_start(way: str) -> None:
    """Less what a spring above it takes."""
    pull = SPRING["stiffness"] * (0.9 - SPRING["rest_length"]) if way != "plain" else 0.0
    assert_allclose(interpreted(at_rest, way)[13:16], [0.0, 0.0, G - pull], rtol=1e-9)


def warmed(way: str, warm: bool) -> np.ndarray:
    motion = motion_of(bouncing(**WAYS[way]))
    if warm:
        motion.warm()
    motion.run_to(np.array([0.1]))
    return motion.coordinates.copy()


@pytest.mark.parametrize("way", WAYS)
def test_warming_up_leaves_no_trace(way: str) -> None:
    assert np.array_equal(interpreted(warmed, way, True), interpreted(warmed, way, False))
