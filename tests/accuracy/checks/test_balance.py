# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Balances of runs with known work and impulse."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from benchmarks.contact.stick_slips import case
from rb_sim import Simulation, load_scene
from rb_sim.accuracy.checks.balance import (
    Ledger,
    external_wrench,
    unknown_force,
)
from rb_sim.mechanics.samples import SampleBlock, SampleLayout, empty_block
from rb_sim.scene.listing import find_scene
from rb_sim.scene.load import scene_from_mapping
from tests.accuracy.checks.blocks import Block

DRAGGED = {
    "bodies": {
        "stone": {
            "mass": 2.0,
            "inertia": [0.1, 0.1, 0.1],
            "linear_velocity": [3.0, 0.0, 0.0],
        }
    },
    "effects": {"air": {"type": "linear_drag", "body": "stone", "coefficient": 1.0}},
    "simulation": {"duration": 2.0, "rate": 100, "method": "rk4", "step": 0.001},
}


def ledger_of(scene) -> Ledger:
    simulation = Simulation(scene)
    ledger = Ledger(scene, simulation.layout)
    options = scene.simulation
    for block in simulation.blocks(options.duration, options.rate):
        ledger.add(block)
    return ledger


def test_rolling_sphere_balances_energy_and_momentum():
    """Known force and torque, weight and the contact reaction: LL section 38 problem 1.

    Limit: the integrator's tolerance, 1e-13 per step, over some tens of steps.
    """
    ledger = ledger_of(load_scene(find_scene("rolling_sphere"), duration=1.0, tolerance=1e-13))
    energy, momentum = ledger.energy(), ledger.momentum()
    assert energy["work"] > 1e-2
    assert energy["relative"] < 1e-11
    assert momentum["linear"]["relative"] < 1e-11
    assert momentum["angular"]["relative"] < 1e-11


def test_offset_body_with_wrenches_in_body_axes():
    """A tumbling body, pushed at a point away from its offset centre of mass."""
    scene = load_scene(
        {
            "bodies": {
                "beam": {
                    "mass": 2.0,
                    "inertia": [0.1, 0.2, 0.25],
                    "center_of_mass": [0.1, -0.2, 0.3],
                    "position": [1.0, 2.0, 3.0],
                    "angular_velocity": [1.0, 2.0, 0.5],
                }
            },
            "effects": {
                "weight": {"type": "gravity"},
                "jet": {
                    "type": "wrench",
                    "body": "beam",
                    "frame": "body",
                    "point_B": [0.3, 0.1, -0.4],
                    "force": [0.5, -0.2, 0.7],
                    "torque": [0.1, 0.2, -0.3],
                },
            },
            "simulation": {"duration": 2.0, "rate": 200, "method": "rk4", "step": 0.001},
        }
    )
    ledger = ledger_of(scene)
    for balance in ledger.momentum().values():
        assert balance["relative"] < 1e-9
    assert ledger.energy()["relative"] < 1e-9


def test_drag_does_the_work_that_the_body_loses():
    """v = v0 exp(-c t / m), so E(0) - E = m v0^2 / 2 (1 - exp(-2 c t / m))."""
    ledger = ledger_of(load_scene(DRAGGED))
    energy = ledger.energy()
    assert energy["work"] == pytest.approx(-9.0 * (1.0 - np.exp(-2.0)), rel=1e-9)
    assert energy["relative"] < 1e-9
    assert ledger.unknown_force == "air"
    assert ledger.momentum() is None


@pytest.mark.parametrize("interpolation", ["hold", "linear"])
@pytest.mark.parametrize("rate", [100.0, 37.0])
def test_the_work_of_a_table_is_integrated_over_its_pieces(interpolation: str, rate: float):
    """Velocities are polynomials of each piece, so that work is exact whether a sample lies at a
    jump (100 Hz: at three of four) or not."""
    table = {
        "type": "wrench_table",
        "body": "stone",
        "interpolation": interpolation,
        "times": [0.05, 0.153, 0.3, 0.61],
        "forces": [[10, 0, 0], [-20, 5, 0], [3, 3, 3], [7, 0, 0]],
    }
    options = {"duration": 1.0, "rate": rate, "tolerance": 1e-12}
    mapping = {"bodies": DRAGGED["bodies"], "effects": {"push": table}, "simulation": options}
    energy = ledger_of(load_scene(mapping)).energy()
    assert energy is not None and energy["relative"] < 1e-14


PUSH, ROPE, END = 50.0, 100.0, 2.0
"""Largest force [N], drag [N s/m] and duration [s]; the speed of a light body follows the force."""


@pytest.mark.parametrize(
    ("pull", "mean_square"),
    [
        ({"type": "wrench", "force": [PUSH, 0, 0]}, 1.0),
        ({"type": "wrench", "frame": "body", "force": [0, PUSH, 0]}, 1.0),
        ({"type": "wrench", "sine_force": [PUSH, 0, 0], "angular_frequency": np.pi}, 0.5),
        ({"type": "wrench_table", "times": [0, END], "forces": [[0, 0, 0], [PUSH, 0, 0]]}, 1 / 3),
    ],
    ids=["constant", "body axes", "sine", "table"],
)
@pytest.mark.parametrize("since", [0.0, 100.7], ids=["own time", "stamps"])
def test_a_wrench_and_the_drag_against_it_exchange_what_each_of_them_does(
    pull: dict[str, Any], mean_square: float, since: float
) -> None:
    """With a mass of no effect v = F / c: the wrench gives int F^2 / c dt, the drag takes as much,
    and their sum is zero."""
    half = np.sqrt(0.5)
    body = {"mass": 1e-3, "inertia": [1e-3] * 3, "orientation": [0.0, 0.0, half, half]}
    effects = {"pull": pull | {"body": "b"}}
    effects["drag"] = {"type": "linear_drag", "body": "b", "coefficient": ROPE}
    options = {"duration": END, "rate": 1000.0, "method": "radau5", "tolerance": 1e-8}
    mapping = {"bodies": {"b": body}, "effects": effects, "simulation": options}
    simulation = Simulation(load_scene(mapping))
    block = simulation.run(checks=False).block
    ledger = Ledger(simulation.scene, simulation.layout, since)
    ledger.add(replace(block, t=block.t + since))
    assert ledger.exchanged == pytest.approx(2 * PUSH**2 / ROPE * END * mean_square, rel=1e-3)


def test_what_is_left_of_velocities_that_a_weld_takes_is_no_energy() -> None:
    """It is rounding, which a step then changes by all of it."""
    body = {
        "mass": 38.0,
        "inertia": [0.0406, 0.0586, 0.0463],
        "position": [0.1786, -0.2654, 0.1129],
        "orientation": {"axis": [-0.34, -0.51, -0.79], "angle": -1.76},
        "linear_velocity": [0.3332, 0.2893, 0.3382],
        "angular_velocity": [-2.036, 0.7815, -0.8538],
    }
    scene = {
        "bodies": {"block": body},
        "constraints": {"weld": {"type": "weld", "body": "block"}},
        "simulation": {
            "method": "rk4", "step": 0.1, "duration": 1.0, "rate": 10.0, "project_initial": True,
        },
    }  # fmt: skip
    run = Simulation(scene, announce=None).run()
    moved = np.abs([run.block.linear_velocity, run.block.angular_velocity]).max()
    assert 0.0 < moved < 1e-14
    assert run.findings == ()


def test_work_that_is_done_while_nobody_looks_is_none_that_is_lost() -> None:
    """A block that a growing force pulls sticks at each of three samples and slips between: the
    samples show no power, and nothing says that there was none."""
    run = Simulation(case(261127, 4, False).mapping, announce=None).run()
    assert not run.block.power.any() and run.block.energy[-1] > 100.0
    assert "energy" not in {finding.check for finding in run.findings}


def test_a_pulse_between_two_samples_is_no_energy_out_of_nothing() -> None:
    """It strikes a pendulum that hangs at rest, where no other energy is exchanged."""
    table = {
        "type": "wrench_table", "body": "bob", "times": [0.52, 0.521, 0.522],
        "forces": [[0, 0, 0], [300, 0, 0], [0, 0, 0]],
    }  # fmt: skip
    pin = {"type": "fixed_point", "body": "bob", "point_B": [0, 0, 1.0]}
    scene = {
        "bodies": {"bob": {"mass": 1.0, "inertia": [0.1, 0.2, 0.25]}},
        "constraints": {"pin": pin},
        "effects": {"push": table, "weight": {"type": "gravity"}},
        "simulation": {"duration": 2.0, "rate": 20.0, "project_initial": True},
    }
    run = Simulation(scene, announce=None).run()
    assert not run.block.power.any() and run.energy[-1] > run.energy[0] + 0.01
    assert run.findings == ()


# The ledger of a run, on samples by hand: what is rounding, and where a balance breaks.


NAMES = SampleLayout(("a",), ("one", "two"), ("a", "a"), ())


def ledger() -> Ledger:
    """Of a body of 2 kg with two joints to the world."""
    pin = {"type": "fixed_point", "body": "a"}
    body = {"mass": 2.0, "inertia": [0.1, 0.2, 0.25]}
    scene = {"bodies": {"a": body}, "constraints": {"one": pin, "two": pin}}
    return Ledger(scene_from_mapping(scene), NAMES)


def samples(t: list[float], speed: float, force: float = 3.0, **columns: Any) -> SampleBlock:
    """Of the body that drifts along x while both joints push against each other at x = 5 m."""
    block = empty_block(len(t), NAMES)
    block.t[:] = t
    block.linear_velocity[:, 0, 0], block.momentum[:, 0] = speed, 2.0 * speed
    block.orientation[:, 0, 3] = 1.0
    block.reaction_force[:, 0, 2], block.reaction_force[:, 1, 2] = force, -force
    block.anchor[:, :, 0] = 5.0
    return replace(block, **{name: np.array(values) for name, values in columns.items()})


@pytest.mark.parametrize(("part", "known"), [(0.97, False), (1.03, True)])
def test_momentum_that_may_be_rounding_of_impulses_has_no_scale(part: float, known: bool) -> None:
    """1e-13 of 6 N over 20 s, from the first sample of the run to the last of the block, is
    1.2e-11 N s."""
    speed = part * 0.5 * 1.2e-11
    book = ledger()
    book.add(samples([10.0, 11.0, 12.0, 13.0], speed))
    book.add(samples([14.0, 20.0, 25.0, 30.0], speed))
    balances = book.momentum()
    assert balances is not None
    assert (balances["linear"]["relative"] is not None) is known
    assert balances["angular"]["relative"] is None  # nothing turns


@pytest.mark.parametrize(("lost", "first"), [(0.0, 4), (0.1, 3), (1.0, 2)])
def test_where_energy_breaks_its_balance_in_a_block(lost: float, first: int) -> None:
    """Of 10 J at the start with a power of 2 W: from the third sample on some are lost, more from
    the fourth on; the bound is a hundredth of what is exchanged, 18 J. The last where none is."""
    t = np.arange(5.0)
    kinetic = 10.0 + 2.0 * t - lost * np.array([0.0, 0.0, 0.5, 5.0, 5.0])
    book = ledger()
    block = samples(t.tolist(), 1.0, kinetic_energy=kinetic, power=np.full(5, 2.0))
    book.add(block)
    energy = book.energy()
    assert energy is not None and energy["work"] == pytest.approx(8.0)
    assert energy["scale"] == pytest.approx(18.0)
    assert energy["error"] == pytest.approx(-5.0 * lost, abs=1e-12)
    assert book.first_beyond(block, 0.01) == first


# Balances that pass their bounds, on ledgers by hand; and the wrench from outside by formulas.


BODY = {"mass": 2.0, "inertia": [0.1, 0.2, 0.25]}
OFFSET = {"mass": 3.0, "inertia": [0.1, 0.2, 0.25], "center_of_mass": [0.1, -0.2, 0.3]}
SPRING = {"type": "spring", "body": "b", "parent": "a", "stiffness": 9.0}


def scene_of(effects: dict[str, Any], **constraints: Any) -> Any:
    bodies = {"a": BODY, "b": OFFSET | {"position": [1.0, 2.0, 3.0]}}
    return scene_from_mapping({"bodies": bodies, "effects": effects, "constraints": constraints})


def drawn(seed: int, reactions: int = 0) -> Any:
    """Two samples of both bodies, with reactions and a command on b."""
    rng = np.random.default_rng(seed)
    block: Any = Block(
        [0.0, 1.0],
        position=rng.normal(size=(2, 2, 3)),
        orientation=Rotation.random(4, random_state=seed).as_quat().reshape(2, 2, 4),
        command=rng.normal(size=(2, 1, 6)),
    )
    for name in ("reaction_force", "reaction_torque", "anchor"):
        setattr(block, name, rng.normal(size=(2, reactions, 3)))
    return block


def test_what_acts_from_outside_by_hand() -> None:
    """A weight, a wrench in body axes at a point of b, a command at the origin of b, the reaction
    of a joint to the world; not a spring or a joint between both, nor parts of a reaction."""
    g, f, tau, point = (np.array(v) for v in ([0, 1, -9.0], [1, 2, 3], [4, 5, -6], [0.3, 0.1, 2]))
    effects = {
        "weight": {"type": "gravity", "acceleration": g.tolist()},
        "jet": {
            "type": "wrench", "body": "b", "frame": "body", "point_B": point.tolist(),
            "force": f.tolist(), "torque": tau.tolist(),
        },
        "wind": {"type": "wrench", "body": "a", "force": f.tolist(), "torque": tau.tolist()},
        "joystick": {"type": "commanded_wrench", "body": "b"},
        "spring": SPRING,
    }  # fmt: skip
    pin = {"type": "fixed_point", "body": "a"}
    scene = scene_of(effects, pin=pin, link=pin | {"body": "b", "parent": "a"})
    names = SampleLayout(("a", "b"), ("pin", "link", "pin/A"), ("a", "b", "a"), ("b",))
    block = drawn(3, 3)
    found = external_wrench(block, scene, names)
    center = np.array(OFFSET["center_of_mass"])
    for k in range(2):
        turn, (p_a, p_b) = Rotation.from_quat(block.orientation[k, 1]), block.position[k]
        at, origin = p_b + turn.apply(point - center), p_b - turn.apply(center)
        push, pull = block.command[k, 0, :3], block.reaction_force[k, 0]
        force = 5.0 * g + turn.apply(f) + f + push + pull
        torque = np.cross(2.0 * p_a + 3.0 * p_b, g) + np.cross(at, turn.apply(f)) + turn.apply(tau)
        torque += np.cross(p_a, f) + tau + np.cross(origin, push) + block.command[k, 0, 3:]
        torque += np.cross(block.anchor[k, 0], pull) + block.reaction_torque[k, 0]
        assert_allclose(found[k], [*force, *torque], rtol=1e-13, atol=1e-12)


@pytest.mark.parametrize(
    ("sine", "known"),
    [({}, True), ({"sine_force": [1.0, 0, 0]}, False), ({"sine_torque": [0, 1.0, 0]}, False)],
)
def test_a_wrench_that_swings_is_not_reported_by_samples(sine: dict[str, Any], known: bool) -> None:
    swing = {"angular_frequency": 2.0} if sine else {}
    wrench = {"type": "wrench", "body": "a", "force": [1.0, 0.0, 0.0]} | sine | swing
    assert unknown_force(scene_of({"push": wrench})) == ("" if known else "push")
