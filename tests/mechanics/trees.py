# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scenes of several bodies whose laws are compared: trees, loops, stars, and what changes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.many_body_scenes import chain, star
from tests.one_body_scenes import INERTIA, Mapping


def held(arms: int) -> dict[str, Any]:
    """A star that hangs on the world by its hub, whose axes of inertia are not the body's."""
    scene = star(arms)
    scene["bodies"]["hub"]["inertia"] = [[0.5, 0.05, -0.02], [0.05, 0.6, 0.03], [-0.02, 0.03, 0.7]]
    scene["constraints"]["ground"] = {"type": "fixed_point", "body": "hub", "point_B": [0, 0, 0.1]}
    return scene


def driven(arms: int) -> dict[str, Any]:
    """A star whose hub has a blade, a line that is not holonomic."""
    scene = star(arms)
    blade = {"type": "velocity", "body": "hub", "linear": [0.0, 1.0, 0.0]}
    scene["constraints"]["blade"] = blade
    return scene


def body(mass: float, **own: Any) -> Mapping:
    return {"mass": mass, "inertia": INERTIA, "center_of_mass": [0.04, -0.03, 0.05]} | own


def tree() -> Mapping:
    """A chain with joints of every kind between bodies, a prescribed velocity, a loop, a body that
    only springs hold; effects with and without a potential, on bodies and between them."""
    ends = {"point_B": [0.1, 0.05, -0.1], "point_A": [0.4, -0.3, 0.6]}
    on = {"body": "b", "parent": "a"}
    return {
        "bodies": {
            "a": body(1.3),
            "b": body(0.7, position=[0.4, 0.0, -0.9]),
            "c": body(2.1, position=[0.9, 0.2, -1.0]),
            "d": body(0.9, position=[1.4, 0.1, 0.3]),
        },
        "constraints": {
            "pivot": {"type": "fixed_point", "body": "a", "point_B": [0.0, 0.1, 0.5]},
            "hinge": {"type": "fixed_axis", "axis_B": [0.1, 1.0, 0.2], "point_B": [-0.4, 0, 0.4]}
            | on,
            "rod": {"type": "distance", "body": "c", "parent": "b", "point_A": [0.1, 0.0, 0.0]},
            "table": {"type": "plane", "body": "c", "normal_A": [0.1, 0.0, 1.0]},
            "upright": {"type": "parallel", "body": "c", "parent": "a", "axis_B": [0.0, 0.0, 1.0]},
            "drive": {"type": "velocity", "body": "c", "linear": [0.1, 1.0, 0.0], "rate": 0.4},
        },
        "effects": {
            "weight": {"type": "gravity", "acceleration": [0.3, -0.4, -9.7]},
            "spring": {"type": "spring", "stiffness": 40.0, "rest_length": 0.3} | on | ends,
            "damper": {"type": "spring", "damping": 0.6, "body": "d", "parent": "c"} | ends,
            "twist": {"type": "torsion_spring", "axis_B": [1.0, 2.0, 0.5], "stiffness": 0.8}
            | {"body": "d", "parent": "a", "damping": 0.1},
            "push": {"type": "wrench", "body": "b", "force": [1.0, -2.0, 1.5]}
            | {"torque": [0.1, 0.2, -0.15], "point_B": [0.05, -0.02, 0.08]},
        },
        "simulation": {"project_initial": True},
    }


def with_spare_row() -> Mapping:
    """A table on four legs beside a body on a spring: one line more than there is rank."""
    scene = tree()
    leg = {"type": "plane", "body": "d", "normal_A": [0.0, 0.0, 1.0], "point_A": [0.0, 0.0, 0.0]}
    feet = ([0.5, 0.8, 0.0], [-0.5, 0.8, 0.0], [-0.5, -0.8, 0.0], [0.5, -0.8, 0.0])
    scene["bodies"]["d"]["position"] = [1.4, 0.1, 0.0]
    legs = {f"leg{i}": leg | {"point_B": foot} for i, foot in enumerate(feet)}
    return scene | {"constraints": {"pivot": scene["constraints"]["pivot"]} | legs}


def rod() -> Mapping:
    """One line in all."""
    scene = tree()
    return scene | {"constraints": {"rod": scene["constraints"]["rod"]}}


def unheld() -> Mapping:
    """No joint at all."""
    return tree() | {"constraints": {}}


def cranks() -> Mapping:
    """A plate on four equal cranks: 40 lines for 29, and pivots that have many neighbours."""
    length, start = 0.6, 0.7
    hinge = {"type": "fixed_axis", "axis_B": [0.0, 1.0, 0.0], "bearing_distance": 0.2}
    turn = {"axis": [0.0, 1.0, 0.0], "angle": start}
    tip = [0.0, 0.0, -length]
    gone = [-length * math.sin(start), 0.0, -length * math.cos(start)]
    bodies, constraints = {"plate": body(1.7, position=gone)}, {}
    for i, (x, y) in enumerate(((0.5, 0.3), (-0.4, 0.3), (-0.4, -0.2), (0.5, -0.2))):
        bodies[f"crank{i}"] = body(0.5 + 0.1 * i, position=[x, y, 0.0], orientation=turn)
        constraints[f"fixed{i}"] = hinge | {"body": f"crank{i}"}
        joint = hinge | {"body": "plate", "parent": f"crank{i}"}
        constraints[f"moving{i}"] = joint | {"point_B": [x, y, 0.0], "point_A": tip}
    effects = {"weight": {"type": "gravity"}, "push": tree()["effects"]["push"] | {"body": "plate"}}
    return tree() | {"bodies": bodies, "constraints": constraints, "effects": effects}


def cross() -> Mapping:
    """The plate and its cranks in flight: pivots with as many neighbours, no line too many."""
    scene = cranks()
    joints = scene["constraints"].items()
    return scene | {"constraints": {k: own for k, own in joints if k.startswith("moving")}}


def double() -> Mapping:
    """A hinge and a fixed point on its axis: eight lines between two bodies, in two blocks."""
    scene = tree()
    axis = np.array([0.1, 1.0, 0.2]) / np.sqrt(1.05)
    point = (np.array([-0.4, 0.0, 0.4]) + 0.3 * axis).tolist()
    joints = {name: scene["constraints"][name] for name in ("pivot", "hinge", "rod")}
    joints["again"] = {"type": "fixed_point", "body": "b", "parent": "a", "point_B": point}
    return scene | {"constraints": joints}


def two_stars() -> Mapping:
    """Two hubs, the second one on the first."""
    scene = held(5)
    again = {f"other_{name}": own for name, own in held(5)["bodies"].items()}
    for own in again.values():
        x, y, z = own.get("position", (0.0, 0.0, 0.0))
        own["position"] = [x + 0.2, y, z + 2.0]
    constraints = dict(scene["constraints"])
    for name, joint in held(5)["constraints"].items():
        if name != "ground":
            renamed = {key: f"other_{joint[key]}" for key in ("body", "parent") if key in joint}
            constraints[f"other_{name}"] = joint | renamed
    constraints["link"] = {"type": "fixed_point", "body": "other_hub", "parent": "hub"}
    bodies = scene["bodies"] | again
    simulation = {"project_initial": True}
    return scene | {"bodies": bodies, "constraints": constraints, "simulation": simulation}


def hinged() -> dict[str, Any]:
    """Four links on parallel hinges, the last one to the ground: a loop with redundant lines."""
    scene = chain(4)
    places = ([0, 0, 0.5], [0.5, 0, 1.0], [1.0, 0, 0.5], [1.0, 0.0, 0.0])
    ends = ([0, 0, -0.5], [-0.5, 0, 0], [0, 0, 0.5], [0, 0, 0.0])
    outer = (None, [0, 0, 0.5], [0.5, 0, 0], [0, 0, -0.5])
    for i, (place, end, far) in enumerate(zip(places, ends, outer, strict=True)):
        scene["bodies"][f"b{i}"]["position"] = place
        joint = {"type": "fixed_axis", "body": f"b{i}", "point_B": end, "axis_B": [0, 1, 0]}
        joint["bearing_distance"] = 0.2
        if i:
            joint |= {"parent": f"b{i - 1}", "point_A": far, "axis_A": [0, 1, 0]}
        scene["constraints"][f"j{i}"] = joint
    scene["constraints"]["ground"] = {"type": "fixed_point", "body": "b3", "point_B": [0, 0, 0]}
    return scene


def changing() -> dict[str, Any]:
    """Every way in which something changes between steps, a rolling drive, and free spins."""
    scene = chain(3)
    scene["bodies"]["free"] = {
        "mass": 2.0,
        "inertia": [0.3, 0.2, 0.1],
        "position": [0, 0, 5],
        "angular_velocity": [0.1, 2.0, 0.1],
    }
    scene["effects"] |= {
        "by_hand": {"type": "commanded_wrench", "body": "b1"},
        "table": {
            "type": "wrench_table",
            "body": "b2",
            "times": [0.0, 1.0],
            "forces": [[1.0, 0.5, 0.0], [0.0, 2.0, 1.0]],
            "interpolation": "linear",
        },
        "spring": {
            "type": "spring",
            "body": "b2",
            "parent": "b0",
            "stiffness": 30.0,
            "rest_length": 0.9,
        },
    }
    return scene


SCENES = {
    "tree": tree,
    "spare line": with_spare_row,
    "rod": rod,
    "unheld": unheld,
    "loop": hinged,
    "double": double,
    "cranks": cranks,
    "cross": cross,
    "star": lambda: held(5),
    "two stars": two_stars,
    "driven star": lambda: driven(5),
    "changing": changing,
}
"""Of the stars the hub stays an unknown; of the last one tables and spins change between steps."""
