"""A wheel beside another body rolls as it does alone, whatever its axis and the plane's normal.

Alone it has reduced coordinates, beside another body multipliers: two derivations of one motion.
"""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene

R = 0.3
AXES = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}


def scene(axis: str, normal: str, others: bool) -> dict[str, Any]:
    n, a = np.array(AXES[normal]), np.array(AXES[axis])
    spin = 2.0 * a + 0.7 * n
    velocity = -np.cross(spin, -R * n)
    wheel = {
        "mass": 1.0,
        "shape": {"type": "disk", "radius": R, "axis_B": AXES[axis]},
        "position": (R * n).tolist(),
        "linear_velocity": velocity.tolist(),
        "angular_velocity": spin.tolist(),
    }
    frame = {"frame": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": [0.0, 0.0, 5.0]}}
    roll = {"type": "rolling", "body": "wheel", "normal_A": AXES[normal]}
    return {
        "bodies": {"wheel": wheel} | (frame if others else {}),
        "constraints": {"roll": roll},
        "effects": {
            "g": {"type": "gravity", "acceleration": (-9.81 * n).tolist(), "bodies": ["wheel"]}
        },
        "simulation": {"duration": 1.0, "rate": 20.0},
    }


@pytest.mark.parametrize(("axis", "normal"), list(permutations("xyz", 2)))
def test_rolls_as_it_does_alone(axis, normal):
    alone, beside = (Simulation(load_scene(scene(axis, normal, o))).run() for o in (False, True))
    np.testing.assert_allclose(beside.position["wheel"], alone.position["wheel"], atol=1e-9)
    there, here = beside.reaction["roll"].force, alone.reaction["roll"].force
    np.testing.assert_allclose(there, here, atol=1e-7)
    assert np.abs(beside.position["wheel"][-1] - beside.position["wheel"][0]).max() > 0.1
