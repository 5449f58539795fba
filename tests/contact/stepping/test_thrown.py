# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What is thrown at something round, or at several, ends in few steps of time stepping where the
run that locates its strikes ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene

SPEED, RADIUS, POST = 20.0, 0.02, 0.05
SHAPES: dict[str, dict[str, Any]] = {
    "ball": {"type": "sphere", "radius": RADIUS},
    "box": {"type": "box", "size": [0.03, 0.04, 0.05]},
    "rod": {"type": "rod", "length": 0.08, "axis_B": [0, 0, 1]},
    "cylinder": {"type": "cylinder", "radius": 0.02, "length": 0.05, "axis_B": [0, 0, 1]},
}
POSTS: dict[str, dict[str, Any]] = {
    "sphere": {"type": "sphere", "radius": POST},
    "pipe": {"type": "cylinder", "radius": POST, "axis": [0, 0, 1], "side": "outside"},
    "block": {"type": "box", "size": [0.08, 0.1, 0.12]},
    "drum": {"type": "cylinder", "radius": POST, "length": 0.12, "axis_B": [0, 0, 1]},
}
PAIRS = [
    ("ball", "pipe"), ("ball", "block"), ("ball", "drum"), ("box", "sphere"), ("rod", "sphere"),
    ("cylinder", "sphere"),
]  # fmt: skip


def at_a_post(shape: str, post: str, number: int, **simulation: Any) -> dict[str, Any]:
    """Something is thrown at a post, or past it: a surface, or a body that turns."""
    rng = np.random.default_rng([8, number])
    bodies: dict[str, Any] = {"b": {"mass": 1.0, "shape": SHAPES[shape]}}
    bodies["b"] |= {"position": [0.0, 0.0, 0.0], "linear_velocity": [SPEED, 0.0, 0.0]}
    bodies["b"]["orientation"] = {"axis": rng.normal(size=3).tolist(), "angle": 1.0}
    bodies["b"]["angular_velocity"] = (5.0 * rng.normal(size=3)).tolist()
    place = rng.uniform([0.9, -0.05, -0.05], [1.1, 0.05, 0.05]).tolist()
    law = {"type": "contact", "body": "b", "restitution": 1.0, "friction": {"type": "smooth"}}
    if post in ("sphere", "pipe"):
        at = {"center" if post == "sphere" else "point": place}
        law["surface"] = POSTS[post] | at
    else:
        bodies["a"] = {"mass": 3.0, "shape": POSTS[post], "position": place}
        bodies["a"]["angular_velocity"] = [0.0, 0.0, 2.0]
        law |= {"parent": "a", "surface": {"type": "shape"}}
    run = {"duration": 0.08, "rate": 100.0} | simulation
    return {"bodies": bodies, "constraints": {"c": law}, "effects": {}, "simulation": run}


@pytest.mark.parametrize(("shape", "post"), PAIRS)
def test_whatever_is_thrown_at_something_round_goes_its_way(shape: str, post: str) -> None:
    """Beside the run that locates the strikes."""
    struck = 0
    for number in range(4):
        ends = []
        for how in ({}, {"method": "time_stepping", "step": 1e-2}):
            scene = load_scene(at_a_post(shape, post, number, **how))
            simulation = Simulation(scene, announce=None)
            ends.append(simulation.run(watched=False).block.linear_velocity[-1])
            struck += len(simulation.events)
        np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=2e-3 * SPEED)
    assert struck >= 3


def thrown(number: int, **simulation: Any) -> dict[str, Any]:
    """A ball that is thrown among four round posts, which it may strike one after the other."""
    rng = np.random.default_rng([3, number])
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": RADIUS}, "position": [0, 0, 0]}
    ball["linear_velocity"] = [SPEED, *rng.normal(size=2).tolist()]
    law: dict[str, Any] = {"restitution": float(rng.choice([0.0, 0.5, 1.0]))}
    if rng.choice([0.0, 0.3]):
        law["friction"] = {"type": "coulomb", "static": 0.3}
    posts = {}
    for k in range(4):
        radius = float(rng.uniform(0.03, 0.1))
        centre = rng.uniform([0.2, -0.15, -0.1], [0.5, 0.15, 0.1]).tolist()
        surface = {"type": "sphere", "radius": radius, "center": centre}
        posts[f"p{k}"] = {"type": "contact", "body": "ball", "surface": surface} | law
    return {
        "bodies": {"ball": ball},
        "constraints": posts,
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"duration": 0.05, "rate": 100.0} | simulation,
    }


def test_one_that_strikes_several_ends_where_events_lead() -> None:
    """In five steps, beside the run that locates each strike.  One of 40 strikes eight times, which
    magnifies what steps of 10 ms leave of the fall."""
    strikes = 0
    for number in range(40):
        simulations = [
            Simulation(load_scene(thrown(number, **how)), announce=None)
            for how in ({}, {"method": "time_stepping", "step": 1e-2})
        ]
        exact, found = (simulation.run(watched=False) for simulation in simulations)
        strikes += bool(simulations[0].events)
        bound = 5e-3 if len(simulations[0].events) > 4 else 1e-3
        error = found.linear_velocity["ball"][-1] - exact.linear_velocity["ball"][-1]
        assert np.linalg.norm(error) < bound * SPEED, number
        error = found.position["ball"][-1] - exact.position["ball"][-1]
        assert np.linalg.norm(error) < bound, number
    assert strikes == 32


@pytest.mark.parametrize("step", [1e-2, 2e-3])
def test_its_way_falls_as_it_does(step: float) -> None:
    """By 50 g a ball falls by 25 mm in a step of 10 ms, more than its radius; the way in steps is
    exact between strikes."""
    ends = []
    for how in ({}, {"method": "time_stepping", "step": step}):
        mapping = thrown(5, **how)
        mapping["effects"]["weight"]["acceleration"] = [0.0, 0.0, -490.0]
        mapping["constraints"] = {"p": mapping["constraints"]["p0"]}
        surface = {"type": "sphere", "radius": POST, "center": [0.27, 0.0, -0.06]}
        mapping["constraints"]["p"]["surface"] = surface
        simulation = Simulation(load_scene(mapping), announce=None)
        simulation.advance(0.04)
        assert how or simulation.events
        ends.append(simulation._motion.coordinates[0:10])
    np.testing.assert_allclose(ends[1][7:10], ends[0][7:10], rtol=0.0, atol=0.05)
