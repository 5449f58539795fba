# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A reference case -> a scene mapping in the form of our YAML.

`origin` shifts the body origin O away from the centre of mass C, so that both ways of saying where
a body is are tested on the same motion.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Case = dict[str, Any]
Mapping = dict[str, Any]


def body_of(body: Case, initial: Case, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> Mapping:
    """The body with its origin at `origin` from C (body axes) and the initial state of C."""
    r_CO = np.asarray(origin, dtype=float)
    q = initial.get("quaternion_xyzw", [0.0, 0.0, 0.0, 1.0])
    w = np.asarray(initial.get("omega_body", [0.0, 0.0, 0.0]), dtype=float)
    turn = Rotation.from_quat(q)
    mapping = {
        "mass": body["mass"],
        "inertia": body.get("inertia_com_body", [1.0, 1.0, 1.0]),
        "center_of_mass": (-r_CO).tolist(),
        "position": (np.asarray(initial["position"]) + turn.apply(r_CO)).tolist(),
        "orientation": list(q),
        "linear_velocity": (
            np.asarray(initial["velocity_world"]) + turn.apply(np.cross(w, r_CO))
        ).tolist(),
        "angular_velocity": w.tolist(),
    }
    if "kind" in body.get("shape", {}):
        mapping["shape"] = shape_of(body["shape"], r_CO)
    return mapping


def shape_of(shape: Case, r_CO: np.ndarray) -> Mapping:
    """The shape, its centre taken from the body origin."""
    centre = np.asarray(shape.get("centre_from_com_body", [0.0, 0.0, 0.0])) - r_CO
    mapping = {"type": shape["kind"], "center_B": centre.tolist()}
    if shape["kind"] == "ellipsoid":
        return mapping | {"semi_axes": shape["semi_axes"]}
    mapping["radius"] = shape["radius"]
    if shape["kind"] != "sphere":
        mapping["axis_B"] = shape["axis_body"]
    if shape["kind"] == "cylinder":
        mapping["length"] = 1.0
    return mapping


def constraints_of(case: Case, r_CO: np.ndarray) -> Mapping:
    """The constraints of a case of one body, by name."""
    spec, kind = case["constraint"], case["constraint"]["type"]
    if kind == "free":
        return {}
    if kind == "fixed_point":
        return {"joint": {"type": kind, "body": "body"} | anchors(spec, r_CO)}
    if kind == "fixed_axis":
        distance = re.search(r"anchor \+ ([\d.]+)\*axis_world", spec["bearing_B"])
        assert distance and "floating" in spec["bearing_B"]
        axes = {"axis_B": spec["axis_body"], "axis_A": spec["axis_world"]}
        extra = {"bearing_distance": float(distance[1]), "floating": "B"}
        return {"joint": {"type": kind, "body": "body"} | anchors(spec, r_CO) | axes | extra}
    if kind == "translation_along_curve":
        guide = guide_of(spec["curve"], case)
        own = {"type": "translation", "body": "body", "point_B": (-r_CO).tolist()}
        return {"joint": own | {"guide": guide}}
    if kind in ("rolling_contact", "rolling_line_contact"):
        plane = {"normal_A": spec["normal"], "point_A": spec["point"]}
        return {"joint": {"type": "rolling", "body": "body"} | plane}
    if kind == "knife_edge":
        return knife_edge(spec, case["initial"]["quaternion_xyzw"], r_CO)
    raise ValueError(f"no scene for {kind}")


def anchors(spec: Case, r_CO: np.ndarray) -> Mapping:
    point = (np.asarray(spec["anchor_body"]) - r_CO).tolist()
    return {"point_B": point, "point_A": spec["anchor_world"]}


def knife_edge(spec: Case, q: Sequence[float], r_CO: np.ndarray) -> Mapping:
    """Plane, axis kept normal to it, and no velocity across the blade."""
    point = (np.asarray(spec["blade_point_body"]) - r_CO).tolist()
    normal_B = Rotation.from_quat(q).inv().apply(spec["plane_normal"])
    across = np.cross(normal_B, spec["blade_direction_body"])
    own = {"body": "body", "point_B": point}
    axes = {"axis_B": normal_B.tolist(), "axis_A": spec["plane_normal"]}
    return {
        "plane": {"type": "plane", "normal_A": spec["plane_normal"]} | own,
        "tilt": {"type": "parallel", "body": "body"} | axes,
        "blade": {"type": "velocity", "linear": across.tolist(), "frame": "body"} | own,
    }


# Range of the curve's own parameter and number of points.  The spline's second derivative, and
# with it the reaction, is in error by the sixth power of the spacing; the motion stays well within
# the range, so that the ends of the spline have no part in it.
GUIDE_POINTS: dict[str, tuple[float, float, int]] = {
    "helix": (-46.0, 2.0, 601),
    "cycloid": (-2.7, 2.7, 401),
    "parabola": (-1.2, 1.2, 301),
}


def curve_law(curve: Case) -> Callable[[np.ndarray], np.ndarray]:
    """Points of the curve for an array of its own parameter."""
    if curve["kind"] == "helix":
        r, p = curve["radius"], curve["rise_per_radian"]
        return lambda s: np.stack([r * np.cos(s), r * np.sin(s), p * s], axis=-1)
    if curve["kind"] == "cycloid":
        b = curve["generating_radius"]
        return lambda s: np.stack([b * (s + np.sin(s)), 0 * s, b * (1 - np.cos(s))], axis=-1)
    p = curve["p"]
    return lambda s: np.stack([s, 0 * s, s * s / (2 * p)], axis=-1)


def guide_of(curve: Case, case: Case) -> Mapping:
    if curve["kind"] == "circle":
        geometry = {"center": curve["center"], "radius": curve["radius"]}
        return {"type": "circle", "normal": curve["plane_normal"]} | geometry
    first, last, n = GUIDE_POINTS[curve["kind"]]
    return {"type": "curve", "points": curve_law(curve)(np.linspace(first, last, n)).tolist()}


def effects_of(case: Case, r_CO: np.ndarray) -> Mapping:
    """Gravity (always named: cases then share compiled kernels) and the loads."""
    effects: Mapping = {"weight": {"type": "gravity", "acceleration": list(case["gravity"])}}
    wrench: Mapping = {"type": "wrench", "body": "body", "frame": "world"}
    wrench["point_B"] = (-r_CO).tolist()
    for load in case["loads"]:
        kind = load["type"]
        if kind == "axis_torque":
            axis = np.asarray(case["constraint"]["axis_world"])
            wrench["torque"] = (load["constant"] * axis).tolist()
            effects["drag"] = damping(load["viscous"])
        elif kind == "constant_force":
            assert not np.any(load["force_world"])
        elif kind == "constant_couple":
            wrench["torque"] = load["torque_world"]
        elif kind in ("force_at_com_world", "torque_world"):
            part = "force" if kind.startswith("force") else "torque"
            wrench |= {part: load["constant"], f"sine_{part}": load["sine_amplitude"]}
            wrench["angular_frequency"] = load["sine_omega"]
        elif kind == "viscous_torque":
            effects["drag"] = damping(load["coefficient"])
        elif kind == "spring_damper":
            effects["spring"] = {
                "type": "spring",
                "body": "body",
                "point_B": (np.asarray(load["point_body"]) - r_CO).tolist(),
                "point_A": load["anchor_world"],
                "stiffness": load["stiffness"],
                "damping": load.get("damping", 0.0),
                "rest_length": load["rest_length"],
            }
        else:
            raise ValueError(f"no effect for {kind}")
    return effects | ({"load": wrench} if len(wrench) > 4 else {})


def damping(coefficient: float) -> Mapping:
    return {"type": "angular_damping", "body": "body", "coefficient": coefficient}


def start_of(case: Case) -> Case:
    """Initial state; its attitude from the first sample.

    `initial` of the two pendulum cases has the attitude of the hanging body, which contradicts
    their own position, anchor and samples; in all other cases both are the same.
    """
    return case["initial"] | {"quaternion_xyzw": case["samples"]["quaternion_xyzw"][0]}


def scene_of(case: Case, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> Mapping:
    """The scene of a case of one body, named `body`."""
    r_CO = np.asarray(origin, dtype=float)
    return {
        "bodies": {"body": body_of(case["body"], start_of(case), origin)},
        "constraints": constraints_of(case, r_CO),
        "effects": effects_of(case, r_CO),
    }


def double_pendulum(case: Case) -> Mapping:
    """Two spherical joints: body1 on the world, body2 on body1."""
    joints, bodies = case["constraint"], ("body1", "body2")
    first = {"point_B": joints["joint1"]["body1"], "point_A": joints["joint1"]["world"]}
    second = {"point_B": joints["joint2"]["body2"], "point_A": joints["joint2"]["body1"]}
    return {
        "bodies": {name: body_of(case["body"][name], case["initial"][name]) for name in bodies},
        "constraints": {
            "joint1": {"type": "fixed_point", "body": "body1"} | first,
            "joint2": {"type": "fixed_point", "body": "body2", "parent": "body1"} | second,
        },
        "effects": {"weight": {"type": "gravity", "acceleration": case["gravity"]}},
    }


def ball_on_support(case: Case) -> Mapping:
    """A ball that rolls on a block that slides along x."""
    spec = case["constraint"]
    normal = spec.get("wedge_normal", [0.0, 0.0, 1.0])
    floor = {"type": "line", "direction": [1.0, 0.0, 0.0]}
    effects: Mapping = {"weight": {"type": "gravity", "acceleration": case["gravity"]}}
    for load in case["loads"]:
        effects["push"] = {"type": "wrench", "body": load["on"], "force": load["force_world"]}
    return {
        "bodies": {
            name: body_of(case["body"][name], case["initial"][name]) for name in ("block", "ball")
        },
        "constraints": {
            "floor": {"type": "translation", "body": "block", "guide": floor},
            "contact": {"type": "rolling", "body": "ball", "parent": "block", "normal_A": normal},
        },
        "effects": effects,
    }
