# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Statics scenes as mappings, for the tests."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

UP = [0.0, 0.0, 1.0]


def table(legs, load, at, friction: Any = "smooth") -> dict[str, Any]:
    """A weightless plate on feet at `legs`, the force `load` [N] at `at`."""
    contact = {"type": "contact", "body": "table", "normal_A": UP, "friction": friction}
    return {
        "bodies": {"table": {}},
        "supports": {f"N{i + 1}": contact | {"point_B": list(leg)} for i, leg in enumerate(legs)},
        "loads": {
            "load": {"type": "wrench", "body": "table", "force": list(load), "point_B": list(at)}
        },
    }


def ladder(alpha, floor: Any, wall: Any, weight=150.0, length=4.0) -> dict[str, Any]:
    """A ladder at `alpha` to the floor; origin at the foot, z up the ladder."""
    middle = [0.0, 0.0, 0.5 * length]
    foot = {"type": "contact", "body": "ladder", "point_B": [0.0, 0.0, 0.0], "normal_A": UP}
    top = {"type": "contact", "body": "ladder", "point_B": [0.0, 0.0, length]}
    return {
        "bodies": {
            "ladder": {
                "center_of_mass": middle,
                "orientation": {"axis": [0.0, 1.0, 0.0], "angle": 0.5 * math.pi - alpha},
            }
        },
        "supports": {
            "floor": foot | {"friction": floor},
            "wall": top | {"normal_A": [-1.0, 0.0, 0.0], "friction": wall},
        },
        "loads": {
            "weight": {
                "type": "wrench",
                "body": "ladder",
                "force": [0.0, 0.0, -weight],
                "point_B": middle,
            }
        },
    }


def block(slope, friction: Any, weight=10.0) -> dict[str, Any]:
    """A particle on an incline that rises along x."""
    normal = [-math.sin(slope), 0.0, math.cos(slope)]
    contact = {"type": "contact", "body": "block", "point_B": [0.0, 0.0, 0.0]}
    return {
        "bodies": {"block": {}},
        "supports": {"slope": contact | {"normal_A": normal, "friction": friction}},
        "loads": {"weight": {"type": "wrench", "body": "block", "force": [0.0, 0.0, -weight]}},
    }


def moved(scene: dict[str, Any], turn: Rotation, shift: np.ndarray) -> dict[str, Any]:
    """The scene with the whole world turned and shifted: each point p becomes turn p + shift."""

    def point(p):
        return (turn.apply(p) + shift).tolist()

    def direction(d):
        return turn.apply(d).tolist()

    bodies = {}
    for name, body in scene["bodies"].items():
        orientation = body.get("orientation", [0.0, 0.0, 0.0, 1.0])
        if isinstance(orientation, dict):
            axis = np.array(orientation["axis"]) / np.linalg.norm(orientation["axis"])
            own = Rotation.from_rotvec(orientation["angle"] * axis)
        else:
            own = Rotation.from_quat(orientation)
        bodies[name] = body | {
            "position": point(body.get("position", [0.0, 0.0, 0.0])),
            "orientation": (turn * own).as_quat().tolist(),
        }
    supports = {}
    for name, support in scene["supports"].items():
        new = dict(support)
        if "parent" not in support:
            for key, change in (("point_A", point), ("normal_A", direction), ("axis_A", direction)):
                if key in support:
                    new[key] = change(support[key])
        supports[name] = new
    loads = {}
    for name, load in scene["loads"].items():
        new = dict(load)
        if load.get("frame", "world") == "world":
            for key in ("force", "torque", "acceleration"):
                if key in load:
                    new[key] = direction(load[key])
        loads[name] = new
    return {"bodies": bodies, "supports": supports, "loads": loads}


def scaled(scene: dict[str, Any], factor: float) -> dict[str, Any]:
    """The scene with all loads multiplied."""
    loads = {}
    for name, load in scene["loads"].items():
        grown = {
            key: [factor * v for v in load[key]]
            for key in ("force", "torque", "acceleration")
            if key in load
        }
        loads[name] = load | grown
    return scene | {"loads": loads}
