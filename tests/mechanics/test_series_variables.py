# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Other variables for the Taylor series: the motion in them is that in the coordinates.

Both laws are integrated by SciPy over a time in which everything turns; whom the variables suit is
told by whom they may not be taken for.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import TypeAdapter
from scipy.integrate import solve_ivp

from rb_sim import load_scene
from rb_sim.catalogue.spec import UnitVector3
from rb_sim.mechanics.taylor_variables import AS_PENDULUM, IN_ANGLES, IN_WORLD_AXES, variables_of
from rb_sim.scene.compile import compile_scene
from tests.interpreted import interpreted
from tests.moving import floats

Mapping = dict[str, Any]
NORMAL = TypeAdapter(UnitVector3).validate_python([0.1, 0.2, 0.97])
DOWN = [-8.0 * x for x in NORMAL]
"""[m/s^2], along the normal to the last bit."""
TURN = {"axis": [0.3, -0.5, 0.8], "angle": 0.9}
WEIGHT = {"type": "gravity", "acceleration": DOWN}
SLANTED = {"type": "gravity", "acceleration": [0.4, -0.2, -9.7]}


def body(**own: Any) -> Mapping:
    moving = {"angular_velocity": [1.5, -2.0, 3.0], "linear_velocity": [0.4, -0.3, 0.2]}
    return {"mass": 1.7, "orientation": TURN} | moving | own


def scene(joint: Mapping, effects: list[Mapping], **own: Any) -> Mapping:
    return {
        "bodies": {"b": body(**own)},
        "constraints": {"joint": {"body": "b"} | joint},
        "effects": {f"e{i}": effect for i, effect in enumerate(effects)},
        "simulation": {"project_initial": True},
    }


ROLLING = {"type": "rolling", "normal_A": NORMAL, "point_A": [0.3, 0.1, -0.2]}
AXIS = {"type": "fixed_axis", "axis_B": [0.2, 0.3, 0.9], "point_B": [0.1, 0.02, -0.3]}
UNEVEN = [[0.031, 0.002, -0.003], [0.002, 0.04, 0.001], [-0.003, 0.001, 0.026]]
BALL = {"type": "sphere", "radius": 0.2}
RIM: Mapping = {"type": "disk", "radius": 0.2}
ROUND = [0.03, 0.03, 0.03]
ALONG_Z = [0.02, 0.02, 0.035]
K = np.array([2.0, 3.0, 6.0]) / 7.0
ALONG_K = (0.02 * np.eye(3) + 0.015 * np.outer(K, K)).tolist()
PUSH = {"type": "wrench", "body": "b", "force": [0.4, -0.3, 0.2], "torque": [0.01, -0.02, 0.03]}
OFF = {"center_of_mass": [0.04, -0.03, 0.05]}

SUITED: dict[str, tuple[Any, Mapping]] = {
    "pendulum": (AS_PENDULUM, scene(AXIS, [SLANTED], inertia=UNEVEN, **OFF)),
    "two weights": (AS_PENDULUM, scene(AXIS, [SLANTED, WEIGHT], inertia=UNEVEN, **OFF)),
    "disk": (IN_ANGLES, scene(ROLLING, [WEIGHT], inertia=ALONG_Z, shape=RIM)),
    "disk, slanted axis": (
        IN_ANGLES,
        scene(ROLLING, [WEIGHT], inertia=ALONG_K, shape=RIM | {"axis_B": K.tolist()}),
    ),
    "disk without weight": (IN_ANGLES, scene(ROLLING, [], inertia=ALONG_Z, shape=RIM)),
    "sphere": (IN_WORLD_AXES, scene(ROLLING, [SLANTED, PUSH], inertia=ROUND, shape=BALL)),
}


def moved(mapping: Mapping, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates after a time: by dy/dt, and by dz/dt and the change that it makes of y."""
    from rb_sim.mechanics.system import rate

    compiled = compile_scene(load_scene(mapping))
    system = compiled.system
    known = variables_of(system)
    assert known is not None

    def after(law: Any, at: Any) -> np.ndarray:
        tight: dict[str, Any] = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
        return solve_ivp(lambda t, at: law(floats(at)), (0.0, time), at, **tight).y[:, -1]

    def slope(at: tuple[float, ...]) -> tuple[float, ...]:
        return rate(system, 0.0, at)

    y = floats(after(slope, compiled.y))  # nothing begins in the pose in which the scene does
    z = floats(known.begin(system, y))
    assert len(z) == known.count
    dz = floats(after(lambda at: known.rates(system, at), z) - np.array(z))
    return after(slope, y), np.array(y) + np.array(known.change(system, y, z, dz))


@pytest.mark.parametrize("name", SUITED)
def test_the_motion_is_the_same(name: str) -> None:
    by_y, by_z = interpreted(moved, SUITED[name][1], 0.4)
    assert_allclose(by_z, by_y, rtol=0.0, atol=1e-10)


def known_of(mapping: Mapping) -> Any:
    return variables_of(compile_scene(load_scene(mapping)).system)


@pytest.mark.parametrize("name", SUITED)
def test_whom_they_suit(name: str) -> None:
    known, mapping = SUITED[name]
    assert known_of(mapping) is known


@pytest.mark.parametrize("size", [1e-8, 1.0, 1e8])
def test_moments_are_equal_but_for_rounding_in_any_units(size: float) -> None:
    """Of a disk: to the last digit of the largest, whatever that is."""
    for uneven, known in ((0.0, IN_ANGLES), (1e-14, None)):
        inertia = (size * np.diag([0.02, 0.02 * (1.0 + uneven), 0.035])).tolist()
        assert known_of(scene(ROLLING, [WEIGHT], inertia=inertia, shape=RIM)) is known


UNSUITED = {
    "pendulum that is pushed": scene(AXIS, [SLANTED, PUSH], inertia=UNEVEN),
    "disk under a slanted weight": scene(ROLLING, [SLANTED], inertia=ALONG_Z, shape=RIM),
    "disk that is pushed": scene(ROLLING, [WEIGHT, PUSH], inertia=ALONG_Z, shape=RIM),
    "disk off its centre": scene(ROLLING, [WEIGHT], inertia=ALONG_Z, shape=RIM, **OFF),
    "uneven disk": scene(ROLLING, [WEIGHT], inertia=[0.02, 0.021, 0.035], shape=RIM),
    "disk with a product of inertia": scene(
        ROLLING,
        [WEIGHT],
        inertia=[[0.02, 0.001, 0.0], [0.001, 0.02, 0.0], [0.0, 0.0, 0.035]],
        shape=RIM,
    ),
    "disk whose axis is another": scene(
        ROLLING, [WEIGHT], inertia=ALONG_Z, shape=RIM | {"axis_B": [1.0, 0.0, 0.0]}
    ),
    "uneven ball": scene(ROLLING, [SLANTED], inertia=[0.03, 0.03, 0.031], shape=BALL),
    "ball uneven about y": scene(ROLLING, [SLANTED], inertia=[0.03, 0.031, 0.03], shape=BALL),
    "ball with a product of inertia": scene(
        ROLLING,
        [SLANTED],
        inertia=[[0.03, 0.0, 0.0], [0.0, 0.03, 0.001], [0.0, 0.001, 0.03]],
        shape=BALL,
    ),
    "ball with another product": scene(
        ROLLING,
        [SLANTED],
        inertia=[[0.03, 0.001, 0.0], [0.001, 0.03, 0.0], [0.0, 0.0, 0.03]],
        shape=BALL,
    ),
    "ball off its centre": scene(ROLLING, [SLANTED], inertia=ROUND, shape=BALL, **OFF),
    "ball pushed off its centre": scene(
        ROLLING, [PUSH | {"point_B": [0.0, 0.0, 0.1]}], inertia=ROUND, shape=BALL
    ),
    "ball pushed along its own axes": scene(
        ROLLING, [PUSH | {"frame": "body"}], inertia=ROUND, shape=BALL
    ),
    "free body": scene({"type": "free"}, [], inertia=ROUND),
    "ellipsoid": scene(
        ROLLING, [], inertia=ROUND, shape={"type": "ellipsoid", "semi_axes": [0.2, 0.2, 0.2]}
    ),
}


@pytest.mark.parametrize("name", UNSUITED)
def test_whom_they_do_not_suit(name: str) -> None:
    assert known_of(UNSUITED[name]) is None
