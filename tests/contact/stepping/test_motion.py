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
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.stepping.step_workspace import GAP
from rb_sim.contact.stepping.stepping_motion import SteppedContacts
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import G, ball, body, scene, touch


def motion_of(mapping: dict[str, Any]) -> SteppedContacts:
    loaded = scene_from_mapping(mapping)
    return SteppedContacts(compile_scene(loaded), compile_method(loaded.simulation, 1.0))


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
        found = had_impulse(start, steps)
        assert found == pytest.approx(0.01 * force.sum(), rel=1e-9)


@pytest.mark.parametrize("shape", ["ball", "egg"])
@pytest.mark.parametrize("start", [0.0, 0.55])
def test_bodies_go_as_their_support_does_at_the_end_of_a_step(start: float, shape: str) -> None:
    """By what both have gained in its first half: they lie on what slows down by less than g."""
    for steps in (1, 4):
        wanted = SHAKE * RATTLE * math.cos(RATTLE * (start + 0.01 * steps))
        assert carried(shape, start, steps)[0] == pytest.approx(wanted, abs=5e-5)


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


@pytest.mark.parametrize("way", WAYS)
def test_the_sample_at_the_start_has_the_forces_of_the_first_step(way: str) -> None:
    """And the state of the start."""
    start, first = sampled(way, 0.2, 0.0, 0.01)[3]
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
    assert_allclose(at_rest(way)[13:16], [0.0, 0.0, G - pull], rtol=1e-9)
