# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Random scenes in which supports are carried: by what turns, flies, is driven or part of a loop.

Every shape on surfaces beside the middle of a parent that turns or is free, both with their centres
of mass elsewhere; bodies in pipes and bowls that a parent carries; linkages that close a loop and
strike, or carry what slides; bodies on two supports at once; bodies under commands that change
while they touch.  Each scene follows from its seed and number alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.contact.coupled_scenes import Parts, Rng, scene_of, solid, turning
from benchmarks.contact.random_scenes import (
    Mapping,
    Scene,
    inertia,
    law_of,
    unit,
)
from benchmarks.contact.shapes import size_of

ON: dict[str, tuple[str, ...]] = {
    "plane": ("sphere", "ellipsoid", "disk", "cylinder", "box", "rod", "points"),
    "ball": ("sphere", "ellipsoid", "disk", "cylinder", "box", "rod", "points"),
    "log": ("sphere", "ellipsoid", "disk"),
    "own box": ("sphere", "rod", "box", "points"),
    "own drum": ("sphere", "rod", "points"),
}
"""What falls onto a support of a parent from outside."""
IN: dict[str, tuple[str, ...]] = {
    "pipe": ("sphere", "ellipsoid", "disk", "cylinder", "box", "rod", "points"),
    "bowl": ("sphere", "ellipsoid", "disk", "cylinder", "box", "rod", "points"),
}
"""What moves in a hollow of a parent."""


def touching_body(rng: Rng, kind: str) -> tuple[Mapping, Mapping, float]:
    """(body, what its contact names of it, its size) of a shape or of listed points."""
    if kind != "points":
        own = solid(rng, kind)
        return own, {}, size_of(own["shape"]) + float(np.linalg.norm(own.get("center_of_mass", 0)))
    cloud = rng.normal(size=(int(rng.integers(4, 9)), 3))
    cloud *= 0.15 / np.linalg.norm(cloud, axis=1)[:, None]
    mass = float(rng.uniform(0.3, 3.0))
    own = {"mass": mass, "inertia": inertia(rng, mass, 0.15)}
    return own, {"points": cloud.tolist()}, 0.15


def surface_on(rng: Rng, support: str) -> tuple[Mapping, Mapping, float]:
    """(surface, the parent's shape if it is that, height of its top above the parent's origin)."""
    x, y = (0.1 * rng.normal(size=2)).tolist()
    if support == "plane":
        return {"type": "plane", "point": [x, y, 0.1], "normal": [0.0, 0.0, 1.0]}, {}, 0.1
    r = float(rng.uniform(0.3, 0.6))
    if support == "ball":
        return {"type": "sphere", "center": [x, y, 0.1], "radius": r}, {}, 0.1 + r
    if support == "log":
        lying = {"axis": [1.0, 0.0, 0.0], "radius": r, "side": "outside"}
        return {"type": "cylinder", "point": [x, y, 0.1]} | lying, {}, 0.1 + r
    centre = {"center_B": [x, y, 0.1]}
    if support == "own box":
        size = rng.uniform(0.5, 1.0, 3).tolist()
        return {"type": "shape"}, {"type": "box", "size": size} | centre, 0.1 + 0.5 * size[2]
    drum = {"type": "cylinder", "radius": r, "length": 1.2, "axis_B": [1.0, 0.0, 0.0]} | centre
    return {"type": "shape"}, drum, 0.1 + r


def thrown(rng: Rng, own: Mapping, position: list[float]) -> Mapping:
    """The body on its way down there, turning."""
    return own | {
        "position": position,
        "orientation": {"axis": unit(rng), "angle": float(rng.uniform(0.0, 3.0))},
        "linear_velocity": [*rng.normal(0.0, 0.5, 2).tolist(), -float(rng.uniform(0.3, 1.5))],
        "angular_velocity": (rng.uniform(0.0, 8.0) * np.array(unit(rng))).tolist(),
    }


def carried(rng: Rng) -> Parts:
    """`b` falls onto a support that `a` carries, which turns on an axis or hangs on a point."""
    support = str(rng.choice(list(ON)))
    own, points, size = touching_body(rng, str(rng.choice(ON[support])))
    surface, shape, top = surface_on(rng, support)
    bodies, constraints, effects = turning(rng, [0.0, 0.0, 0.0])
    bodies["a"] |= {"center_of_mass": (0.1 * rng.normal(size=3)).tolist()}
    bodies["a"] |= {"shape": shape} if shape else {}
    bodies["b"] = thrown(rng, own, [*(0.1 * rng.normal(size=2)).tolist(), top + 1.4 * size])
    on = {"type": "contact", "body": "b", "parent": "a", "surface": surface}
    constraints["on"] = on | points | law_of(rng)
    return bodies, constraints, effects


def afloat(rng: Rng) -> Parts:
    """Two free bodies meet; some fall onto a floor as well."""
    support = str(rng.choice(["ball", "own box", "own drum", "log", "plane"]))
    own, points, size = touching_body(rng, str(rng.choice(ON[support])))
    surface, shape, top = surface_on(rng, support)
    mass = float(rng.uniform(1.0, 6.0))
    a: Mapping = {"mass": mass, "inertia": inertia(rng, mass, 1.0), "position": [0.0, 0.0, 0.0]}
    a |= {"center_of_mass": (0.1 * rng.normal(size=3)).tolist()}
    a |= {"angular_velocity": rng.normal(0.0, 1.5, 3).tolist()} | (
        {"shape": shape} if shape else {}
    )
    b = thrown(rng, own, [*(0.1 * rng.normal(size=2)).tolist(), top + 1.4 * size])
    on = {"type": "contact", "body": "b", "parent": "a", "surface": surface}
    constraints = {"on": on | points | law_of(rng)}
    if rng.random() < 0.3:
        floor = {"type": "plane", "point": [0.0, 0.0, -0.6]}
        constraints["under"] = {
            "type": "contact", "body": "a", "surface": floor,
            "points": (0.5 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, -1]])).tolist(),
        } | law_of(rng)  # fmt: skip
    return {"a": a, "b": b}, constraints, {}


def hollow(rng: Rng) -> Parts:
    """`b` in a pipe or a bowl that `a` carries, which turns on an axis or hangs on a point."""
    support = str(rng.choice(list(IN)))
    own, points, _ = touching_body(rng, str(rng.choice(IN[support])))
    r = float(rng.uniform(1.0, 1.6))
    x, y = (0.1 * rng.normal(size=2)).tolist()
    surface: Mapping = {"type": "sphere", "center": [x, y, 0.1], "radius": r, "side": "inside"}
    if support == "pipe":
        lie = {"axis": [1.0, 0.0, 0.0], "radius": r, "side": "inside"}
        surface = {"type": "cylinder", "point": [x, y, 0.1]} | lie
    bodies, constraints, effects = turning(rng, [0.0, 0.0, 0.0])
    bodies["a"] |= {"center_of_mass": (0.1 * rng.normal(size=3)).tolist()}
    bodies["b"] = thrown(rng, own, [x, y, 0.5 - r])
    on = {"type": "contact", "body": "b", "parent": "a", "surface": surface}
    constraints["in"] = on | points | law_of(rng)
    return bodies, constraints, effects


def linkage(rng: Rng) -> Parts:
    """Four bars in a plane that close a loop: the coupler carries what slides, or the rocker's end
    strikes a floor."""
    y = {"axis_B": [0.0, 1.0, 0.0]}
    long, short = float(rng.uniform(0.9, 1.2)), float(rng.uniform(0.25, 0.4))

    def bar(length: float, x: float, z: float, angle: float) -> Mapping:
        mass = float(rng.uniform(0.5, 2.0))
        about = mass * length**2 / 12.0
        turn = {"axis": [0.0, 1.0, 0.0], "angle": angle}
        return {
            "mass": mass, "inertia": [about, about, 0.1 * about], "position": [x, 0.0, z],
            "orientation": turn,
        }  # fmt: skip

    # upright cranks at both ends of a level coupler: a parallelogram, off its singular ones
    lean = float(rng.uniform(0.2, 0.8))
    s, c = short * np.sin(lean), short * np.cos(lean)
    bodies = {
        "crank": bar(short, 0.5 * s, 0.5 * c, lean),
        "rocker": bar(short, long + 0.5 * s, 0.5 * c, lean),
        "coupler": bar(long, s + 0.5 * long, c, 0.5 * np.pi),
    }
    rate = float(rng.normal(0.0, 3.0))
    for name in ("crank", "rocker"):
        bodies[name] |= {
            "angular_velocity": [0.0, rate, 0.0],
            "linear_velocity": [0.5 * rate * c, 0.0, -0.5 * rate * s],
        }
    bodies["coupler"] |= {"linear_velocity": [rate * c, 0.0, -rate * s]}
    foot, head = [0.0, 0.0, -0.5 * short], [0.0, 0.0, 0.5 * short]
    fixed: Mapping = {"type": "fixed_axis"} | y
    constraints: Mapping = {
        "A": fixed | {"body": "crank", "point_B": foot},
        "B": fixed | {"body": "rocker", "point_B": foot},
        "C": fixed | {"body": "coupler", "parent": "crank", "point_B": [0.0, 0.0, -0.5 * long]},
        "D": {"type": "fixed_point", "body": "coupler", "parent": "rocker"}
        | {"point_B": [0.0, 0.0, 0.5 * long], "point_A": head},
    }
    constraints["C"] |= {"point_A": head}
    if rng.random() < 0.5:
        floor = {"type": "plane", "point": [0.0, 0.0, 0.5 * c]}
        tips = [[0.0, 0.0, 0.6 * long]]
        constraints["floor"] = {"type": "contact", "body": "coupler", "points": tips}
        constraints["floor"] |= {"surface": floor} | law_of(rng)
    else:
        own, points, size = touching_body(rng, str(rng.choice(ON["plane"])))
        top = {"type": "plane", "point": [0.05, 0.0, 0.0], "normal": [-1.0, 0.0, 0.0]}
        bodies["b"] = thrown(rng, own, [s + 0.5 * long, 0.0, c + 0.05 + 1.3 * size])
        on = {"type": "contact", "body": "b", "parent": "coupler", "surface": top}
        constraints["on"] = on | points | law_of(rng)
    return bodies, constraints, {}


def wedged(rng: Rng) -> Parts:
    """`b` between a floor or a slope and a wall, or in a corner of a body that turns."""
    own, points, size = touching_body(rng, str(rng.choice(ON["plane"])))
    lean = float(rng.uniform(0.3, 1.2))
    first = {"type": "plane", "normal": [float(np.sin(lean)), 0.0, float(np.cos(lean))]}
    second = {"type": "plane", "normal": [-float(np.sin(lean)), 0.0, float(np.cos(lean))]}
    bodies, constraints, effects = {}, {}, {}
    parent: Mapping = {}
    if rng.random() < 0.5:
        bodies, constraints, effects = turning(rng, [0.0, 0.0, 0.0])
        parent = {"parent": "a"}
    bodies["b"] = thrown(rng, own, [0.0, 0.0, 1.5 * size / float(np.cos(lean))])
    for name, surface in (("left", first), ("right", second)):
        own_law = law_of(rng)
        constraints[name] = {"type": "contact", "body": "b", "surface": surface}
        constraints[name] |= parent | points | own_law
    return bodies, constraints, effects


def commanded(rng: Rng) -> Parts:
    """`b` on a support that `a` carries, and both under commands that change."""
    bodies, constraints, effects = carried(rng)
    effects["hand"] = {"type": "commanded_wrench", "body": str(rng.choice(["a", "b"]))}
    return bodies, constraints, effects


FAMILIES: dict[str, Callable[[Rng], Parts]] = {
    f.__name__: f for f in (carried, afloat, hollow, linkage, wedged, commanded)
}


def joined_scene(seed: int, number: int) -> Scene:
    """The scene of this number."""
    return scene_of(FAMILIES, np.random.default_rng([seed, number, 2]))
