# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Traced laws and the loops that call them: any size, from threads, interpreted or not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.many_body_scenes import chain, lattice, on_springs
from rb_sim import Simulation, load_scene
from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.compiled import family_of
from rb_sim.mechanics.laws import ReducedLaws
from rb_sim.motion.motion import Motion
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests import runs
from tests.interpreted import trajectory
from tests.mechanics.bennett import Bennett
from tests.one_body_scenes import JOINTS
from tests.sweeps.plans import THROWN


def motion(mapping: dict[str, Any]) -> Motion:
    scene = scene_from_mapping(mapping)
    return motion_of(compile_scene(scene), compile_method(scene.simulation, 1.0))


@pytest.mark.parametrize(
    "mapping",
    [chain(24), lattice(5)],
    ids=["24 links", "25 bodies, 40 springs"],
)
def test_a_scene_of_any_size_runs_and_keeps_its_energy(mapping):
    """Sizes at which walks that recurse over the types of a scene end in a RecursionError."""
    run = Simulation(scene_from_mapping(mapping)).run(checks=False)
    energy = run.block.kinetic_energy + run.block.potential_energy
    assert_allclose(energy, energy[0], atol=1e-6 * (1.0 + abs(energy).max()))
    assert run.block.residual.max() < 1e-12


def test_links_of_a_chain_at_rest_carry_what_hangs_below():
    """Hanging straight down: the force in joint i is the weight of the links i and below."""
    scene = chain(12, duration=0.05)
    scene["effects"]["g"]["acceleration"] = [9.81, 0.0, 0.0]  # along the chain
    block = Simulation(scene_from_mapping(scene)).run(checks=False).block
    weights = -9.81 * np.arange(12, 0, -1)
    assert_allclose(block.reaction_force[:, :, 0], np.tile(weights, (len(block.t), 1)), rtol=1e-12)


@pytest.mark.parametrize("method", ["euler", "rk4", "gauss6", "dopri853", "radau5", "taylor"])
@pytest.mark.parametrize("name", ["fixed_point", "rolling ellipsoid"])
def test_every_method_gives_the_same_numbers_interpreted(name, method):
    size = {"tolerance": 1e-10} if method == "taylor" else {"step": 0.01}
    options = {"method": method, "duration": 0.05, "rate": 40.0, "project_initial": True} | size
    scene = JOINTS[name] | {"simulation": options}
    compiled, plain = runs.trajectory(scene), trajectory(scene)
    for column in ("position", "orientation", "reaction_force", "kinetic_energy"):
        assert_allclose(getattr(plain, column), getattr(compiled, column), rtol=1e-12, atol=1e-13)


def test_interpreted_runs_give_the_same_numbers():
    options = {"duration": 0.05, "rate": 100.0}
    compiled = Simulation(scene_from_mapping(chain(2, **options))).run(checks=False).block
    plain = trajectory(chain(2, **options))
    for name in ("position", "orientation", "reaction_force", "kinetic_energy"):
        assert_allclose(getattr(compiled, name), getattr(plain, name), atol=1e-12, err_msg=name)


@pytest.mark.parametrize("method", ["rk4", "euler"])
def test_steps_in_a_stride_are_those_one_by_one(method, monkeypatch):
    """Fixed steps that are one law, in a loop of their own: as with a call for every stage, to the
    bit, also over the end of a table and where a sample falls between two steps."""
    scene = on_springs(1, duration=0.2, rate=70.0)
    scene["simulation"] |= {"method": method, "step": 3e-3}
    push = {"times": [0.0, 0.05], "forces": [[1.0, 2.0, 3.0], [3.0, 2.0, 1.0]]}
    scene["effects"]["push"] = {"type": "wrench_table", "body": "b"} | push
    strides = Simulation(scene_from_mapping(scene)).run(checks=False).block
    monkeypatch.setattr(ReducedLaws, "whole", lambda *given, **options: None)
    steps = Simulation(scene_from_mapping(scene)).run(checks=False).block
    for name in ("t", "position", "orientation", "linear_velocity", "angular_velocity"):
        assert getattr(strides, name).tobytes() == getattr(steps, name).tobytes(), name


# Laws are kept for equal systems, and for these alone.


def laws_of(scene: dict[str, Any]) -> Any:
    return compile_scene(scene_from_mapping(scene)).laws


def heavier(scene: dict[str, Any]) -> dict[str, Any]:
    """The scene with one mass that differs in its last bit."""
    bodies = scene["bodies"]
    bodies["b0"]["mass"] = float(np.nextafter(bodies["b0"]["mass"], 2.0))
    return scene


@pytest.mark.parametrize("links", [1, 2])
def test_the_same_scene_has_the_same_laws_whatever_its_method(links):
    first = laws_of(chain(links))
    other = chain(links)
    other["simulation"] = {"duration": 1.0, "rate": 7.0, "method": "taylor", "tolerance": 1e-9}
    assert laws_of(other) is first
    assert laws_of(heavier(chain(links))) is not first


def test_commands_of_one_run_do_not_reach_another_of_the_same_scene():
    scene = chain(2, duration=0.05)
    scene["effects"]["hand"] = {"type": "commanded_wrench", "body": "b1"}
    alone = Simulation(scene_from_mapping(scene)).run(checks=False).position["b1"]
    pushed, still = (Simulation(scene_from_mapping(scene)) for _ in range(2))
    pushed.apply_wrench("b1", force=[3.0, 2.0, 1.0], torque=[0.0, 0.0, 0.0])
    for _ in range(5):
        pushed.advance(0.01)
        still.advance(0.01)
    assert abs(pushed.sample().position["b1"][0] - alone[-1]).max() > 1e-4
    assert_allclose(still.sample().position["b1"][0], alone[-1], atol=1e-15)


# A motion on traced laws can be kept and come back; what loops are told of a method.


HANGING = {"type": "fixed_axis", "body": "b", "axis_B": [0.0, 1.0, 0.0], "point_B": [0.3, 0, 0.1]}
WAYS: dict[str, dict[str, Any]] = {
    "rk4": {"step": 0.01},
    "dopri853": {"tolerance": 1e-8},
    "taylor": {"tolerance": 1e-8},
    "radau5": {"tolerance": 1e-6},
    "gauss6": {"step": 0.02},
}


def swinging(method: str, linkage: bool = False) -> Any:
    """A pendulum, or a linkage whose lines are chosen anew after every step, and which a table
    pushes; its numbers and the choice are inputs of the laws."""
    body = {"mass": 2.0, "inertia": [0.2, 0.3, 0.4]}
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    mapping: dict[str, Any] = {"bodies": {"b": body}, "constraints": {"axle": HANGING}}
    mapping |= {"effects": {"weight": weight}}
    if linkage:
        mapping = Bennett(2).scene(4.0)
        push = {"type": "wrench_table", "body": "bar1", "times": [0.1, 0.5, 0.9]}
        push |= {"forces": [[1.0, 2.0, 0.0], [0.0, 3.0, 1.0], [0.0, 0.0, 2.0]]}
        mapping["effects"] = {"push": push}
    mapping["simulation"] = {"duration": 1.0, "method": method} | WAYS[method]
    scene = scene_from_mapping(mapping)
    return motion_of(compile_scene(scene), compile_method(scene.simulation, 1.0))


@pytest.mark.parametrize(
    ("method", "linkage"), [*((method, False) for method in WAYS), ("rk4", True), ("taylor", True)]
)
def test_what_is_kept_goes_on_again_to_the_last_bit(method: str, linkage: bool) -> None:
    """From between two points of the grid, twice, whatever has happened since."""
    motion = swinging(method, linkage)
    times = np.array([0.4137, 0.6, 0.8])
    rows = np.zeros((3, 3, motion.width))
    motion.run_to(np.array([0.2053]))
    kept = motion.keep()
    counts = []
    for out in rows:
        motion.run_to(times, out)
        counts.append((motion.steps, motion.rejected_steps, motion.frontier, motion.time))
        motion.run_to(np.array([0.95]))
        motion.back_to(kept)
        assert motion.time == 0.2053
    assert rows[0].any() and rows[0].tobytes() == rows[1].tobytes() == rows[2].tobytes()
    assert counts[0] == counts[1] == counts[2]


@pytest.mark.parametrize("method", WAYS)
def test_a_motion_that_starts_again_is_a_new_one(method: str) -> None:
    """Of its grid, its series and its counts nothing is left, though a state was no number."""
    motion, out = swinging(method), np.zeros((2, 1, swinging(method).width))
    assert motion.take_worst() == 0.0
    motion.run_to(np.array([0.5]), out[0])
    steps = motion.steps, motion.rejected_steps, motion.frontier
    with pytest.raises(Exception, match="finite|small enough|Taylor|singular"):
        motion.reset((float("nan"), 1.0))
        motion.run_to(np.array([0.1]))
    motion.reset()
    assert motion.steps == motion.rejected_steps == 0 and motion.frontier == (0.0, 0.0)
    motion.run_to(np.array([0.5]), out[1])
    assert out[0].tobytes() == out[1].tobytes()
    assert (motion.steps, motion.rejected_steps, motion.frontier) == steps


# Scenes that differ only in numbers share laws, and move as with laws of their own.


CHAIN = """\
bodies:
  a: {mass: 1.0, inertia: [0.1, 0.1, 0.02], position: [0.5, 0, 0], center_of_mass: [0.0, 0.0, 0.0]}
  b: {mass: 2.0, inertia: [0.1, 0.2, 0.2], position: [1.5, 0, 0], angular_velocity: [1.0, 0.0, 0.0]}
constraints:
  first: {type: fixed_point, body: a, point_B: [-0.5, 0, 0]}
  second: {type: fixed_point, body: b, parent: a, point_B: [-0.5, 0, 0]}
effects:
  weight: {type: gravity, acceleration: [0.0, 0.0, -9.81]}
  air: {type: linear_drag, body: b, coefficient: 0.3}
simulation: {duration: 0.3, rate: 20, method: rk4, step: 0.005, project_initial: true}
"""

TOP = """\
bodies:
  top:
    mass: 15.0
    inertia: [0.24, 0.47, 0.24]
    center_of_mass: [0, 1, 0]
    angular_velocity: [0, 50, 1]
constraints:
  tip: {type: fixed_point, body: top}
effects:
  weight: {type: gravity, acceleration: [0.0, 0.0, -9.81]}
simulation: {duration: 0.3, rate: 20, method: dopri853, tolerance: 1.0e-9}
"""


def changed(text: str, pairs: dict[str, str]) -> Any:
    for old, new in pairs.items():
        assert old in text
        text = text.replace(old, new)
    return load_scene(text)


VARIANTS = [
    (TOP, [{"15.0": "14.0"}, {"[0, 50, 1]": "[0, 60, 1]"}, {"0.47": "0.42", "15.0": "16.5"}]),
    (CHAIN, [{"mass: 2.0": "mass: 2.5"}, {"0.3}": "0.1}"}, {"0.3}": "0.7}", "2.0": "1.1"}]),
    (THROWN, [{"mass: 2.0": "mass: 3.0"}, {"-9.81": "-1.6"}, {"-9.81": "-3.7", "3.0]": "5.0]"}]),
]


@pytest.mark.parametrize(("text", "variants"), VARIANTS, ids=["top", "chain", "thrown"])
def test_a_member_moves_as_with_laws_of_its_own(text: str, variants: list[dict[str, str]]) -> None:
    scenes = [load_scene(text), *(changed(text, pairs) for pairs in variants)]
    family = family_of([compile_scene(scene) for scene in scenes])
    assert family is not None
    for scene in scenes:
        shared, own = Simulation(scene, family=family), Simulation(scene)
        assert shared.compiled.laws is family.laws
        a, b = shared.run(checks=False), own.run(checks=False)
        for body in a.position:
            for name in ("position", "orientation", "linear_velocity", "angular_velocity"):
                x, y = getattr(a, name)[body], getattr(b, name)[body]
                assert np.abs(x - y).max() <= 1e-11 * (1.0 + np.abs(y).max()), (body, name)
        for name, reaction in a.reaction.items():
            force = b.reaction[name].force
            assert np.abs(reaction.force - force).max() <= 1e-10 * (1.0 + np.abs(force).max())


def test_what_differs_in_a_constant_of_the_family_keeps_its_own_laws() -> None:
    members = [load_scene(TOP), changed(TOP, {"15.0": "14.0"})]
    family = family_of([compile_scene(scene) for scene in members])
    assert family is not None
    other = changed(TOP, {"-9.81": "-1.62"})
    assert Simulation(other, family=family).compiled.laws is not family.laws
    thrown = load_scene(THROWN)
    assert Simulation(thrown, family=family).compiled.laws is not family.laws
