"""A torsion spring that passes half a turn is told, with its name and the time; others are not."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.base.diagnostic import Finding
from rb_sim.checks.bounds import Effort
from rb_sim.checks.check_list import WatchList
from rb_sim.checks.half_turn import HalfTurns, halves, halves_of
from rb_sim.mechanics.samples import SampleLayout
from rb_sim.scene.load import scene_from_mapping
from tests.checks.blocks import Block
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
    assert "torque has changed sign" in str(told)


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


@pytest.mark.parametrize("with_parent", [False, True])
def test_half_of_the_angle_beside_scipy(with_parent: bool) -> None:
    """(cos, sin) of it, from quaternions of both bodies, up to a common sign."""
    q, p, first = (Rotation.random(5, random_state=seed) for seed in (1, 2, 3))
    before, axis = first[0], np.array([2.0, -1.0, 2.0]) / 3.0
    effect: Any = SimpleNamespace(axis_B=axis)
    ways = halves_of(effect, 0 if with_parent else None, before)
    found = halves(ways, q.as_quat(), p.as_quat() if with_parent else None)
    turn = before.inv() * (p.inv() * q if with_parent else q)
    wanted = np.stack([turn.as_quat()[:, 3], turn.as_quat()[:, :3] @ axis])
    signs = np.sign((found * wanted).sum(axis=0))
    np.testing.assert_allclose(found * signs, wanted, atol=1e-14)


def two_wheels(parent: str | None) -> tuple[Any, SampleLayout]:
    """Wheels a and b with springs from one that stands, or from the world."""
    body = {"mass": 1.0, "inertia": [INERTIA] * 3}
    start = {"orientation": {"axis": [0.6, 0.0, 0.8], "angle": 1.0}}
    spring = {"type": "torsion_spring", "axis_B": [0.0, 0.0, 1.0], "stiffness": 1e-3}
    spring |= {} if parent is None else {"parent": parent}
    scene = {
        "bodies": {"a": body | start, "b": body | start, "frame": body | start},
        "effects": {"coil_a": spring | {"body": "a"}, "coil_b": spring | {"body": "b"}},
    }
    return scene_from_mapping(scene), SampleLayout(("a", "b", "frame"), (), (), ())


def spun(t: np.ndarray, rates: tuple[float, ...]) -> Any:
    """Samples of wheels that turn evenly about their own z from the start."""
    start = Rotation.from_rotvec(np.array([0.6, 0.0, 0.8]))
    turns = [(start * Rotation.from_rotvec(np.outer(t, [0, 0, w]))).as_quat() for w in rates]
    spin = np.zeros((len(t), len(rates), 3))
    spin[:, :, 2] = rates
    energy = np.full(len(t), 1.0)
    return Block(
        t, orientation=np.stack(turns, axis=1), angular_velocity=spin, kinetic_energy=energy
    )


@pytest.mark.parametrize("cut", [3, 15, 16, 17])
@pytest.mark.parametrize("parent", [None, "frame"])
@pytest.mark.parametrize("rates", [(1.0, -2.0, 0.0), (-2.0, 1.0, 0.0), (1.0, -2.0, 0.25)])
def test_the_first_of_two_springs_is_told_wherever_blocks_end(
    cut: int, parent: str | None, rates: tuple[float, ...]
) -> None:
    """Half a turn is passed at pi over the rate beside the parent's; samples are 0.1 s apart."""
    (scene, layout), t = two_wheels(parent), 0.1 * np.arange(40)
    watch = HalfTurns(scene, layout)
    beside = [abs(w - (rates[2] if parent else 0.0)) for w in rates[:2]]
    fastest = int(np.argmax(beside))
    sample = int(np.ceil(10.0 * math.pi / beside[fastest]))
    found = [watch.first(spun(part, rates)) for part in (t[:cut], t[cut:])]
    assert found[0] is None or sample < cut
    name, at, angle = found[sample >= cut]
    assert name == ("coil_a", "coil_b")[fastest] and at == pytest.approx(0.1 * sample)
    assert angle == pytest.approx(0.1 * sample * beside[fastest], rel=1e-12)
