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
    t = x = v = 0.0
    way, sticks = math.copysign(1.0, -a * w), False
    while True:
        if sticks:

            def at(s: Any, t: float = t, x: float = x) -> tuple[Any, Any]:
                return x + a * (np.sin(w * s) - math.sin(w * t)), a * w * np.cos(w * s)

            def goes_on(s: float, at: Any = at) -> float:
                return static - abs(k * at(s)[0] - mass * a * w * w * math.sin(w * s))

        else:
            middle = -way * kinetic / k

            def at(s: Any, t: float = t, x: float = x, v: float = v, c: float = middle) -> Any:
                cos, sin = np.cos(own * (s - t)), np.sin(own * (s - t))
                return c + (x - c) * cos + v / own * sin, v * cos - own * (x - c) * sin

            def goes_on(s: float, at: Any = at, way: float = way) -> float:
                return way * (at(s)[1] - a * w * math.cos(w * s))

        until = first_zero(goes_on, t, end, part)
        here = (times >= t) & (times <= until)
        out[here] = at(times[here])[0]
        if until >= end:
            return out
        x, v = (float(value) for value in at(until))
        t = until
        pull = k * x - mass * a * w * w * math.sin(w * t)
        sticks = not sticks and abs(pull) <= static
        way = -math.copysign(1.0, pull)


def first_zero(f: Callable[[float], float], start: float, end: float, part: float) -> float:
    """Where f > 0 comes to zero after `start`; infinite if not before `end`."""
    before = start + 1e-6 * part
    while before < end:
        after = before + part
        if f(after) <= 0.0:
            return brentq(f, before, after, xtol=1e-15, rtol=1e-14) if f(before) > 0.0 else before
        before = after
    return math.inf


ALONG_X: dict[str, Callable[[Mapping, Array], Array]] = {
    "spring": spring,
    "stick_slip": stick_slip,
}
"""Closed forms of a body that moves along x, by the kind of scene."""
