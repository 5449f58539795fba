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

from rb_sim import load_scene
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
    """-k (theta - theta0) along the axis, theta from -pi to pi."""
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
