"""What two bodies do relative to each other is told where places leave it few digits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.watches.test_little import findings

FAR = 100.0
"""m/s, so that the pair is 1 km away after ten seconds, where a place rounds to 1.1e-13 m."""


def pair(amplitude: float, drift: float, spin: float = 0.0, **options: Any) -> dict[str, Any]:
    """Two bodies of 1 kg on a spring of 50 N/m, which start `amplitude` further apart than it is
    long; with a spin they turn about each other."""
    bodies = {
        name: {
            "mass": 1.0,
            "inertia": [1.0] * 3,
            "position": [end * 0.5 * (1.0 + amplitude), 0.0, 0.0],
            "linear_velocity": [drift, spin * end * 0.5 * (1.0 + amplitude), 0.0],
        }
        for name, end in (("a", -1.0), ("b", 1.0))
    }
    spring = {"type": "spring", "body": "b", "parent": "a", "stiffness": 50.0, "rest_length": 1.0}
    return {
        "bodies": bodies,
        "effects": {"spring": spring},
        "simulation": {"duration": 10.0, "rate": 20.0} | options,
    }


def test_a_nanometre_between_bodies_far_away_is_told() -> None:
    """Its distance was wrong by 4.5 times the nanometre, without a word."""
    found = findings(pair(1e-9, FAR))["little motion"]
    assert found.where == "b beside a" and found.figure > 1.0 and "tolerance" in found.advice


def test_where_places_round_no_tolerance_is_advised() -> None:
    found = findings(pair(1e-9, FAR, tolerance=1e-14))["little motion"]
    assert "round off" in found.advice


@pytest.mark.parametrize("drift", [0.0, 1.0, FAR])
def test_a_micrometre_has_digits(drift: float) -> None:
    assert "little motion" not in findings(pair(1e-6, drift))


def test_bodies_that_keep_their_distance_are_not_told() -> None:
    """They turn about each other with 1 rad/s: 50 x = (1 + x) / 2."""
    assert "little motion" not in findings(pair(1.0 / 99.0, FAR, 1.0))
    rounded = round(1.0 / 99.0, 10)
    assert "little motion" not in findings(pair(rounded, FAR, 1.0))


@pytest.mark.parametrize("mass", [1.0, 1e-6, 1e-9])
def test_what_a_joint_holds_at_its_distance_is_not_told_however_light(mass: float) -> None:
    """A rod that hangs by its end from the middle of a slider; where that is light, what rounds off
    on the rod moves it by far more than its own roundings."""
    slider = {"mass": mass, "inertia": [0.01 * mass] * 3}
    rod = {"mass": 1.0, "inertia": [0.05, 0.05, 0.025], "position": [0.6 * 0.6, 0.0, -0.6 * 0.8]}
    rod["orientation"] = {"axis": [0.0, 1.0, 0.0], "angle": -0.6435011087932844}  # asin 0.6
    rail = {"type": "translation", "body": "slider"}
    rail["guide"] = {"type": "line", "direction": [1.0, 0.0, 0.0]}
    hinge = {"type": "fixed_axis", "body": "rod", "parent": "slider", "point_B": [0.0, 0.0, 0.6]}
    hinge |= {"axis_B": [0.0, 1.0, 0.0], "axis_A": [0.0, 1.0, 0.0], "point_A": [0.0, 0.0, 0.0]}
    scene = {
        "bodies": {"slider": slider, "rod": rod},
        "constraints": {"rail": rail, "hinge": hinge},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 1.0, "rate": 50.0, "project_initial": True},
    }
    assert "little motion" not in findings(scene)


def welded(seed: int) -> dict[str, Any]:
    """A foot welded to the ground, an arm welded to it that carries a load, at rest but for the
    rounding of speeds that somebody has computed."""
    random = np.random.default_rng(seed)
    bodies = {
        name: {
            "mass": 2.0,
            "inertia": [0.1, 0.2, 0.25],
            "center_of_mass": random.normal(size=3).tolist(),
            "position": random.normal(size=3).tolist(),
            "orientation": {"axis": random.normal(size=3).tolist(), "angle": 1.0},
            "linear_velocity": (1e-17 * random.normal(size=3)).tolist(),
        }
        for name in ("foot", "arm")
    }
    welds = {"foot": {"type": "weld", "body": "foot"}}
    welds["arm"] = {"type": "weld", "body": "arm", "parent": "foot"}
    load = {"type": "wrench", "body": "arm", "force": [5.0, 3.0, -2.0]}
    return {
        "bodies": bodies,
        "constraints": welds,
        "effects": {"weight": {"type": "gravity"}, "load": load},
        "simulation": {"duration": 0.5, "rate": 10.0, "tolerance": 1e-12},
    }


def test_what_is_welded_at_rest_moves_by_no_more_than_rounding() -> None:
    """Half of such structures were told to move apart by a few digits."""
    assert not [seed for seed in range(12) if "little motion" in findings(welded(seed))]
