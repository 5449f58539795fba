# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The laws of one body at any state, without a run: reduced coordinates beside maximal ones.

The two share no equation of motion (test_free_rotor.py compares runs beside a bystander); here
they are asked at random coordinates, so that every term counts and a comparison costs milliseconds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.interpreted import interpreted
from tests.moving import difference
from tests.one_body_scenes import EFFECTS, JOINTS, Mapping

INSTANT = 0.11
"""[s] at which the laws are asked; within all tables over time."""
EFFECTS_ON_JOINTS = {
    f"{effect} on {joint}": JOINTS[joint] | {"effects": {"one": EFFECTS[effect]}}
    for effect in EFFECTS
    for joint in ("free", "fixed_point", "fixed_axis, none floats", "translation along a circle")
}
SCENES = JOINTS | EFFECTS_ON_JOINTS


def compiled_both(mapping: Mapping) -> tuple[Any, Any]:
    from rb_sim import load_scene
    from rb_sim.scene.compile import compile_scene

    read = load_scene(mapping)
    return compile_scene(read), compile_scene(read, coordinates="maximal")


def anywhere(reduced: Any, rng: np.random.Generator) -> tuple[float, ...]:
    """Coordinates in the middle of a motion: other places and speeds, as far as the joint lets."""
    from rb_sim.mechanics.system import project

    y = np.array(reduced.y) + 0.3 * rng.normal(size=len(reduced.y))
    return tuple(project(reduced.system, INSTANT, tuple(float(x) for x in y)))


def sampled(compiled: Any, y: Any) -> np.ndarray:
    from tests.numbers import sample_at

    return sample_at(compiled, INSTANT, y)


def both(mapping: Mapping, seed: int) -> tuple[np.ndarray, ...]:
    """Samples and rates of the state, by reduced and by maximal coordinates: (2, ...) each."""
    from rb_sim.mechanics.system import inside
    from rb_sim.mechanics.systems.one_body import rate
    from tests.numbers import rate_at

    reduced, maximal = compiled_both(mapping)
    y = anywhere(reduced, np.random.default_rng(seed))
    assert inside(reduced.system, y)
    own = sampled(reduced, y)
    state = own[:13].copy()
    dy = np.array(rate(reduced.system, INSTANT, y))
    along = difference(lambda h: sampled(reduced, tuple(np.array(y) + h * dy))[:13])
    expected = rate_at(maximal, INSTANT, state)
    return np.array([own, sampled(maximal, state)]), np.array([along, expected])


@pytest.mark.parametrize("name", SCENES)
def test_samples_and_rates_agree_at_any_state(name: str) -> None:
    """Reactions, anchors, energies, power, momenta; accelerations, as rates of the velocities."""
    samples, rates = interpreted(both, SCENES[name], 0)
    assert_allclose(samples[0, :-1], samples[1, :-1], rtol=0.0, atol=1e-12 * np.abs(samples).max())
    assert samples[:, -1].max() < 1e-13
    assert_allclose(rates[0], rates[1], rtol=0.0, atol=1e-8 * (1.0 + np.abs(rates).max()))


def projected_from(mapping: Mapping, stretch: float, lift: float) -> tuple[float, ...]:
    """(residual off the manifold, after `project`, size of the arm that lifts are measured by,
    largest difference of a coordinate from where it was)."""
    from rb_sim.mechanics.system import project

    reduced, _ = compiled_both(mapping)
    start = anywhere(reduced, np.random.default_rng(5))
    y, q = np.array(start), {13: 3, 10: 3, 7: 0}[len(start)]
    y[q : q + 4] *= 1.0 + stretch
    normal = getattr(reduced.system, "normal", (0.0, 0.0, 0.0))
    if any(normal):
        y[:3] += lift * np.array(normal)
    off = sampled(reduced, tuple(y))
    back = project(reduced.system, INSTANT, tuple(y))
    arm = 0.0
    if any(normal):
        arm = abs(reduced.system.offset) + float(np.linalg.norm(off[19:22] - off[:3]))
    gone = float(np.abs(np.array(back) - start).max())
    return float(off[-1]), float(sampled(reduced, back)[-1]), arm, gone


QUATERNIONS = ["free", "fixed_point", "rolling sphere", "rolling disk", "rolling ellipsoid"]


@pytest.mark.parametrize("stretch", [1e-6, -1e-6])
@pytest.mark.parametrize("name", QUATERNIONS)
def test_the_residual_is_how_far_the_quaternion_is_from_length_one(
    name: str, stretch: float
) -> None:
    off, back, _, gone = interpreted(projected_from, JOINTS[name], stretch, 0.0)
    assert off == pytest.approx(abs((1.0 + stretch) ** 2 - 1.0), rel=1e-9)
    assert back < 1e-15 and gone < 1e-14


@pytest.mark.parametrize("lift", [1e-3, -1e-3])
@pytest.mark.parametrize("name", QUATERNIONS[2:])
def test_the_residual_is_how_far_what_rolls_is_from_the_plane(name: str, lift: float) -> None:
    """Relative to the plane's distance from the origin and the arm to the point of contact."""
    off, back, arm, gone = interpreted(projected_from, JOINTS[name], 0.0, lift)
    assert off == pytest.approx(1e-3 / arm, rel=1e-9)
    assert back < 1e-15 and gone < 1e-14


def maximal_from_near(mapping: Mapping) -> tuple[float, float]:
    """(residual near the manifold, after `project`) in maximal coordinates."""
    from tests.numbers import projected

    _, maximal = compiled_both(mapping)
    y = np.array(maximal.y) + 1e-4 * np.random.default_rng(2).normal(size=13)
    off = sampled(maximal, y)[-1]
    return float(off), float(sampled(maximal, projected(maximal.system, INSTANT, y))[-1])


@pytest.mark.parametrize("name", sorted(set(JOINTS) - {"free"}))
def test_maximal_coordinates_come_back_from_near_the_manifold(name: str) -> None:
    off, back = interpreted(maximal_from_near, JOINTS[name])
    assert off > 1e-6
    assert back < 1e-13
