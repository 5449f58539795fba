"""Loads that are no number: a step that is too long ends a run in one line, whoever meets them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.base.errors import StepTooLargeError
from tests.contact.scenes import ball, scene, touch
from tests.contact.stepping.test_motion import motion_of


def pulled(speed: float) -> dict[str, Any]:
    """A ball that flies from 0.5 m to where a spring with a length is fixed, at 1 m."""
    spring = {
        "type": "spring", "body": "ball", "point_A": [0, 0, 1], "stiffness": 10.0,
        "rest_length": 0.2,
    }  # fmt: skip
    bodies = {"ball": ball([0, 0, 0.5], linear_velocity=[0, 0, speed])}
    mapping = scene(bodies, {"floor": touch("ball")}, gravity=False, spring=spring)
    run = {"method": "time_stepping", "step": 0.1, "duration": 0.1, "rate": 10.0}
    return mapping | {"simulation": run}


def test_a_spring_that_has_lost_its_direction_ends_the_run() -> None:
    """In the middle of the first step its ends meet exactly."""
    with pytest.raises(
        StepTooLargeError, match=r"no longer finite at t = 0 s: step 0\.1 s is too large"
    ):
        Simulation(pulled(10.0)).run()
    assert np.isfinite(Simulation(pulled(10.1)).run().energy).all()


def test_an_egg_that_is_thrown_out_of_the_world_has_no_nearest_point() -> None:
    """Its distance has no square, so that it lies in no direction, and Python divides by zero; the
    step that led there has no numbers, which ends the run."""
    egg = {"mass": 1.0, "shape": {"type": "ellipsoid", "semi_axes": [0.2, 0.3, 0.1]}}
    ground = touch("egg", surface={"type": "sphere", "radius": 1.0})
    mapping = scene({"egg": egg | {"position": [0, 0, 2]}}, {"ground": ground})
    run = {"method": "time_stepping", "step": 0.01, "duration": 1.0}
    motion = motion_of(mapping | {"simulation": run})
    y = np.array(motion.coordinates)
    motion._find_others(0.0, y)
    assert np.isfinite(y).all()
    y[0:3] = 1e200
    motion._find_others(0.0, y)
    assert np.isnan(y).all()
