"""The Jacobian by differences of bodies in contact, beside that in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.events.steps import difference, jacobian_by_differences, slowest_slip
from rb_sim.mechanics.contact.contact_bodies import (
    CLOSED,
    COMPLIANT,
    SLIDE,
    SLIP,
    STATIC,
    TOUCH_WIDTH,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import G, touch
from tests.interpreted import interpreted

SPEED, LENGTH = 4.0, 0.5
"""Of a scene [m/s, m]."""
MASSES, MOMENTS = (2.0, 0.5), ((0.02, 0.03, 0.04), (0.005, 0.003, 0.004))
STIFFNESS, DAMPING, MU = 300.0, 7.0, 0.3
SPINS = ((0.3, -0.2, 0.5), (1.0, 2.0, 0.7))


def test_the_slowest_slip_of_those_whose_friction_has_a_corner() -> None:
    """Over the scene's speed: at least what is followed, at most a thousandth."""

    def slowest(*slips: float, creep: float = 0.0) -> float:
        touch = np.zeros((4, TOUCH_WIDTH))
        touch[:, [CLOSED, SLIDE, STATIC, COMPLIANT]] = 1.0, SLIDING, 0.3, 1.0
        touch[0, STATIC], touch[3, SLIDE] = 0.0, STUCK
        touch[1:3, SLIP], touch[1:3, SLIP + 2] = 0.6 * np.array(slips), 0.8 * np.array(slips)
        system = SimpleNamespace(touch=touch, speed=SPEED, still=1e-6, creep=creep)
        return float(slowest_slip(system))

    assert slowest(2e-3, 1e-4) == pytest.approx(1e-4 / SPEED)
    assert slowest(1e-4, 2e-3) == pytest.approx(1e-4 / SPEED)
    assert slowest(2e-3, 1e-7) == pytest.approx(1e-6 / SPEED)
    assert slowest(2e-3, 1e-7, creep=1e-8) == pytest.approx(1e-7 / SPEED)
    assert slowest(2.0, 3.0) == pytest.approx(1e-3)


def test_differences_are_parts_of_the_slowest_slip() -> None:
    """Of velocities a ten-thousandth; of places a thousandth, between 1e-12 and 1e-8."""
    system = SimpleNamespace(speed=SPEED, length=LENGTH)
    for slip, place in ((1e-7, 1e-10), (1e-3, 1e-8), (1e-10, 1e-12)):
        expected = [place * LENGTH] * 3 + [place] * 4
        expected += [1e-4 * slip * SPEED] * 3 + [1e-4 * slip * SPEED / LENGTH] * 3
        assert_allclose([difference(system, k, slip) for k in range(13)], expected, rtol=1e-12)


def found(friction: bool) -> tuple[np.ndarray, np.ndarray]:
    """(y, df/dy) of two balls on a floor that gives way; without friction, or without spin and so
    slow that a difference of the scene's size would turn their slip round."""
    compliance = {"stiffness": STIFFNESS, "damping": DAMPING}
    bodies = {
        name: {
            "mass": MASSES[i], "inertia": list(MOMENTS[i]),
            "angular_velocity": [0, 0, 0] if friction else list(SPINS[i]),
            "shape": {"type": "sphere", "radius": 0.1}, "position": [i, 0.2 * i, 0.095 - 0.01 * i],
            "linear_velocity": [3e-7, 4e-7 - 8e-7 * i, -0.02 + 0.03 * i],
            "orientation": {"axis": [1.0, 2.0, 0.5], "angle": 0.7},
        }
        for i, name in enumerate("ab")
    }  # fmt: skip
    floors = {
        name: touch(name, mu=MU if friction else 0.0, compliance=compliance) for name in bodies
    }
    weight = {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}}
    run = {"duration": 1.0, "method": "dopri853", "tolerance": 1e-9}
    mapping = {"bodies": bodies, "constraints": floors, "effects": weight, "simulation": run}
    compiled: Any = compile_scene(scene_from_mapping(mapping))
    system, y = compiled.system._replace(still=1e-9), np.array(compiled.y)
    system.touch[:, CLOSED] = 1.0
    system.touch[:, SLIDE] = SLIDING
    out, before = np.full(len(y) ** 2, 5.0), y.copy()
    jacobian_by_differences.function(0.0, y, system, out)
    assert np.array_equal(y, before)
    return y, out.reshape(len(y), len(y))


def force(y: np.ndarray) -> float:
    """Of the support on one ball [N]."""
    return STIFFNESS * (0.1 - y[2]) - DAMPING * y[9]


def product(q: Any, p: Any) -> np.ndarray:
    """Of quaternions, with the real part last."""
    return np.array(
        [*(q[3] * p[:3] + p[3] * q[:3] + np.cross(q[:3], p[:3])), q[3] * p[3] - q[:3] @ p[:3]]
    )


def across(w: Any) -> np.ndarray:
    """The matrix of the cross product with w."""
    return np.cross(w, np.eye(3)).T


def smooth(y: np.ndarray, i: int) -> np.ndarray:
    """d(dp, dq, dv, dw)/d(p, q, v, w) of ball i without friction: Euler's equations, a spring."""
    q, w, inertia, out = y[3:7], y[10:13], np.diag(MOMENTS[i]), np.zeros((13, 13))
    out[:3, 7:10] = np.eye(3)
    spin = np.append(w, 0.0)
    out[3:7, 3:7] = np.transpose([0.5 * product(e, spin) for e in np.eye(4)])
    out[3:7, 10:13] = np.transpose([0.5 * product(q, e) for e in np.eye(4)[:3]])
    out[9, 2], out[9, 9] = -STIFFNESS / MASSES[i], -DAMPING / MASSES[i]
    turning = across(w) @ inertia - across(inertia @ w)
    out[10:, 10:] = -np.linalg.solve(inertia, turning)
    return out


def test_balls_on_a_floor_that_gives_way() -> None:
    """Neither depends on the other; the work grows by N times the speed.  Of quaternions only how
    they turn: what loads do where they have not the length 1 is no law of motion."""
    y, jacobian = interpreted(found, False)
    expected = np.zeros((27, 27))
    for i in range(2):
        own = y[13 * i : 13 * i + 13]
        expected[13 * i : 13 * i + 13, 13 * i : 13 * i + 13] = smooth(own, i)
        expected[26, 13 * i + 2] = -STIFFNESS * own[9]
        expected[26, 13 * i + 9] = force(own) - DAMPING * own[9]
        jacobian[np.ix_([*range(13 * i + 7, 13 * i + 13), 26], range(13 * i + 3, 13 * i + 7))] = 0.0
    assert_allclose(jacobian, expected, rtol=1e-5, atol=1e-3)


def test_a_slow_slip_turns_at_once() -> None:
    """Friction is -mu N s / |s|: across the slip it changes by mu N / |s|, along not at all."""
    y, jacobian = interpreted(found, True)
    for i in range(2):
        own = y[13 * i : 13 * i + 13]
        slip, n = own[7:9], force(own)
        size = np.linalg.norm(slip)
        d = slip / size
        expected = np.diag([0.0, 0.0, -DAMPING])
        expected[:2, :2] = -MU * n / size * (np.eye(2) - np.outer(d, d))
        expected[:2, 2] = MU * DAMPING * d
        at = slice(13 * i + 7, 13 * i + 10)
        scale = MU * n / size / MASSES[i]
        assert_allclose(jacobian[at, at] / scale, expected / MASSES[i] / scale, atol=1e-7)
