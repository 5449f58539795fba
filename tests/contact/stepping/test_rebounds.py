# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Restitution and friction together create no energy in a step (Kane and Levinson 1985)."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.scene.load import scene_from_mapping

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
        found = thrown(lean, speed, spin, **STEPS).run(watched=False)
        assert np.diff(found.energy).max() <= 1e-12
        arm = -0.5 * np.array([np.sin(lean), np.cos(lean)])
        rises = found.linear_velocity["rod"][:, 2] - found.angular_velocity["rod"][:, 1] * arm[0]
        rebounds += rises[-1] > 0.0
    assert rebounds > 5


def test_a_rebound_that_creates_none_is_newtons() -> None:
    """Upright and without slip: v+ = -e v-."""
    found = thrown(0.0, 0.0, 0.0, **STEPS).run(watched=False)
    assert found.linear_velocity["rod"][-1, 2] == pytest.approx(E, abs=1e-9)


@pytest.mark.parametrize(
    "start", [(-0.527, -0.089, 2.884), (-0.572, -1.209, 1.885), (-0.927, -0.653, 0.1)]
)
def test_one_that_would_create_some_is_poissons(start: tuple[float, float, float]) -> None:
    """As in the run that locates the impact; Newton's law gave 1.08 times the energy."""
    ends = [thrown(*start, **how).run(watched=False).block for how in ({}, STEPS)]
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
    found = Simulation(scene_from_mapping(scene)).run(watched=False)
    assert np.abs(found.angular_velocity["box"]).max() < 1e-3
    assert found.energy[-1] == pytest.approx(found.energy[0], rel=1e-4)
