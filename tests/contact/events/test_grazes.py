"""An impact that step or tolerance may have missed is told: a gap came near zero, no more."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.contact.toss_scenes import toss
from rb_sim import Simulation, load_scene
from rb_sim.base.diagnostic import Finding
from rb_sim.catalogue.geometry.corners_and_rims import ABSENT
from rb_sim.checks.bounds import effort_of
from rb_sim.checks.effort import found_in
from rb_sim.contact.events.shares import GRAZE
from rb_sim.contact.problem.order import (
    GRAZES_WIDTH,
    MISSED_WIDTH,
    WAY,
    Doubts,
    error_beside,
    error_of,
    error_of_gap,
    held_beside,
)
from rb_sim.mechanics.contact.contact_table import (
    CLOSED,
    LEVELS_BEFORE,
    POINT,
    SENSE,
    SLOPES_BEFORE,
)
from tests.contact.events.test_dips import past_corner
from tests.contact.events.test_missed import REACH, W, oscillator
from tests.contact.scenes import body, scene, touch

RADIUS = 0.1
OVERLAPS = [10.0**-k for k in range(3, 14)]
"""By which the ball would go into the wall where it turns [m]."""
SETTINGS = [
    {"method": "dopri853", "tolerance": 1e-4},
    {"method": "dopri853", "tolerance": 1e-6},
    {"method": "dopri853", "tolerance": 1e-8},
    {"method": "rk4", "step": 0.02},
    {"method": "rk4", "step": 0.005},
    {"method": "gauss6", "step": 0.02},
]


def of_setting(setting: dict[str, Any]) -> str:
    """Of a test."""
    return "-".join(map(str, setting.values()))


def ran(mapping: dict[str, Any]) -> tuple[Simulation, list[Finding]]:
    """The run of the scene, and what it says of impacts that may be missed."""
    simulation = Simulation(load_scene(mapping), announce=None)
    run = simulation.run(watched=False)
    found = found_in(run.block, effort_of(simulation), 100.0, 1.0)
    return simulation, [finding for finding in found if finding.what == GRAZE]


def turning(overlap: float, **setting: Any) -> dict[str, Any]:
    """The ball on a spring turns at x = -REACH, `overlap` beyond where it meets a wall."""
    mapping = oscillator(**setting) | {}
    mapping["simulation"]["duration"] = 1.5 * np.pi / W
    point = [overlap - REACH - RADIUS, 0.0, 0.0]
    surface = {"type": "plane", "point": point, "normal": [1.0, 0.0, 0.0]}
    mapping["constraints"]["wall"] = {"type": "contact", "body": "ball", "surface": surface}
    return mapping


@pytest.mark.parametrize("setting", SETTINGS[:-1], ids=of_setting)
def test_no_graze_is_missed_without_a_word(setting: dict[str, Any]) -> None:
    """By x = REACH cos(W t) the ball strikes at W sqrt(2 REACH overlap)."""
    missed = 0
    for overlap in OVERLAPS:
        simulation, told = ran(turning(overlap, **setting))
        if any(event.kind == "impact" for event in simulation.events):
            assert not told
            continue
        strikes = W * (2.0 * REACH * overlap) ** 0.5 / simulation.compiled.system.speed
        if strikes > effort_of(simulation).outcome_bound:
            missed += 1
            (finding,) = told
            assert finding.where == "wall"
            assert finding.figure > strikes
            assert finding.t == pytest.approx(np.pi / W, abs=2e-2)
    assert missed > 0


@pytest.mark.parametrize("setting", SETTINGS, ids=of_setting)
@pytest.mark.parametrize("overlap", [1e-3, 1e-2, 1e-1])
def test_what_turns_round_within_a_step_strikes_before(
    overlap: float, setting: dict[str, Any]
) -> None:
    """At the step's end it may move as slowly as one likes, and has been there faster."""
    simulation, told = ran(turning(overlap, **setting))
    (strike,) = (event for event in simulation.events if event.kind == "impact")
    at = (np.pi - np.arccos(1.0 - overlap / REACH)) / W
    assert strike.t == pytest.approx(at, rel=3e-3)
    assert told == []


@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-4, 1e-6])
@pytest.mark.parametrize(("beside", "radius"), [(0.0, 0.1), (0.05, 0.02), (0.11, 0.02)])
def test_what_swings_over_within_a_step_strikes_what_is_between(
    beside: float, radius: float, tolerance: float
) -> None:
    """From rest to rest, far from the post at both ends, which half a period is one step for."""
    mapping = oscillator(method="dopri853", tolerance=tolerance, duration=1.02 * np.pi / W)
    surface = {"type": "sphere", "radius": radius, "center": [0.0, beside, RADIUS]}
    mapping["constraints"]["post"] = {"type": "contact", "body": "ball", "surface": surface}
    simulation, _ = ran(mapping)
    strikes = [event.t for event in simulation.events if event.kind == "impact"]
    meets = ((RADIUS + radius) ** 2 - beside**2) ** 0.5
    assert strikes[:1] == pytest.approx([np.arccos(meets / REACH) / W], rel=1e-5)


@pytest.mark.parametrize("setting", SETTINGS, ids=of_setting)
def test_a_wall_that_is_surely_not_met_is_not_told(setting: dict[str, Any]) -> None:
    assert ran(turning(-3e-2, **setting))[1] == []


def test_a_step_that_hardly_moves_the_gap_tells_it_as_well() -> None:
    """Euler falls short of the top of a throw by g h t/2 = 1 mm, and steps there by micrometres."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": RADIUS}}
    up, g, h = 2.0, 9.81, 1e-3
    off = 0.5 * h * up
    for above, told in ((-0.5 * off, True), (2.0 * off, False)):
        surface = {
            "type": "plane",
            "point": [0.0, 0.0, 0.5 * up * up / g + RADIUS + above],
            "normal": [0.0, 0.0, -1.0],
        }
        mapping = {
            "bodies": {"ball": ball | {"linear_velocity": [0.3, 0.0, up]}},
            "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -g]}},
            "constraints": {"ceiling": {"type": "contact", "body": "ball", "surface": surface}},
            "simulation": {"method": "euler", "step": h, "duration": 0.35, "rate": 100.0},
        }
        simulation, found = ran(mapping)
        assert not simulation.events
        assert bool(found) == told
        if told:  # the gap is half of what places may be wrong by, as the top is reached
            strikes = (2.0 * g * 0.5 * off) ** 0.5 / simulation.compiled.system.speed
            assert found[0].figure == pytest.approx(strikes, rel=0.1)


@pytest.mark.parametrize("spin", [0.0, 1.0])
def test_a_corner_that_passes_an_edge_is_told(spin: float) -> None:
    """The nearest face changes there: the gap, which falls by a part of 1 m/s, has a kink."""
    for beside, tolerance, told in ((1e-7, 1e-6, True), (1e-7, 1e-10, False), (1e-3, 1e-6, False)):
        mapping, _ = past_corner(1e-4, 1.0, spin)
        (rod,) = (name for name in mapping["bodies"] if name != "cube")
        place = np.array(mapping["bodies"][rod]["position"])
        out = np.array([1e-4 + beside, 0.0, 1e-4 + beside])
        mapping["bodies"][rod]["position"] = (place + out).tolist()
        mapping["simulation"] = {"tolerance": tolerance, "duration": 0.8, "rate": 100.0}
        simulation, found = ran(mapping)
        assert not simulation.events
        assert bool(found) == told
        if told:
            assert 0.1 < found[0].figure <= 1.0


ARM, STIFF, RISE = 0.2, 40.0, 0.3
"""Length of a rod whose end is held [m], a spring at the other [N/m], by how much it points up."""


def swinging(overlap: float, **setting: Any) -> dict[str, Any]:
    """A rod swings about one end, which keeps to the floor, as a pendulum about the way to the
    anchor of a spring; where it turns its other end would be `overlap` below the floor."""
    start = 2.0 * RISE + overlap / ARM
    way = np.array([np.cos(start), 0.0, np.sin(start)])
    rod = body(
        {"type": "rod", "length": ARM, "axis_B": [1.0, 0.0, 0.0]}, [0.5 * ARM * x for x in way]
    )
    rod["orientation"] = {"axis": [0.0, -1.0, 0.0], "angle": start}
    held = touch(friction={"type": "rough"}, mode="bilateral", points=[[-0.5 * ARM, 0.0, 0.0]])
    spring = {"type": "spring", "body": "body", "stiffness": STIFF, "rest_length": 0.0}
    spring["point_B"] = [0.5 * ARM, 0.0, 0.0]
    spring["point_A"] = [np.cos(RISE), 0.0, np.sin(RISE)]
    constraints = {"held": held, "end": touch(points=[[0.5 * ARM, 0.0, 0.0]])}
    mapping = scene(rod, constraints, gravity=False, spring=spring)
    return mapping | {"simulation": {"duration": 0.35, "rate": 100.0} | setting}


def strikes_at(overlap: float) -> float:
    """Speed at which its end strikes, by what the spring has lost [m/s]."""
    fallen = STIFF * ARM * (np.cos(RISE) - np.cos(RISE + overlap / ARM))
    return ARM * (2.0 * fallen / (ARM * ARM / 3.0)) ** 0.5


@pytest.mark.parametrize("setting", SETTINGS[:-1], ids=of_setting)
def test_nor_is_one_of_what_another_point_holds(setting: dict[str, Any]) -> None:
    """Only errors of the angle count there, and they do."""
    kinds = set()
    for overlap in OVERLAPS:
        simulation, told = ran(swinging(overlap, **setting))
        found = any(event.kind == "impact" for event in simulation.events)
        strikes = strikes_at(overlap) / simulation.compiled.system.speed
        if not found and strikes > effort_of(simulation).outcome_bound:
            (finding,) = told
            assert finding.where == "end" and finding.figure > strikes
        kinds.add("found" if found else "told" if told else "slow")
    assert "found" in kinds and len(kinds) > 1


def test_a_rim_that_rolls_nearly_flat_grazes_nothing() -> None:
    """Its points come within 7 mm of the floor, where the tolerance leaves 2 mm of angles, but
    12 mm of places, which the point that holds cannot be wrong by."""
    mapping = toss(773, 151).mapping
    mapping["simulation"]["tolerance"] = 1e-4
    simulation, told = ran(mapping)
    assert told == [] and len(simulation.events) > 3


def test_the_error_of_what_a_point_holds_is_that_of_its_angle() -> None:
    motion: Any = Simulation(load_scene(swinging(-0.05)))._motion
    system, y, allowed = motion.system, motion.coordinates, 1e-6
    system.touch[:, LEVELS_BEFORE], system.touch[:, SLOPES_BEFORE] = 1.0, -1.0
    missed = np.zeros((1, MISSED_WIDTH))
    doubts = Doubts(np.zeros((2, GRAZES_WIDTH)), missed, 0.0, allowed)
    error = error_of_gap(system, doubts, y, 1) * system.length
    assert error == pytest.approx(allowed * ARM, rel=1e-9)
    missed[0, WAY] = 1e-7
    error = error_of_gap(system, doubts, y, 1) * system.length
    assert error == pytest.approx((allowed + 2e-7 / system.length) * ARM, rel=1e-9)
    system.touch[0, CLOSED] = 0.0  # held by nothing
    assert error_of_gap(system, doubts, y, 1) * system.length > allowed


def test_what_leaves_a_floor_is_no_graze() -> None:
    """Drawn up by a force that grows, a ball leaves with no speed: its gap begins at zero."""
    mapping = oscillator(method="dopri853", tolerance=1e-4, duration=0.9)
    mapping["effects"]["crane"] = {
        "type": "wrench",
        "body": "ball",
        "force": [0.0, 0.0, 0.0],
        "sine_force": [0.0, 0.0, 20.0],
        "angular_frequency": 3.0,
    }
    simulation, told = ran(mapping)
    assert [event.kind for event in simulation.events] == ["closes", "opens", "impact"]
    assert told == []


def test_what_bounces_and_comes_to_rest_is_none() -> None:
    mapping = oscillator(method="dopri853", tolerance=1e-6, duration=2.0)
    del mapping["effects"]["spring"]
    mapping["bodies"]["ball"]["position"] = [0.0, 0.0, 0.4]
    mapping["constraints"]["floor"]["restitution"] = 0.6
    simulation, told = ran(mapping)
    assert "rests" in {event.kind for event in simulation.events} or len(simulation.events) > 5
    assert told == []


def test_a_point_that_a_rim_has_not_here_grazes_nothing() -> None:
    """In a trough there is room for two points of a rim, of which one may be none."""
    solid = body({"type": "disk", "radius": 0.15}, [0.0, 0.02, -0.5])
    solid["orientation"] = {"axis": [0.6, 0.8, 0.0], "angle": 1.2}
    trough = {"type": "cylinder", "axis": [1, 0, 0], "radius": 1.0}
    motion: Any = Simulation(load_scene(scene(solid, touch(surface=trough))))._motion
    system, y = motion.system, motion.coordinates
    system.touch[:, LEVELS_BEFORE], system.touch[:, SLOPES_BEFORE] = 1.0, -1.0
    doubts = Doubts(np.zeros((2, GRAZES_WIDTH)), np.zeros((1, MISSED_WIDTH)), 0.0, 1e-6)
    there = system.touch[:, SENSE] != ABSENT
    assert there.tolist().count(True) == 1
    assert [error_of_gap(system, doubts, y, c) > 0.0 for c in range(2)] == there.tolist()


def test_errors_of_a_gap_are_those_of_both_bodies() -> None:
    """Of places, and of angles at the arm to a point that holds; the support is the first body."""
    block = body({"type": "box", "size": [2.0, 2.0, 0.2]}, [3.0, 0.0, 0.0])
    cube = body({"type": "box", "size": [0.2, 0.2, 0.2]}, [3.0, 0.0, 0.2])
    lies = touch("b", mu=0.5, parent="a", surface={"type": "shape"})
    motion: Any = Simulation(load_scene(scene({"a": block, "b": cube}, {"c": lies})))._motion
    system, y, allowed = motion.system, motion.coordinates, 1e-6
    length, far = system.length, np.array([3e-4, 5e-5])
    places = sum(float(np.linalg.norm(y[13 * i : 13 * i + 3])) for i in range(2))
    expected = 3.5e-4 + allowed * (places + 2.0 * length)
    assert error_of(system, far, y, 0, allowed) == pytest.approx(expected, rel=1e-12)
    held = held_beside(system, 0)
    assert held > 0 and system.touch[held, CLOSED] == 1.0
    arm = np.linalg.norm(np.subtract(*system.touch[[0, held], POINT : POINT + 3]))
    angle = 2.0 * allowed + 3.5e-4 / length
    found = error_beside(system, far, y, 0, held, allowed)
    assert found == pytest.approx(angle * arm, rel=1e-12)
