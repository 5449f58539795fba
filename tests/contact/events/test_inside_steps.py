# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""States inside a long step of an implicit method, where one step to them has no solution."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import StepTooLargeError

SCENE: dict[str, Any] = {
    "bodies": {
        "a": {
            "mass": 7.302,
            "inertia": [[3.338, -0.081, 0.352], [-0.081, 4.296, -0.431], [0.352, -0.431, 2.201]],
            "orientation": {"axis": [0.783, 0.395, -0.481], "angle": 1.241},
            "center_of_mass": [0.037, 0.023, 0.024],
            "angular_velocity": [-1.268, 1.916, -0.523],
        },
        "b": {
            "mass": 1.559,
            "shape": {"type": "ellipsoid", "semi_axes": [0.083, 0.13, 0.158]},
            "inertia": [0.004, 0.003, 0.005],
            "center_of_mass": [-0.012, 0.047, -0.048],
            "position": [0.187, -0.53, -0.32],
            "orientation": {"axis": [-0.772, -0.212, 0.599], "angle": 1.353},
            "linear_velocity": [-1.795, 1.991, -0.19],
            "angular_velocity": [5.113, 2.77, -3.08],
        },
    },
    "constraints": {
        "on": {
            "type": "contact",
            "body": "b",
            "parent": "a",
            "surface": {
                "type": "plane",
                "point": [0.193, -0.161, 0.026],
                "normal": [0.558, -0.036, 0.829],
            },
            "friction": {"type": "coulomb", "static": 0.935},
            "compliance": {"stiffness": 5043.835},
        }
    },
    "effects": {"weight": {"type": "gravity", "acceleration": [-1.461, 2.619, -0.075]}},
    "simulation": {"duration": 0.16, "rate": 4000.0, "method": "gauss6", "step": 0.01},
}
"""An ellipsoid that rubs on a soft plane of a free body while both turn, in steps of a period."""


@pytest.fixture(scope="module")
def often() -> Any:
    """The run with many samples inside a step."""
    return Simulation(load_scene(SCENE)).run()


def test_every_sample_is_a_state(often: Any) -> None:
    """Samples that the method did not reach in one step were written as NaN, without a word."""
    found = often
    for name in ("a", "b"):
        assert np.isfinite(found.position[name]).all()
        norms = np.linalg.norm(found.orientation[name], axis=1)
        np.testing.assert_allclose(norms, 1.0, rtol=0.0, atol=1e-12)


def test_seldom_samples_show_the_same_motion(often: Any) -> None:
    """What is done for a sample does not change the steps."""
    options = SCENE["simulation"] | {"rate": 50.0}
    seldom = Simulation(load_scene(SCENE | {"simulation": options})).run()
    np.testing.assert_array_equal(often.position["b"][-1], seldom.position["b"][-1])


def test_a_step_that_has_no_solution_in_flight_is_an_error() -> None:
    """An implicit method comes near the end of a slip in shorter steps, which it has no solution
    across. A damper beside the axis of a thin rod, which turns at once, is no such thing: the run
    crept through it in microseconds, a thousand to each step that was asked for."""
    rod = {
        "mass": 4.0,
        "shape": {"type": "rod", "length": 0.26},
        "orientation": {"axis": [0.0, 1.0, 0.0], "angle": 0.3},
        "position": [0.0, 0.0, 2.0],
    }
    spring = {
        "type": "spring",
        "body": "rod",
        "stiffness": 1400.0,
        "rest_length": 0.0,
        "damping": 12.0,
        "point_A": [0.5, -0.7, 1.6],
        "point_B": [0.11, -0.03, -0.04],
    }
    scene = {
        "bodies": {"rod": rod},
        "constraints": {"floor": {"type": "contact", "body": "rod"}},
        "effects": {"spring": spring},
        "simulation": {"method": "gauss6", "step": 4e-3, "duration": 0.1, "rate": 100.0},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    with pytest.raises(StepTooLargeError, match="too large for gauss6"):
        simulation.advance(0.1)
