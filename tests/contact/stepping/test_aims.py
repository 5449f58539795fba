# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A ball that strikes something round, or passes it, in few steps goes on as it ought to; where a
pair is not followed through the step, a normal that has turned by its end is told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.accuracy.checks.check import effort_of
from rb_sim.accuracy.checks.step_checks import found_in

SPEED, RADIUS, POST = 20.0, 0.02, 0.05
BESIDE = (0.0, 0.03, 0.05, 0.065, 0.0699, 0.0701, 0.1, 0.2)
"""Of the way from the middle of the post [m]; from RADIUS + POST on it passes."""
SHAKEN: dict[str, Any] = {
    "motion": {"type": "shaken", "direction": [0, 0, 1], "amplitude": 1e-9, "frequency": 1.0}
}
"""A support that moves, if only by a nanometre, is not followed through a step."""


def sent_off(
    beside: float,
    step: float,
    parent: bool,
    speed: float = SPEED,
    far_away: Any = None,
    **more: Any,
) -> tuple[Simulation, np.ndarray, list[str]]:
    """A smooth, elastic ball strikes a round post, fixed or free to move, or passes it: what it
    does then, and what the checks say."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": RADIUS}}
    contact: dict[str, Any] = {
        "type": "contact", "body": "ball", "restitution": 1.0, "friction": {"type": "smooth"},
    }  # fmt: skip
    bodies = {"ball": ball | {"position": [0.013, 0.0, 0.0], "linear_velocity": [speed, 0.0, 0.0]}}
    place = [1.0, beside, 0.0]
    if parent:
        bodies["post"] = ball | {"position": place, "shape": {"type": "sphere", "radius": POST}}
        contact |= {"parent": "post", "surface": {"type": "shape"}}
    else:
        contact |= {"surface": {"type": "sphere", "radius": POST, "center": place}}
    duration = 4.0 / speed
    scene = {
        "bodies": bodies,
        "constraints": {"strikes": contact | more},
        "simulation": {
            "method": "time_stepping", "step": step, "duration": duration, "rate": 1.0 / duration,
        },
    }  # fmt: skip
    if far_away:
        bodies["egg"] = {"mass": 1.0, "shape": far_away, "position": [50.0, 0.0, 0.0]}
        ground = {"type": "sphere", "radius": 1.0, "center": [60.0, 0.0, 0.0]}
        scene["constraints"] |= {"far": {"type": "contact", "body": "egg", "surface": ground}}  # type: ignore[operator]
    simulation = Simulation(load_scene(scene), announce=None)
    run = simulation.run(checks=False)
    found = found_in(run.block, effort_of(simulation), 1.0)
    reported = [finding.where for finding in found if finding.check == "contact steps"]
    return simulation, run.linear_velocity["ball"][-1], reported


def exact(
    beside: float, parent: bool, speed: float = SPEED, e: float = 1.0, mu: float = 0.0
) -> np.ndarray:
    """Of a sphere: the impulse along the normal, and across it what ends the slip, if friction is
    so much; two equal balls share it."""
    along = np.array([speed, 0.0, 0.0])
    if beside > RADIUS + POST:
        return along
    sine = beside / (RADIUS + POST)
    normal = np.array([-((1.0 - sine**2) ** 0.5), -sine, 0.0])
    share = 0.5 if parent else 1.0
    push = -share * (1.0 + e) * (along @ normal)
    across = along - (along @ normal) * normal
    drag = min(mu * push, share * 2.0 / 7.0 * float(np.linalg.norm(across)))
    ahead = across / max(float(np.linalg.norm(across)), 1e-12)
    return along + push * normal - drag * ahead


@pytest.mark.parametrize("parent", [False, True], ids=["fixed", "free"])
@pytest.mark.parametrize("step", [1e-2, 1e-3])
@pytest.mark.parametrize("speed", [1.0, 20.0])
def test_a_ball_goes_its_way_whatever_the_step(speed: float, step: float, parent: bool) -> None:
    """In one step it may have gone thrice the way that it touches the post on: it was sent off by
    any angle, and where it would have passed the post was in its way from afar."""
    split = speed * step > 2e-3  # else normals are those of the middle of a whole step
    for beside in BESIDE:
        _, velocity, reported = sent_off(beside, step, parent, speed)
        error = np.linalg.norm(velocity - exact(beside, parent, speed)) / speed
        assert error < (1e-9 if split else 0.02), beside
        assert reported == []


@pytest.mark.parametrize("parent", [False, True], ids=["fixed", "free"])
@pytest.mark.parametrize(("e", "mu"), [(0.0, 0.0), (0.5, 0.1), (1.0, 2.0)])
def test_so_does_one_that_rubs(e: float, mu: float, parent: bool) -> None:
    """Where it keeps to the post after the strike, it goes straight on from there."""
    friction = {"type": "coulomb", "static": mu} if mu else {"type": "smooth"}
    for beside in BESIDE:
        more = {"restitution": e, "friction": friction}
        _, velocity, _ = sent_off(beside, 1e-2, parent, **more)
        error = np.linalg.norm(velocity - exact(beside, parent, SPEED, e, mu)) / SPEED
        assert error < 2e-3, beside


def test_one_that_something_else_sends_at_a_post_does_not_end_in_it() -> None:
    """Its way would have passed below; it bounces off a floor in the middle of the step."""
    place = np.array([0.2, 0.0, 0.075])
    surface = {"type": "sphere", "radius": 0.03, "center": place.tolist()}
    law = {"type": "contact", "body": "ball", "restitution": 1.0}
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": RADIUS}, "position": [0, 0, 0.03]}
    scene = {
        "bodies": {"ball": ball | {"linear_velocity": [SPEED, 0.0, -8.0]}},
        "constraints": {"floor": law, "post": law | {"surface": surface}},
        "simulation": {"method": "time_stepping", "step": 1e-2, "duration": 0.01, "rate": 100.0},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    simulation.advance(0.01)
    y = simulation._motion.coordinates
    assert y[9] == pytest.approx(8.0)
    assert np.linalg.norm(y[0:3] - place) > 0.03 + RADIUS - 1e-9


@pytest.mark.parametrize("step", [1e-2, 2e-3, 1e-3, 2e-4])
def test_no_ball_is_sent_off_a_wrong_way_without_a_word(step: float) -> None:
    """Of a pair that is not followed; also where it would have passed."""
    wrong = 0
    for beside in (0.02, 0.03, 0.04, 0.05, 0.06, 0.065, 0.069, 0.075, 0.1, 0.2):
        _, velocity, reported = sent_off(beside, step, False, **SHAKEN)
        error = float(np.linalg.norm(velocity - exact(beside, False))) / SPEED
        if error > 0.2:
            wrong += 1
            assert reported == ["strikes"]
    assert (wrong > 0) == (step >= 1e-3)


# What is thrown at something round, or at several, ends in few steps of time stepping where the
# run that locates its strikes ends.


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
            ends.append(simulation.run(checks=False).block.linear_velocity[-1])
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
    for number in range(20):
        simulations = [
            Simulation(load_scene(thrown(number, **how)), announce=None)
            for how in ({}, {"method": "time_stepping", "step": 1e-2})
        ]
        exact, found = (simulation.run(checks=False) for simulation in simulations)
        strikes += bool(simulations[0].events)
        bound = 5e-3 if len(simulations[0].events) > 4 else 1e-3
        error = found.linear_velocity["ball"][-1] - exact.linear_velocity["ball"][-1]
        assert np.linalg.norm(error) < bound * SPEED, number
        error = found.position["ball"][-1] - exact.position["ball"][-1]
        assert np.linalg.norm(error) < bound, number
    assert strikes > 10


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
