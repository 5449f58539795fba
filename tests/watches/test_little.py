"""A motion that is little for its tolerance is told, where nothing else holds it to its digits."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.finding import Finding
from rb_sim.watches.bounds import Effort, effort_of
from rb_sim.watches.little import Little
from rb_sim.watches.watch_list import WatchList
from tests.watches.blocks import Block


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


def moved(places: Any, turns: Any, effort: Effort, **scene: Any) -> Finding | None:
    """What the watch says of bodies at these places (n, N, 3) that turned by angles (n, N) about an
    axis, in two blocks."""
    places, half = np.array(places, dtype=float), 0.5 * np.array(turns, dtype=float)
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    attitudes = np.concatenate((np.sin(half)[..., None] * axis, np.cos(half)[..., None]), axis=2)
    watch = Little(cast(Any, SimpleNamespace(constraints=scene)))
    cut = len(places) // 2
    for part in (slice(0, cut), slice(cut, None)):
        block: Any = Block(
            range(len(places[part])), position=places[part], orientation=attitudes[part]
        )
        watch.add(block, effort)
    return watch.found(7.0, effort, ("a", "b"))


FINE = Effort("dopri853", None, 1e-9, 100, 0, local=1e-9)
"""A motion below 1e-6 m leaves a step an error of a thousandth."""
RISE = np.array([0.0, 0.7, 0.2, 1.0, 0.4, 0.3])[:, None]
"""The whole way is that to the fourth sample."""


@pytest.mark.parametrize(
    ("way", "turn", "figure"),
    [
        (1e-7, 0.0, 3e-2),  # three metres away a step may err by 3e-9 m
        (3.1e-6, 0.0, None),
        (2.9e-6, 0.0, 3.0 / 2.9e3),
        (0.0, 1e-7, 3e-2),
        (1e-7, 2e-8, 15e-2),  # of both the smaller
        (1e-5, 0.9e-7, None),  # but what is nothing beside the other may be error
        (1e-5, 1.1e-7, 3.0 / 110.0),
        (2.9e-12, 0.0, None),  # rounding
        (3.1e-12, 0.0, 3e3 / 3.1),
    ],
)
def test_a_little_motion_by_its_whole_way(way: float, turn: float, figure: float | None) -> None:
    """Along z, of a body 3 m away; another one goes its ways."""
    places = np.zeros((6, 2, 3))
    places[:, 0] = np.hstack([np.full((6, 1), 3.0), np.zeros((6, 1)), way * RISE])
    places[:, 1] = np.hstack([np.zeros((6, 2)), RISE])
    turns = np.hstack([turn * RISE, RISE])
    found = moved(places, turns, FINE)
    if figure is None:
        assert found is None
        return
    assert found is not None and (found.where, found.t, found.bound) == ("a", 7.0, 1e-3)
    assert found.figure == pytest.approx(figure, rel=1e-3)
    assert found.advice == f"try a tolerance below {1e-12 / figure:.0e}"
    assert moved(places, turns, FINE._replace(held=frozenset({"a"}))) is None
    assert moved(places, turns, FINE._replace(local=0.0)) is None


@pytest.mark.parametrize(("late", "told"), [(0.0, False), (4e-12, False), (1e-11, True)])
def test_what_settles_on_a_contact_is_not_told_and_what_goes_on_there_is(
    late: float, told: bool
) -> None:
    """5e-10 m in the first samples, as numbers of ten digits put it there; later less than a
    hundredth of that, or more. Without a contact it is told in any case."""
    places, turns = np.zeros((6, 2, 3)), np.zeros((6, 2))
    places[0, :, 2], places[5, :, 2], places[:, 1, 0] = 5e-10, late, RISE[:, 0]
    touches = SimpleNamespace(type="contact", body="a", parent=None)
    assert (moved(places, turns, FINE, floor=touches) is not None) is told
    assert moved(places, turns, FINE) is not None
    touches.body, touches.parent = "b", "a"
    assert (moved(places, turns, FINE, floor=touches) is not None) is told


def test_the_worst_of_two_is_told() -> None:
    places = np.zeros((6, 2, 3))
    places[:, :, 2] = RISE * [1e-7, 1e-8]
    found = moved(places, np.zeros((6, 2)), FINE)
    assert found is not None and found.where == "b" and found.figure == pytest.approx(0.1)
    assert moved(places * 1e3, np.zeros((6, 2)), FINE) is None
    assert Little(cast(Any, SimpleNamespace(constraints={}))).found(1.0, FINE, ("a",)) is None
