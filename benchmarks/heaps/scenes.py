# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Heaps as scene mappings: stacks, a pyramid, balls in a bin, dominoes, a break shot."""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

import numpy as np

G = 9.81
MU = 0.5
FRICTION = {"type": "coulomb", "static": MU, "kinetic": MU}


def heap(bodies: dict[str, Any], constraints: dict[str, Any], step: float = 1e-3) -> dict[str, Any]:
    """A scene of these bodies under weight, with time stepping."""
    weight = {"type": "gravity", "acceleration": [0.0, 0.0, -G]}
    options = {"duration": 1.0, "rate": 50.0, "method": "time_stepping", "step": step}
    return {
        "bodies": bodies,
        "constraints": constraints,
        "effects": {"weight": weight},
        "simulation": options,
    }


def box(size: tuple[float, float, float], position: tuple[float, float, float], **more: Any) -> Any:
    shape = {"type": "box", "size": list(size)}
    return {"mass": 0.5, "shape": shape, "position": list(position)} | more


def ball(radius: float, position: Any, **more: Any) -> Any:
    shape = {"type": "sphere", "radius": radius}
    return {"mass": 0.5, "shape": shape, "position": [float(x) for x in position]} | more


def on_floor(body: str, **more: Any) -> dict[str, Any]:
    return {"type": "contact", "body": body, "friction": FRICTION} | more


def on_body(body: str, parent: str, **more: Any) -> dict[str, Any]:
    surface = {"type": "shape"}
    return (
        {"type": "contact", "body": body, "parent": parent, "surface": surface}
        | {"friction": FRICTION}
        | more
    )


def stack(count: int, step: float = 1e-3) -> dict[str, Any]:
    """Equal boxes on each other."""
    a = 0.1
    bodies = {f"b{i}": box((a, a, a), (0.0, 0.0, a * (i + 0.5))) for i in range(count)}
    constraints = {"floor": on_floor("b0")}
    constraints |= {f"c{i}": on_body(f"b{i}", f"b{i - 1}") for i in range(1, count)}
    return heap(bodies, constraints, step)


def pyramid(rows: int = 5, step: float = 1e-3) -> dict[str, Any]:
    """Rows of boxes, each with one box less than the one below: 5 rows are 15 boxes."""
    a, gap = 0.1, 0.01
    bodies, constraints = {}, {}
    for row in range(rows):
        for i in range(rows - row):
            x = (a + gap) * (i - 0.5 * (rows - row - 1))
            bodies[f"b{row}_{i}"] = box((a, a, a), (x, 0.0, a * (row + 0.5)))
            if row == 0:
                constraints[f"floor{i}"] = on_floor(f"b0_{i}")
                continue
            for k in (i, i + 1):
                constraints[f"c{row}_{i}_{k}"] = on_body(f"b{row}_{i}", f"b{row - 1}_{k}")
    return heap(bodies, constraints, step)


def walls(names: list[str], half: float) -> dict[str, Any]:
    """A floor and four walls for every body."""
    planes = {
        "floor": ([0, 0, 0], [0, 0, 1]),
        "west": ([-half, 0, 0], [1, 0, 0]),
        "east": ([half, 0, 0], [-1, 0, 0]),
        "south": ([0, -half, 0], [0, 1, 0]),
        "north": ([0, half, 0], [0, -1, 0]),
    }
    return {
        f"{wall}_{name}": on_floor(
            name,
            surface={
                "type": "plane",
                "point": [float(x) for x in point],
                "normal": [float(x) for x in normal],
            },
        )
        for name in names
        for wall, (point, normal) in planes.items()
    }


def balls_in_bin(count: int = 30, step: float = 1e-3, half: float = 0.16) -> dict[str, Any]:
    """Balls that fall into a bin and pile up."""
    r, rng = 0.05, np.random.default_rng(7)
    side = int((2.0 * half) / (2.2 * r))
    bodies = {}
    for i in range(count):
        layer, at = divmod(i, side * side)
        x, y = divmod(at, side)
        spread = 0.004 * rng.uniform(-1.0, 1.0, 2)
        place = np.array([x, y]) * 2.2 * r - (side - 1) * 1.1 * r + spread
        bodies[f"s{i}"] = ball(r, [*place, 0.08 + 0.12 * layer])
    names = list(bodies)
    constraints = walls(names, half)
    constraints |= {f"{a}_{b}": on_body(b, a) for a, b in combinations(names, 2)}
    return heap(bodies, constraints, step)


def piled_balls(step: float = 1e-3) -> dict[str, Any]:
    """Ten balls that pile up in a narrow bin."""
    return balls_in_bin(10, step, 0.11)


def dropped_balls(side: int = 6, step: float = 1e-3) -> dict[str, Any]:
    """A cube of balls that falls by a metre: 6 x 6 x 6 of them are the test "666" of SimBenchmark
    (Hwangbo, Kang 2018), with its sizes; friction is this module's."""
    rng, bodies = np.random.default_rng(42), {}
    for i in range(side**3):
        z, rest = divmod(i, side * side)
        y, x = divmod(rest, side)
        place = 0.21 * np.array([x, y, z]) + 1e-3 * rng.uniform(0.0, 1.0, 3) + [0.0, 0.0, 1.101]
        bodies[f"s{i}"] = ball(0.1, place, mass=10.0)
    constraints = {
        "floor": on_floor("all"),
        "balls": {"type": "contact", "between": "all", "friction": FRICTION},
    }
    return heap(bodies, constraints, step)


def dominoes(count: int = 10, step: float = 1e-3) -> dict[str, Any]:
    """Standing slabs, the first of which is pushed over."""
    bodies, constraints = {}, {}
    for i in range(count):
        push = {"angular_velocity": [0.0, 4.0, 0.0], "linear_velocity": [0.32, 0.0, 0.0]}
        first = push if i == 0 else {}
        bodies[f"d{i}"] = box((0.02, 0.08, 0.16), (0.07 * i, 0.0, 0.08), **first)
        constraints[f"floor{i}"] = on_floor(f"d{i}")
        if i > 0:
            constraints[f"c{i}"] = on_body(f"d{i}", f"d{i - 1}")
        if i > 1:
            constraints[f"e{i}"] = on_body(f"d{i}", f"d{i - 2}")
    return heap(bodies, constraints, step)


def break_shot(step: float = 1e-4) -> dict[str, Any]:
    """A ball shot at fifteen in a triangle, on a table."""
    r = 0.028575
    bodies = {"cue": ball(r, [-0.6, 0.0, r], linear_velocity=[8.0, 0.0, 0.0])}
    for row in range(5):
        for i in range(row + 1):
            x = row * math.sqrt(3.0) * r * 1.0005
            bodies[f"o{row}_{i}"] = ball(r, [x, (2.0 * i - row) * r * 1.0005, r])
    for body in bodies.values():
        body["mass"] = 0.17
    bounce = {"restitution": 0.95, "friction": FRICTION | {"static": 0.06, "kinetic": 0.06}}
    cloth = FRICTION | {"static": 0.2, "kinetic": 0.2}
    constraints = {f"table_{name}": on_floor(name, friction=cloth) for name in bodies}
    constraints |= {f"{a}_{b}": on_body(b, a, **bounce) for a, b in combinations(list(bodies), 2)}
    return heap(bodies, constraints, step)
