# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What is added as CONTRIBUTING says runs under events and under time stepping alike."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from rb_sim import SceneError, Simulation, Trajectory, load_scene
from rb_sim.accuracy.checks import check_list
from rb_sim.base import errors as diagnostic
from rb_sim.catalogue import constraints, effects
from rb_sim.catalogue.contact import LAWS
from rb_sim.catalogue.surfaces import SURFACES
from tests import adding

G, MASS, SPEED = 10.0, 2.0, 1.0
EVENTS = {"method": "dopri853", "tolerance": 1e-10}
STEPS = {"method": "time_stepping", "step": 1e-3}
BOTH = [pytest.param(EVENTS, 1e-8, id="events"), pytest.param(STEPS, 3e-3, id="time stepping")]
"""Settings, and the error that they leave, relative to the motion: of first order in the step."""


@pytest.fixture(autouse=True)
def listed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The one line of each."""
    monkeypatch.setitem(effects.SPECS, "ramp", adding.Ramp)
    monkeypatch.setitem(constraints.SPECS, "conveyor", adding.Conveyor)
    monkeypatch.setitem(SURFACES, "cone", adding.Cone)
    words = diagnostic.Check("distance from the start [m]", "0.505", "it moves", "hold it")
    monkeypatch.setitem(diagnostic.CHECKS, "leash", words)
    added = (*check_list.CHECKS, (("leash",), adding.leash))
    monkeypatch.setattr(check_list, "CHECKS", added)
    for name, law in (
        ("oil", adding.OilLaw),
        ("weakening", adding.WeakeningLaw),
        ("sideways", adding.SidewaysLaw),
        ("nothing", adding.NothingLaw),
    ):
        monkeypatch.setitem(LAWS, name, law)
    yield


def slab(friction: Any = None, speed: float = SPEED, **more: Any) -> dict[str, Any]:
    """A slab that slides along x on the floor."""
    contact = {"type": "contact", "body": "slab"} | ({"friction": friction} if friction else {})
    return {
        "bodies": {
            "slab": {
                "mass": MASS,
                "shape": {"type": "box", "size": [0.4, 0.4, 0.02]},
                "position": [0.0, 0.0, 0.01],
                "linear_velocity": [speed, 0.0, 0.0],
            }
        },
        "constraints": {"floor": contact} | more.pop("constraints", {}),
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}}
        | more.pop("effects", {}),
        "simulation": {"duration": 1.0, "rate": 100.0} | more,
    }


def run(mapping: dict[str, Any], *sinks: Any) -> Trajectory:
    return Simulation(load_scene(mapping)).run(sinks=sinks)


@pytest.mark.parametrize(("setting", "error"), BOTH)
def test_an_effect(setting: dict[str, Any], error: float) -> None:
    """x = v t + k t^3 / 6 m on a smooth floor, which bears the weight."""
    push = {"type": "ramp", "body": "slab", "rate": 3.0}
    found = run(slab(effects={"push": push}, **setting))
    assert found.position["slab"][-1, 0] == pytest.approx(SPEED + 3.0 / (6.0 * MASS), rel=error)
    assert found.reaction["floor"].force[-1, 2] == pytest.approx(MASS * G, rel=1e-9)


@pytest.mark.parametrize(("setting", "error"), BOTH)
def test_a_constraint(setting: dict[str, Any], error: float) -> None:
    """What drives a slab at constant speed gives what friction takes."""
    drive = {"conveyor": {"type": "conveyor", "body": "slab", "speed": SPEED}}
    rubs = {"type": "coulomb", "static": 0.3}
    found = run(slab(rubs, constraints=drive, **setting))
    assert found.position["slab"][-1, 0] == pytest.approx(SPEED, rel=error)
    assert found.reaction["conveyor"].force[-1, 0] == pytest.approx(0.3 * MASS * G, rel=1e-6)


@pytest.mark.parametrize(("setting", "error"), BOTH)
def test_a_law_of_friction_without_a_corner(setting: dict[str, Any], error: float) -> None:
    """dv/dt = -c g v^2: v = v0 / (1 + c g v0 t)."""
    found = run(slab({"type": "oil", "coefficient": 0.8}, **setting))
    assert found.linear_velocity["slab"][-1, 0] == pytest.approx(SPEED / 9.0, rel=error)
    travelled = math.log(9.0) / (0.8 * G)
    assert found.position["slab"][-1, 0] == pytest.approx(travelled, rel=error)


@pytest.mark.parametrize(("setting", "error"), BOTH)
def test_a_law_of_friction_that_sticks(setting: dict[str, Any], error: float) -> None:
    """ds = -v dv / g mu(v), with mu = (a + b v^2) / (c + v^2): the integral is elementary."""
    law = {"type": "weakening", "static": 0.5, "slow": 0.1, "speed": 0.3}
    found = run(slab(law, **setting))
    static, slow, wide = 0.5, 0.1, 0.3**2  # mu = (slow v^2 + static wide) / (v^2 + wide)
    u, below = SPEED**2, static * wide
    travelled = u / slow + (wide - below / slow) / slow * math.log(1.0 + slow * u / below)
    assert found.position["slab"][-1, 0] == pytest.approx(0.5 * travelled / G, rel=error)
    assert abs(found.linear_velocity["slab"][-1, 0]) < 1e-12
    held = slab(
        law, 0.0, effects={"push": {"type": "ramp", "body": "slab", "rate": 9.0}}, **setting
    )
    assert abs(run(held).position["slab"][-1, 0]) < 1e-9  # 9 N of 10 that it bears


@pytest.mark.parametrize(("setting", "error"), BOTH)
@pytest.mark.parametrize(
    ("law", "taken"),
    [
        ({"type": "oil", "coefficient": 0.05}, 0.05),
        ({"type": "weakening", "static": 0.2, "slow": 0.1, "speed": 1.0}, 0.15),
    ],
)
def test_their_impacts(law: Any, taken: float, setting: dict[str, Any], error: float) -> None:
    """An impact takes mu(v) P, with the slip before it: P = (1 + e) m times the fall."""
    mapping = slab(law, restitution=0.0, **setting)
    mapping["simulation"].pop("restitution")
    body, floor = mapping["bodies"]["slab"], mapping["constraints"]["floor"]
    body |= {"linear_velocity": [SPEED, 0.0, -1.0], "inertia": [1.0, 1.0, 1.0]}
    body.pop("shape")
    floor |= {"points": [[0.0, 0.0, 0.0]], "restitution": 0.5}
    mapping["effects"], mapping["simulation"]["duration"] = {}, 0.1
    found = run(mapping).linear_velocity["slab"][-1]
    assert found[2] == pytest.approx(0.5, rel=1e-9)
    assert found[0] == pytest.approx(SPEED - taken * 1.5, rel=1e-9)


def test_friction_that_a_step_cannot_take_is_refused_by_that_method_alone() -> None:
    law = {"type": "sideways", "coefficient": 0.1}
    turned = run(slab(law, **EVENTS)).linear_velocity["slab"][-1]
    assert math.hypot(*turned[:2]) == pytest.approx(SPEED, rel=1e-8)  # it turns at c g
    assert math.atan2(turned[1], turned[0]) == pytest.approx(0.1 * G, rel=1e-8)
    with pytest.raises(SceneError, match=r"floor.friction.*Sideways.*against the slip.*stepping"):
        run(slab(law, **STEPS))


@pytest.mark.parametrize("setting", [EVENTS, STEPS])
def test_friction_without_a_traction_is_refused(setting: dict[str, Any]) -> None:
    with pytest.raises(SceneError, match=r"floor.friction.*nothing.*static.*traction.register"):
        run(slab({"type": "nothing"}, **setting))


@pytest.mark.parametrize(("setting", "error"), BOTH)
def test_a_pair(setting: dict[str, Any], error: float) -> None:
    """A point runs round a cone at the height v^2/g, pressed by m g / sin(half angle)."""
    half, height = 0.6, 0.5
    radius = height * math.tan(half)
    body = {
        "mass": MASS,
        "inertia": [0.1, 0.1, 0.1],
        "position": [radius, 0.0, height],
        "linear_velocity": [0.0, math.sqrt(G * height), 0.0],
    }
    mapping = slab(**setting) | {"bodies": {"slab": body}}
    floor = mapping["constraints"]["floor"]
    floor |= {"points": [[0.0, 0.0, 0.0]], "surface": {"type": "cone", "half_angle": half}}
    found = run(mapping)
    assert found.position["slab"][:, 2] == pytest.approx(height, rel=error)
    push = found.reaction["floor"].force
    size = (push[1:] ** 2).sum(axis=1) ** 0.5
    assert size == pytest.approx(MASS * G / math.sin(half), rel=4.0 * error)
    assert found.contact_state["floor"].min() > 0


@pytest.mark.parametrize("setting", [EVENTS, STEPS])
def test_a_sink(setting: dict[str, Any]) -> None:
    sink = adding.Last()
    found = run(slab(**setting), sink)
    assert sink.samples == len(found.t) == 101
    assert sink.position["slab"] == found.position["slab"][-1].tolist()


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
@pytest.mark.parametrize("setting", [EVENTS, STEPS])
def test_a_check(setting: dict[str, Any]) -> None:
    """A slab at 1 m/s passes 0.505 m between two samples, one at 0.4 m/s does not."""
    (finding,) = [one for one in run(slab(**setting)).findings if one.check == "leash"]
    assert finding.where == "slab" and finding.t == pytest.approx(0.51)
    assert finding.figure == pytest.approx(0.51, rel=1e-9)
    assert "leash" not in {one.check for one in run(slab(speed=0.4, **setting)).findings}
