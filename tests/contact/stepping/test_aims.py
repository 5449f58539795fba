"""A step too long for a strike on a round surface is told: its impulse goes along a normal that has
turned by the time of the strike."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.effort_watch import ASTRAY, found_in

SPEED, RADIUS, POST = 20.0, 0.02, 0.05


def sent_off(beside: float, step: float, parent: bool) -> tuple[Simulation, np.ndarray, list[str]]:
    """A smooth, elastic ball strikes a round post, fixed or free to move, or passes it: what it
    does then, and what the watches say."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": RADIUS}}
    contact: dict[str, Any] = {
        "type": "contact", "body": "ball", "restitution": 1.0, "friction": {"type": "smooth"},
    }  # fmt: skip
    bodies = {"ball": ball | {"position": [0.013, 0.0, 0.0], "linear_velocity": [SPEED, 0.0, 0.0]}}
    place = [1.0, beside, 0.0]
    if parent:
        bodies["post"] = ball | {"position": place, "shape": {"type": "sphere", "radius": POST}}
        contact |= {"parent": "post", "surface": {"type": "shape"}}
    else:
        contact |= {"surface": {"type": "sphere", "radius": POST, "center": place}}
    duration = 0.2
    scene = {
        "bodies": bodies,
        "constraints": {"strikes": contact},
        "simulation": {
            "method": "time_stepping", "step": step, "duration": duration, "rate": 1.0 / duration,
        },
    }  # fmt: skip
    simulation = Simulation(load_scene(scene), announce=None)
    run = simulation.run(watched=False)
    found = found_in(run.block, effort_of(simulation), 1.0 / duration, 1.0)
    told = [finding.where for finding in found if finding.watch == "aim"]
    return simulation, run.linear_velocity["ball"][-1], told


def exact(beside: float, parent: bool) -> np.ndarray:
    """Specular reflection; of two equal balls, half of it."""
    along = np.array([SPEED, 0.0, 0.0])
    if beside > RADIUS + POST:
        return along
    sine = beside / (RADIUS + POST)
    normal = np.array([-((1.0 - sine**2) ** 0.5), -sine, 0.0])
    return along - (1.0 if parent else 2.0) * (along @ normal) * normal


@pytest.mark.parametrize("parent", [False, True], ids=["fixed", "free"])
@pytest.mark.parametrize("step", [1e-2, 2e-3, 1e-3, 2e-4])
def test_no_ball_is_sent_off_a_wrong_way_without_a_word(step: float, parent: bool) -> None:
    """Also where it would have passed: from afar the post is in its way."""
    wrong = 0
    for beside in (0.02, 0.03, 0.04, 0.05, 0.06, 0.065, 0.069, 0.075, 0.1, 0.2):
        _, velocity, told = sent_off(beside, step, parent)
        error = float(np.linalg.norm(velocity - exact(beside, parent))) / SPEED
        if error > 0.2:
            wrong += 1
            assert told == ["strikes"]
    assert (wrong > 0) == (step > 1e-3 or (step == 1e-3 and not parent))


@pytest.mark.parametrize("parent", [False, True], ids=["fixed", "free"])
def test_a_step_that_follows_the_surface_is_not_told(parent: bool) -> None:
    for beside in (0.0, 0.02, 0.05, 0.06, 0.1):
        simulation, velocity, told = sent_off(beside, 2e-4, parent)
        assert told == []
        assert simulation.astray[0] < ASTRAY
        assert np.linalg.norm(velocity - exact(beside, parent)) < 0.03 * SPEED


def test_what_is_wrong_follows_from_the_turn_of_the_normal() -> None:
    """It pushes half a step before the end, along the normal there, and gives twice the speed of
    approach along it."""
    step = 2e-4
    simulation, velocity, _ = sent_off(0.04, step, False)
    given = velocity - [SPEED, 0.0, 0.0]
    figure, t, _ = simulation.astray
    before = 0.013 + SPEED * (t - 0.5 * step)
    arm = np.array([before, 0.0, 0.0]) - [1.0, 0.04, 0.0]
    later = arm + 0.5 * step * velocity
    turn = np.linalg.norm(arm / np.linalg.norm(arm) - later / np.linalg.norm(later))
    wrong = np.linalg.norm(given) * turn
    assert figure == pytest.approx(wrong / simulation.compiled.system.speed, rel=1e-6)


def test_a_plane_has_one_normal() -> None:
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": RADIUS}}
    scene = {
        "bodies": {"ball": ball | {"position": [0, 0, 1.0], "linear_velocity": [3.0, 0.0, -9.0]}},
        "constraints": {"floor": {"type": "contact", "body": "ball", "restitution": 0.8}},
        "simulation": {"method": "time_stepping", "step": 0.05, "duration": 2.0, "rate": 20.0},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    simulation.advance(2.0)
    assert simulation.astray == (0.0, 0.0, "")
