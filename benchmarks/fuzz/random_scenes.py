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
        kinds += ["translation", "translation"]
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
    if kind == "translation" and rng.random() < 0.6:
        own["guide"] = {"type": "line", "direction": unit(rng)}
    return own


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
        )
    )
    return {
        "type": "contact",
        "body": name,
        "surface": {"type": "plane", "point": [0, 0, -1.0], "normal": [0, 0, 1]},
        "friction": friction,
        "restitution": rng.choice((0.0, 0.0, rng.uniform(0.0, 1.0))),
    }


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
