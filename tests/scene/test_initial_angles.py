# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a start or a run violates of an angle or a spin means the same whatever a scene's size."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.base.errors import SceneError
from rb_sim.mechanics.tables.table_laws import BODIES, TableLaws
from rb_sim.scene.load import scene_from_mapping

SIZES = (1e-6, 1e-3, 1.0, 1e3, 1e5)


def body(size: float) -> dict[str, Any]:
    squares = np.array([0.1, 0.2, 0.25]) * size**2
    return {"mass": 1.0, "inertia": squares.tolist(), "center_of_mass": [0.3 * size, 0, 0]}


def upright(size: float, tilt: float = 0.0, spin: float = 0.0) -> dict[str, Any]:
    """A body on a plane whose axis, off by `tilt` [rad], is to stay parallel to z; it falls over
    its size in half a second."""
    start = {"orientation": {"axis": [1, 0, 0], "angle": tilt}, "angular_velocity": [spin, 0, 0]}
    return {
        "bodies": {"b": body(size) | start},
        "constraints": {
            "upright": {"type": "parallel", "body": "b", "axis_B": [0, 0, 1], "axis_A": [0, 0, 1]},
            "table": {"type": "plane", "body": "b", "point_B": [size, 0, 0], "normal_A": [0, 0, 1]},
        },
        "effects": {"weight": {"type": "gravity", "acceleration": [size, 0, -size]}},
        "simulation": {"duration": 0.1, "rate": 10.0, "method": "rk4", "step": 0.01},
    }


@pytest.mark.parametrize("size", SIZES)
def test_a_tilt_is_refused_by_its_angle(size: float) -> None:
    """At a kilometre 1e-3 rad were taken for rounding without a word, and the body turned."""
    with pytest.raises(SceneError, match=r"upright: the initial position violates it by 1e-05 rad"):
        Simulation(scene_from_mapping(upright(size, tilt=1e-5)))
    Simulation(scene_from_mapping(upright(size, tilt=1e-7)))


@pytest.mark.parametrize("size", SIZES)
def test_a_spin_is_refused_by_its_speed_at_the_scene_s_size(size: float) -> None:
    fall = math.sqrt(9.81 * size)
    with pytest.raises(SceneError, match="upright: the initial velocity violates it by"):
        Simulation(scene_from_mapping(upright(size, spin=1e-5 * fall / size)))
    Simulation(scene_from_mapping(upright(size, spin=1e-8 * fall / size)))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("count", [2, BODIES])
def test_a_run_is_on_its_constraints_at_every_size(size: float, count: int) -> None:
    """Rounding of an attitude was told as a violation at a micrometre: 1e-16 rad over 1e-6 m."""
    names = [f"b{k}" for k in range(count)]
    welds: dict[str, Any] = {}
    for name, parent in zip(names[1:], names[:-1], strict=True):
        welds[name] = {"type": "weld", "body": name, "parent": parent}
    spin = {"orientation": {"axis": [1, 2, 3], "angle": 0.7}}
    bodies = {n: body(size) | spin | {"position": [0, k * size, 0]} for k, n in enumerate(names)}
    push = {"type": "wrench", "body": "b0", "force": [size, 0, 0], "torque": [0, size**2, size**2]}
    scene = upright(size) | {
        "bodies": bodies,
        "constraints": {"foot": {"type": "fixed_point", "body": "b0"}} | welds,
    }
    scene["effects"] = scene["effects"] | {"push": push}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation = Simulation(scene_from_mapping(scene))
        assert isinstance(simulation.compiled.laws, TableLaws) == (count == BODIES)
        assert simulation.run().residual.max() < 1e-12
