"""What shows in how a run was integrated is told in finite steps, whatever it lost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.watches.bounds import Effort, effort_of
from rb_sim.watches.effort_watch import found_in, turns


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


TOP = {"mass": 0.22, "inertia": [0.0026, 0.0022, 0.00335], "angular_velocity": [10.0, 6.0, -4.0]}


def test_a_long_step_of_auto_was_measured_and_is_told_only_beyond() -> None:
    """Its 4 rad keep the pose to 1e-3; the same step, named, and longer runs are not measured."""
    setting = {"method": "auto", "tolerance": 1e-3, "duration": 2.0, "rate": 50.0}
    scene = {"bodies": {"top": TOP}, "simulation": setting}
    chosen = Simulation(load_scene(scene), announce=None)
    assert chosen.choice is not None and chosen.choice.step is not None
    block = chosen.run(watched=False).block
    sharp = Simulation(load_scene(scene, method="dopri853", tolerance=1e-13), announce=None)
    exact = sharp.run(watched=False).block
    assert np.abs(block.orientation - exact.orientation).max() < 0.5e-3
    effort = effort_of(chosen)
    bodies = chosen.layout.bodies
    assert not [*found_in(block, effort, 50.0, 1.0), *turns(block, effort, bodies)]
    for unmeasured in (effort._replace(kept_to=0.0), effort._replace(kept_to=1.99)):
        assert [finding.watch for finding in turns(block, unmeasured, bodies)] == ["turn"]
