# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reported reactions are the whole impulse of a step: with the weight they are its momentum.

Newton's second law on the samples alone, for every body: m (v_k+1 - v_k) = h (F_k+1 + E), with F
all reactions BY constraints ON the body and E the mean of the effects at both ends, whatever the
state of a contact after the step, and also where bodies are moved apart at its end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.contact.toss_scenes import toss
from benchmarks.heaps import scenes
from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.scene.listing import find_scene
from tests.contact.scenes import acts_on, shipped_with_contacts

STEP = 1e-3
EXACT = 1e-9
"""Of a momentum: velocities smaller than this part of what a step adds are set to 0."""


def momentum_error(mapping: dict[str, Any], duration: float = 0.5) -> float:
    """Largest difference over samples and bodies of m dv and impulses, over m g h + m |v|."""
    options = {"method": "time_stepping", "step": STEP, "duration": duration, "rate": 1.0 / STEP}
    scene = load_scene(mapping | {"simulation": options})
    run = Simulation(scene).run(checks=False)
    worst = 0.0
    for name, body in scene.bodies.items():
        m, v = body.mass, run.linear_velocity[name]
        gained = np.zeros_like(v[1:])
        for key, constraint in scene.constraints.items():
            gained += acts_on(constraint, name) * run.reaction[key].force[1:]
        for key, effect in scene.effects.items():
            if acted := run.effect.get(key, run.effect.get(f"{key}/{name}")):
                mean = 0.5 * (acted.force[1:] + acted.force[:-1])
                gained += acts_on(effect, name) * mean
        error = np.linalg.norm(m * np.diff(v, axis=0) - STEP * gained, axis=1)
        worst = max(worst, error.max() / (m * (9.81 * STEP + np.linalg.norm(v, axis=1).max())))
    return worst


def ball(restitution: float) -> dict[str, Any]:
    return {
        "bodies": {
            "b": {
                "mass": 1.0,
                "shape": {"type": "sphere", "radius": 0.1},
                "position": [0.0, 0.0, 0.2],
            }
        },
        "constraints": {"c": {"type": "contact", "body": "b", "restitution": restitution}},
        "effects": {"g": {"type": "gravity"}},
    }


@pytest.mark.parametrize("restitution", [0.0, 0.9])
def test_of_a_ball_that_bounces(restitution):
    assert momentum_error(ball(restitution)) < EXACT


def test_torques_of_a_ball_that_strikes_a_post_within_a_step() -> None:
    """I dw = h (torque + arm x force), also in the step that the strike divides."""
    mapping = ball(0.5)
    moving = {"linear_velocity": [0.0, 0.0, -20.0], "angular_velocity": [3.0, -2.0, 20.0]}
    mapping["bodies"]["b"] |= moving
    post = {"type": "sphere", "radius": 0.05, "center": [0.0, 0.0, -0.05]}
    resists = {"rolling_resistance": 2e-3, "spinning_resistance": 5e-3, "surface": post}
    mapping["constraints"]["c"] |= {"friction": {"type": "coulomb", "static": 0.3}} | resists
    options = {"method": "time_stepping", "step": STEP, "duration": 0.02, "rate": 1.0 / STEP}
    run = Simulation(load_scene(mapping | {"simulation": options})).run(checks=False)
    turn, moment = Rotation.from_quat(run.orientation["b"]), 0.4 * 0.1**2
    gained = moment * np.diff(turn.apply(run.angular_velocity["b"]), axis=0)
    reaction = run.reaction["c"]
    arm = np.array([0.0, 0.0, -0.1])
    given = STEP * (reaction.torque + np.cross(arm, reaction.force))[1:]
    np.testing.assert_allclose(gained, given, rtol=0.0, atol=1e-6)
    assert np.abs(reaction.torque).max() > 10.0


def test_of_bodies_that_lean_on_each_other_as_they_come_to_rest():
    """What they pay for being moved apart goes through their contacts to the floor; and a point of
    two slabs that is new at the end of a step does not take the place of one that has pushed."""
    from benchmarks.heaps.scenes import dominoes

    assert momentum_error(dominoes(4), 1.2) < EXACT


def test_of_an_edge_that_has_gone_where_another_comes() -> None:
    """A point that comes at the end of a step took the place, and the impulse, of one that left."""
    from benchmarks.heaps.scenes import dominoes

    mapping = dominoes(3)
    for constraint in mapping["constraints"].values():
        constraint["friction"] = {"type": "coulomb", "static": 0.4}
    assert momentum_error(mapping, 1.2) < EXACT


@pytest.mark.parametrize("number", range(5))
def test_of_tosses(number):
    try:
        error = momentum_error(toss(421, number).mapping)
    except RbSimError as refused:
        pytest.skip(str(refused))
    assert error < EXACT


@pytest.mark.parametrize("name", shipped_with_contacts())
def test_of_shipped_scenes(name):
    import yaml

    mapping = yaml.safe_load(find_scene(name).read_text(encoding="utf-8"))
    assert momentum_error(mapping) < EXACT


# Friction that a run reports lies in Coulomb's cone, whatever is done to bodies after the step.


def beyond_cone(mapping: dict[str, Any], duration: float) -> float:
    """By how much friction on planes exceeds mu N at most, over the largest N of the run."""
    options = mapping["simulation"] | {"duration": duration, "rate": 1000.0, "step": 1e-3}
    run = Simulation(load_scene(mapping | {"simulation": options})).run(checks=False)
    worst, largest = 0.0, 0.0
    for name, one in mapping["constraints"].items():
        surface = one.get("surface", {"type": "plane"})
        if one["type"] != "contact" or "parent" in one or surface["type"] != "plane":
            continue
        mu = one["friction"]["static"]
        normal = np.array(surface.get("normal", [0.0, 0.0, 1.0]))
        force = run.reaction[name].force
        push = force @ normal
        across = np.linalg.norm(force - np.outer(push, normal), axis=1)
        worst, largest = max(worst, (across - mu * push).max()), max(largest, push.max())
    assert largest > 0.0
    return worst / largest


@pytest.mark.parametrize(("name", "duration"), [("piled_balls", 1.0), ("dominoes", 0.9)])
def test_in_heaps(name: str, duration: float) -> None:
    """Balls in a bin and slabs, which overlap, are moved apart and come to rest."""
    assert beyond_cone(getattr(scenes, name)(), duration) < 1e-12
