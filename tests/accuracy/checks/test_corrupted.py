# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws and settings that are spoilt on purpose are seen by the checks, end to end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import pytest

from rb_sim import Simulation, load_scene
from rb_sim.accuracy.checks.check import effort_of
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.base.errors import Finding, SimulationError
from rb_sim.catalogue.constraints import rows
from rb_sim.catalogue.constraints.rows import DistanceRow, fill
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.spec import wrench
from rb_sim.cli.verbs.run import FAILED, RunOptions, run
from rb_sim.integrate.layout import held
from rb_sim.mechanics.compiled import forget
from rb_sim.mechanics.contact import contact_laws as contact_loops
from rb_sim.mechanics.contact.motion_kernels import bring_to_manifold
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.samples import SampleBlock
from rb_sim.numerics.kernels import by_address
from rb_sim.numerics.vectors import scale, sin, where
from tests.accuracy.checks.test_singular_configuration import four_bar

SCENE = {
    "bodies": {
        "bob": {
            "mass": 1.0,
            "inertia": [0.02, 0.03, 0.01],
            "position": [1.0, 0.0, 0.0],
            "angular_velocity": [0.5, 1.0, -2.0],
        }
    },
    "constraints": {
        "rod": {"type": "distance", "body": "bob", "point_B": [0.0, 0.1, 0.2], "point_A": [0, 0, 0]}
    },
    "effects": {"weight": {"type": "gravity"}},
    "simulation": {"duration": 2.0, "rate": 100.0, "tolerance": 1e-10, "project_initial": True},
}


def findings(spoil: Callable[[Any], Any] = lambda effort: effort, **options: Any) -> dict[str, Any]:
    """What the checks say of the run, by watch; spoil: what they are told of its setting."""
    scene = load_scene(SCENE, **options)
    simulation = Simulation(scene, announce=None)
    check_list = CheckList(scene, simulation.layout)
    for block in simulation.blocks(scene.simulation.duration, scene.simulation.rate):
        check_list.add(block, spoil(effort_of(simulation)))
    return {finding.check: finding for finding in check_list.findings}


def test_unspoilt_it_passes() -> None:
    assert findings() == {}


def test_a_wrong_jacobian_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The arm of the reaction is half as long again: it does work and turns the body wrongly."""
    put = rows.put

    def spoilt(G: Any, k: Any, u: Any, torque_B: Any, *others: Any) -> None:
        put(G, k, u, scale(1.5, torque_B), *others)

    monkeypatch.setattr(rows, "put", spoilt)
    try:
        assert {"energy", "angular momentum"} & set(findings(method="rk4", step=1e-3))
    except SimulationError as error:  # or the run itself says that it cannot go on
        assert "t = " in str(error)


def test_a_dropped_term_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without what the rod's turning adds to the acceleration the projection alone holds it."""
    whole = fill.kernels[DistanceRow]

    def without_bias(row: Any, t: Any, B: Any, A: Any, G: Any, k: Any) -> None:
        whole(row, t, B, A, G, k)
        G[k, rows.BIAS] = 0.0

    monkeypatch.setitem(fill.kernels, DistanceRow, without_bias)
    assert {"energy", "momentum"} & set(findings(method="rk4", step=1e-3))


def test_a_force_that_is_not_its_potential_s_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = wrench.kernels[GravityRow]

    def weaker(*arguments: Any) -> Any:
        force, torque = whole(*arguments)
        return scale(0.999, force), torque

    monkeypatch.setitem(wrench.kernels, GravityRow, weaker)
    found = set(findings())
    assert "energy" in found
    assert {"momentum", "angular momentum"} & found


def test_a_truncated_tolerance_is_seen() -> None:
    """The watches hold the run to 1e-10, it is integrated to 1e-3."""
    found = findings(lambda effort: effort._replace(tolerance=1e-10), tolerance=1e-3)
    assert "energy" in found


# A part of the simulator is spoilt while a scene runs: its watch tells when and where.
#
# Every spoilt run has a sound one beside it, which is passed without a word.


SINKS = 1e-7
"""How much a spoilt way back lets a ball down in every step [m]."""


def reported(mapping: dict[str, Any], **options: Any) -> dict[str, Finding]:
    """By watch, of a run of the scene, whose laws are made of what is spoilt."""
    forget()
    simulation = Simulation(load_scene(mapping, **options), announce=None)
    setting = simulation.scene.simulation
    check_list = CheckList(simulation.scene, simulation.layout, simulation.compiled)
    for block in simulation.blocks(setting.duration, setting.rate):
        check_list.add(block, partial(effort_of, simulation))
    return {finding.check: finding for finding in check_list.findings}


def test_steps_that_do_not_come_back_to_a_joint_are_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The rod holds its bob by its acceleration alone: its error grows from the first steps on."""
    setting = {"method": "rk4", "step": 5e-3}
    assert reported(SCENE, **setting) == {}

    def astray(self: MultiBodyLaws) -> Any:
        return self.traced(lambda system, t, y: [*y, 0.0])

    spoilt = cached_property(astray)
    spoilt.__set_name__(MultiBodyLaws, "back")
    monkeypatch.setattr(MultiBodyLaws, "back", spoilt)
    found = reported(SCENE, **setting)["residual"]
    assert found.where == "rod" and 0.0 < found.t < 0.5


@by_address
def sinking(t, y, p, out):
    bring_to_manifold(held(p), t, y)
    y[2] -= SINKS


def on_a_floor(**start: Any) -> dict[str, Any]:
    """A ball of 10 cm above a floor without friction."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}} | start
    return {
        "bodies": {"ball": ball},
        "constraints": {
            "floor": {"type": "contact", "body": "ball", "friction": {"type": "smooth"}}
        },
        "effects": {"weight": {"type": "gravity", "acceleration": [0, 0, -9.81]}},
        "simulation": {"duration": 0.5, "rate": 100.0, "method": "rk4", "step": 1e-2},
    }


def test_a_ball_that_sinks_into_its_floor_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """By 1e-7 m in each of the steps: beyond 1e-6 of the scene's size after ten of them, or so."""
    scene = on_a_floor(position=[0, 0, 0.1], linear_velocity=[1, 0, 0])
    assert reported(scene) == {}
    monkeypatch.setattr(contact_loops, "bring_back", sinking)
    found = reported(scene)["residual"]
    assert 0.0 < found.t <= 0.15 and found.figure > 1e-6


def test_a_law_that_no_step_can_follow_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """A weight that jumps by a thousandth some hundred times on the way."""
    setting = {"duration": 1.0}
    assert reported(SCENE, **setting) == {}
    whole = wrench.kernels[GravityRow]

    def jumping(row: Any, t: Any, inertial: Any, B: Any, A: Any) -> Any:
        force, torque = whole(row, t, inertial, B, A)
        return scale(where(sin(400.0 * t) > 0.0, 1.001, 1.0), force), torque

    monkeypatch.setitem(wrench.kernels, GravityRow, jumping)
    found = reported(SCENE, **setting)
    assert found["energy"].where == "bob" and found["energy"].t < 0.1


def test_lines_that_come_to_depend_on_each_other_are_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The line of the coupler turns into the last one of a hinge, which it is at 0.5 s."""
    scene = four_bar(2.0, rocker=1.5)
    for body in scene["bodies"].values():
        body |= {"angular_velocity": [0, 0, 0], "linear_velocity": [0, 0, 0]}
    assert reported(scene) == {}
    whole = fill.kernels[DistanceRow]

    def turning(row: Any, t: Any, B: Any, A: Any, G: Any, k: Any) -> None:
        whole(row, t, B, A, G, k)
        for i in range(6):
            G[k, i] = (1.0 - 2.0 * t) * G[k, i] + 2.0 * t * G[k - 1, i]
            G[k, 6 + i] = (1.0 - 2.0 * t) * G[k, 6 + i]

    monkeypatch.setitem(fill.kernels, DistanceRow, turning)
    found = reported(scene)["singular configuration"]
    assert found.where == "coupler" and found.t == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(("height", "chatters"), [(1e-2, False), (1e-6, True)])
def test_contacts_that_change_without_end_are_reported(height: float, chatters: bool) -> None:
    """A ball that hops for ever, by a micrometre 1,100 times a second, is sampled ten times."""
    scene = on_a_floor(position=[0, 0, 0.1 + height])
    scene["constraints"]["floor"]["restitution"] = 1.0
    scene["simulation"] = {"duration": 2.0, "rate": 10.0}
    found = reported(scene)
    assert set(found) == ({"events"} if chatters else set())
    if chatters:
        assert found["events"].where == "floor" and found["events"].t <= 2.0


# A run that ends in an error is looked at to its last sample, too.


SCENE_FAILED = """
bodies: {b: {mass: 1.0, inertia: [1, 2, 3], angular_velocity: [1, 0, 0]}}
simulation: {duration: 100.0, rate: 100.0, method: rk4, step: 0.01}
"""
"""10,001 samples."""

EARLIER = 5
"""Samples before the end."""


def test_what_the_last_block_of_a_run_that_fails_shows_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE_FAILED)
    assert run(RunOptions(str(path), quiet=True)) == 0
    assert "warning" not in capfd.readouterr().err
    blocks = Simulation.blocks

    def ends_early(simulation: Simulation, *given: Any) -> Iterator[SampleBlock]:
        last = None
        for block in blocks(simulation, *given):
            if last is not None:
                yield last
            last = block
        assert last is not None
        residual = last.residual.copy()
        residual[-EARLIER] = 1.0
        yield replace(last, residual=residual)
        raise SimulationError("no step is small enough")

    monkeypatch.setattr(Simulation, "blocks", ends_early)
    assert run(RunOptions(str(path), quiet=True)) == FAILED
    said = capfd.readouterr().err
    assert "constraint violation" in said and "no step is small enough" in said
