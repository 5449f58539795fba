"""Time stepping tends to the exact motion where a rim lands at an angle, and books its work."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.testing import assert_allclose

from rb_sim.simulation import Simulation
from tests.contact.scenes import body, scene, touch

SHAPE = {"type": "disk", "radius": 0.1}
START = body(
    SHAPE,
    [0.0, 0.0, 0.2],
    orientation={"axis": [0.0, 1.0, 0.0], "angle": 0.9},
    linear_velocity=[0.2, 0.1, -1.0],
    angular_velocity=[3.0, 1.0, 2.0],
)


def stepped(step: float) -> Any:
    """The trajectory over 0.25 s of a disk that lands on its rim, without friction."""
    mapping = scene(START, touch())
    mapping["simulation"] = {
        "duration": 0.25, "rate": 40.0, "method": "time_stepping", "step": step
    }  # fmt: skip
    return Simulation(mapping).run()


def test_a_disk_that_lands_on_its_rim() -> None:
    """Its place and energy after the impact tend to a limit with the step, and energy changes by
    the work that is booked, at any step."""
    runs = [stepped(step) for step in (8e-4, 4e-4, 2e-4, 1e-4, 5e-5, 2e-6)]
    for run in runs:
        assert run.contact_work[-1] < -0.05  # it has struck
        assert_allclose(run.energy - run.energy[0], run.contact_work, atol=1e-9)
    last = runs[-1]
    energy = [abs(run.energy[-1] - last.energy[-1]) for run in runs[:-1]]
    place = [
        np.abs(run.position["body"][-1] - last.position["body"][-1]).max() for run in runs[:-1]
    ]
    for errors in (energy, place):
        assert errors[-1] <= 0.25 * errors[0]
    assert energy[-1] <= 0.02 * last.energy[0]
