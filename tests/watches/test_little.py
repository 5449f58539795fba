"""A motion that is little for its tolerance is told, where nothing else holds it to its digits."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest

from rb_sim import Simulation, load_scene
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.watch_list import WatchList


def findings(mapping: dict[str, Any], duration: float | None = None) -> dict[str, Any]:
    """By watch, of a run of the scene."""
    simulation = Simulation(load_scene(mapping), announce=None)
    options = simulation.scene.simulation
    watches = WatchList(simulation.scene, simulation.layout, simulation.compiled)
    for block in simulation.blocks(duration or options.duration, options.rate):
        watches.add(block, partial(effort_of, simulation))
    watches.finish()
    return {finding.watch: finding for finding in watches.findings}


def shaken(force: float, **options: Any) -> dict[str, Any]:
    """A rod on a hinge that a force shakes: a law of the time, so that nothing holds it."""
    return {
        "bodies": {"rod": {"mass": 1.0, "inertia": [0.1] * 3, "position": [0, 0, -1.0]}},
        "constraints": {
            "hinge": {
                "type": "fixed_axis", "body": "rod", "point_B": [0, 0, 1], "axis_B": [0, 1, 0],
            }
        },
        "effects": {
            "weight": {"type": "gravity", "acceleration": [0, 0, -9.81]},
            "shake": {
                "type": "wrench", "body": "rod", "sine_force": [force, 0, 0],
                "angular_frequency": 2.0,
            },
        },
        "simulation": {"duration": 5.0, "rate": 50.0} | options,
    }  # fmt: skip


def test_a_motion_of_a_nanometre_in_a_law_of_the_time_is_told() -> None:
    found = findings(shaken(1e-8))["little motion"]
    assert found.where == "rod" and found.figure > 1e-2
    assert "tolerance" in found.advice
    assert "little motion" not in findings(shaken(1e-8, tolerance=1e-13))


@pytest.mark.parametrize("force", [0.0, 1e-3, 1.0])
def test_rest_and_motions_with_digits_are_not(force: float) -> None:
    assert not findings(shaken(force))


def test_what_is_held_to_its_motion_is_not() -> None:
    swing = shaken(0.0)
    del swing["effects"]["shake"]
    swing["bodies"]["rod"]["angular_velocity"] = [0, 1e-9, 0]
    swing["bodies"]["rod"]["linear_velocity"] = [-1e-9, 0, 0]
    assert not findings(swing)


def test_a_fixed_step_is_not() -> None:
    assert "little motion" not in findings(shaken(1e-8, method="rk4", step=1e-2))


def test_a_ball_that_settles_on_the_floor_is_not() -> None:
    """It is put there by ten digits, and falls by the eleventh."""
    ball = {
        "mass": 1.0,
        "shape": {"type": "sphere", "radius": 0.1},
        "position": [0, 0, 0.10000000003],
    }
    scene = {
        "bodies": {"ball": ball},
        "constraints": {"floor": {"type": "contact", "body": "ball"}},
        "effects": {"weight": {"type": "gravity", "acceleration": [0, 0, -9.81]}},
        "simulation": {"duration": 0.5, "rate": 50.0},
    }
    assert not findings(scene)


def test_the_rounding_of_a_weight_is_no_error_of_a_swing() -> None:
    """A rod of 10 N that swings by a micrometre exchanges 1e-12 J, of which a rounding is 1e-3."""
    swing = shaken(0.0)
    del swing["effects"]["shake"]
    swing["bodies"]["rod"]["angular_velocity"] = [0, 1e-6, 0]
    swing["bodies"]["rod"]["linear_velocity"] = [-1e-6, 0, 0]
    assert not findings(swing)


@pytest.mark.parametrize(
    ("amplitude", "rubs", "told"),
    [
        (1e-5, True, False),
        (1e-8, True, True),
        (1e-8, False, True),
        (4e-10, True, True),
        (4e-10, False, True),
        (1e-11, True, True),
    ],
)
def test_a_little_motion_in_contact_is_told(amplitude: float, rubs: bool, told: bool) -> None:
    """A ball that swings in a bowl, of 1e-8 m wrong by 7e-3 of it and of 4e-10 m by 0.19; unlike
    what settles by as little, it goes on."""
    deep = (0.9**2 - amplitude**2) ** 0.5
    shape = {"type": "sphere", "radius": 0.1}
    bowl = {"type": "sphere", "center": [0, 0, 0], "radius": 1.0, "side": "inside"}
    contact: dict[str, Any] = {"type": "contact", "body": "ball", "surface": bowl}
    if rubs:
        contact["friction"] = {"type": "coulomb", "static": 0.5}
    scene = {
        "bodies": {"ball": {"mass": 1.0, "shape": shape, "position": [amplitude, 0.0, -deep]}},
        "constraints": {"bowl": contact},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 3.0, "rate": 50.0},
    }
    assert ("little motion" in findings(scene)) == told


@pytest.mark.parametrize(("force", "told"), [(3.0, False), (0.1, True)])
def test_a_coarse_tolerance_is_told_of_little_motions_only(force: float, told: bool) -> None:
    """A step may err by 1e-3 m, as was asked for: of half a metre to and fro that leaves three
    digits, of some centimetres (theta = F / 5.4 N, small) two."""
    assert ("little motion" in findings(shaken(force, tolerance=1e-3))) == told


def damped(tolerance: float) -> dict[str, Any]:
    """A sphere that honey stops within a micrometre, and in which it then sinks by 20 in 2 s."""
    return {
        "bodies": {
            "ball": {"mass": 1.0, "inertia": [0.1] * 3, "linear_velocity": [1.0, 0.0, 0.0]},
        },
        "effects": {
            "honey": {"type": "linear_drag", "body": "ball", "coefficient": 1e6},
            "weight": {"type": "gravity", "acceleration": [0, 0, -9.81]},
        },
        "simulation": {"duration": 2.0, "rate": 10, "method": "auto", "tolerance": tolerance},
    }


@pytest.mark.filterwarnings("error:overflow")  # of trials in steps too long: none of the user's
def test_of_a_choice_of_auto_counts_what_it_keeps() -> None:
    """Its own tolerance is a thousand times the error that it measured, and no user's to change."""
    assert not findings(damped(1e-9))
    coarse = findings(damped(1e-6))["little motion"]
    advised = float(coarse.advice.split()[-1])
    fall = 9.81e-6 * 2.0
    assert 0.5e-3 * fall < advised < 2e-3 * fall  # one digit is told
    assert not findings(damped(0.5 * advised))
