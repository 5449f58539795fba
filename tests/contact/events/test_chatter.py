"""Slips that rounding begins and ends: friction at its very bound holds, and soon."""

from __future__ import annotations

import math

import numpy as np

from rb_sim import Simulation, load_scene
from rb_sim.contact.problem.bounces import DENSE, GRIP, LONGEST_LEAP, SHORT_SLIPS, Chatter
from rb_sim.mechanics.contact.contact_bodies import SLIP_BEGINS, SLIP_ENDS
from tests.contact.scenes import box, scene, touch

UNIT = 0.2
"""[s]."""
SHORT, LONGER, LONG = 0.1 * DENSE * UNIT, 3.0 * DENSE * UNIT, 2.0 * LONGEST_LEAP * UNIT


def gripped_after(lengths: list[float]) -> float:
    """How much more friction holds after slips of these lengths [s], one after the other."""
    chatter, t = Chatter(UNIT), 0.0
    for length in lengths:
        chatter.holds_firmer(t, SLIP_BEGINS)
        t += length
        chatter.holds_firmer(t, SLIP_ENDS)
    return chatter.grip


def test_short_slips_count_beside_others_that_hardly_matter() -> None:
    assert gripped_after([SHORT, LONGER] * (SHORT_SLIPS - 1)) == 0.0
    assert gripped_after([SHORT, LONGER] * SHORT_SLIPS) == GRIP


def test_a_slip_that_moves_something_begins_the_count_anew() -> None:
    assert gripped_after([SHORT] * (SHORT_SLIPS - 1) + [LONG] + [SHORT]) == 0.0
    assert gripped_after([LONGER] * 10 * SHORT_SLIPS) == 0.0


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
    assert len(slips) <= 4 * 3 * SHORT_SLIPS
