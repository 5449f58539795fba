# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random scenes that a person could mean: bodies, joints, effects and contacts of every kind."""

from __future__ import annotations

import math
import random
from typing import Any

Mapping = dict[str, Any]


def vector(rng: random.Random, size: float = 1.0) -> list[float]:
    return [rng.gauss(0.0, size) for _ in range(3)]


def unit(rng: random.Random) -> list[float]:
    v = vector(rng)
    size = math.hypot(*v)
    return [x / size for x in v]


def magnitude(rng: random.Random, low: float, high: float) -> float:
    """Log-uniform."""
    return 10.0 ** rng.uniform(math.log10(low), math.log10(high))


def body(rng: random.Random, place: list[float], shape: Mapping | None) -> Mapping:
    size = magnitude(rng, 0.05, 0.5)
    own: Mapping = {"mass": magnitude(rng, 0.01, 100.0), "position": place}
    if shape is not None:
        own["shape"] = shape
    else:
        own["inertia"] = [own["mass"] * size**2 * rng.uniform(0.35, 0.6) for _ in range(3)]
    if rng.random() < 0.4 and shape is None:
        own["center_of_mass"] = vector(rng, 0.1)
    if rng.random() < 0.6:
        own["orientation"] = {"axis": unit(rng), "angle": rng.uniform(-3.0, 3.0)}
    own["angular_velocity"] = vector(rng, magnitude(rng, 0.1, 20.0))
    own["linear_velocity"] = vector(rng, 0.5)
    return own


def shape(rng: random.Random) -> Mapping:
    r = rng.uniform(0.05, 0.3)
    kind = rng.choice(("sphere", "sphere", "box", "cylinder", "disk", "ellipsoid", "rod"))
    if kind == "box":
        return {"type": kind, "size": [rng.uniform(0.1, 0.5) for _ in range(3)]}
    if kind == "ellipsoid":
        return {"type": kind, "semi_axes": [rng.uniform(0.1, 0.3) for _ in range(3)]}
    if kind == "cylinder":
        return {"type": kind, "radius": r, "length": rng.uniform(0.1, 0.6)}
    if kind == "rod":
        return {"type": kind, "length": rng.uniform(0.2, 1.0)}
    return {"type": kind, "radius": r}


def joint(rng: random.Random, name: str, parent: str | None, place: list[float]) -> Mapping:
    kinds = ["fixed_point", "fixed_axis", "distance", "plane", "parallel", "weld", "velocity"]
    if parent is None:
        kinds += ["translation", "translation", "translation"]
    kind = rng.choice(kinds)
    own: Mapping = {"type": kind, "body": name}
    if parent is not None and kind != "velocity":
        own["parent"] = parent
    if kind not in ("parallel", "weld", "translation"):
        own["point_B"] = vector(rng, 0.3)
    if kind == "fixed_axis":
        own["axis_B"] = unit(rng)
    if kind == "parallel":
        own["axis_B"] = unit(rng)
    if kind == "plane":
        own["normal_A"] = unit(rng)
    if kind == "distance":
        own["point_A"] = [x + y for x, y in zip(place, vector(rng, 1.0), strict=True)]
    if kind == "velocity":
        own |= {"linear": unit(rng), "rate": rng.uniform(-1.0, 1.0)}
    if kind == "translation" and rng.random() < 0.8:
        own["guide"] = guide(rng, place)
    return own


def guide(rng: random.Random, place: list[float]) -> Mapping:
    """A curve of the world that passes near the place."""
    kind = rng.choice(("line", "circle", "curve"))
    if kind == "line":
        return {"type": kind, "direction": unit(rng)}
    if kind == "circle":
        radius = magnitude(rng, 0.3, 3.0)
        center = [p + radius * x for p, x in zip(place, unit(rng), strict=True)]
        return {"type": kind, "center": center, "normal": unit(rng), "radius": radius}
    points = [[p + x for p, x in zip(place, vector(rng), strict=True)] for _ in range(5)]
    return {"type": kind, "points": points, "closed": rng.random() < 0.5}


def string(rng: random.Random, name: str, parent: str | None, place: list[float]) -> Mapping:
    """A string that is just taut, or slack, to another body or to a place above."""
    own: Mapping = {"type": "string", "body": name, "point_B": vector(rng, 0.1)}
    if parent is not None:
        own |= {"parent": parent, "point_A": vector(rng, 0.1)}
    else:
        own["point_A"] = [p + x for p, x in zip(place, vector(rng, 0.5), strict=True)]
        own["point_A"][2] += 1.0
    own["restitution"] = rng.choice((0.0, 0.0, rng.uniform(0.0, 0.9)))
    if rng.random() < 0.3:
        own |= {"restitution": 0.0, "compliance": compliance(rng)}
    return own


def compliance(rng: random.Random) -> Mapping:
    return {"stiffness": magnitude(rng, 1e2, 1e5), "damping": rng.choice((0.0, 1.0))}


def rolling(rng: random.Random, name: str) -> tuple[Mapping, Mapping]:
    """A shape that rolls on a plane, and the plane."""
    kind = rng.choice(("sphere", "disk", "ellipsoid", "cylinder"))
    r = rng.uniform(0.05, 0.3)
    forms: Mapping = {
        "sphere": {"radius": r},
        "disk": {"radius": r},
        "ellipsoid": {"semi_axes": [rng.uniform(0.1, 0.3) for _ in range(3)]},
        "cylinder": {"radius": r, "length": rng.uniform(0.1, 0.6)},
    }
    return {"type": kind} | forms[kind], {"type": "rolling", "body": name, "normal_A": unit(rng)}


def effect(rng: random.Random, names: list[str]) -> Mapping:
    name = rng.choice(names)
    kind = rng.choice(
        ("linear_drag", "quadratic_drag", "angular_damping", "spring", "torsion_spring", "wrench",
         "wrench", "wrench_table", "commanded_wrench", "spring")
    )  # fmt: skip
    own: Mapping = {"type": kind, "body": name}
    if kind in ("linear_drag", "quadratic_drag", "angular_damping"):
        own["coefficient"] = magnitude(rng, 1e-4, 1e3)
    elif kind == "spring":
        own |= {"stiffness": magnitude(rng, 0.1, 1e7), "point_A": vector(rng)}
        own |= {"damping": rng.choice((0.0, magnitude(rng, 1e-3, 1e3)))}
        own |= {
            "rest_length": rng.choice((0.0, rng.uniform(0.1, 1.0))),
            "point_B": vector(rng, 0.2),
        }
        if len(names) > 1 and rng.random() < 0.4:
            own["parent"] = rng.choice([n for n in names if n != name])
    elif kind == "torsion_spring":
        own |= {"axis_B": unit(rng), "stiffness": magnitude(rng, 0.01, 100.0)}
    elif kind == "wrench":
        own |= {"force": vector(rng, magnitude(rng, 0.1, 1e4)), "torque": vector(rng, 0.3)}
        if rng.random() < 0.5:
            own |= {"sine_force": vector(rng, 3.0), "angular_frequency": rng.uniform(0.5, 50.0)}
        own["frame"] = rng.choice(("world", "body"))
    elif kind == "wrench_table":
        times = sorted(rng.uniform(0.0, 0.5) for _ in range(rng.randint(2, 6)))
        own |= {"times": times, "forces": [vector(rng, 5.0) for _ in times]}
        own["interpolation"] = rng.choice(("linear", "hold"))
    return own


def contact(rng: random.Random, name: str) -> Mapping:
    friction: Any = rng.choice(
        (
            {"type": "smooth"},
            {"type": "coulomb", "static": 0.5, "kinetic": 0.4},
            {"type": "coulomb", "static": 0.3, "kinetic": 0.3},
            {"type": "viscous", "coefficient": magnitude(rng, 0.1, 10.0)},
            {"type": "regularised", "coefficient": 0.3, "speed": magnitude(rng, 1e-3, 1.0)},
        )
    )
    own: Mapping = {
        "type": "contact",
        "body": name,
        "surface": {"type": "plane", "point": [0, 0, -1.0], "normal": [0, 0, 1]},
        "friction": friction,
        "restitution": rng.choice((0.0, 0.0, rng.uniform(0.0, 1.0))),
    }
    if rng.random() < 0.2:
        own["surface"] = rng.choice(
            (
                {"type": "sphere", "center": [0, 0, -6.0], "radius": 5.0},
                {"type": "sphere", "center": [0, 0, 20.0], "radius": 21.0, "side": "inside"},
                {"type": "cylinder", "point": [0, 0, 20.0], "axis": [1, 0, 0], "radius": 21.0},
            )
        )
    if rng.random() < 0.2:
        own["motion"] = rng.choice(
            (
                {"type": "turntable", "rate": rng.uniform(-5.0, 5.0)},
                {"type": "shaken", "direction": unit(rng), "amplitude": 0.01, "frequency": 5.0},
            )
        )
    if rng.random() < 0.2:
        own |= {"restitution": 0.0, "compliance": compliance(rng)}
    if friction["type"] == "coulomb" and rng.random() < 0.3:
        own |= {"rolling_resistance": 1e-3, "spinning_resistance": 1e-3}
    return own


def between(rng: random.Random, name: str, parent: str) -> Mapping:
    """A contact of two bodies by their shapes."""
    return {
        "type": "contact", "body": name, "parent": parent, "surface": {"type": "shape"},
        "friction": rng.choice(({"type": "smooth"}, {"type": "coulomb", "static": 0.4})),
    }  # fmt: skip


def scene(rng: random.Random, contacts: float = 0.3) -> Mapping:
    """A scene with up to four bodies; its start is brought onto its joints.

    contacts: share of scenes with contacts.
    """
    in_contact = rng.random() < contacts
    names = [f"b{i}" for i in range(rng.choice((1, 1, 2, 2, 3, 4)))]
    shapes = {n: shape(rng) if in_contact or rng.random() < 0.2 else None for n in names}
    places = {n: vector(rng, 0.5) for n in names}
    bodies = {n: body(rng, places[n], shapes[n]) for n in names}
    constraints: Mapping = {}
    for i, name in enumerate(names):
        if in_contact and rng.random() < 0.8:
            bodies[name]["position"][2] = abs(bodies[name]["position"][2]) + 2.5 * i
            constraints[f"c{i}"] = contact(rng, name)
            balls = [n for n in names[:i] if bodies[n]["shape"]["type"] in ("sphere", "box")]
            if balls and bodies[name]["shape"]["type"] == "sphere" and rng.random() < 0.5:
                constraints[f"s{i}"] = between(rng, name, rng.choice(balls))
        elif in_contact and rng.random() < 0.5:
            constraints[f"t{i}"] = string(rng, name, rng.choice([None, *names[:i]]), places[name])
        elif shapes[name] is not None and not in_contact and rng.random() < 0.5:
            bodies[name]["shape"], constraints[f"r{i}"] = rolling(rng, name)
        elif rng.random() < 0.7:
            parent = rng.choice([None, *names[:i]])
            constraints[f"j{i}"] = joint(rng, name, parent, places[name])
    effects: Mapping = {}
    if rng.random() < 0.8:
        effects["weight"] = {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}
    for i in range(rng.choice((0, 1, 1, 2, 3))):
        effects[f"e{i}"] = effect(rng, names)
    options: Mapping = {"duration": 0.5, "rate": 100.0, "project_initial": True}
    if in_contact:
        options |= rng.choice(({}, {}, {"method": "time_stepping", "step": 0.002}))
    else:
        options |= rng.choice(
            (
                {},
                {"tolerance": magnitude(rng, 1e-14, 1e-3)},
                {"method": "rk4", "step": magnitude(rng, 1e-3, 0.1)},
                {"method": "euler", "step": magnitude(rng, 1e-3, 0.1)},
                {"method": "gauss6", "step": magnitude(rng, 1e-3, 0.1)},
                {"method": "radau5", "tolerance": magnitude(rng, 1e-10, 1e-3)},
                {"method": "radau5", "step": magnitude(rng, 1e-3, 0.1)},
            )
        )
    return {"bodies": bodies, "constraints": constraints, "effects": effects, "simulation": options}
