"""What shows in how a run was integrated is told in finite steps, whatever it lost."""

from __future__ import annotations

import math

import pytest

from rb_sim import Simulation, load_scene
from rb_sim.watches.bounds import Effort
from rb_sim.watches.effort_watch import found_in


@pytest.mark.parametrize("lost", [0.5, 1e3, 1e300, math.inf])
def test_energy_lost_to_running_contacts_without_bound_names_a_step(lost: float) -> None:
    """A trial of another step blew up, and the search for a step ended in a traceback."""
    block = Simulation(load_scene("thrown_ball", duration=0.1), announce=None).sample().block
    effort = Effort("time_stepping", 0.002, None, 50, 0, restruck=lost)
    (finding,) = found_in(block, effort, 100.0, 1.0)
    assert finding.watch == "running contact" and finding.figure == lost
    assert finding.finer_step is not None and 0.0 < finding.finer_step < 0.002
