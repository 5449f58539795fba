# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Torsion springs between two bodies that are turned at the start and turn: angle, torque, energy.

Their balance is in tests/properties/test_between_bodies, their swing alone in test_effects.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene
from rb_sim.catalogue.types import WORLD, Inertial, potential, wrench
from rb_sim.scene.compile import compile_scene
from tests.moving import floats, random_state

AXIS = np.array([2.0, 3.0, 6.0]) / 7.0
STIFFNESS, DAMPING, REST = 0.8, 0.3, 0.4
STARTS = {"a": {"axis": [0.3, -0.5, 0.8], "angle": 0.9}, "b": {"axis": [1, 0.2, 0], "angle": -1.7}}
BODY = Inertial(1.0, (1.0, 1.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def rows(parent: bool, **law: float) -> list[Any]:
    solid = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    bodies = {name: solid | {"orientation": turn} for name, turn in STARTS.items()}
    spring = {"type": "torsion_spring", "body": "b", "axis_B": AXIS.tolist()} | law
    scene = {"bodies": bodies, "effects": {"s": spring | ({"parent": "a"} if parent else {})}}
    compiled = compile_scene(load_scene(scene), coordinates="maximal")
    return [placed.row for placed in compiled.system.effects]


def start(name: str) -> Rotation:
    axis = np.array(STARTS[name]["axis"], dtype=float)
    return Rotation.from_rotvec(STARTS[name]["angle"] * axis / np.linalg.norm(axis))


def states(parent: bool, turned: Rotation, sign: float) -> tuple[Any, Any]:
    """The body turned by `turned`, body axes, from its pose at the start as its parent carries it,
    which has turned since; sign: of the quaternion, which means the same."""
    rng = np.random.default_rng(1)
    B, A = random_state(rng), random_state(rng) if parent else WORLD
    carried = Rotation.from_quat(A.q_WB) * (start("a").inv() if parent else Rotation.identity())
    q = (carried * start("b") * turned).as_quat()
    return B._replace(q_WB=floats(sign * q)), A


ANGLES = (-4.0, -math.pi + 0.01, -1.0, 0.0, 0.7, 2.5, math.pi - 0.01, 4.5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("parent", [False, True])
@pytest.mark.parametrize("angle", ANGLES)
def test_a_turn_about_its_axis(angle: float, parent: bool, sign: float) -> None:
    """-k (theta - theta0) along the axis, theta from -pi to pi where no turn was counted yet."""
    (row,) = rows(parent, stiffness=STIFFNESS, rest_angle=REST)
    B, A = states(parent, Rotation.from_rotvec(angle * AXIS), sign)
    wound = (angle + math.pi) % (2.0 * math.pi) - math.pi - REST
    force, torque = wrench(row, 0.0, BODY, B, A)
    assert force == (0.0, 0.0, 0.0)
    assert_allclose(torque, -STIFFNESS * wound * AXIS, atol=1e-12)
    energy = potential(row, 0.0, BODY, B, A)
    assert energy == pytest.approx(0.5 * STIFFNESS * wound**2, abs=1e-12)


@pytest.mark.parametrize("parent", [False, True])
def test_a_turn_across_its_axis_is_no_twist(parent: bool) -> None:
    (row,) = rows(parent, stiffness=STIFFNESS)
    across = np.cross(AXIS, [1.0, 0.0, 0.0])
    B, A = states(parent, Rotation.from_rotvec(0.9 * across / np.linalg.norm(across)), 1.0)
    assert_allclose(wrench(row, 0.0, BODY, B, A)[1], 0.0, atol=1e-14)
    assert potential(row, 0.0, BODY, B, A) < 1e-28


@pytest.mark.parametrize("parent", [False, True])
def test_a_damper_takes_the_relative_spin_about_the_axis(parent: bool) -> None:
    (row,) = rows(parent, damping=DAMPING)
    B, A = states(parent, Rotation.from_rotvec([0.3, 1.0, -0.4]), 1.0)
    spins = [Rotation.from_quat(S.q_WB).apply(S.w_WB_B) for S in (B, A)]
    relative = Rotation.from_quat(B.q_WB).inv().apply(spins[0] - spins[1])
    force, torque = wrench(row, 0.0, BODY, B, A)
    assert force == (0.0, 0.0, 0.0)
    assert_allclose(torque, -DAMPING * (relative @ AXIS) * AXIS, atol=1e-14)


def test_what_is_left_out_is_not_there() -> None:
    assert len(rows(True, stiffness=1.0, damping=1.0)) == 2
    assert rows(True) == []


SPIN, MOMENT = 12.0, 0.2
"""A wheel on a torsion spring that winds it by 1.2 turns and back, I_3 [kg m^2]."""
FREQUENCY = math.sqrt(STIFFNESS * 0.625 / MOMENT)
KINDS = {
    "reduced": {},
    "maximal": {"other": {"mass": 1.0, "inertia": [0.1] * 3, "position": [9.0, 0.0, 0.0]}},
    "contact": {"ball": {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}},
    "tables": {f"b{k}": {"mass": 1.0, "inertia": [0.1] * 3} for k in range(12)},
}


def wound(kind: str, rate: float = 20.0, **options: Any) -> Simulation:
    """The wheel beside nothing, another body, a ball on a floor, or a dozen bodies."""
    wheel = {"mass": 1.0, "inertia": [0.1, 0.15, MOMENT], "angular_velocity": [0.0, 0.0, SPIN]}
    spring = {"type": "torsion_spring", "body": "wheel", "axis_B": [0.0, 0.0, 1.0]}
    axle = {"type": "fixed_axis", "body": "wheel", "axis_B": [0.0, 0.0, 1.0]}
    scene: dict[str, Any] = {
        "bodies": {"wheel": wheel} | KINDS[kind],
        "constraints": {"axle": axle},
        "effects": {"spring": spring | {"stiffness": FREQUENCY**2 * MOMENT}},
        "simulation": {"duration": 6.0, "rate": rate} | options,
    }
    if kind == "contact":
        scene["bodies"]["ball"] |= {"position": [3.0, 0.0, 0.1]}
        scene["constraints"]["floor"] = {"type": "contact", "body": "ball"}
        weight = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81], "bodies": ["ball"]}
        scene["effects"]["weight"] = weight
    return Simulation(load_scene(scene), announce=None)


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        *((kind, {"method": "dopri853", "tolerance": 1e-10}) for kind in KINDS),
        *((kind, {"method": "rk4", "step": 1e-3}) for kind in ("reduced", "maximal", "contact")),
        *((kind, {"method": "taylor", "tolerance": 1e-10}) for kind in ("reduced", "maximal")),
        ("reduced", {"method": "radau5", "tolerance": 1e-9}),
        ("contact", {"method": "time_stepping", "step": 1e-3}),
    ],
)
def test_a_spring_winds_beyond_half_a_turn(kind: str, options: Any) -> None:
    """w = w0 cos(W t) and U = I w0^2 sin^2(W t) / 2, with samples that are turns apart."""
    run = wound(kind, 2.0, **options).run()
    bound = 1e-3 if options["method"] == "time_stepping" else 1e-7
    spin = run.angular_velocity["wheel"][:, 2]
    assert_allclose(spin, SPIN * np.cos(FREQUENCY * run.t), atol=SPIN * bound)
    energy = 0.5 * MOMENT * (SPIN * np.sin(FREQUENCY * run.t)) ** 2
    assert_allclose(run.block.potential_energy - run.block.potential_energy[0], energy, atol=1e-2)
    assert run.findings == ()


@pytest.mark.parametrize("kind", ["reduced", "contact"])
def test_turns_stay_counted_over_a_command_and_in_a_run_that_goes_on(kind: str) -> None:
    """Each begins a new grid of steps; at 0.7 s the spring is wound by 4 rad and more."""
    simulation = wound(kind)
    first = simulation.run(0.7)
    assert SPIN / FREQUENCY * math.sin(FREQUENCY * 0.7) > 4.0
    rest = simulation.run(5.3)
    t = np.append(first.t, rest.t)
    spin = np.append(first.angular_velocity["wheel"], rest.angular_velocity["wheel"], 0)[:, 2]
    assert_allclose(spin, SPIN * np.cos(FREQUENCY * t), atol=1e-6)
    if kind == "reduced":  # in contact no second run goes on from another one
        assert rest.global_error is not None and rest.global_error.relative < 1e-6


def test_the_linear_model_of_a_wound_spring_is_that_about_where_it_is() -> None:
    """The same stiffness about any angle, and the torque of all turns."""
    simulation = wound("reduced")
    simulation.run(0.7)
    values = simulation.linearize().eigenvalues
    assert_allclose(np.abs(values).max(), FREQUENCY, rtol=1e-6)


def test_a_reset_counts_anew() -> None:
    simulation = wound("reduced")
    first = simulation.run(1.0)
    simulation.reset()
    again = simulation.run(1.0)
    assert_allclose(again.angular_velocity["wheel"], first.angular_velocity["wheel"], atol=1e-15)
