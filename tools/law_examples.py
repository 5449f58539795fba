# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A whole scene for each law, as short as it can be."""

from __future__ import annotations

_BODY = "bodies: {b: {mass: 1.0, inertia: [1, 1, 1]}}\n"
_BALL = "bodies: {b: {mass: 1.0, shape: {type: sphere, radius: 0.1}, position: [0, 0, 0.1]}}\n"

EXAMPLES = {
    "free": _BODY + "constraints: {loose: {type: free, body: b}}",
    "fixed_point": _BODY + "constraints: {pin: {type: fixed_point, body: b, point_B: [0, 0, 1]}}",
    "fixed_axis": "bodies: {b: {mass: 1.0, inertia: [1, 1, 1], center_of_mass: [1, 0, 0]}}\n"
    + "constraints: {hinge: {type: fixed_axis, body: b, axis_B: [0, 1, 0], bearing_distance: 0.5}}",
    "translation": _BODY
    + "constraints:\n  rail:\n    type: translation\n    body: b\n"
    + "    guide: {type: line, point: [0, 0, 0], direction: [1, 0, 0]}",
    "rolling": _BALL + "constraints: {floor: {type: rolling, body: b}}",
    "distance": _BODY + "constraints: {rod: {type: distance, body: b, point_A: [0, 0, 1]}}",
    "plane": _BODY + "constraints: {table: {type: plane, body: b, normal_A: [0, 0, 1]}}",
    "parallel": _BODY + "constraints: {upright: {type: parallel, body: b, axis_B: [0, 0, 1]}}",
    "weld": _BODY + "constraints: {bolt: {type: weld, body: b}}",
    "velocity": _BODY
    + "constraints: {edge: {type: velocity, body: b, linear: [0, 1, 0], frame: body}}",
    "contact": _BALL
    + "constraints:\n  floor:\n    type: contact\n    body: b\n"
    + "    friction: {type: coulomb, static: 0.4, kinetic: 0.3}\n    restitution: 0.5",
    "string": _BALL
    + "constraints: {rope: {type: string, body: b, point_A: [0.3, 0, 0.5], length: 0.6}}",
    "gravity": _BODY + "effects: {weight: {type: gravity}}",
    "linear_drag": _BODY + "effects: {air: {type: linear_drag, body: b, coefficient: 0.1}}",
    "quadratic_drag": _BODY + "effects: {air: {type: quadratic_drag, body: b, coefficient: 0.1}}",
    "angular_damping": _BODY + "effects: {oil: {type: angular_damping, body: b, coefficient: 0.1}}",
    "spring": _BODY + "effects:\n  tie: {type: spring, body: b, point_A: [0, 0, 1], stiffness: 50}",
    "torsion_spring": _BODY
    + "effects: {coil: {type: torsion_spring, body: b, axis_B: [0, 0, 1], stiffness: 2.0}}",
    "wrench": _BODY + "effects: {push: {type: wrench, body: b, force: [1, 0, 0]}}",
    "wrench_table": _BODY
    + "effects:\n  push:\n    type: wrench_table\n    body: b\n"
    + "    times: [0, 1, 2]\n    forces: [[0, 0, 0], [1, 0, 0], [0, 0, 0]]",
    "commanded_wrench": _BODY + "effects: {drive: {type: commanded_wrench, body: b}}",
}

TORQUE_ONLY = ("parallel", "angular_damping", "torsion_spring")
"""Laws that exert no force."""
