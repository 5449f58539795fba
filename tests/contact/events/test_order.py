"""Impacts whose order hangs on the length of the steps are told, with a step that tells it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.diagnostic import Finding
from rb_sim.checks.bounds import effort_of
from rb_sim.checks.effort import found_in
from rb_sim.contact.events.shares import ORDER
from rb_sim.contact.problem.order import shares_a_body
from rb_sim.mechanics.systems.many_bodies import BODY, PARENT
from tests.contact.events.test_missed import REACH, W, oscillator
from tests.contact.scenes import touch

AT, RADIUS = -0.1, 0.1
SPEED = W * (REACH**2 - AT**2) ** 0.5
LEAN = np.array([0.6, 0.8, 0.0])
LONG, SHORT = 2e-2, 1e-3
"""Steps [s]."""


def ran(mapping: dict[str, Any]) -> tuple[Simulation, list[Finding]]:
    """The run of the scene, and what is ambiguous of the order of impacts."""
    simulation = Simulation(load_scene(mapping), announce=None)
    run = simulation.run(watched=False)
    found = found_in(run.block, effort_of(simulation), 100.0, 1.0)
    return simulation, [finding for finding in found if finding.what == ORDER]


def struck(
    late: float, step: float, first: Any = (1.0, 0.0, 0.0), second: Any = LEAN, mu: float = 0.0
) -> tuple[Simulation, list[Finding]]:
    """The ball meets a wall of normal `first` at x = AT, and would meet another, of normal
    `second`, `late` seconds later; and what is ambiguous of the order."""
    mapping = oscillator(method="rk4", step=step, duration=0.12)
    meets = np.array([AT, 0.0, RADIUS])
    for name, normal, wait in (("wall", first, 0.0), ("lean", second, late)):
        n = np.array(normal)
        point = meets - (RADIUS + wait * SPEED * n[0]) * n
        surface = {"type": "plane", "point": point.tolist(), "normal": n.tolist()}
        mapping["constraints"][name] = touch("ball", mu, surface=surface)
    return ran(mapping)


def test_an_order_that_steps_decide_is_told_with_a_finer_step() -> None:
    """By the closed form x = REACH cos(W t) long steps are as late at the wall as `off`: what is to
    come half of that later is told, what is to come ten times later is not.  The wall that stands
    upright alone stops the ball; after the one that leans it goes on along both, at
    LEAN_x LEAN_y SPEED."""
    simulation, _ = struck(1e-2, LONG)
    (first,) = (event for event in simulation.events if event.kind == "impact")
    off = abs(first.t - np.arccos(AT / REACH) / W)
    assert off > 1e-5
    simulation, told = struck(0.5 * off, LONG)
    (finding,) = told
    differs = LEAN[0] * LEAN[1] * SPEED
    assert finding.figure == pytest.approx(differs / simulation.compiled.system.speed, 1e-3)
    assert finding.t == first.t and finding.finer_step is not None
    assert finding.finer_step < LONG
    for late, step in ((10.0 * off, LONG), (0.5 * off, SHORT)):
        assert not struck(late, step)[1]


FAST = 2.0
"""Speed of the ball that slides freely [m/s]."""
ASIDE, ACROSS = np.array([-0.6, 0.8, 0.0]), np.array([0.0, 1.0, 0.0])
"""Ways that it goes."""


def both_strike(
    tolerance: float, later: float, way: np.ndarray = ASIDE
) -> tuple[Simulation, list[Finding]]:
    """A ball on a spring, and `later` seconds after it by the closed forms one that slides freely,
    meet the same third ball, which rests; and what is ambiguous of the order."""
    mapping = oscillator(method="dopri853", tolerance=tolerance, duration=0.2)
    meets_at = float(np.arccos(AT / REACH)) / W
    ball = mapping["bodies"]["ball"]
    resting = np.array([AT - 2.0 * RADIUS, 0.0, RADIUS])
    sliding = resting - (2.0 * RADIUS + FAST * (meets_at + later)) * way
    mapping["bodies"]["target"] = ball | {"position": resting.tolist()}
    velocity = {"linear_velocity": (FAST * way).tolist()}
    mapping["bodies"]["slider"] = ball | {"position": sliding.tolist()} | velocity
    surface = {"type": "sphere", "radius": RADIUS}
    for name in ("target", "slider"):
        mapping["constraints"][f"floor_of_{name}"] = touch(name)
    for name in ("ball", "slider"):
        strikes = touch(name, parent="target", surface=surface)
        mapping["constraints"][f"{name}_strikes"] = strikes
    return ran(mapping)


def first_impact(simulation: Simulation) -> tuple[str, float]:
    (event, *_) = (event for event in simulation.events if event.kind == "impact")
    return event.contact, event.t


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_an_order_that_the_tolerance_turns_round_is_told(tolerance: float) -> None:
    """By the closed form the spring's ball is as late as `off`, or as early: what comes half of
    that after it, or before, is taken the other way round.  What comes 1e3 times later is right
    and not told, nor is the same scene with a tolerance 1e4 times smaller.

    Struck by the spring's ball first, the third one runs on at SPEED/2, and the slider gains on it
    at ASIDE_x SPEED/2 less: it loses half of that less than where it strikes what rests."""
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
    differs = -0.25 * ASIDE[0] * SPEED
    assert finding.figure == pytest.approx(differs / simulation.compiled.system.speed, 1e-3)
    assert finding.finer_step is None and "tolerance" in finding.advice
    simulation, told = both_strike(tolerance, 1e3 * abs(off))
    assert first_impact(simulation)[0] == "ball_strikes" and not told
    simulation, told = both_strike(1e-4 * tolerance, later)
    assert first_impact(simulation)[0] == right and not told


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_impacts_across_each_other_are_the_same_in_both_orders(tolerance: float) -> None:
    """The order is wrong, and of no account: a smooth push along x does not change what goes along
    y, and both pairs of equal balls part their speed."""
    simulation, _ = both_strike(tolerance, 1e-2)
    off = first_impact(simulation)[1] - float(np.arccos(AT / REACH)) / W
    simulation, told = both_strike(tolerance, 0.5 * off, ACROSS)
    first = "slider_strikes" if off > 0.0 else "ball_strikes"
    assert first_impact(simulation)[0] == first
    assert told == []
    meets_at, end = float(np.arccos(AT / REACH)) / W, simulation.time
    velocity = np.array([-0.5 * SPEED, 0.5 * FAST, 0.0])
    place = np.array([AT - 2.0 * RADIUS, 0.0, RADIUS]) + velocity * (end - meets_at)
    found = np.array(simulation.sample().position["target"])
    assert np.abs(found - place).max() < 100.0 * tolerance


@pytest.mark.parametrize(("mu", "both"), [(0.0, False), (0.5, True)])
def test_walls_across_each_other_tell_their_order_by_friction_alone(mu: float, both: bool) -> None:
    """Smooth, each takes its part of the velocity, whichever is first; rough, the first one decides
    which way the ball spins."""
    walls = np.array([[0.6, 0.8, 0.0], [0.8, -0.6, 0.0]])
    simulation, _ = struck(1e-2, LONG, *walls, mu=mu)
    (first, *_) = (event for event in simulation.events if event.kind == "impact")
    off = abs(first.t - np.arccos(AT / REACH) / W)
    _, told = struck(0.5 * off, LONG, *walls, mu=mu)
    assert bool(told) == both


@pytest.mark.parametrize("side", ["outside", "inside"])
@pytest.mark.parametrize("impacts", ["together", "one_by_one"])
def test_a_point_that_a_rim_has_not_is_in_no_order(side: str, impacts: str) -> None:
    """A rim has up to two low points on a cylinder, and one where it is steep; the table of
    contacts tells the other at its place, where it would strike at the same instant.
    One by one, orders are not compared."""
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
    mapping = {
        "bodies": {"disk": disk},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "constraints": {"on": contact | {"surface": surface | {"point": [0.0, 0.0, centre]}}},
        "simulation": {"duration": 0.15, "rate": 100.0, "tolerance": 1e-10, "impacts": impacts},
    }
    simulation, told = ran(mapping)
    assert "impact" in {event.kind for event in simulation.events}
    assert len(simulation.layout.contacts) == 2
    assert told == []


def test_contacts_share_bodies_but_not_the_world() -> None:
    ends = [(0, -1), (1, -1), (1, 0), (2, 0), (3, 2), (2, 3)]
    lines = np.zeros((len(ends), 8), np.int64)
    lines[:, [BODY, PARENT]] = ends
    system = SimpleNamespace(lines=lines, joints=0, first_row=np.arange(len(ends)))
    for c, one in enumerate(ends):
        for i, other in enumerate(ends):
            bodies = (set(one) & set(other)) - {-1}
            assert shares_a_body(system, c, i) == bool(bodies), (one, other)
