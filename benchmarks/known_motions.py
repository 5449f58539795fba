# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motions of random scenes that are known without integrating them, for benchmarks.silent_runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import brentq

from rb_sim import load_scene
from rb_sim.accuracy.closed_forms import exact_samples

Array = np.ndarray
Mapping = dict[str, Any]

G = 9.81
PARTS = 400
"""Of a period, in each of which a function that oscillates changes its sign once at most."""


def known_poses(kind: str, scene: Mapping, times: Array) -> Array | None:
    """Poses (n, bodies, 7) of the closed form: of a kind of benchmarks.hard_to_see, or of the
    program; None where there is none."""
    if kind in ALONG_X:
        (body,) = scene["bodies"].values()
        poses = np.zeros((len(times), 1, 7))
        poses[:, 0, :3], poses[:, 0, 6] = body["position"], 1.0
        poses[:, 0, 0] = ALONG_X[kind](scene, times)
        return poses
    found = exact_samples(load_scene(in_a_plane(scene)), times)
    if found is None:
        return None
    block = found[1]
    return np.concatenate([block.position, block.orientation], axis=2)


def in_a_plane(scene: Mapping) -> Mapping:
    """The scene with a hinge about y for a ball joint, if one body begins in that plane and stays
    there: its principal axes are those of the body."""
    bodies, joints = list(scene["bodies"].values()), scene.get("constraints") or {}
    ((name, joint),) = joints.items() if len(joints) == 1 else (("", {}),)
    spin = bodies[0].get("angular_velocity", [0.0, 0.0, 0.0])
    about_y = spin[0] == spin[2] == 0.0
    if kind_of(joint) != "fixed_point" or len(bodies) != 1 or not about_y:
        return scene
    if set(map(kind_of, scene["effects"].values())) != {"gravity"}:
        return scene
    point = joint.get("point_B", [0.0, 0.0, 0.0])
    turned = bodies[0].get("orientation", {"axis": [0, 1, 0]})
    if point[1] != 0.0 or turned["axis"] != [0, 1, 0] or len(bodies[0]["inertia"]) != 3:
        return scene
    return scene | {"constraints": {name: joint | {"type": "fixed_axis", "axis_B": [0, 1, 0]}}}


def kind_of(part: Mapping) -> str:
    return part.get("type", "")


def spring(scene: Mapping, times: Array) -> Array:
    """x of a body that starts at rest on a spring without length."""
    body, law = scene["bodies"]["p"], scene["effects"]["s"]
    return body["position"][0] * np.cos(math.sqrt(law["stiffness"] / body["mass"]) * times)


def stick_slip(scene: Mapping, times: Array) -> Array:
    """x of a block on a floor that is shaken as u = a sin(w t), held by a spring.

    It sticks until k x + m u'' is above static friction, and slips as an oscillation about a place
    that kinetic friction shifts, until the slip x' - u' is zero.
    """
    body, floor = scene["bodies"]["p"], scene["constraints"]["c"]
    mass, k = body["mass"], scene["effects"]["s"]["stiffness"]
    static, kinetic = (floor["friction"][name] * mass * G for name in ("static", "kinetic"))
    a, w = floor["motion"]["amplitude"], 2.0 * math.pi * floor["motion"]["frequency"]
    own, end, out = math.sqrt(k / mass), float(times[-1]), np.zeros(len(times))
    part = 2.0 * math.pi / max(own, w) / PARTS
    t: float = 0.0
    x: float = 0.0
    v: float = 0.0
    way: float = math.copysign(1.0, -a * w)
    sticks: bool = False
    at: Callable[[Any], tuple[Any, Any]]

    def pull_at(x: float, s: float) -> float:
        return k * x - mass * a * w * w * math.sin(w * s)

    while True:
        begun, x_0, v_0, middle = t, x, v, -way * kinetic / k

        def with_floor(s: Any, begun: float = begun, x_0: float = x_0) -> tuple[Any, Any]:
            return x_0 + a * (np.sin(w * s) - math.sin(w * begun)), a * w * np.cos(w * s)

        def sliding(
            s: Any, begun: float = begun, x_0: float = x_0, v_0: float = v_0, c: float = middle
        ) -> tuple[Any, Any]:
            cos, sin = np.cos(own * (s - begun)), np.sin(own * (s - begun))
            return c + (x_0 - c) * cos + v_0 / own * sin, v_0 * cos - own * (x_0 - c) * sin

        at = with_floor if sticks else sliding

        def left(s: float, at: Any = at, sticks: bool = sticks, way: float = way) -> float:
            if sticks:
                return static - abs(pull_at(at(s)[0], s))
            return way * (at(s)[1] - a * w * math.cos(w * s))

        t = first_zero(left, begun, end, part)
        here = (times >= begun) & (times <= t)
        out[here] = at(times[here])[0]
        if t >= end:
            return out
        x, v = (float(value) for value in at(t))
        sticks = not sticks and abs(pull_at(x, t)) <= static
        way = -math.copysign(1.0, pull_at(x, t))


def first_zero(f: Callable[[float], float], start: float, end: float, part: float) -> float:
    """Where f > 0 comes to zero after `start`; infinite if not before `end`."""
    before = start + 1e-6 * part
    while before < end:
        after = before + part
        if f(after) <= 0.0:
            found: Any = brentq(f, before, after, xtol=1e-15) if f(before) > 0.0 else before
            return float(found)
        before = after
    return math.inf


ALONG_X: dict[str, Callable[[Mapping, Array], Array]] = {
    "spring": spring,
    "stick_slip": stick_slip,
}
"""Closed forms of a body that moves along x, by the kind of scene."""
