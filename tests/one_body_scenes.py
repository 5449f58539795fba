# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One short scene per joint of one body and per effect, shared by the tests of laws."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Mapping = dict[str, Any]

TURN = {"axis": [0.3, -0.5, 0.8], "angle": 0.9}
Q = Rotation.from_rotvec(0.9 * np.array([0.3, -0.5, 0.8]) / math.sqrt(0.98))
WEIGHT = {"type": "gravity", "acceleration": [0.3, -0.4, -9.7]}
LOAD = {
    "type": "wrench",
    "body": "body",
    "force": [1.0, -2.0, 1.5],
    "torque": [0.1, 0.2, -0.15],
    "point_B": [0.05, -0.02, 0.08],
}
INERTIA = [[0.031, 0.002, -0.003], [0.002, 0.04, 0.001], [-0.003, 0.001, 0.026]]


def body(**own: Any) -> Mapping:
    """An uneven body whose origin is not its centre of mass."""
    return {
        "mass": 1.7,
        "inertia": INERTIA,
        "center_of_mass": [0.04, -0.03, 0.05],
        "position": [0.0, 0.0, 0.0],
        "orientation": TURN,
        "linear_velocity": [0.4, -0.3, 0.2],
        "angular_velocity": [1.5, -2.0, 3.0],
    } | own


def scene(joint: Mapping | None, effects: Mapping | None = None, **own: Any) -> Mapping:
    """A scene of that body; its start is moved onto the joint."""
    return {
        "bodies": {"body": body(**own)},
        "constraints": {"joint": {"body": "body"} | joint} if joint else {},
        "effects": {"weight": WEIGHT, "load": LOAD} if effects is None else effects,
        "simulation": {"duration": 0.4, "rate": 50.0, "tolerance": 1e-13, "project_initial": True},
    }


def axis(floating: str) -> Mapping:
    kind = {"type": "fixed_axis", "axis_B": [0.2, 0.3, 0.9], "point_B": [0.1, 0.02, -0.3]}
    return kind | {"bearing_distance": 0.6, "floating": floating}


def rolling(shape: Mapping) -> Mapping:
    plane = {"type": "rolling", "normal_A": [0.1, 0.2, 0.97], "point_A": [0.3, 0.1, -0.2]}
    return scene(plane, shape=shape)


def ring(n: int = 120) -> list[list[float]]:
    s = np.linspace(0.0, 2.0 * math.pi, n, endpoint=False)
    return np.stack([np.cos(s), np.sin(s), 0.3 * np.sin(2.0 * s)], axis=-1).tolist()


CENTER = {"center_B": [0.02, 0.01, 0.03]}
JOINTS: dict[str, Mapping] = {
    "free": scene(None),
    "fixed_point": scene({"type": "fixed_point", "point_B": [0.1, -0.2, 0.3]}),
    "fixed_axis, A floats": scene(axis("A")),
    "fixed_axis, B floats": scene(axis("B")),
    "fixed_axis, none floats": scene(axis("none")),
    "translation": scene({"type": "translation", "point_B": [0.1, 0.0, -0.1]}),
    "translation along a line": scene(
        {"type": "translation", "guide": {"type": "line", "direction": [1.0, 2.0, -0.5]}}
    ),
    "translation along a circle": scene(
        {
            "type": "translation",
            "point_B": [0.1, 0.0, -0.1],
            "guide": {
                "type": "circle",
                "center": [0.1, 0.2, 0.3],
                "normal": [0.2, 1.0, 0.1],
                "radius": 0.8,
            },
        },
        position=[0.9, 0.2, 0.4],
    ),
    "translation along a curve": scene(
        {"type": "translation", "guide": {"type": "curve", "points": ring(), "closed": True}},
        position=[0.9, 0.2, 0.1],
    ),
    "rolling sphere": rolling({"type": "sphere", "radius": 0.2} | CENTER),
    "rolling disk": rolling({"type": "disk", "radius": 0.2} | CENTER),
    "rolling ellipsoid": rolling({"type": "ellipsoid", "semi_axes": [0.2, 0.15, 0.1]} | CENTER),
    "rolling cylinder": rolling(
        {"type": "cylinder", "radius": 0.2, "length": 0.4, "axis_B": [0.2, 1.0, 0.1]} | CENTER
    ),
}

ON_BODY = {"body": "body"}
TABLE = {
    "times": [0.05, 0.15, 0.3],
    "forces": [[1.0, 0.0, 2.0], [0.0, -3.0, 1.0], [2.0, 1.0, 0.0]],
    "torques": [[0.1, 0.0, 0.0], [0.0, 0.2, -0.1], [0.3, 0.0, 0.1]],
}
SINE = {"sine_force": [1.0, 2.0, -1.0], "sine_torque": [0.1, 0.2, 0.3], "angular_frequency": 9.0}
STRING = {"type": "spring", "point_B": [0.1, 0.05, -0.1], "point_A": [0.4, -0.3, 0.6]} | ON_BODY
EFFECTS: dict[str, Mapping] = {
    "gravity": WEIGHT,
    "linear_drag": ON_BODY
    | {"type": "linear_drag", "coefficient": 0.7, "medium_velocity": [0.2, 0.1, 0.0]},
    "quadratic_drag": ON_BODY | {"type": "quadratic_drag", "coefficient": 0.7},
    "angular_damping": ON_BODY | {"type": "angular_damping", "coefficient": 0.02},
    "spring": STRING | {"stiffness": 40.0, "damping": 0.6, "rest_length": 0.3},
    "bushing": STRING | {"stiffness": 40.0, "damping": 0.6},
    "torsion_spring": ON_BODY
    | {"type": "torsion_spring", "axis_B": [1.0, 2.0, 0.5], "stiffness": 0.8, "damping": 0.05}
    | {"rest_angle": 0.2},
    "wrench": LOAD,
    "wrench in body axes": LOAD | {"frame": "body"},
    "harmonic wrench": ON_BODY | {"type": "wrench", "phase": 0.4} | SINE,
    "harmonic wrench in body axes": ON_BODY | {"type": "wrench", "frame": "body"} | SINE,
    "wrench_table": ON_BODY | {"type": "wrench_table"} | TABLE,
    "wrench_table held": ON_BODY
    | {"type": "wrench_table", "interpolation": "hold", "frame": "body"}
    | TABLE,
}

DIRECTIONS = ("linear_velocity", "acceleration", "medium_velocity", "direction", "normal")
IN_WORLD_ONLY = ("force", "torque", "sine_force", "sine_torque", "linear", "angular")
POINTS = ("position", "center", "point")
ON_PARENT = {"point_A": True, "normal_A": False, "axis_A": False}
"""Which of the fields on the parent are points."""


def moved(part: Any, turn: Rotation, shift: np.ndarray) -> Any:
    """The scene with the world turned, then shifted; what is fixed in bodies stays as it is."""
    if isinstance(part, list):
        return [moved(entry, turn, shift) for entry in part]
    if not isinstance(part, dict):
        return part
    out = {}
    for key, value in part.items():
        world = part.get("frame", "world") == "world"
        vector = isinstance(value, list) and len(value) == 3 and not isinstance(value[0], list)
        on_world = key in ON_PARENT and "parent" not in part
        if vector and (key in POINTS or (on_world and ON_PARENT[key])):
            out[key] = (turn.apply(value) + shift).tolist()
        elif vector and (key in DIRECTIONS or on_world or (key in IN_WORLD_ONLY and world)):
            out[key] = turn.apply(value).tolist()
        elif key == "points" or (key in ("forces", "torques") and world):
            offset = shift if key == "points" else 0.0
            out[key] = (turn.apply(value) + offset).tolist()
        elif key == "orientation":
            out[key] = (turn * Q).as_quat().tolist()
        else:
            out[key] = moved(value, turn, shift)
    return out
