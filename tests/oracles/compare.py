# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors of a run against the samples of a reference case, relative to the scale of each column."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rb_sim.simulation.trajectory import Trajectory

STATE = {
    "position": "position",
    "quaternion_xyzw": "orientation",
    "velocity_world": "linear_velocity",
    "omega_body": "angular_velocity",
}
NOTHING = 1e-12
"""A column whose scale is below this part of the natural one is zero but for rounding."""


def worst_vector(measured: np.ndarray, expected: np.ndarray) -> float:
    """Largest length of the difference over the samples."""
    return float(np.linalg.norm(np.asarray(measured) - np.asarray(expected), axis=1).max())


def worst_quaternion(measured: np.ndarray, expected: np.ndarray) -> float:
    """As `worst_vector`, with q and -q the same attitude."""
    expected = np.asarray(expected, dtype=float)
    sign = np.where(np.sum(measured * expected, axis=1) < 0.0, -1.0, 1.0)
    return worst_vector(sign[:, None] * measured, expected)


def natural_scales(case: dict[str, Any]) -> dict[str, float]:
    """Length, speed, force, ... of a case, for columns that vanish identically."""
    body, spec, scale = case["body"], case["constraint"], case["reference"]["scale"]
    shape = body.get("shape", {})
    gyration = (np.trace(body["inertia_com_body"]) / 2.0 / body["mass"]) ** 0.5
    arms = [spec.get("anchor_body"), spec.get("blade_point_body"), shape.get("semi_axes")]
    length = max([gyration, shape.get("radius", 0.0)] + [np.linalg.norm(a) for a in arms if a])
    weight = body["mass"] * np.linalg.norm(case["gravity"])
    force = max(weight, scale["reaction_force"])
    return {
        "position": length,
        "quaternion_xyzw": 1.0,
        "velocity_world": length * scale["omega_body"],
        "omega_body": scale["velocity_world"] / length,
        "reaction_force": force,
        "reaction_torque": force * length,
    }


def scales(case: dict[str, Any]) -> dict[str, float]:
    """What each column's error is relative to: its largest value, or the natural scale if zero."""
    given, natural = case["reference"]["scale"], natural_scales(case)
    return {
        name: given[name] if given[name] > NOTHING * natural[name] else natural[name] or 1.0
        for name in natural
    }


def errors(case: dict[str, Any], run: Trajectory, reaction: dict[str, Any]) -> dict[str, float]:
    """Worst error of each column of the case, relative to its scale."""
    samples, found = case["samples"], {}
    np.testing.assert_allclose(run.t, samples["t"], rtol=1e-14, atol=1e-15)
    for column, name in STATE.items():
        worst = worst_quaternion if column.startswith("quat") else worst_vector
        found[column] = worst(getattr(run, name)["body"], samples[column])
    for column, values in reaction.items():
        found[column] = worst_vector(values, samples[column])
    size = scales(case)
    return {column: error / size[column] for column, error in found.items()}


def reaction_of(case: dict[str, Any], run: Trajectory) -> dict[str, Any]:
    """Reaction force and torque as the case counts them, world axes."""
    if case["loads"] and case["loads"][0]["type"] == "spring_damper":
        return {"reaction_force": spring_force(case["loads"][0], run)}
    if not run.reaction:
        return {}
    parts = [value for name, value in run.reaction.items() if "/" not in name]
    return {
        "reaction_force": sum(part.force for part in parts),
        "reaction_torque": sum(part.torque for part in parts),
    }


def spring_force(load: dict[str, Any], run: Trajectory) -> np.ndarray:
    """F = -k d - c d' of a spring whose force the case lists as its reaction."""
    turn = Rotation.from_quat(run.orientation["body"])
    arm = np.tile(load["point_body"], (len(run), 1))
    spin = run.angular_velocity["body"]
    d = run.position["body"] + turn.apply(arm) - np.asarray(load["anchor_world"])
    rate = run.linear_velocity["body"] + turn.apply(np.cross(spin, arm))
    return -load["stiffness"] * d - load.get("damping", 0.0) * rate
