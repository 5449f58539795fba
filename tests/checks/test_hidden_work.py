"""Energy that is lost while samples lie too far apart to tell the work of loads."""

from __future__ import annotations

import warnings
from typing import Any

import pytest

from rb_sim import Simulation
from tests.contact.scenes import ball, scene, touch


def run(step: float, rate: float) -> Any:
    """An arm that turns about its pin at 40 rad/s, braked by some air, beside a ball on a floor."""
    arm = {
        "mass": 1.0, "inertia": [0.01, 0.01, 0.01], "position": [0.3, 0.0, 2.0],
        "linear_velocity": [0.0, 12.0, 0.0], "angular_velocity": [0.0, 0.0, 40.0],
    }  # fmt: skip
    bodies = {"ball": ball([0.0, 0.0, 0.1]), "arm": arm}
    pin = {"type": "fixed_point", "body": "arm", "point_B": [-0.3, 0.0, 0.0], "point_A": [0, 0, 2]}
    air = {"type": "linear_drag", "body": "arm", "coefficient": 1e-4}
    mapping = scene(bodies, {"floor": touch("ball"), "pin": pin}, air=air)
    mapping["simulation"] = {
        "method": "time_stepping", "step": step, "duration": 1.0, "rate": rate
    }  # fmt: skip
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        return Simulation(mapping).run()


@pytest.mark.parametrize("rate", [10.0, 100.0])
def test_energy_that_long_steps_lose_is_told_however_far_samples_lie_apart(rate: float) -> None:
    """At ten samples a second the arm goes round by 4 rad between two."""
    lost = run(0.02, rate)
    assert lost.energy[-1] < 0.95 * lost.energy[0]
    assert "energy" in {finding.watch for finding in lost.findings}


def test_a_run_that_keeps_its_energy_is_not_accused() -> None:
    kept = run(1e-3, 10.0)
    assert kept.energy[-1] == pytest.approx(kept.energy[0], rel=1e-3)
    assert "energy" not in {finding.watch for finding in kept.findings}
