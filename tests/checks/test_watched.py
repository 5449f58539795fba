"""Whoever runs a scene from Python is told of lost accuracy as they are on the command line."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rb_sim import AccuracyWarning, Simulation, SimulationError, load_scene
from rb_sim.bags.tracks import tracks_of_blocks
from rb_sim.checks.check_list import Watched
from rb_sim.fit.recording import Recording, lost_by
from rb_sim.io.bag.reader import BagReader
from tests.bags.scenes import record_run

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
    assert "energy" in {finding.watch for finding in run.findings}
    assert "accuracy lost (energy" in repr(run)


def test_a_sound_run_and_one_that_nobody_watches_give_none() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sound = Simulation(load_scene(COARSE, **FINE), announce=None).run()
        unseen = Simulation(load_scene(COARSE), announce=None).run(watched=False)
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

    watched = Watched(simulation, blocks())
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
    assert "energy" in {finding.watch for finding in found}


def test_a_fit_by_a_coarse_method_tells_it() -> None:
    scene = load_scene(COARSE, **FINE)
    simulation = Simulation(scene, announce=None)
    tracks = tracks_of_blocks([simulation.run().block], scene, simulation.layout, "truth")
    recording = Recording(tracks, {"top": "top"})
    assert lost_by(scene, recording) == ()
    assert any(line.startswith("energy") for line in lost_by(load_scene(COARSE), recording))


def test_trials_beside_a_run_are_not_told() -> None:
    """The derivatives of a run are carried by motions of their own."""
    from rb_sim.simulation.sensitivity import TangentSimulation

    def scene_at(x: Any) -> Any:
        body = COARSE["bodies"]["top"] | {"mass": float(x[0])}
        return load_scene(COARSE | {"bodies": {"top": body}})

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = TangentSimulation(scene_at, np.array([1.0]), [1.0]).run()
    assert run.findings == ()
