# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scenes that differ only in numbers share laws, and move as with laws of their own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.mechanics.inputs import FREE, fits, with_numbers
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.compiled import family_of
from tests.sweeps.plans import THROWN

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
        a, b = shared.run(), own.run()
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


class Spring(NamedTuple):
    stiffness: float
    turns: int
    table: np.ndarray


@pytest.mark.parametrize(
    ("other", "is_one"),
    [
        (Spring(2.0, 3, np.array([1.0, 5.0])), True),
        (Spring(2.0, 3, np.array([1.5, 5.0])), False),
        (Spring(2.0, 4, np.array([1.0, 2.0])), False),
        (Spring(2, 3, np.array([1.0, 2.0])), False),
        (Spring(2.0, 3, np.array([1.0, 2.0, 3.0])), False),
        ((2.0, 3, np.array([1.0, 2.0])), False),
    ],
    ids=["free numbers", "a constant", "a count", "no float", "length", "another kind"],
)
def test_what_fits_a_pattern_differs_from_it_in_free_numbers_only(other: Any, is_one: bool) -> None:
    first = Spring(1.0, 3, np.array([1.0, 2.0]))
    pattern = with_numbers(first, {(0,): FREE, (2, 1): FREE})
    assert fits(first, pattern)
    assert fits(other, pattern) is is_one
    whole_table = with_numbers(first, {(0,): FREE})
    assert fits(first._replace(stiffness=9.0), whole_table) and not fits(other, whole_table)
