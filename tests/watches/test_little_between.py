"""What two bodies do relative to each other is told where places leave it few digits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim.watches import little_between
from rb_sim.watches.bounds import Effort
from tests.watches.blocks import Block
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


FINE = Effort("dopri853", None, 1e-9, 100, 0, local=1e-9)


def parted(
    monkeypatch: pytest.MonkeyPatch, ways: list[float], far: float, effort: Effort = FINE
) -> Any:
    """What is said of bodies 1, 2 ... that part from body 0 by so much, so far away along y."""
    count = len(ways)
    pairs = tuple((k + 1, 0) for k in range(count))
    monkeypatch.setattr(little_between, "pairs_that_part", lambda compiled: pairs)
    watch = little_between.LittleBetween(None)
    share = np.array([0.0, 0.6, 1.0, 0.2, 0.5, 0.1])
    places = np.zeros((6, 1 + count, 3))
    places[:, :, 1] = far
    places[:, 1:, 0] = 2.0 + share[:, None] * ways
    for part in (slice(0, 3), slice(3, 6)):
        watch.add(Block(share[part], position=places[part]), effort)  # type: ignore[arg-type]
    return watch.found(5.0, effort, tuple("abcd")[: 1 + count])


@pytest.mark.parametrize(
    ("way", "far", "figure"),
    [
        (0.9e-6, 0.0, 2e-9 / 0.9e-6),  # two metres away
        (2.1e-6, 0.0, None),
        (1e-6, 3.0, np.hypot(2.0, 3.0) * 1e-3),
        (1e-9, 0.0, 2.0),
    ],
)
def test_a_distance_that_changes_by_little_for_the_tolerance(
    monkeypatch: pytest.MonkeyPatch, way: float, far: float, figure: float | None
) -> None:
    """What a step may miss of places, over the whole change of the distance, above a thousandth."""
    found = parted(monkeypatch, [way], far)
    if figure is None:
        assert found is None
        return
    assert (found.where, found.t, found.bound) == ("b beside a", 5.0, 1e-3)
    assert found.figure == pytest.approx(figure, rel=1e-4)
    assert found.advice == f"try a tolerance below {1e-12 / figure:.0e}"
    held = FINE._replace(held=frozenset({"a", "b"}))
    assert parted(monkeypatch, [way], far, held) is None
    assert parted(monkeypatch, [way], far, FINE._replace(held=frozenset({"a"}))) is not None
    assert parted(monkeypatch, [way], far, FINE._replace(local=0.0)) is None


def test_where_places_round_the_distance_says_how_far_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At 1e6 m 16 roundings are 3.6e-9 m: of 1e-7 m too much whatever holds them, of 1e-5 m not.
    What changes by less than one of them is none."""
    held = FINE._replace(held=frozenset("abc"))
    found = parted(monkeypatch, [1e-7], 1e6, held)
    assert found.figure == pytest.approx(16.0 * 2.0**-52 * 1e6 / 1e-7, rel=0.01)
    assert "places 1e+06 m from the origin" in found.advice
    assert parted(monkeypatch, [1e-5], 1e6, held) is None
    assert parted(monkeypatch, [2e-10], 1e6, held) is None
    worst = parted(monkeypatch, [1e-7, 3e-8, 1.0], 1e6, FINE._replace(held=frozenset("abcd")))
    assert worst.where == "c beside a"
