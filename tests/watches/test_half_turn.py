"""A torsion spring that passes half a turn is told, with its name and the time; others are not."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rb_sim.engine.samples import SampleLayout
from rb_sim.finding import Finding
from rb_sim.scene.load import scene_from_mapping
from rb_sim.watches.bounds import Effort
from rb_sim.watches.half_turn import HalfTurns
from rb_sim.watches.watch_list import WatchList
from tests.runs import trajectory

INERTIA = 0.02
TIGHT = Effort("dopri853", None, 1e-10, 100, 0)


def wheel(stiffness: float, spin: float, rate: float, **more: Any) -> dict[str, Any]:
    """A wheel on an axis with a torsion spring."""
    spring = {"type": "torsion_spring", "body": "wheel", "axis_B": [0.0, 0.0, 1.0]}
    start = {"orientation": {"axis": [0.6, 0.0, 0.8], "angle": 1.0}}
    body = {"mass": 1.0, "inertia": [INERTIA] * 3, "angular_velocity": [0.0, 0.0, spin]}
    return {
        "bodies": {"wheel": body | start},
        "constraints": {"axle": {"type": "fixed_axis", "body": "wheel", "axis_B": [0, 0, 1]}},
        "effects": {"coil": spring | {"stiffness": stiffness} | more},
        "simulation": {"duration": 2.0, "rate": rate, "tolerance": 1e-9},
    }


def found(mapping: dict[str, Any]) -> Finding | None:
    """What is said of the spring in the run of a scene."""
    layout = SampleLayout(tuple(mapping["bodies"]), tuple(mapping["constraints"]), (), ())
    watches = WatchList(scene_from_mapping(mapping), layout)
    watches.add(trajectory(mapping), TIGHT)
    return {finding.watch: finding for finding in watches.findings}.get("half turn")


def test_samples_without_an_attitude_end_in_no_error() -> None:
    """As where Euler's steps blow up, at first or between others."""
    mapping = wheel(0.3, reaching(4.0, 0.3), 200.0)
    scene, block = scene_from_mapping(mapping), trajectory(mapping)
    turns = HalfTurns(scene, SampleLayout(("wheel",), ("axle",), (), ()))
    lost = replace(block, orientation=np.zeros_like(block.orientation))
    assert [turns.first(each) for each in (lost, block, lost)] == [None, None, None]
    assert turns.first(block) is None and turns.first(block) is not None


def reaching(angle: float, stiffness: float) -> float:
    """Spin at which the spring brings the wheel to rest at this angle [rad/s]."""
    return angle * math.sqrt(stiffness / INERTIA)


def test_the_first_half_turn_is_told_with_its_time() -> None:
    """theta = (w0 / n) sin(n t), n = sqrt(k / I)."""
    k, over = 0.3, 4.0
    n = math.sqrt(k / INERTIA)
    told = found(wheel(k, reaching(over, k), 200.0))
    assert told is not None and told.where == "coil"
    assert told.t == pytest.approx(math.asin(math.pi / over) / n, abs=2.0 / 200.0)
    assert "torque has jumped" in str(told)


@pytest.mark.parametrize("rate", [40.0, 20.0, 8.0])
def test_the_angle_told_is_that_of_the_sample(rate: float) -> None:
    """From half a turn on the spring pulls on: theta - 2 pi = -pi cos(n s) + (w / n) sin(n s)."""
    k, over = 0.3, 4.0
    n = math.sqrt(k / INERTIA)
    told = found(wheel(k, reaching(over, k), rate))
    assert told is not None
    passed = math.asin(math.pi / over) / n
    w, s = n * math.sqrt(over**2 - math.pi**2), told.t - passed
    angle = 2.0 * math.pi - math.pi * math.cos(n * s) + w / n * math.sin(n * s)
    assert told.figure == pytest.approx(angle, rel=1e-7)


@pytest.mark.parametrize("rate", [200.0, 1.7])
def test_a_spring_that_swings_within_half_a_turn_is_passed_over(rate: float) -> None:
    """Also where samples tell hardly anything of its way."""
    assert found(wheel(4.0, reaching(3.0, 4.0), rate)) is None


def test_turning_with_the_parent_winds_nothing() -> None:
    k, spin = (
        0.1,
        6.0,
    )  # against the other wheel of the same inertia: 2 spin / sqrt(2 k / I) = 3.8 rad
    mapping = wheel(k, spin, 100.0, parent="frame")
    mapping["bodies"]["frame"] = mapping["bodies"]["wheel"]
    mapping["constraints"]["other"] = mapping["constraints"]["axle"] | {"body": "frame"}
    assert found(mapping) is None
    mapping["bodies"]["frame"] = mapping["bodies"]["wheel"] | {"angular_velocity": [0, 0, -spin]}
    assert found(mapping) is not None
