"""What the loop of samples keeps for answers."""

from __future__ import annotations

from unittest.mock import Mock

from rb_sim import Simulation
from rb_sim.mechanics.samples import ContactEvent
from rb_sim.ros.stepper import Stepper


def test_events_beyond_those_that_are_kept_are_counted(monkeypatch):
    """An answer told the last ones as if they were all."""
    monkeypatch.setattr("rb_sim.ros.stepper.MOST_RECENT", 3)
    simulation = Simulation("rolling_sphere_commanded", announce=None)
    stepper = Stepper(simulation, Mock(), [], rate=100.0)
    events = tuple(ContactEvent(0.001 * k, "floor", "impact") for k in range(8))
    for few in (events[:2], events[2:7], events[7:]):
        monkeypatch.setattr(simulation, "take_events", lambda few=few: few)
        stepper.emit()
    assert stepper.take_events() == (list(events[5:]), 5)
    assert stepper.take_events() == ([], 0)


def test_steps_are_counted_beyond_a_reset_and_a_state_that_was_set():
    """The summary of a bag told those since the last of them as if they were all."""
    simulation = Simulation("heavy_top", announce=None)
    stepper = Stepper(simulation, Mock(), [], rate=100.0)
    counts = []
    for change in (stepper.reset, lambda: stepper.set_state({"top": {}}, project=True), int):
        for _ in range(20):
            assert stepper.step(0.0)
        stepper.settle()  # without what was computed ahead
        counts.append(stepper.steps)
        change()
        assert stepper.steps == counts[-1]
    assert counts[0] > 20 and counts[1] == 2 * counts[0] and counts[2] > counts[1] + 20
