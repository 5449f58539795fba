# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random scenes with contacts that nobody tossed yet: what the parts of a scene do to each other.

Supports that turn, shake, give way or are carried by a body (free, on an axis, or hung on a point);
centres of mass beside the middle; rough, viscous and regularised friction; resistance to rolling
and spinning; two bodies one after the other on the same support, springs and strings between them;
default settings, long steps, time stepping.  Each scene follows from its seed and number alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from benchmarks.contact.shapes import size_of

SHAPES = ("sphere", "sphere", "ellipsoid", "disk", "cylinder", "box", "rod")
SUPPORTS = ("floor", "slope", "turntable", "shaken", "table", "swing", "ball", "bowl")
"""Planes at rest, turning and shaken, on a body that turns on an axis or hangs on a point; a body's
sphere; a hollow sphere in the world."""
BETWEEN = ("none", "none", "none", "spring", "string", "contact", "alone")
"""What is between two bodies; alone: there is one body."""
G = 9.81
Mapping = dict[str, Any]


class Scene(NamedTuple):
    """One scene, and what kind it is of."""

    mapping: Mapping
    kind: str


def unit(rng: np.random.Generator) -> list[float]:
    a = rng.normal(size=3)
    return (a / np.linalg.norm(a)).tolist()


def inertia(rng: np.random.Generator, mass: float, size: float) -> list[list[float]]:
    """Of a cloud of points: any directions, moments that a body can have."""
    points = rng.normal(size=(12, 3)) * (0.35 * size) * rng.uniform(0.6, 1.0, 3)
    points -= points.mean(axis=0)
    square = points.T @ points / len(points)
    return (mass * (np.trace(square) * np.eye(3) - square)).tolist()


def shape_of(name: str, rng: np.random.Generator) -> Mapping:
    r, length = float(rng.uniform(0.08, 0.2)), float(rng.uniform(0.1, 0.4))
    axis = {"axis_B": [0.0, 0.0, 1.0]}
    if name == "sphere":
        return {"type": name, "radius": r}
    if name == "ellipsoid":
        return {"type": name, "semi_axes": rng.uniform(0.1, 0.17, 3).tolist()}
    if name == "box":
        return {"type": name, "size": rng.uniform(0.1, 0.3, 3).tolist()}
    if name == "rod":
        return {"type": name, "length": length} | axis
    if name == "disk":
        return {"type": name, "radius": r} | axis
    return {"type": name, "radius": r, "length": length} | axis


def body_of(shape: Mapping, rng: np.random.Generator, height: float) -> Mapping:
    """A body above the support; some with their centre of mass beside the middle."""
    mass, size = float(rng.uniform(0.3, 3.0)), size_of(shape)
    own: Mapping = {"mass": mass, "shape": shape}
    if shape["type"] != "rod" and rng.random() < 0.6:
        own["inertia"] = inertia(rng, mass, size)
        own["center_of_mass"] = (rng.normal(size=3) * 0.2 * size).tolist()
        if rng.random() < 0.3:
            own["shape"] = shape | {"center_B": (rng.normal(size=3) * 0.1 * size).tolist()}
    gap = size * rng.uniform(1.2, 2.0) + height
    own["position"] = [*(0.05 * rng.normal(size=2)).tolist(), float(gap)]
    own["orientation"] = {"axis": unit(rng), "angle": float(rng.uniform(0.0, 3.0))}
    own["linear_velocity"] = [*rng.normal(0.0, 0.6, 2).tolist(), float(rng.normal(-0.5, 0.5))]
    own["angular_velocity"] = (rng.uniform(0.0, 10.0) * np.array(unit(rng))).tolist()
    return own


def law_of(rng: np.random.Generator) -> Mapping:
    law: Mapping = {}
    mu = float(rng.uniform(0.05, 1.0))
    law["friction"] = [
        {"type": "smooth"},
        {"type": "coulomb", "static": mu},
        {"type": "coulomb", "static": mu, "kinetic": 0.7 * mu},
        {"type": "regularised", "coefficient": mu, "speed": 0.05},
        {"type": "viscous", "coefficient": mu},
        {"type": "viscous", "coefficient": mu, "per_normal": True},
        {"type": "rough"},
    ][rng.choice(7, p=[0.1, 0.3, 0.25, 0.1, 0.1, 0.05, 0.1])]
    if rng.random() < 0.3:
        law["rolling_resistance"] = float(rng.uniform(1e-4, 5e-3))
    if rng.random() < 0.3:
        law["spinning_resistance"] = float(rng.uniform(1e-4, 5e-3))
    if rng.random() < 0.25:
        damping = float(rng.choice([0.0, 20.0]))
        law["compliance"] = {"stiffness": float(rng.uniform(2e3, 2e4)), "damping": damping}
    else:
        law["restitution"] = float(rng.uniform(0.0, 0.8))
    return law


def support_of(name: str, rng: np.random.Generator) -> tuple[Mapping, Mapping, Mapping]:
    """(what of it a contact names, bodies, constraints)."""
    if name == "turntable":
        return {"motion": {"type": "turntable", "rate": float(rng.normal(0.0, 4.0))}}, {}, {}
    if name == "shaken":
        motion = {"type": "shaken", "direction": unit(rng), "amplitude": 0.03}
        motion |= {"frequency": float(rng.uniform(1.0, 9.0)), "phase": float(rng.uniform(0, 6))}
        return {"motion": motion}, {}, {}
    if name == "slope":
        lean = rng.uniform(0.05, 0.5)
        normal = [float(np.sin(lean)), 0.0, float(np.cos(lean))]
        return {"surface": {"type": "plane", "normal": normal}}, {}, {}
    if name == "bowl":
        bowl = {"type": "sphere", "radius": 2.0, "center": [0.0, 0.0, 2.0], "side": "inside"}
        return {"surface": bowl}, {}, {}
    if name == "floor":
        return {"surface": {"type": "plane"}}, {}, {}
    mass = float(rng.uniform(2.0, 8.0))
    parent: Mapping = {"mass": mass, "inertia": inertia(rng, mass, 1.5)}
    parent["position"] = [0.0, 0.0, 0.0]
    if name == "ball":
        parent |= {"shape": {"type": "sphere", "radius": 0.5}, "position": [0.0, 0.0, -0.5]}
        parent["angular_velocity"] = (3.0 * np.array(unit(rng))).tolist()
        floor = {"type": "contact", "body": "a", "surface": {"type": "plane", "point": [0, 0, -1]}}
        return {"parent": "a", "surface": {"type": "shape"}}, {"a": parent}, {"under": floor}
    joint: Mapping = {"type": "fixed_axis", "body": "a", "axis_B": [0.0, 0.0, 1.0]}
    if name == "table":
        parent["angular_velocity"] = [0.0, 0.0, float(rng.normal(0.0, 5.0))]
    else:
        joint = {"type": "fixed_point", "body": "a", "point_B": [0.0, 0.0, 0.8]}
        parent["center_of_mass"] = [0.0, 0.0, -0.1]
        parent["angular_velocity"] = rng.normal(0.0, 0.5, 3).tolist()
    return {"parent": "a", "surface": {"type": "plane"}}, {"a": parent}, {"joint": joint}


def settings_of(rng: np.random.Generator) -> Mapping:
    own: Mapping = {"duration": 0.5, "rate": 2000.0, "project_initial": True}
    return (
        own
        | [
            {},
            {"tolerance": 1e-7},
            {"method": "rk4", "step": float(rng.choice([2e-4, 2e-3, 1e-2]))},
            {"method": "gauss6", "step": 2e-3},
            {"impacts": "one_by_one"},
            {"method": "time_stepping", "step": 1e-3},
        ][rng.choice(6, p=[0.5, 0.1, 0.1, 0.05, 0.1, 0.15])]
    )


def between(name: str, names: list[str], bodies: Mapping, rng: np.random.Generator) -> Any:
    """(constraints, effects) between the two bodies."""
    pair = {"body": names[1], "parent": names[0]}
    if name == "spring":
        spring = {"type": "spring", "stiffness": float(rng.uniform(20.0, 500.0))} | pair
        return {}, {"spring": spring | {"rest_length": float(rng.choice([0.0, 0.4]))}}
    if name == "string":
        return {"string": {"type": "string", "point_A": [0.0, 0.0, 0.0], "length": 0.7} | pair}, {}
    shape = bodies[names[0]]["shape"]["type"]
    if name == "contact" and shape == "sphere":
        law = {"friction": {"type": "coulomb", "static": float(rng.uniform(0.1, 0.8))}}
        law["restitution"] = float(rng.uniform(0.0, 0.8))  # type: ignore[assignment]
        return {"touch": {"type": "contact", "surface": {"type": "shape"}} | pair | law}, {}
    return {}, {}


def random_scene(seed: int, number: int) -> Scene:
    """The scene of this number."""
    rng = np.random.default_rng([seed, number])
    support = str(rng.choice(SUPPORTS))
    link = str(rng.choice(BETWEEN))
    where, bodies, constraints = support_of(support, rng)
    names = ["b"] if link == "alone" else ["b", "c"]
    shapes, effects, height = [str(rng.choice(SHAPES)) for _ in names], {}, 0.0
    for name, kind in zip(names, shapes, strict=True):
        shape = shape_of(kind, rng)
        bodies[name] = body_of(shape, rng, height)
        height += 2.5 * size_of(shape)
        constraints[f"on_{name}"] = {"type": "contact", "body": name} | where | law_of(rng)
    if len(names) == 2:
        more, effects = between(link, names, bodies, rng)
        constraints |= more
    mapping = {
        "bodies": bodies,
        "constraints": constraints,
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}} | effects,
        "simulation": settings_of(rng),
    }
    return Scene(mapping, " ".join([support, link, *shapes]))
