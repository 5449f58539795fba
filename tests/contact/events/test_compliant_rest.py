# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A box that lands on a support that gives way rocks, creeps and rests.

Its corners slip by lean times rate of the lean, ever more slowly, while friction of some newtons
turns those slips at once: explicit steps were as short as that (1e-9 s), and the changes between
rest and slip, at speeds that are but errors, had no end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.contact.toss_scenes import toss
from rb_sim import Simulation
from rb_sim.scene.load import scene_from_mapping

SIZE, MASS, STIFFNESS, DAMPING, MU, G = (0.2, 0.15, 0.1), 1.0, 5e3, 20.0, 0.4, 9.81
AXIS, ANGLE, START = (0.6, 0.8, 0.0), 0.03, (0.05, 0.02, 0.0)
HEIGHT = 0.5 * 0.1 * np.cos(ANGLE) + (0.5 * 0.2 * 0.8 + 0.5 * 0.15 * 0.6) * np.sin(ANGLE) + 1e-4
REFERENCE = {
    "position": ([0.0013857002019, 0.000580810296126, 0.0495490924591], 5e-9),
    "linear_velocity": ([-8.50849545722e-05, 0.000467378122239, -0.00605720189468], 1e-7),
    "angular_velocity": ([-0.00934508803745, -0.0017152263156, 1.09747290247e-07], 2e-6),
}
"""At 0.12 s, by `python -m benchmarks.contact.rocking_box`, and how far off it is: friction is
rounded there at 1e-8 m/s; at 1e-7 m/s it is off by 19 times as much."""


def box(lean: float = 0.0, **simulation: Any) -> Simulation:
    """The box above a floor that leans."""
    body = {
        "mass": MASS, "shape": {"type": "box", "size": SIZE}, "position": [0.0, 0.0, HEIGHT],
        "orientation": {"axis": AXIS, "angle": ANGLE}, "linear_velocity": START,
    }  # fmt: skip
    contact = {
        "type": "contact", "body": "box", "friction": {"type": "coulomb", "static": MU},
        "compliance": {"stiffness": STIFFNESS, "damping": DAMPING},
    }  # fmt: skip
    weight = [G * np.sin(lean), 0.0, -G * np.cos(lean)]
    scene = {
        "bodies": {"box": body},
        "constraints": {"floor": contact},
        "effects": {"weight": {"type": "gravity", "acceleration": weight}},
    }
    return Simulation(scene_from_mapping(scene | {"simulation": simulation}))


@pytest.mark.parametrize("lean", [0.0, 0.2])
def test_it_comes_to_rest(lean: float) -> None:
    simulation = box(lean, duration=1.0, rate=200)
    found = simulation.run()
    assert simulation.steps < 20_000
    assert [e.kind for e in simulation.events[-4:]] == ["sticks"] * 4
    for velocity in (found.linear_velocity["box"][-1], found.angular_velocity["box"][-1]):
        assert np.abs(velocity).max() < 1e-9
    weight = MASS * G * np.array([np.sin(lean), 0.0, -np.cos(lean)])
    np.testing.assert_allclose(found.reaction["floor"].force[-1], -weight, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.reaction["floor"].torque[-1], 0.0, rtol=0.0, atol=1e-9)
    balance = found.energy - found.contact_work
    assert np.ptp(balance) < 1e-9 * MASS * G


def test_on_the_way_it_moves_as_an_independent_program_says() -> None:
    """At 0.12 s corners slip by some 1e-5 m/s, and have stuck six times."""
    found = box(duration=0.12, rate=100).run()
    for name, (expected, off) in REFERENCE.items():
        np.testing.assert_allclose(getattr(found, name)["box"][-1], expected, rtol=0.0, atol=off)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10, 1e-12])
def test_what_has_stopped_is_held_by_static_friction(tolerance: float) -> None:
    """A point that gives way stops under a load of 0.985 of kinetic friction, and stays where the
    load grows beyond that, up to 0.95 of static friction; it went on, creeping."""
    static, kinetic, pulled, swings = 0.5, 0.4, 0.394 * G, 0.08 * G
    body = {"mass": 1.0, "position": [0.0, 0.0, -G / 5e3], "linear_velocity": [-0.01, 0.0, 0.0]}
    contact = {
        "type": "contact", "body": "b", "points": [[0.0, 0.0, 0.0]],
        "compliance": {"stiffness": 5e3},
        "friction": {"type": "coulomb", "static": static, "kinetic": kinetic},
    }  # fmt: skip
    pull = {
        "type": "wrench", "body": "b", "force": [pulled, 0.0, 0.0],
        "sine_force": [swings, 0.0, 0.0], "angular_frequency": 20.0,
    }  # fmt: skip
    scene = {
        "bodies": {"b": {"inertia": [1.0, 1.0, 1.0]} | body},
        "constraints": {"c": contact},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}, "pull": pull},
        "simulation": {"duration": 0.5, "tolerance": tolerance, "method": "dopri853"},
    }
    simulation = Simulation(scene_from_mapping(scene))
    found = simulation.run(watched=False)
    assert [e.kind for e in simulation.events] == ["closes", "slips", "sticks"]
    stopped = found.position["b"][found.t > 0.01, 0]
    assert np.ptp(stopped) < 1e-12
    # the pull helps to stop it, and grows but by 0.08 g 20 t in the millisecond that it takes
    assert stopped[0] == pytest.approx(-0.5 * 0.01**2 / ((kinetic + 0.394) * G), rel=5e-3)


def test_one_corner_that_creeps_near_the_bound_of_friction_rests() -> None:
    """Under 0.98 of kinetic friction; static friction holds more. Runs parted by 2 mm."""
    ends = []
    for tolerance in (1e-10, 1e-12):
        mapping = toss(77, 432).mapping
        times = {"duration": 0.3, "tolerance": tolerance, "method": "dopri853"}
        simulation = Simulation(scene_from_mapping(mapping | {"simulation": times}))
        ends.append(simulation.run(watched=False).position["b"][-1])
        assert simulation.steps < 5000
    np.testing.assert_allclose(*ends, rtol=0.0, atol=1e-8)


def creeping(tolerance: float) -> tuple[int, np.ndarray]:
    """(steps, where it ends) of a box that creeps on a stiffer floor."""
    body = {
        "mass": 1.0,
        "shape": {"type": "box", "size": [0.1, 0.2, 0.16]},
        "position": [0.0, 0.0, 0.0857],
        "orientation": {"axis": [0.8, 0.6, 0.0], "angle": 0.04},
        "linear_velocity": [0.05, -0.08, 0.0],
    }
    contact = {
        "type": "contact", "body": "box", "friction": {"type": "coulomb", "static": 0.45},
        "compliance": {"stiffness": 1.2e4, "damping": 5.0},
    }  # fmt: skip
    scene = {
        "bodies": {"box": body},
        "constraints": {"floor": contact},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}},
        "simulation": {"duration": 0.2, "rate": 100.0, "tolerance": tolerance},
    }
    simulation = Simulation(scene_from_mapping(scene))
    found = simulation.run(watched=False)
    return simulation.steps, found.position["box"][-1]


def test_a_tolerance_that_rounding_does_not_allow_costs_no_more_steps() -> None:
    """Stages of implicit steps are solved to 1e-13: steps that were to keep to that were 1e6."""
    steps, place = creeping(1e-12)
    more, same = creeping(1e-13)
    assert more < 2 * steps
    np.testing.assert_allclose(same, place, rtol=0.0, atol=1e-10)
