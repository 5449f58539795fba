"""Commanded wrenches: what is reported of them is what acts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from tests.interpreted import interpreted

FORCE, TORQUE = [1.0, -2.0, 0.5], [0.3, 0.1, -0.2]
MASS = 1.5


def commanded() -> Any:
    """Two samples, very close, of a body that is turned, under a command in its own axes."""
    from rb_sim import Simulation, load_scene

    body = {
        "mass": MASS,
        "inertia": [0.2, 0.2, 0.2],
        "orientation": {"axis": [1.0, 2.0, 2.0], "angle": 1.1},
    }
    scene = {
        "bodies": {"b": body},
        "effects": {"hand": {"type": "commanded_wrench", "body": "b"}},
        "simulation": {"duration": 1.0, "tolerance": 1e-12},
    }
    simulation = Simulation(load_scene(scene))
    simulation.apply_wrench("b", FORCE, TORQUE, "body")
    return simulation.run(1e-6, 1e6).block


def test_a_command_in_body_axes_is_reported_in_the_worlds() -> None:
    block = interpreted(commanded)
    turn = Rotation.from_rotvec(1.1 / 3.0 * np.array([1.0, 2.0, 2.0]))
    assert_allclose(block.command[0, 0], [*turn.apply(FORCE), *turn.apply(TORQUE)], rtol=1e-12)
    push = MASS * (block.linear_velocity[1, 0] - block.linear_velocity[0, 0]) / 1e-6
    assert_allclose(push, block.command[0, 0, :3], rtol=1e-6)
