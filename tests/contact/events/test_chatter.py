"""Slips that rounding begins and ends: friction at its very bound holds, and soon."""

from __future__ import annotations

import math

import numpy as np

from rb_sim import Simulation, load_scene
from tests.contact.scenes import box, scene, touch


def test_a_box_at_the_very_threshold_of_slipping_rests() -> None:
    """A slope of atan(mu), to the last digit: rounding lets it slip, by 1e-20 m each time. It did
    so 900 times, each event for 5 ms, and was told to take days."""
    angle = math.atan(0.5)
    normal = [math.sin(angle), 0.0, math.cos(angle)]
    start = box([0.2, 0.2, 0.2], (0.1 * np.array(normal)).tolist())
    start |= {"orientation": {"axis": [0, 1, 0], "angle": angle}}
    mapping = scene(start, touch(mu=0.5, surface={"type": "plane", "normal": normal}))
    mapping["simulation"] = {"duration": 1.0, "rate": 100.0, "tolerance": 1e-9}
    simulation = Simulation(load_scene(mapping))
    run = simulation.run()
    assert np.abs(run.position["body"] - run.position["body"][0]).max() <= 1e-15
    slips = [event for event in simulation.events if event.kind == "slips"]
    assert len(slips) <= 12
