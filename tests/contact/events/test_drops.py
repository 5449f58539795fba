# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Nothing that is let go, thrown up or thrown aside falls through a solid, however wide the scene.

Free flight is exact, so the first step of a run is the whole run. Judged from poses alone: no
sample lies inside the solid, and the first impact comes when the parabola first reaches it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene

G = 9.81
FINE = 20_001
"""Points of the parabola that are looked at."""


def solid(kind: str, size: float, rng: np.random.Generator) -> tuple[dict[str, Any], float]:
    """(shape, height of its top above its centre)."""
    if kind == "sphere":
        return {"type": kind, "radius": size}, size
    if kind == "box":
        edges = size * np.array([rng.uniform(0.5, 1), rng.uniform(0.5, 1), rng.uniform(0.01, 1)])
        return {"type": kind, "size": edges.tolist()}, 0.5 * float(edges[2])
    length = size * rng.uniform(0.02, 1.0)
    return {"type": kind, "radius": size, "length": length, "axis_B": [0.0, 0.0, 1.0]}, length / 2


def depth(shape: dict[str, Any], radius: float, p: np.ndarray) -> np.ndarray:
    """Depth of a ball with centre p in a solid at the origin, shape (n,) [m]; negative outside."""
    if shape["type"] == "sphere":
        return radius + shape["radius"] - np.linalg.norm(p, axis=1)
    if shape["type"] == "box":
        beyond = np.abs(p) - 0.5 * np.array(shape["size"])
    else:
        round_ = np.hypot(p[:, 0], p[:, 1]) - shape["radius"]
        beyond = np.stack([round_, np.abs(p[:, 2]) - 0.5 * shape["length"]], axis=1)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return radius - outside - np.minimum(beyond.max(axis=1), 0.0)


@pytest.mark.parametrize("number", range(30))
def test_nothing_falls_through(number):
    rng = np.random.default_rng([20261128, number])
    shape, top = solid(("sphere", "box", "cylinder")[number % 3], 10 ** rng.uniform(-2, 1), rng)
    radius = 10 ** rng.uniform(-3, 0)
    start = [0.05 * top, 0.0, top + radius + 10 ** rng.uniform(-2, 1)]
    velocity = [rng.choice([0.0, rng.uniform(-1, 1)]), 0.0, rng.choice([0.0, rng.uniform(-2, 2)])]
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": radius}, "position": start}
    far = [float(rng.choice([-1, 1]) * 10 ** rng.uniform(0.5, 2.5)), 3.0, 50.0]
    scene = {
        "bodies": {
            "ball": ball | {"linear_velocity": velocity},
            "solid": {"mass": 10.0, "shape": shape},
            "bystander": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "position": far},
        },
        "constraints": {
            "hold": {"type": "weld", "body": "solid"},
            "hold_bystander": {"type": "weld", "body": "bystander"},
            "c": {"type": "contact", "body": "ball", "parent": "solid", "restitution": 0.4}
            | {"surface": {"type": "shape"}},
        },
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}},
        "simulation": {"duration": rng.uniform(1, 4), "rate": float(rng.choice([1, 10, 100]))},
    }
    run = Simulation(load_scene(scene)).run()
    inmost = depth(shape, radius, run.position["ball"]).max()
    assert inmost < 1e-9 * (radius + abs(far[0]))
    t = np.linspace(0.0, run.t[-1], FINE)
    path = np.add(start, np.outer(t, velocity)) - np.outer(0.5 * G * t**2, [0.0, 0.0, 1.0])
    inside = depth(shape, radius, path) > 0.0
    if not inside.any():
        return
    first = t[inside.argmax()]
    assert run.events, f"falls through at t = {first:g} s"
    assert abs(run.events[0].t - first) <= 1.01 * t[1]


def test_lands_at_the_time_of_free_fall():
    """A slab of 20 m x 20 m x 0.1 m: h = g t^2 / 2."""
    scene = {
        "bodies": {
            "ball": {
                "mass": 1.0,
                "shape": {"type": "sphere", "radius": 0.1},
                "position": [0.0, 0.0, 1.0],
            },
            "slab": {
                "mass": 1000.0,
                "shape": {"type": "box", "size": [20.0, 20.0, 0.1]},
                "position": [0.0, 0.0, -0.05],
            },
        },
        "constraints": {
            "hold": {"type": "weld", "body": "slab"},
            "touch": {"type": "contact", "body": "ball", "parent": "slab", "restitution": 0.4}
            | {"surface": {"type": "shape"}},
        },
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}},
        "simulation": {"duration": 2.0, "rate": 10.0},
    }
    run = Simulation(load_scene(scene)).run()
    assert run.events[0].t == pytest.approx((2.0 * 0.9 / G) ** 0.5, abs=1e-12)
    assert run.position["ball"][-1, 2] == pytest.approx(0.1, abs=1e-12)


ENDS = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]])
CORNERS = np.array(
    [[0.6, 0, 0], [-0.3, 0.5, 0.1], [-0.3, -0.5, 0.1], [0, 0, -0.7], [0.1, 0.2, 0.8]]
)


def tumbling(seed: int, radius: float, spin: float, contact: dict[str, Any]) -> dict[str, Any]:
    """A body that tumbles above a sphere, outside or inside of it."""
    rng = np.random.default_rng(seed)
    side = contact["surface"]["side"]
    contact["surface"] |= {"type": "sphere", "radius": radius}
    contact["surface"]["center"] = [0.0, 0.0, radius if side == "inside" else -radius]
    body = {
        "mass": 1.0,
        "position": [0.0, 0.0, 1.0 + rng.uniform(0, 4)],
        "orientation": Rotation.random(random_state=seed).as_quat().tolist(),
        "linear_velocity": rng.normal(size=3).tolist(),
        "angular_velocity": (spin * rng.normal(size=3)).tolist(),
    }
    return {
        "bodies": {"b": body},
        "constraints": {"c": {"type": "contact", "body": "b"} | contact},
        "effects": {"g": {"type": "gravity"}},
    }


def deepest(scene: dict[str, Any], points: np.ndarray, tolerance: float, duration: float) -> float:
    """How deep any of the points lies beyond the sphere in a sample, from poses alone [m]."""
    options = {"method": "dopri853", "tolerance": tolerance, "duration": duration, "rate": 60.0}
    run = Simulation(load_scene(scene | {"simulation": options})).run(check=False, watched=False)
    sphere = scene["constraints"]["c"]["surface"]
    turned = Rotation.from_quat(run.orientation["b"]).as_matrix()
    places = run.position["b"][:, None] + points @ turned.transpose(0, 2, 1) - sphere["center"]
    beyond = np.linalg.norm(places, axis=2) - sphere["radius"]
    return float(beyond.max() if sphere["side"] == "inside" else -beyond.min())


@pytest.mark.parametrize("seed", [43, 46, 76, 124, *range(8)])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-6])
def test_an_end_that_dips_before_another_one_hits_is_not_missed(seed, tolerance):
    """A step of half a turn ends with one end of the rod in the bowl; the other end was in it, and
    out again, before."""
    scene = tumbling(seed, 15.0, 12.0, {"restitution": 0.8, "surface": {"side": "inside"}})
    scene["bodies"]["b"]["shape"] = {"type": "rod", "length": 1.0, "axis_B": [0.0, 0.0, 1.0]}
    assert deepest(scene, ENDS, tolerance, 4.0) < 1e-6


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_points_swing_through_nothing_within_half_a_turn(tolerance):
    scene = tumbling(228, 3.0, 10.0, {"restitution": 0.6, "surface": {"side": "outside"}})
    scene["bodies"]["b"]["inertia"] = [0.2, 0.25, 0.3]
    scene["constraints"]["c"]["points"] = CORNERS.tolist()
    assert deepest(scene, CORNERS, tolerance, 2.0) < 1e-6
