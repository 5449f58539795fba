# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random scenes in which what touches is held, pulled or driven as well.

Arms on turning parents that touch a floor or carry a ball; belts; bodies that touch each other and
are tied by damped springs or strings; loads that change while something touches; starts that touch
and overlap by rounding; guides that lead to a support.  Each scene follows from its seed and number
alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.contact.random_scenes import (
    SHAPES,
    Mapping,
    Scene,
    inertia,
    law_of,
    settings_of,
    shape_of,
    unit,
)
from benchmarks.contact.shapes import size_of

G = 9.81
Rng = np.random.Generator
Parts = tuple[Mapping, Mapping, Mapping]
"""bodies, constraints, effects."""


def solid(rng: Rng, kind: str | None = None, **more: Any) -> Mapping:
    """A body of random size; most have their centre of mass beside the middle."""
    shape = shape_of(kind or str(rng.choice(SHAPES)), rng)
    mass, size = float(rng.uniform(0.3, 3.0)), size_of(shape)
    own: Mapping = {"mass": mass, "shape": shape}
    if shape["type"] != "rod" and rng.random() < 0.5:
        own["inertia"] = inertia(rng, mass, size)
        own["center_of_mass"] = (0.2 * size * rng.normal(size=3)).tolist()
    return own | more


def turning(rng: Rng, position: list[float]) -> Parts:
    """A body `a` that turns on an axis of the world, or hangs on a point of it."""
    mass = float(rng.uniform(1.0, 5.0))
    a: Mapping = {"mass": mass, "inertia": inertia(rng, mass, 1.0), "position": position}
    lean = 0.2 * rng.normal(size=3) + [0.0, 0.0, 1.0]
    axis = (lean / np.linalg.norm(lean)).tolist()
    spin = float(rng.normal(0.0, 4.0))
    a["angular_velocity"] = [spin * x for x in axis]
    joint: Mapping = {"type": "fixed_axis", "body": "a", "axis_B": axis}
    if rng.random() < 0.3:
        joint = {"type": "fixed_point", "body": "a", "point_B": [0.0, 0.0, 0.5]}
    return {"a": a}, {"axle": joint}, {}


def arm(rng: Rng) -> Parts:
    """`b`, hinged to `a`, which turns, comes down upon the floor; some carry a ball."""
    bodies, constraints, effects = turning(rng, [0.0, 0.0, 0.5])
    reach = float(rng.uniform(0.25, 0.5))
    turn = {"axis": unit(rng), "angle": float(rng.uniform(0.0, 0.5))}
    b = solid(rng, position=[reach, 0.0, float(rng.uniform(0.4, 0.6))], orientation=turn)
    bodies["b"] = b | {"angular_velocity": rng.normal(0.0, 2.0, 3).tolist()}
    hold = {"body": "b", "parent": "a", "point_B": [-reach, 0.0, 0.0]}
    kind = rng.choice(["fixed_axis", "fixed_point", "distance"])
    if kind == "fixed_axis":
        hold["axis_B"] = unit(rng)
    elif kind == "distance":
        hold |= {"point_A": [0.0, 0.0, 0.1], "point_B": [0.0, 0.0, 0.0]}
    constraints["hinge"] = {"type": str(kind)} | hold
    if rng.random() < 0.5:
        constraints["floor"] = {"type": "contact", "body": "b"} | law_of(rng)
    else:
        c = solid(rng, position=[reach, 0.0, 1.2], linear_velocity=[0.0, 0.0, -1.0])
        bodies["c"] = c | {"angular_velocity": rng.normal(0.0, 5.0, 3).tolist()}
        top = {"type": "plane", "normal": [0.0, 0.0, 1.0], "point": [0.0, 0.0, 0.05]}
        constraints["on"] = {"type": "contact", "body": "c", "parent": "b", "surface": top}
        constraints["on"] |= law_of(rng)
    if rng.random() < 0.3:
        twist = {"body": "b", "parent": "a", "axis_B": unit(rng), "stiffness": 3.0, "damping": 0.1}
        effects["torsion"] = {"type": "torsion_spring"} | twist
    return bodies, constraints, effects


def belt(rng: Rng) -> Parts:
    """`b` falls on a belt: a body that a velocity constraint drives along a guide."""
    direction = unit(rng) if rng.random() < 0.5 else [1.0, 0.0, 0.0]
    rate = float(rng.normal(0.0, 1.5))
    a = {"mass": 2.0, "inertia": [0.1, 0.1, 0.1], "linear_velocity": [rate * x for x in direction]}
    guide = {"type": "line", "direction": direction}
    drive = {"type": "velocity", "body": "a", "linear": direction, "rate": rate, "frame": "world"}
    constraints = {
        "guide": {"type": "translation", "body": "a", "guide": guide},
        "drive": drive,
        "on": {"type": "contact", "body": "b", "parent": "a", "surface": {"type": "plane"}}
        | law_of(rng),
    }
    b = solid(rng)
    b["position"] = [0.0, 0.0, 1.6 * size_of(b["shape"])]
    b["orientation"] = {"axis": unit(rng), "angle": float(rng.uniform(0.0, 3.0))}
    b["angular_velocity"] = rng.normal(0.0, 4.0, 3).tolist()
    return {"a": a, "b": b}, constraints, {}


def tied(rng: Rng) -> Parts:
    """Two bodies that touch each other and the floor, with a damped spring or a string between."""
    r = float(rng.uniform(0.15, 0.3))
    b = solid(rng, "sphere", position=[0.0, 0.0, r], angular_velocity=rng.normal(0, 4, 3).tolist())
    b["shape"] = {"type": "sphere", "radius": r}
    c = solid(rng, orientation={"axis": unit(rng), "angle": 1.0})
    away = rng.normal(size=2) * 0.05
    c["position"] = [*away.tolist(), 2.0 * r + 1.4 * size_of(c["shape"])]
    c["linear_velocity"] = rng.normal(0.0, 0.5, 3).tolist()
    pair = {"body": "c", "parent": "b"}
    constraints = {
        "floor": {"type": "contact", "body": "b"} | law_of(rng),
        "pair": {"type": "contact", "surface": {"type": "shape"}} | pair | law_of(rng),
    }
    ends = {"point_A": (0.1 * rng.normal(size=3)).tolist()}
    ends["point_B"] = (0.1 * rng.normal(size=3)).tolist()
    if rng.random() < 0.5:
        spring = {"type": "spring", "stiffness": float(rng.uniform(20, 500)), "damping": 2.0}
        spring["rest_length"] = float(rng.choice([0.0, 0.3]))
        return {"b": b, "c": c}, constraints, {"spring": spring | pair | ends}
    rope: Mapping = {"type": "string", "length": 2.0 * r + 0.3} | pair | ends
    if rng.random() < 0.5:
        rope["compliance"] = {"stiffness": 2000.0, "damping": float(rng.choice([0.0, 10.0]))}
    return {"b": b, "c": c}, constraints | {"rope": rope}, {}


def loaded(rng: Rng) -> Parts:
    """A body on the floor under a load that swings and one that is commanded."""
    b = solid(rng)
    b["position"] = [0.0, 0.0, 1.05 * size_of(b["shape"])]
    b["orientation"] = {"axis": unit(rng), "angle": float(rng.uniform(0.0, 3.0))}
    load = {"type": "wrench", "body": "b", "sine_force": rng.normal(0.0, 8.0, 3).tolist()}
    load |= {"sine_torque": rng.normal(0.0, 0.3, 3).tolist()}
    load |= {"angular_frequency": float(rng.uniform(3.0, 40.0)), "frame": "world"}
    floor = {"type": "contact", "body": "b"} | law_of(rng)
    return (
        {"b": b},
        {"floor": floor},
        {"load": load, "hand": {"type": "commanded_wrench", "body": "b"}},
    )


def touching(rng: Rng) -> Parts:
    """A body that starts on its support, apart or inside by rounding."""
    kind = str(rng.choice(["sphere", "box", "cylinder", "disk"]))
    b = solid(rng, kind)
    shape = b["shape"]
    half = {
        "sphere": shape.get("radius"), "box": 0.5 * shape.get("size", [0, 0, 0])[2],
        "cylinder": 0.5 * shape.get("length", 0.0), "disk": shape.get("radius"),
    }[kind]  # fmt: skip
    b.pop("center_of_mass", None)
    b.pop("inertia", None)
    if kind == "disk":
        b["shape"] = shape | {"axis_B": [0.0, 1.0, 0.0]}
    lean = float(rng.choice([0.0, 0.3, 0.6]))
    n = np.array([np.sin(lean), 0.0, np.cos(lean)])
    off = float(rng.choice([0.0, 1e-16, -1e-16, 1e-14, -1e-14, -1e-12, 1e-12]))
    place = 3.0 * rng.normal(size=3)
    b["position"] = (place + (half + off) * n).tolist()
    b["orientation"] = {"axis": [0.0, 1.0, 0.0], "angle": lean}
    along = np.array([np.cos(lean), 0.0, -np.sin(lean)])
    speed = rng.normal() * along + rng.normal() * np.array([0.0, 1.0, 0.0])
    b["linear_velocity"] = (float(rng.choice([0.0, 1.0])) * speed).tolist()
    b["angular_velocity"] = (rng.normal() * np.array([0.0, 0.0, 1.0])).tolist()
    plane = {"type": "plane", "point": place.tolist(), "normal": n.tolist()}
    floor = {"type": "contact", "body": "b", "surface": plane} | law_of(rng)
    return {"b": b}, {"floor": floor}, {}


def guided(rng: Rng) -> Parts:
    """`b` on a guide comes down upon a floor, or upon a ball that is free."""
    b = solid(rng, position=[0.6, 0.0, 0.7], orientation={"axis": unit(rng), "angle": 1.0})
    b["linear_velocity"] = [0.0, 0.0, -1.0]
    circle = {"type": "circle", "center": [0.0, 0.0, 0.7], "normal": [0.0, 1.0, 0.0], "radius": 0.6}
    line = {"type": "line", "direction": [0.3, 0.0, -1.0], "point": [0.6, 0.0, 0.7]}
    guide = circle if rng.random() < 0.5 else line
    constraints: Mapping = {"guide": {"type": "translation", "body": "b", "guide": guide}}
    bodies = {"b": b}
    if rng.random() < 0.5:
        level = float(rng.uniform(0.2, 0.4))
        floor = {"type": "plane", "point": [0.0, 0.0, level]}
        constraints["floor"] = {"type": "contact", "body": "b", "surface": floor} | law_of(rng)
    else:
        bodies["a"] = solid(rng, "sphere", position=[0.6, 0.1, 0.2])
        pair = {"type": "contact", "body": "b", "parent": "a", "surface": {"type": "shape"}}
        constraints["pair"] = pair | law_of(rng)
        under = {"type": "plane", "point": [0.0, 0.0, 0.2 - bodies["a"]["shape"]["radius"]]}
        constraints["under"] = {"type": "contact", "body": "a", "surface": under} | law_of(rng)
    return bodies, constraints, {}


FAMILIES: dict[str, Callable[[Rng], Parts]] = {
    f.__name__: f for f in (arm, belt, tied, loaded, touching, guided)
}


def coupled_scene(seed: int, number: int) -> Scene:
    """The scene of this number."""
    return scene_of(FAMILIES, np.random.default_rng([seed, number, 1]))


def scene_of(families: dict[str, Callable[[Rng], Parts]], rng: Rng) -> Scene:
    """A scene of one of the families, with weight and settings."""
    name = str(rng.choice(list(families)))
    bodies, constraints, effects = families[name](rng)
    weight = {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}}
    mapping = {
        "bodies": bodies,
        "constraints": constraints,
        "effects": weight | effects,
        "simulation": settings_of(rng),
    }
    kinds = [b["shape"]["type"] for b in bodies.values() if "shape" in b]
    return Scene(mapping, " ".join([name, *kinds]))
