# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A run can be looked at and ended however dense its steps are, and says when it stalls."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError
from rb_sim.contact.choose_motion import motion_of
from rb_sim.contact.events import event_steps as contact_steps
from rb_sim.integrate import loop
from rb_sim.integrate.methods.rk4 import Rk4
from rb_sim.motion import motion
from rb_sim.motion.motion import Limits
from rb_sim.scene.compile import compile_scene
from tests.interpreted import interpreted

PUSHED = {
    "bodies": {"puck": {"mass": 2.0, "inertia": [0.1, 0.2, 0.3], "angular_velocity": [0, 0, 1]}},
    "effects": {"drive": {"type": "commanded_wrench", "body": "puck"}},
    "simulation": {"duration": 1.0, "method": "rk4", "step": 1e-3, "rate": 10},
}
BOUNCING = {
    "bodies": {"ball": {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}},
    "constraints": {"floor": {"type": "contact", "body": "ball", "restitution": 0.5}},
    "effects": {"weight": {"type": "gravity"}},
    "simulation": {"duration": 1.0, "method": "rk4", "step": 1e-4, "rate": 10},
}
BOUNCING["bodies"]["ball"]["position"] = [0.0, 0.0, 1.0]


@contextmanager
def short_calls() -> Iterator[None]:
    """Calls of interpreted loops, between which limits are looked at, end after 128 steps."""
    with patch.object(contact_steps, "PIECE_STEPS", 128), patch.object(loop, "PIECE_STEPS", 128):
        yield


@short_calls()
def stalls(scene: dict, step: float, limits: Limits) -> tuple[str, float]:
    """What is said of an advance over 1 s in steps of that length, and the time it is left at."""
    options = scene["simulation"] | {"step": step}
    simulation = Simulation(load_scene(scene | {"simulation": options}))
    with pytest.raises(SimulationError) as error:
        simulation.advance(1.0, limits=limits)
    return str(error.value), simulation.time


@pytest.mark.parametrize("scene", [PUSHED, BOUNCING], ids=["smooth", "contact"])
def test_steps_to_one_sample_are_bounded(scene) -> None:
    text, t = stalls(scene, 1e-6, Limits(steps=100))
    assert text.startswith("the motion no longer advances: ") and "the step is 1e-06 s" in text
    assert t == 0.0


def test_wall_time_to_one_sample_is_bounded() -> None:
    text, t = stalls(PUSHED, 1e-6, Limits(wall_time=1e-3))
    assert text.startswith("the motion no longer advances") and t == 0.0


def many_samples(limits: Limits) -> int:
    simulation = Simulation(load_scene(PUSHED))
    return sum(len(block) for block in simulation.blocks(4.0, 10.0, lambda t: True, limits))


def test_limits_count_from_sample_to_sample() -> None:
    """4000 steps in all, 100 from one sample to the next."""
    assert many_samples(Limits(steps=2000)) == 41


@short_calls()
def split(scene: dict) -> tuple[list, list, int]:
    """The state after an advance that was ended inside, and gone on with; and after a whole one."""
    whole = Simulation(load_scene(scene))
    whole.advance(1.0)
    parted = Simulation(load_scene(scene))
    looks: list[float] = []

    def once(t: float) -> bool:
        looks.append(t)
        return False

    while not parted.advance(1.0 - parted.time, once):
        assert parted.time == 0.0 and len(looks) < 100
    rows = [
        s.sample().block.position.tolist() + s.sample().block.orientation.tolist()
        for s in (whole, parted)
    ]
    return rows[0], rows[1], len(looks)


@pytest.mark.parametrize(
    ("scene", "step"), [(PUSHED, 2e-4), (BOUNCING, 2e-3)], ids=["smooth", "contact"]
)
def test_an_advance_that_was_ended_goes_on_to_the_same_bits(scene, step) -> None:
    options = scene["simulation"] | {"step": step}
    whole, parted, looks = interpreted(split, scene | {"simulation": options})  # slow enough
    assert parted == whole
    assert looks >= 1


def looks_of(count: int) -> tuple[int, int]:
    """(looks at the run, its steps) of so many balls on the floor."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}
    scene = {
        "bodies": {f"b{i}": ball | {"position": [i, 0.0, 0.1]} for i in range(count)},
        "constraints": {f"c{i}": {"type": "contact", "body": f"b{i}"} for i in range(count)},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 0.01},
    }
    motion = motion_of(compile_scene(load_scene(scene)), Rk4(1e-6))
    motion.warm()
    motion.reset()
    looks: list[int] = []
    motion.watch = lambda: looks.append(motion.steps)
    motion.run_to([0.01])
    return len(looks), motion.steps


def test_the_more_contacts_a_step_bears_the_fewer_steps_go_by_unseen() -> None:
    """A signal waits for the end of a call of the loop: of 2048 steps of three boxes on their
    faces, whatever is their length, that was 2 s."""
    for count, most in ((1, 2048), (4, 512)):
        looks, steps = looks_of(count)
        assert steps / (looks + 1) <= most


SLIDING = {
    "bodies": {"box": {"mass": 1.0, "shape": {"type": "box", "size": [0.2, 0.2, 0.2]}}},
    "constraints": {"floor": {"type": "contact", "body": "box"}},
    "effects": {"weight": {"type": "gravity"}},
    "simulation": {"duration": 1.0, "method": "time_stepping", "step": 0.01, "rate": 10},
}
SLIDING["bodies"]["box"] |= {"position": [0.0, 0.0, 0.1], "linear_velocity": [1.0, 0.0, 0.0]}


@pytest.mark.parametrize(
    "method",
    [
        {"method": "time_stepping", "step": 0.01},
        {"method": "rk4", "step": 0.01},
        {"method": "dopri853"},
    ],
)
def test_a_run_whose_steps_take_longer_than_a_piece_comes_to_its_end(method: dict) -> None:
    """Pieces became shorter than a step, which was then taken again and again to its beginning:
    216 balls on a busy machine never came to their end."""
    options = {"duration": 1.0, "rate": 10} | method
    simulation = Simulation(load_scene(SLIDING | {"simulation": options}))
    looks: list[float] = []

    def goes_on(t: float) -> bool:
        looks.append(t)
        return len(looks) < 1000

    with patch.object(motion, "PIECE", 0.0):
        samples = sum(len(block) for block in simulation.blocks(1.0, 10.0, goes_on))
    assert samples == 11
    assert len(looks) <= 2 * simulation.steps + samples
