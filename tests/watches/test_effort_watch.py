"""What shows in how a run was integrated is told in finite steps, whatever it lost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.watches.bounds import Effort, effort_of
from rb_sim.watches.effort_watch import found_in


@pytest.mark.parametrize("lost", [0.5, 1e3, 1e300, math.inf])
def test_energy_lost_to_running_contacts_without_bound_names_a_step(lost: float) -> None:
    """A trial of another step blew up, and the search for a step ended in a traceback."""
    block = Simulation(load_scene("thrown_ball", duration=0.1), announce=None).sample().block
    effort = Effort("time_stepping", 0.002, None, 50, 0, restruck=lost)
    (finding,) = found_in(block, effort, 100.0, 1.0)
    assert finding.watch == "running contact" and finding.figure == lost
    assert finding.finer_step is not None and 0.0 < finding.finer_step < 0.002


@pytest.mark.parametrize(("duration", "tolerance"), [(1000.0, 1e-4), (300.0, 1e-4), (1000.0, 1e-6)])
def test_errors_that_add_up_to_the_phase_are_told(duration: float, tolerance: float) -> None:
    """x = cos(20 t): no more than 0.02 rad of the phase are lost without a word, and what is told
    is lost by the closed form.  A rod in contact that turned 2e4 times at a tolerance of 1e-4 was
    wrong by 1.4 % of its way, and nothing told it."""
    ball = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1], "position": [1.0, 0.0, 0.0]}
    spring = {"type": "spring", "body": "ball", "stiffness": 400.0, "rest_length": 0.0}
    setting = {"method": "taylor", "tolerance": tolerance, "duration": duration, "rate": 10.0}
    mapping = {"bodies": {"ball": ball}, "effects": {"spring": spring}, "simulation": setting}
    simulation = Simulation(load_scene(mapping))
    block = simulation.run(watched=False).block
    wrong = float(np.abs(block.position[:, 0, 0] - np.cos(20.0 * block.t)).max())
    found = found_in(block, effort_of(simulation), 10.0, 1.0)
    told = [finding for finding in found if finding.watch == "tolerance"]
    assert bool(told) == (wrong > 0.02)
    if told:
        assert told[0].figure == tolerance * simulation.steps > told[0].bound
        assert told[0].advice.endswith("1e-05")
