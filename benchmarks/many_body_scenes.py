# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scenes of many bodies, springs and joints, as mappings."""

from __future__ import annotations

import math
from typing import Any

RUN = {"duration": 0.2, "rate": 20.0, "method": "rk4", "step": 1e-3}


def _jointed(bodies: dict[str, Any], joints: dict[str, Any], run: dict[str, Any]) -> dict[str, Any]:
    """The scene of bodies on joints under a gravity that no joint's axis is in line with."""
    gravity = {"type": "gravity", "acceleration": [0, 1.0, -9.81]}
    return {
        "bodies": bodies,
        "constraints": joints,
        "effects": {"g": gravity},
        "simulation": RUN | run,
    }


def chain(links: int, **run: Any) -> dict[str, Any]:
    """Rods of 1 m on spherical joints, stretched out from the origin along x."""
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    for i in range(links):
        bodies[f"b{i}"] = {
            "mass": 1.0,
            "inertia": [0.01, 0.09, 0.08],
            "position": [0.5 + i, 0, 0],
        }
        joint = {"type": "fixed_point", "body": f"b{i}", "point_B": [-0.5, 0, 0]}
        if i:
            joint |= {"parent": f"b{i - 1}", "point_A": [0.5, 0, 0]}
        joints[f"j{i}"] = joint
    return _jointed(bodies, joints, run)


def on_springs(springs: int, **run: Any) -> dict[str, Any]:
    """One body on so many springs to fixed points around it."""
    effects = {
        f"s{i}": {
            "type": "spring",
            "body": "b",
            "point_B": [0.1 * math.cos(i), 0.1 * math.sin(i), 0.05],
            "point_A": [math.cos(i), math.sin(i), 1.0],
            "stiffness": 10.0,
            "rest_length": 0.3,
        }
        for i in range(springs)
    }
    body = {"mass": 1.0, "inertia": [0.01, 0.02, 0.03], "angular_velocity": [0.3, 0.1, 2.0]}
    return {"bodies": {"b": body}, "effects": effects, "simulation": RUN | run}


def lattice(side: int, **run: Any) -> dict[str, Any]:
    """side x side bodies, neighbours on springs."""
    bodies: dict[str, Any] = {}
    effects: dict[str, Any] = {}
    spring = {"type": "spring", "stiffness": 100.0, "rest_length": 0.9}
    for i in range(side):
        for j in range(side):
            own = f"b{i}_{j}"
            bodies[own] = {"mass": 1.0, "inertia": [0.01] * 3, "position": [float(i), float(j), 0]}
            if i:
                effects[f"x{i}_{j}"] = spring | {"body": own, "parent": f"b{i - 1}_{j}"}
            if j:
                effects[f"y{i}_{j}"] = spring | {"body": own, "parent": f"b{i}_{j - 1}"}
    return {"bodies": bodies, "effects": effects, "simulation": RUN | run}


def star(arms: int, **run: Any) -> dict[str, Any]:
    """Rods of 1 m on spherical joints around a free hub."""
    bodies: dict[str, Any] = {"hub": {"mass": 5.0, "inertia": [0.5, 0.6, 0.7]}}
    joints: dict[str, Any] = {}
    for i in range(arms):
        angle = 2.0 * math.pi * i / arms
        c, s = math.cos(angle), math.sin(angle)
        bodies[f"a{i}"] = {
            "mass": 1.0,
            "inertia": [0.01, 0.09, 0.08],
            "position": [1.5 * c, 1.5 * s, 0.0],
            "orientation": [0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2)],
        }
        ends = {"point_B": [-0.5, 0, 0], "point_A": [c, s, 0]}
        joints[f"j{i}"] = {"type": "fixed_point", "body": f"a{i}", "parent": "hub", **ends}
    return _jointed(bodies, joints, run)


def rods(side: int, **run: Any) -> dict[str, Any]:
    """side x side bodies, neighbours joined by massless rods."""
    bodies: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    rod = {"type": "distance", "point_B": [0.05, 0, 0], "point_A": [0, 0.05, 0.01]}
    for i in range(side):
        for j in range(side):
            own = f"b{i}_{j}"
            place = [float(i), float(j), 0.1 * ((7 * i + 3 * j) % 5)]
            bodies[own] = {"mass": 1.0, "inertia": [0.01, 0.02, 0.03], "position": place}
            if i:
                joints[f"x{i}_{j}"] = rod | {"body": own, "parent": f"b{i - 1}_{j}"}
            if j:
                joints[f"y{i}_{j}"] = rod | {"body": own, "parent": f"b{i}_{j - 1}"}
    return _jointed(bodies, joints, run)
