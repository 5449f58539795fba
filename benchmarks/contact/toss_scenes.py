# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scenes of random tosses: each follows from its seed and its number alone."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from benchmarks.contact.shapes import size_of

SUPPORTS = (
    "floor", "slope", "sphere", "bowl", "trough", "cylinder", "ball", "box", "drum",
)  # fmt: skip
"""Planes; a sphere from outside and inside; an endless cylinder from inside and outside; other
bodies: a ball that lies on a floor, a box and a cylinder that float."""
SHAPES = ("disk", "cylinder", "box", "rod", "ellipsoid", "ball")
FLOATING = ("box", "drum")


class Toss(NamedTuple):
    """One scene, and what kind it is of."""

    mapping: dict[str, Any]
    shape: str
    support: str
    law: str
    """kinds of friction and of support that are compiled apart."""


def unit(rng: np.random.Generator) -> list[float]:
    a = rng.normal(size=3)
    return (a / np.linalg.norm(a)).tolist()


def shape_of(name: str, rng: np.random.Generator) -> dict[str, Any]:
    r, length = rng.uniform(0.05, 0.15), rng.uniform(0.1, 0.4)
    if name == "ball":
        return {"type": "sphere", "radius": r}
    if name == "ellipsoid":
        return {"type": "ellipsoid", "semi_axes": rng.uniform(0.06, 0.14, 3).tolist()}
    if name == "box":
        return {"type": "box", "size": rng.uniform(0.08, 0.25, 3).tolist()}
    axis = {"axis_B": [0.0, 0.0, 1.0]}
    if name == "rod":
        return {"type": "rod", "length": length} | axis
    if name == "disk":
        return {"type": "disk", "radius": r} | axis
    return {"type": "cylinder", "radius": r, "length": length} | axis


def support_of(name: str, rng: np.random.Generator) -> tuple[dict[str, Any], list[float]]:
    """(surface, normal above which the body starts)."""
    if name == "slope":
        lean = rng.uniform(0.05, 0.4)
        normal = [float(np.sin(lean)), 0.0, float(np.cos(lean))]
        return {"type": "plane", "normal": normal}, normal
    if name == "sphere":
        return {"type": "sphere", "radius": 1.5, "center": [0.0, 0.0, -1.5]}, [0.0, 0.0, 1.0]
    if name == "bowl":
        centre = {"center": [0.0, 0.0, 3.0]}
        return {"type": "sphere", "radius": 3.0, "side": "inside"} | centre, [0.0, 0.0, 1.0]
    if name == "trough":
        axis = {"axis": [1.0, 0.0, 0.0], "point": [0.0, 0.0, 3.0]}
        return {"type": "cylinder", "radius": 3.0, "side": "inside"} | axis, [0.0, 0.0, 1.0]
    if name == "cylinder":
        axis = {"axis": [1.0, 0.0, 0.0], "point": [0.0, 0.0, -1.0]}
        return {"type": "cylinder", "radius": 1.0, "side": "outside"} | axis, [0.0, 0.0, 1.0]
    if name in ("ball", "box", "drum"):
        return {"type": "shape"}, [0.0, 0.0, 1.0]
    return {"type": "plane"}, [0.0, 0.0, 1.0]


def law_of(shape: str, support: str, rng: np.random.Generator) -> dict[str, Any]:
    law: dict[str, Any] = {}
    kind = rng.choice(["smooth", "coulomb", "two coefficients", "regularised"])
    mu = float(rng.uniform(0.05, 0.8))
    if kind == "coulomb":
        law["friction"] = {"type": "coulomb", "static": mu}
    elif kind == "two coefficients":
        law["friction"] = {"type": "coulomb", "static": mu, "kinetic": 0.8 * mu}
    elif kind == "regularised":
        law["friction"] = {"type": "regularised", "coefficient": mu, "speed": 0.05}
    if rng.random() < 0.2:
        damping = float(rng.choice([0.0, 20.0]))
        law["compliance"] = {"stiffness": float(rng.uniform(2e3, 2e4)), "damping": damping}
    elif rng.random() < 0.7:
        law["restitution"] = float(rng.uniform(0.0, 0.9))
    if shape == "disk" and support in ("floor", "slope") and "compliance" not in law:
        law["lies_flat"] = bool(rng.random() < 0.7)
    return law


def kind_of_law(law: dict[str, Any]) -> str:
    """What of a law is compiled apart."""
    friction = law.get("friction", {"type": "smooth"})["type"]
    more = [key for key in ("compliance", "lies_flat") if law.get(key)]
    return " ".join([friction, *more])


def parent_of(name: str, rng: np.random.Generator) -> dict[str, Any]:
    """The body that is tossed at, its top at the origin."""
    mass = float(rng.uniform(1.0, 5.0))
    if name == "ball":
        top = float(rng.uniform(0.3, 0.6))
        shape: dict[str, Any] = {"type": "sphere", "radius": top}
    elif name == "box":
        size = rng.uniform(0.6, 1.2, 3).tolist()
        shape, top = {"type": "box", "size": size}, 0.5 * size[2]
    else:
        top, length = float(rng.uniform(0.3, 0.6)), float(rng.uniform(1.0, 2.0))
        shape = {"type": "cylinder", "radius": top, "length": length, "axis_B": [1.0, 0.0, 0.0]}
    return {"mass": mass, "shape": shape, "position": [0.0, 0.0, -top]}


def toss(seed: int, number: int, shapes: Any = SHAPES, supports: Any = SUPPORTS) -> Toss:
    """The toss of this number."""
    rng = np.random.default_rng([seed, number])
    name = str(shapes[rng.integers(len(shapes))])
    support = str(supports[rng.integers(len(supports))])
    shape = shape_of(name, rng)
    surface, normal = support_of(support, rng)
    height = size_of(shape) * rng.uniform(1.05, 2.5)
    law = law_of(name, support, rng)
    bodies = {
        "b": {
            "mass": float(rng.uniform(0.2, 2.0)),
            "shape": shape,
            "position": (height * np.array(normal)).tolist(),
            "orientation": {"axis": unit(rng), "angle": float(rng.uniform(0.0, 3.1))},
            "linear_velocity": [*rng.normal(0.0, 0.7, 2).tolist(), float(rng.normal(0.0, 1.0))],
            "angular_velocity": (rng.uniform(0.0, 20.0) * np.array(unit(rng))).tolist(),
        }
    }
    constraints = {"c": {"type": "contact", "body": "b", "surface": surface} | law}
    weight: dict[str, Any] = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    if surface["type"] == "shape":
        bodies["a"] = parent_of(support, rng)
        constraints["c"]["parent"] = "a"
    if support == "ball":
        floor = {"type": "plane", "point": [0.0, 0.0, -2.0 * bodies["a"]["shape"]["radius"]]}
        constraints["f"] = {"type": "contact", "body": "a", "surface": floor}
    if support in FLOATING:
        weight["bodies"] = ["b"]
    mapping = {
        "bodies": bodies,
        "constraints": constraints,
        "effects": {"weight": weight},
        "simulation": {"duration": 0.6, "rate": 500},
    }
    return Toss(mapping, name, support, kind_of_law(law))
