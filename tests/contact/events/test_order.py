"""Impacts whose order hangs on the length of the steps are told, with a step that tells it."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.contact.events.left_open import ORDER
from rb_sim.finding import Finding
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.effort_watch import found_in
from tests.contact.events.test_missed import REACH, W, oscillator

AT, RADIUS = -0.1, 0.1
SPEED = W * (REACH**2 - AT**2) ** 0.5
LEAN = np.array([0.6, 0.8, 0.0])
LONG, SHORT = 2e-2, 1e-3
"""Steps [s]."""


def struck(late: float, step: float) -> tuple[Simulation, list[Finding]]:
    """The ball meets a wall at x = AT, and would meet another, which leans, `late` seconds later;
    and what is ambiguous of the order."""
    mapping = oscillator(method="rk4", step=step, duration=0.12)
    meets = np.array([AT, 0.0, RADIUS])
    upright = meets - RADIUS * np.array([1.0, 0.0, 0.0])
    leaning = meets - (RADIUS + late * SPEED * LEAN[0]) * LEAN
    for name, point, normal in (("wall", upright, [1.0, 0.0, 0.0]), ("lean", leaning, LEAN)):
        surface = {"type": "plane", "point": list(point), "normal": list(normal)}
        mapping["constraints"][name] = {"type": "contact", "body": "ball", "surface": surface}
    simulation = Simulation(load_scene(mapping))
    run = simulation.run(watched=False)
    found = found_in(run.block, effort_of(simulation), 100.0, 1.0)
    return simulation, [finding for finding in found if finding.what == ORDER]


def test_an_order_that_steps_decide_is_told_with_a_finer_step() -> None:
    """By the closed form x = REACH cos(W t) long steps are as late at the wall as `off`: what is to
    come half of that later is told, what is to come ten times later is not."""
    simulation, _ = struck(1e-2, LONG)
    (first,) = (event for event in simulation.events if event.kind == "impact")
    off = abs(first.t - np.arccos(AT / REACH) / W)
    assert off > 1e-5
    simulation, told = struck(0.5 * off, LONG)
    (finding,) = told
    assert finding.figure == pytest.approx(LEAN[0] * SPEED / simulation.compiled.system.speed, 1e-3)
    assert finding.t == first.t and finding.finer_step is not None
    assert finding.finer_step < LONG
    for late, step in ((10.0 * off, LONG), (0.5 * off, SHORT)):
        assert not struck(late, step)[1]


AHEAD, FAST = 0.6, 2.0
"""Way [m] and speed [m/s] of the ball that slides freely."""


def both_strike(tolerance: float, later: float) -> tuple[Simulation, list[Finding]]:
    """A ball on a spring, and `later` seconds after it by the closed forms one that slides along y,
    meet the same third ball, which rests; and what is ambiguous of the order."""
    mapping = oscillator(method="dopri853", tolerance=tolerance, duration=0.2)
    meets_at = float(np.arccos(AT / REACH)) / W
    ball = mapping["bodies"]["ball"]
    resting, sliding = [AT - 2.0 * RADIUS, 0.0, RADIUS], [AT - 2.0 * RADIUS, 0.0, RADIUS]
    sliding[1] = -2.0 * RADIUS - FAST * (meets_at + later)
    mapping["bodies"]["target"] = ball | {"position": resting}
    velocity = {"linear_velocity": [0.0, FAST, 0.0]}
    mapping["bodies"]["slider"] = ball | {"position": sliding} | velocity
    surface = {"type": "sphere", "radius": RADIUS}
    for body in ("target", "slider"):
        mapping["constraints"][f"floor_of_{body}"] = {"type": "contact", "body": body}
    for body in ("ball", "slider"):
        contact = {"type": "contact", "body": body, "parent": "target", "surface": surface}
        mapping["constraints"][f"{body}_strikes"] = contact
    simulation = Simulation(load_scene(mapping))
    run = simulation.run(watched=False)
    found = found_in(run.block, effort_of(simulation), 100.0, 1.0)
    return simulation, [finding for finding in found if finding.what == ORDER]


def first_impact(simulation: Simulation) -> tuple[str, float]:
    (event, *_) = (event for event in simulation.events if event.kind == "impact")
    return event.contact, event.t


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_an_order_that_the_tolerance_turns_round_is_told(tolerance: float) -> None:
    """By the closed form the spring's ball is as late as `off`, or as early: what comes half of
    that after it, or before, is taken the other way round.  What comes 1e3 times later is right
    and not told, nor is the same scene with a tolerance 1e4 times smaller."""
    simulation, _ = both_strike(tolerance, 1e-2)
    name, t = first_impact(simulation)
    off = t - float(np.arccos(AT / REACH)) / W
    assert name == "ball_strikes" and abs(off) > 1e-10
    later = 0.5 * off
    wrong, right = (
        ("slider_strikes", "ball_strikes") if off > 0.0 else ("ball_strikes", "slider_strikes")
    )
    simulation, (finding,) = both_strike(tolerance, later)
    assert first_impact(simulation)[0] == wrong
    assert finding.figure == pytest.approx(FAST / simulation.compiled.system.speed, 1e-3)
    assert finding.finer_step is None and "tolerance" in finding.advice
    simulation, told = both_strike(tolerance, 1e3 * abs(off))
    assert first_impact(simulation)[0] == "ball_strikes" and not told
    simulation, told = both_strike(1e-4 * tolerance, later)
    assert first_impact(simulation)[0] == right and not told


@pytest.mark.parametrize("side", ["outside", "inside"])
def test_a_point_that_a_rim_has_not_is_in_no_order(side: str) -> None:
    """A rim has up to two low points on a cylinder, and one where it is steep; the table of
    contacts tells the other at its place, where it would strike at the same instant."""
    radius, tilt = 1.0, 0.4
    disk = {
        "mass": 1.0,
        "shape": {"type": "disk", "radius": 0.1, "axis_B": [0.0, 0.0, 1.0]},
        "position": [0.0, 0.0, 0.2],
        "orientation": {"axis": [0.3, 1.0, 0.0], "angle": tilt},
        "linear_velocity": [0.2, 0.1, -0.5],
    }
    centre = -radius if side == "outside" else radius
    surface = {"type": "cylinder", "radius": radius, "side": side, "axis": [1.0, 0.0, 0.0]}
    contact = {"type": "contact", "body": "disk", "restitution": 0.3}
    scene = {
        "bodies": {"disk": disk},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "constraints": {"on": contact | {"surface": surface | {"point": [0.0, 0.0, centre]}}},
        "simulation": {"duration": 0.15, "rate": 100.0, "tolerance": 1e-10},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    run = simulation.run(watched=False)
    assert "impact" in {event.kind for event in simulation.events}
    assert len(simulation.layout.contacts) == 2
    found = found_in(run.block, effort_of(simulation), 100.0, 1.0)
    assert [finding for finding in found if finding.what == ORDER] == []
