# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What is right is not warned about: rest, a total of zero, integrals over few samples."""

from __future__ import annotations

import math
import random
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipk

from benchmarks.fuzz.random_scenes import scene as random_scene
from rb_sim import AccuracyWarning, Simulation, load_scene
from rb_sim.accuracy.checks.balance import Ledger
from rb_sim.accuracy.checks.check import Effort
from rb_sim.accuracy.checks.check_list import CheckList

FRICTION = {"type": "coulomb", "static": 0.5}
WEIGHT = {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}}


def cube(mass: float, position: list[float], spin: float = 0.0) -> dict[str, Any]:
    shape = {"type": "box", "size": [1.0, 1.0, 1.0]}
    return {"mass": mass, "shape": shape, "position": position, "angular_velocity": [0, 0, spin]}


def heavy_on_light() -> Simulation:
    """1000 kg on 1 kg: weights times heights are 1e4 J."""
    return Simulation(
        {
            "bodies": {"a": cube(1.0, [0, 0, 0.5]), "b": cube(1000.0, [0, 0, 1.5])},
            "constraints": {
                "floor": {"type": "contact", "body": "a", "friction": FRICTION},
                "top": {"type": "contact", "body": "b", "parent": "a", "friction": FRICTION}
                | {"surface": {"type": "plane", "point": [0, 0, 0.5]}},
            },
            "effects": WEIGHT,
            "simulation": {"duration": 1.0, "rate": 100.0},
        }
    )


@pytest.mark.parametrize(("drift", "reported"), [(5e-9, False), (2.0, True)])
def test_energy_of_what_stands_still_is_held_against_weight_times_length(
    drift: float, reported: bool
) -> None:
    """5e-9 J are 5e-13 m of height of 1000 kg; 2 J are a fifth of a millimetre."""
    simulation = heavy_on_light()
    block = simulation.run(checks=False).block
    moved = replace(block, kinetic_energy=block.kinetic_energy + drift * block.t / block.t[-1])
    check_list = CheckList(simulation.scene, simulation.layout, simulation.compiled)
    check_list.add(moved, Effort("dopri853", None, 1e-10, 10))
    assert any(found.check == "energy" for found in check_list.findings) is reported


def test_angular_momentum_whose_total_is_zero_is_held_against_that_of_the_bodies() -> None:
    """Two cubes of 1 kg that spin against each other at 3 rad/s: 0.5 N m s each."""
    scene = {
        "bodies": {"a": cube(1.0, [1, 0, 0], 3.0), "b": cube(1.0, [-1, 0, 0], -3.0)},
        "simulation": {"duration": 1.0, "rate": 100.0},
    }
    simulation = Simulation(scene)
    block = simulation.run(checks=False).block
    wrong = block.angular_momentum + 1e-11 * block.t[:, None] * np.array([0.0, 0.0, 1.0])
    ledger = Ledger(simulation.scene, simulation.layout)
    ledger.add(replace(block, angular_momentum=wrong))
    balance = ledger.momentum()
    assert balance is not None
    assert balance["angular"]["scale"] == pytest.approx(2 * 3.0 / 6.0)
    assert balance["angular"]["relative"] == pytest.approx(1e-11, rel=1e-3)


def test_a_shipped_pendulum_at_few_samples_is_right() -> None:
    """Its samples make 8.6e-6 of the impulse of the support, and no error of the motion."""
    run = Simulation("config/pendulum.yaml").run(1.3333, 30.0)
    assert run.findings == ()


def test_a_drag_that_acts_between_two_samples_is_no_energy_that_is_lost() -> None:
    """It stops a body in 1 ms, sampled every 10 ms, and by chance every other sample gave nearly
    the same work as all of them: by every method 4.8 % of the energy seemed to be lost."""
    scene = random_scene(random.Random("8421 17"), contacts=False)
    options = {"duration": 0.5, "rate": 100.0, "project_initial": True}
    run = Simulation(scene | {"simulation": options}).run()
    assert run.global_error is not None and run.global_error.relative < 1e-8
    assert run.findings == ()


@pytest.mark.parametrize(
    ("setting", "error"),
    [({"method": "radau5", "tolerance": 1e-4}, 1e-6), ({"method": "rk4", "step": 1e-6}, 1e-12)],
    ids=["error of the tolerance", "exactly no power"],
)
def test_a_wrench_that_a_stiff_drag_balances_loses_no_energy(
    setting: dict[str, Any], error: float
) -> None:
    """5 kN and a drag on 0.1 kg that moves at 1 m/s after 20 us: 5 kW come and go. Their difference
    at the samples is an error of the speed times 5 kN, or nothing at all by fixed steps; 0.05 J,
    the energy of the body, are no scale of it."""
    scene = {
        "bodies": {"b": {"mass": 0.1, "inertia": [0.01, 0.01, 0.01]}},
        "effects": {
            "pull": {"type": "wrench", "body": "b", "force": [5e3, 0.0, 0.0]},
            "drag": {"type": "linear_drag", "body": "b", "coefficient": 5e3},
        },
        "simulation": {"duration": 3.0 if "tolerance" in setting else 0.1, "rate": 100.0} | setting,
    }
    run = Simulation(scene).run()
    assert run.block.position[-1, 0, 0] == pytest.approx(run.t[-1] - 2e-5, rel=error)
    assert run.findings == ()


def test_a_motion_that_both_runs_make_wrong_alike_shows_in_its_energy() -> None:
    """A balance beyond the bound of the second run is not withdrawn by it."""
    simulation = heavy_on_light()
    run = simulation.run()
    wrong = replace(run.block, kinetic_energy=run.block.kinetic_energy + 20.0 * run.t)
    check_list = CheckList(simulation.scene, simulation.layout, simulation.compiled)
    check_list.add(wrong, Effort("dopri853", None, 1e-10, 10))
    assert run.global_error is not None
    check_list.check(run.global_error, simulation)
    assert [found.check for found in check_list.findings] == ["energy"]


@pytest.mark.filterwarnings("ignore::rb_sim.AccuracyWarning")
def test_a_step_that_a_second_run_finds_right_is_not_reported() -> None:
    """A cube falls 5 m while a stiff spring turns another one by 1e-8 rad to and fro: gauss6 does
    not follow the spring in steps of half a period, which makes nothing of the motion."""
    frequency = 1000.0
    swinging = cube(1.0, [3.0, 0.0, 0.0], 1e-8 * frequency)
    spring = {"type": "torsion_spring", "body": "s", "stiffness": frequency**2 / 6.0}
    scene = {
        "bodies": {"b": cube(1.0, [0.0, 0.0, 0.0]), "s": swinging},
        "constraints": {
            "axis": {"type": "fixed_axis", "body": "s", "axis_B": [0, 0, 1]},
        },
        "effects": WEIGHT | {"spring": spring | {"axis_B": [0, 0, 1]}},
        "simulation": {"duration": 1.0, "rate": 50.0, "method": "gauss6", "step": 0.003},
    }
    simulation = Simulation(scene)
    alone = simulation.run(check=False)
    assert "step" in {found.check for found in alone.findings}
    simulation.reset()
    checked = simulation.run()
    assert "step" not in {found.check for found in checked.findings}
    assert np.abs(checked.position["b"][:, 2] + 4.905 * checked.t**2).max() < 1e-9


# Samples once a period show nothing of the motion in between: none is held against it.


STIFFNESS, DAMPING = 4000.0, 0.4
PERIOD = 2.0 * math.pi / math.sqrt(STIFFNESS - (0.5 * DAMPING) ** 2)
"""Of 1 kg on the damped spring: from rest it rests again after each [s]."""

DAMPED: dict[str, Any] = {
    "bodies": {"bob": {"mass": 1.0, "inertia": [0.1] * 3, "position": [1.3, 0.0, 0.0]}},
    "effects": {
        "s": {
            "type": "spring",
            "body": "bob",
            "stiffness": STIFFNESS,
            "damping": DAMPING,
            "rest_length": 1.0,
        }
    },
}

SWING, LENGTH = 1.2, 0.4
"""Amplitude [rad] and distance of the centre of mass [m] of a rod that hangs on a hinge."""
ABOUT_HINGE = 0.02 + LENGTH**2
SWING_PERIOD = float(
    4.0 * math.sqrt(ABOUT_HINGE / (9.81 * LENGTH)) * ellipk(math.sin(0.5 * SWING) ** 2)
)

PENDULUM: dict[str, Any] = {
    "bodies": {
        "rod": {
            "mass": 1.0,
            "inertia": [0.02, 0.02, 0.001],
            "center_of_mass": [0.0, 0.0, -LENGTH],
            "orientation": {"axis": [0.0, 1.0, 0.0], "angle": SWING},
        }
    },
    "constraints": {"hinge": {"type": "fixed_axis", "body": "rod", "axis_B": [0.0, 1.0, 0.0]}},
    "effects": {"weight": {"type": "gravity"}},
}


def findings(mapping: dict[str, Any], interval: float, **options: Any) -> set[str]:
    """What the checks say of 60 samples at this interval [s]."""
    span = {"duration": 60.0 * interval, "rate": 1.0 / interval}
    simulation = Simulation(load_scene(mapping | {"simulation": span | options}), announce=None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        return {finding.check for finding in simulation.run().findings}


@pytest.mark.parametrize("periods", [1.0, 3.0, 0.5, 0.03])
def test_a_pendulum_seen_where_it_turns_about_exchanges_energy(periods: float) -> None:
    assert findings(PENDULUM, periods * SWING_PERIOD) == set()


def driven(stiffness: float, damping: float, rate: float, force: float) -> dict[str, Any]:
    """The steady answer of 1 kg to a force that swings."""
    answer = force / complex(stiffness - rate**2, damping * rate)
    body = {"mass": 1.0, "inertia": [0.1] * 3, "position": [answer.imag, 0.0, 0.0]}
    body["linear_velocity"] = [rate * answer.real, 0.0, 0.0]
    push = {"sine_force": [force, 0.0, 0.0], "angular_frequency": rate}
    return {
        "bodies": {"bob": body},
        "effects": {
            "s": {"type": "spring", "body": "bob", "stiffness": stiffness},
            "d": {"type": "linear_drag", "body": "bob", "coefficient": damping},
            "f": {"type": "wrench", "body": "bob"} | push,
        },
    }


@pytest.mark.parametrize("periods", [1.0, 2.0, 0.5, 0.03])
def test_a_steady_swing_seen_once_a_period_is_no_little_motion(periods: float) -> None:
    swing = driven(9.0, 0.5, 2.0, 3.0)
    assert findings(swing, periods * math.pi) == set()


def test_energy_that_a_method_loses_is_reported_all_the_same() -> None:
    """rk4 with 7 steps to the period, and samples that see it."""
    assert "energy" in findings(DAMPED, PERIOD / 28.0, method="rk4", step=PERIOD / 7.0)


def test_a_spring_seen_only_where_it_turns_about_loses_nothing() -> None:
    """Samples a period apart show it at rest with all of its energy; the second run is looked at
    between them, too."""
    spring = {"type": "spring", "body": "bob", "stiffness": (20.0 * math.pi) ** 2}
    scene = {
        "bodies": {"bob": {"mass": 1.0, "inertia": [0.1] * 3, "position": [0.3, 0.0, 0.0]}},
        "effects": {"s": spring | {"rest_length": 0.0}},
        "simulation": {"duration": 10.0, "rate": 10.0, "tolerance": 1e-8},
    }
    run = Simulation(scene, announce=None).run()
    assert run.block.kinetic_energy.max() < 1e-8
    assert run.findings == ()
