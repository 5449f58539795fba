# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Each watch speaks where something is corrupted, names where, and is silent where nothing is."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rb_sim import AccuracyWarning, Simulation, SimulationError, load_scene
from rb_sim.accuracy.checks.check import Effort
from rb_sim.accuracy.checks.check_list import CheckedSamples, CheckList
from rb_sim.bags.fit.recording import Recording, lost_by
from rb_sim.bags.tracks import tracks_of_blocks
from rb_sim.base.errors import Finding
from rb_sim.io.bag.reader import BagReader
from rb_sim.mechanics.samples import ARRAYS, ContactEvent, SampleBlock, SampleLayout
from rb_sim.scene.load import scene_from_mapping
from tests.bags.scenes import record_run
from tests.runs import trajectory

TOP: dict[str, Any] = {
    "bodies": {
        "top": {
            "mass": 0.5,
            "inertia": [0.0004, 0.0004, 0.000625],
            "center_of_mass": [0.0, 0.0, 0.08],
            "orientation": {"axis": [1.0, 0.0, 0.0], "angle": 0.6},
            "angular_velocity": [0.0, 0.0, 200.0],
        }
    },
    "constraints": {"tip": {"type": "fixed_point", "body": "top"}},
    "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
    "simulation": {"duration": 0.2, "rate": 500, "tolerance": 1e-10},
}
SWING: dict[str, Any] = {
    "bodies": {
        "rod": {
            "mass": 1.0,
            "inertia": [0.1, 0.1, 0.01],
            "center_of_mass": [0.0, 0.0, -0.5],
            "angular_velocity": [0.0, 2.0, 0.0],
        }
    },
    "constraints": {"hinge": {"type": "fixed_point", "body": "rod"}},
    "effects": {
        "weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]},
        "air": {"type": "angular_damping", "body": "rod", "coefficient": 0.05},
    },
    "simulation": {"duration": 1.0, "rate": 200, "tolerance": 1e-10},
}
TIGHT = Effort("dopri853", None, 1e-10, 100)


def layout_of(mapping: dict[str, Any]) -> SampleLayout:
    bodies, constraints = tuple(mapping["bodies"]), tuple(mapping.get("constraints", ()))
    return SampleLayout(bodies, constraints, bodies, ())


def findings(
    mapping: dict[str, Any], block: SampleBlock, effort: Effort = TIGHT, **layout: Any
) -> dict[str, Finding]:
    names = layout_of(mapping)._replace(**layout)
    check_list = CheckList(scene_from_mapping(mapping), names)
    half = len(block) // 2
    for part in (slice(0, half), slice(half, None)):
        columns = {name: getattr(block, name)[part] for name in ARRAYS}
        events = tuple(e for e in block.events if e.t <= columns["t"][-1])
        check_list.add(replace(block, **columns, events=events), effort)
    return {finding.check: finding for finding in check_list.findings}


@pytest.fixture(scope="module")
def swing() -> SampleBlock:
    return trajectory(SWING)


def test_an_exact_run_is_passed_without_a_word(swing: SampleBlock) -> None:
    assert findings(SWING, swing) == {}
    assert findings(TOP, trajectory(TOP)) == {}


def test_euler_on_a_fast_top_is_reported_before_it_explodes() -> None:
    """First-order steps of 0.2 rad gain energy: the balance breaks within the first tenths."""
    options = {"duration": 0.3, "method": "euler", "step": 1e-3, "tolerance": None}
    mapping = TOP | {"simulation": TOP["simulation"] | options}
    found = findings(mapping, trajectory(mapping), Effort("euler", 1e-3, None, 300))
    assert found["energy"].where == "top"
    assert found["energy"].t < 0.3
    assert found["energy"].figure > found["energy"].bound == 2e-2
    assert "try step 0.0002 s" in str(found["energy"])


def test_what_an_error_makes_is_not_what_it_is_measured_by(swing: SampleBlock) -> None:
    """Energies times 1e30 from half the run on: relative to the start, not to themselves."""
    grown = swing.kinetic_energy * np.where(swing.t > 0.5, 1e30, 1.0)
    found = findings(SWING, replace(swing, kinetic_energy=grown))
    assert found["energy"].figure > 1e25
    assert found["energy"].t == pytest.approx(0.505)


def test_a_single_sample_that_is_no_number_is_reported(swing: SampleBlock) -> None:
    """gauss6, whose equations had no solution between two steps: a share of a nameless scale was
    taken for a body at rest, in silence."""
    hole = np.where(np.arange(len(swing)) == 20, np.nan, 1.0)
    spoilt = {
        name: swing_column * hole.reshape(-1, *[1] * (swing_column.ndim - 1))
        for name in ("position", "linear_velocity", "kinetic_energy", "potential_energy", "power")
        for swing_column in (getattr(swing, name),)
    }
    found = findings(SWING, replace(swing, **spoilt), Effort("gauss6", 0.01, None, 100))
    assert "not finite" in str(found["energy"])
    assert found["energy"].t == pytest.approx(float(swing.t[20]))


def test_a_dropped_power_breaks_the_energy_balance(swing: SampleBlock) -> None:
    """Of the drag's power a tenth is left out; the momentum balance knows nothing of it."""
    found = findings(SWING, replace(swing, power=0.9 * swing.power))
    assert set(found) == {"energy"}


def test_a_wrong_reaction_breaks_the_momentum_balance() -> None:
    """As a wrong Jacobian gives: the reaction 1 % too large."""
    mapping = SWING | {"effects": {"weight": SWING["effects"]["weight"]}}
    block = trajectory(mapping)
    assert findings(mapping, block) == {}
    found = findings(mapping, replace(block, reaction_force=1.01 * block.reaction_force))
    assert set(found) == {"momentum", "angular momentum"} or set(found) == {"momentum"}


def test_a_constraint_that_opens_is_named(swing: SampleBlock) -> None:
    opened = swing.position + np.where(swing.t > 0.7, 0.01, 0.0)[:, None, None]
    residual = np.where(swing.t > 0.7, 0.02, swing.residual)
    found = findings(SWING, replace(swing, position=opened, residual=residual))
    assert found["residual"].where == "hinge"
    assert found["residual"].t == pytest.approx(0.705)
    assert found["residual"].figure == 0.02


def test_a_constraint_of_a_state_without_an_attitude_is_named_as_well(swing: SampleBlock) -> None:
    """As where Euler's steps blow up: nothing brings such a sample back onto the constraint."""
    lost = np.where(swing.t > 0.7, 0.0, 1.0)[:, None, None]
    residual = np.where(swing.t > 0.7, 0.02, swing.residual)
    spoilt = replace(swing, orientation=lost * swing.orientation, residual=residual)
    assert findings(SWING, spoilt)["residual"].where == "hinge"


@pytest.mark.parametrize(("spin", "told"), [(6.2, False), (6.4, True), (1e200, True)])
def test_more_than_half_a_turn_in_a_fixed_step_is_reported(
    swing: SampleBlock, spin: float, told: bool
) -> None:
    """In steps of 0.5 s half a turn is 2 pi rad/s. A motion that has blown up turns by more, and
    samples that do not resolve it leave its balances silent."""
    fast = replace(swing, angular_velocity=np.full_like(swing.angular_velocity, spin / 3.0**0.5))
    found = findings(SWING, fast, Effort("gauss6", 0.5, None, 1))
    assert ("step" in found) == told
    if told:
        assert found["step"].where == "rod" and found["step"].t == 0.0
        assert "rotation in one step of 0.5 s" in str(found["step"])
    assert "step" not in findings(SWING, fast, Effort("dopri853", None, 1e-10, 2))


def test_chatter_is_reported_with_its_contact(swing: SampleBlock) -> None:
    events = tuple(ContactEvent(float(t), "floor", "leaps") for t in np.linspace(0.0, 1.0, 40000))
    block = replace(swing, events=events, contact_state=np.zeros((len(swing), 1)))
    mapping = SWING | {"constraints": SWING["constraints"]}
    assert findings(mapping, block, contacts=("floor",))["events"].where == "floor"


def test_a_body_at_rest_has_no_balance_to_break() -> None:
    mapping = {
        "bodies": {"bob": SWING["bodies"]["rod"] | {"angular_velocity": [0.0, 0.0, 0.0]}},
        "constraints": {"hinge": {"type": "fixed_point", "body": "bob"}},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"duration": 1.0, "rate": 50, "tolerance": 1e-10},
    }
    assert findings(mapping, trajectory(mapping)) == {}


def test_under_a_stream_of_commands_constraints_are_watched_and_balances_are_not(
    swing: SampleBlock,
) -> None:
    """A balance over the few samples between two commands would say nothing."""
    stream = np.zeros((len(swing), 1, 6))
    stream[:, 0, 0] = np.arange(len(swing))
    broken = replace(swing, command=stream, residual=np.full_like(swing.residual, 0.02))
    broken = replace(broken, kinetic_energy=swing.kinetic_energy * (1.0 + swing.t))
    assert set(findings(SWING, broken, commanded=("rod",))) == {"residual"}


def test_momenta_that_add_up_to_nothing_are_not_compared_with_their_rounding() -> None:
    """Two bodies on a spring drift through the origin: their angular momenta, 0.15 kg m^2/s each,
    cancel but for their rounding, and half of that was told as an error of 0.5."""
    body = {"mass": 1.0, "inertia": [1.0] * 3, "linear_velocity": [1.0, 0.3, 0.0]}
    mapping: dict[str, Any] = {
        "bodies": {
            "a": body | {"position": [-0.50005, 0.0, 0.0]},
            "b": body | {"position": [0.50005, 0.0, 0.0]},
        },
        "effects": {
            "spring": {
                "type": "spring", "body": "b", "parent": "a", "stiffness": 50.0, "rest_length": 1.0,
            }
        },
        "simulation": {"duration": 10.0, "rate": 20.0, "tolerance": 1e-10},
    }  # fmt: skip
    block = trajectory(mapping)
    assert findings(mapping, block) == {}
    turned = replace(block, angular_momentum=block.angular_momentum + 1e-6 * block.t[:, None])
    assert set(findings(mapping, turned)) == {"angular momentum"}


@pytest.mark.parametrize("tolerance", [1e-10, 1e-13])
def test_a_thin_rod_that_swings_about_its_own_axis_between_samples_is_not_accused(
    tolerance: float,
) -> None:
    """A damper takes 9e-6 J at 29 rad/s from what swings by 0.03 rad about the axis of a rod, three
    radians from sample to sample: half the samples say the same of that as all do, 9e-8 of what is
    exchanged amiss, of which no tolerance is the reason."""
    inertia = 0.020833333333333332
    rod = {
        "mass": 1.0,
        "inertia": [inertia, inertia, 1.25e-5],
        "angular_velocity": [-0.6965681882596109, -0.940338212007596, -0.928303062172487],
        "linear_velocity": [-0.659966647386564, 0.9466445500473224, 0.9253112048624146],
    }
    mapping: dict[str, Any] = {
        "bodies": {"rod": rod},
        "effects": {
            "weight": {"type": "gravity"},
            "damper": {
                "type": "torsion_spring", "body": "rod", "axis_B": [0, 0, 1],
                "stiffness": 0.010442681142809405, "damping": 7.445134697902447e-05,
            },
        },
        "simulation": {"duration": 1.0, "rate": 10.0, "tolerance": tolerance},
    }  # fmt: skip
    block = trajectory(mapping)
    assert findings(mapping, block, Effort("dopri853", None, tolerance, 60)) == {}


# Whoever runs a scene from Python is told of lost accuracy as they are on the command line.


SPIN = 40.0
COARSE: dict[str, Any] = {
    "bodies": {
        "top": {"mass": 1.0, "inertia": [1.0, 2.0, 3.0], "angular_velocity": [0.1, SPIN, 0.2]}
    },
    "simulation": {"method": "euler", "step": 0.02, "duration": 1.0, "rate": 50.0},
}
"""Steps of 0.8 rad about the middle axis: Euler's method gains half of (w h)^2 in each."""

FINE = {"method": "dopri853", "tolerance": 1e-10, "step": None}


def test_a_run_gives_a_warning_for_each_finding_at_its_caller() -> None:
    with pytest.warns(AccuracyWarning, match=r"^energy: .* is .* at t = .* \(top\)") as told:
        run = Simulation(load_scene(COARSE), announce=None).run()
    assert [str(warning.message) for warning in told] == [str(each) for each in run.findings]
    assert {Path(warning.filename).name for warning in told} == {Path(__file__).name}
    assert "energy" in {finding.check for finding in run.findings}
    assert "accuracy lost (energy" in repr(run)


def test_a_sound_run_and_one_that_nobody_watches_give_none() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sound = Simulation(load_scene(COARSE, **FINE), announce=None).run()
        unseen = Simulation(load_scene(COARSE), announce=None).run(checks=False)
    assert sound.findings == unseen.findings == ()
    assert "accuracy" not in repr(sound)


def test_a_run_that_fails_tells_what_was_seen_before() -> None:
    """The spin blows up; the warning names the first sample beyond the bound, not the end."""
    simulation = Simulation(load_scene(COARSE, duration=100.0), announce=None)
    with pytest.warns(AccuracyWarning, match="energy"), pytest.raises(SimulationError):
        simulation.run()


def test_sinks_and_progress_come_first() -> None:
    """What is told of a run is told when its samples are safe."""
    simulation = Simulation(load_scene(COARSE), announce=None)
    ends: list[float] = []
    with warnings.catch_warnings():
        warnings.simplefilter("error", AccuracyWarning)
        with pytest.raises(AccuracyWarning):
            simulation.run(progress=lambda t, end: ends.append(t))
    assert ends[-1] == 1.0


def test_a_state_that_is_set_is_no_lost_energy() -> None:
    """From there on it is another run: half the spin has a quarter of the energy."""
    simulation = Simulation(load_scene(COARSE, **FINE), announce=None)

    def blocks() -> Any:
        yield from simulation.blocks(0.5, 50.0)
        spin = {"top": {"angular_velocity": [0.0, 0.5 * SPIN, 0.0]}}
        simulation.set_state(spin)
        yield from simulation.blocks(0.5, 50.0)

    watched = CheckedSamples(simulation, blocks())
    energies = [block.energy[-1] for block in watched]
    assert energies[-1] == pytest.approx(0.25 * energies[0], rel=0.05)
    assert watched.findings == ()


def test_a_bag_that_is_simulated_again_by_a_coarse_method_tells_it(tmp_path: Path) -> None:
    from rb_sim.bags.resim import resimulate
    from rb_sim.scene.yaml_reader import write

    bag = record_run(write(COARSE), tmp_path / "bag", **FINE)
    found = resimulate(BagReader(bag), load_scene(COARSE, **FINE), tmp_path / "same")
    assert found == ()
    found = resimulate(BagReader(bag), load_scene(COARSE), tmp_path / "coarse")
    assert "energy" in {finding.check for finding in found}


def test_a_fit_by_a_coarse_method_tells_it() -> None:
    scene = load_scene(COARSE, **FINE)
    simulation = Simulation(scene, announce=None)
    tracks = tracks_of_blocks(
        [simulation.run(checks=False).block], scene, simulation.layout, "truth"
    )
    recording = Recording(tracks, {"top": "top"})
    assert lost_by(scene, recording) == ()
    assert any(line.startswith("energy") for line in lost_by(load_scene(COARSE), recording))


def test_trials_beside_a_run_are_not_reported() -> None:
    """The derivatives of a run are carried by motions of their own."""
    from rb_sim.simulation.sensitivity import TangentSimulation

    def scene_at(x: Any) -> Any:
        body = COARSE["bodies"]["top"] | {"mass": float(x[0])}
        return load_scene(COARSE | {"bodies": {"top": body}})

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = TangentSimulation(scene_at, np.array([1.0]), [1.0]).run()
    assert run.findings == ()
