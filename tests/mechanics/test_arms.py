# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""An angle off the manifold is a length at the end of an arm of the scene's length, for everybody
who judges errors: Newton's way back, residuals with and without contacts, the analysis of bags."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation
from rb_sim.bags.analysis.scene_laws import ConstraintFigures, SceneLaws
from rb_sim.scene.compile import compile_motion
from rb_sim.scene.load import scene_from_mapping
from tests.mechanics.test_redundant import with_ball

SIZES = (1e-6, 1.0, 1e3)
TILT = 1e-5
"""Of a body about the x axis [rad], which its plane allows and its parallel axes do not."""


def upright(size: float, count: int = 1, method: str = "dopri853") -> dict[str, Any]:
    """Bodies on a table, each with its axis parallel to z."""
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    for k in range(count):
        squares = (np.array([0.1, 0.2, 0.25]) * size**2).tolist()
        bodies[f"b{k}"] = {"mass": 1.0, "inertia": squares, "position": [0.0, k * size, 0.0]}
        on = {"body": f"b{k}"}
        joints[f"axis{k}"] = {"type": "parallel", "axis_B": [0, 0, 1], "axis_A": [0, 0, 1]} | on
        joints[f"table{k}"] = {"type": "plane", "point_B": [size, 0, 0], "normal_A": [0, 0, 1]} | on
    run: dict[str, Any] = {"duration": 0.1, "rate": 10.0, "method": method}
    run |= {} if method == "dopri853" else {"step": 0.01}
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -size]}
    return {"bodies": bodies, "constraints": joints, "effects": {"w": weight}, "simulation": run}


def tilted(y: Any) -> np.ndarray:
    """The state with its first body turned by TILT about x."""
    y = np.array(y, dtype=float)
    y[3:7] = math.sin(0.5 * TILT), 0.0, 0.0, math.cos(0.5 * TILT)
    return y


def beside_a_ball(size: float, method: str = "dopri853") -> dict[str, Any]:
    """One upright body, and a ball above a floor."""
    scene = with_ball(upright(size, 1, method))
    ball = {"shape": {"type": "sphere", "radius": 0.1 * size}, "position": [5 * size, 0, size]}
    scene["bodies"]["ball"] |= ball
    return scene


@pytest.mark.parametrize("size", SIZES)
def test_the_analysis_of_bags_measures_it_alike(size: float) -> None:
    scene = scene_from_mapping(upright(size, 2))
    laws = SceneLaws(scene)
    figures = ConstraintFigures(laws)
    y = tilted(compile_motion(scene, "maximal").y)
    figures.add(np.zeros(1), laws.at(np.zeros(1), y[None]))
    reported = figures.as_dict()
    assert reported is not None
    assert reported["relative"] == pytest.approx(math.sin(TILT), rel=1e-9)
    assert reported["position"]["axis0"]["largest"] == pytest.approx(math.sin(TILT), rel=1e-9)


def welded(size: float) -> dict[str, Any]:
    """Two bodies welded to each other that tumble about a point, beside a ball that bounces; with
    masses as cubes and times as roots of lengths the motion is the same at every size."""
    body = {
        "mass": size**3,
        "inertia": (np.array([0.1, 0.2, 0.25]) * size**5).tolist(),
        "orientation": {"axis": [1, 2, 3], "angle": 0.7},
    }
    scene = beside_a_ball(size)
    scene["bodies"] |= {"b0": body, "b1": body | {"position": [0.3 * size, size, 0.1 * size]}}
    scene["bodies"]["ball"]["mass"] = size**3
    torque = {"type": "wrench", "body": "b0", "force": [0, 0, 0], "torque": [0, size**4, size**4]}
    scene["constraints"] = {
        "foot": {"type": "fixed_point", "body": "b0"},
        "weld": {"type": "weld", "body": "b1", "parent": "b0"},
        "floor": scene["constraints"]["floor"],
    }
    scene["effects"] = {
        "weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]},
        "push": torque,
    }
    scene["simulation"] = {"duration": 0.5 * size**0.5, "rate": 40.0 / size**0.5}
    return scene


@pytest.mark.parametrize("size", [1e-6, 1e3])
def test_a_weld_beside_a_contact_moves_alike_at_every_size(size: float) -> None:
    """Rounding of an attitude, 1e-16 rad, was a violation of 1e-10 at a micrometre."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = Simulation(scene_from_mapping(welded(size))).run()
        metre = Simulation(scene_from_mapping(welded(1.0))).run()
    assert run.residual.max() < 1e-12
    for body in ("b1", "ball"):
        assert_allclose(run.position[body] / size, metre.position[body], atol=1e-9)
