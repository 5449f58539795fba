# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Samples computed ahead are those computed one by one, to the last bit, whatever comes between."""

from __future__ import annotations

from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.base.errors import SimulationError
from rb_sim.mechanics.samples import ContactEvent
from rb_sim.motion.motion import NO_LIMITS
from rb_sim.ros.stepper import Ahead, Stepper
from rb_sim.scene.listing import find_scene
from rb_sim.scene.load import load_scene

RATE = 500.0
METHODS: list[dict[str, Any]] = [
    {"method": "rk4", "step": 7e-4},
    {"method": "gauss6", "step": 3e-3},
    {"method": "dopri853", "tolerance": 1e-10},
    {"method": "taylor", "tolerance": 1e-12},
    {"method": "radau5", "tolerance": 1e-9},
]
PAIR: dict[str, Any] = {
    "bodies": {
        "ball": {"mass": 2.0, "inertia": [0.1, 0.2, 0.3], "position": [0, 0, -0.3]},
        "weight": {"mass": 1.0, "inertia": [0.1, 0.1, 0.1], "position": [0, 0, -1]},
    },
    "constraints": {
        "pin": {"type": "fixed_point", "body": "ball", "point_B": [0, 0, 0.3]},
        "joint": {
            "type": "fixed_point",
            "body": "weight",
            "parent": "ball",
            "point_A": [0, 0, -0.3],
            "point_B": [0, 0, 0.4],
        },
    },
    "effects": {
        "gravity": {"type": "gravity"},
        "drive": {"type": "commanded_wrench", "body": "ball"},
    },
}
"""Two bodies, in maximal coordinates."""


class Slow(Ahead):
    """One sample at a time."""

    def next(self, *arguments: Any) -> Any:
        self._most = 1
        return super().next(*arguments)


def walk(ahead: Ahead, simulation: Simulation, seed: int, samples: int = 150) -> list[Any]:
    """Samples under commands and looks at the simulation, now and then."""
    chance, rows = np.random.default_rng(seed), []
    for k in range(1, samples + 1):
        if simulation.layout.commanded and chance.random() < 0.05:
            frame = "world" if chance.random() < 0.5 else "body"
            body = simulation.layout.commanded[0]
            ahead.apply_wrench(body, *chance.normal(size=(2, 3)).tolist(), frame=frame)
        if chance.random() < 0.05:
            ahead.rewind()
            assert simulation.time == pytest.approx((k - 1) / RATE, abs=1e-12)
            rows.append(simulation.sample_row())
        if chance.random() < 0.5:
            ahead.fill(k, 0.25, None, NO_LIMITS)
        row = ahead.next(k, 0.25, None, NO_LIMITS)
        assert row is not None
        rows.append(row)
    ahead.rewind()
    return [*rows, simulation.steps, simulation.rejected_steps]


@pytest.mark.parametrize(
    ("scene", "setting"),
    [
        *(("rolling_sphere_commanded", setting) for setting in METHODS),
        ("heavy_top", METHODS[0]),
        (PAIR, METHODS[2]),
    ],
)
def test_ahead_and_one_by_one_agree_to_the_last_bit(scene, setting, monkeypatch):
    monkeypatch.setattr("rb_sim.ros.stepper.BUDGET", 1e9)
    source = scene if isinstance(scene, dict) else find_scene(scene)
    loaded, found = load_scene(source, **setting), []
    for kind in (Ahead, Slow):
        simulation = Simulation(loaded, announce=None)
        found.append(walk(kind(simulation, RATE), simulation, seed=3))
    for one, other in zip(*found, strict=True):
        if isinstance(one, int):
            assert one == other
            continue
        assert one.t == other.t
        np.testing.assert_array_equal(one.row, other.row)
        np.testing.assert_array_equal(one.command, other.command)


def test_what_is_due_waits_for_no_others(monkeypatch):
    """Those are computed and packed before: one in 32 samples would be late by as much."""
    monkeypatch.setattr("rb_sim.ros.stepper.BUDGET", 1e9)
    simulation, did = Simulation("rolling_sphere_commanded", announce=None), []
    plain = simulation.step_rows

    def computed(times, *arguments):
        did.append("computed")
        return plain(times, *arguments)

    monkeypatch.setattr(simulation, "step_rows", computed)
    commands, sink = Mock(), Mock()
    sink.prepare = lambda _: did.append("packed")
    stepper = Stepper(simulation, commands, [sink], RATE)
    in_time = []
    for _ in range(100):
        did.clear()
        stepper.step(0.0)
        in_time.append(not did)
        stepper.look_ahead()
    assert in_time == [False] * 2 + [True] * 98  # samples 2 and 3 are a go of two
    did.clear()
    stepper.rewind()
    stepper.look_ahead()
    assert did.count("packed") == 0  # nor right behind a command


def test_costly_samples_are_not_computed_ahead(monkeypatch):
    monkeypatch.setattr("rb_sim.ros.stepper.BUDGET", 0.0)
    simulation = Simulation("rolling_sphere_commanded", announce=None)
    ahead = Ahead(simulation, RATE)
    for k in range(1, 50):
        ahead.next(k, 0.0, None, NO_LIMITS)
        assert simulation.time == pytest.approx(k / RATE, abs=1e-12)


def test_a_motion_without_a_way_back_goes_one_by_one():
    """That of bodies in contact."""
    simulation = Simulation("bouncing_ball", announce=None)
    assert simulation.keep() is None
    ahead = Ahead(simulation, RATE)
    for k in range(1, 20):
        ahead.next(k, 0.0, None, NO_LIMITS)
        assert simulation.time == pytest.approx(k / RATE, abs=1e-12)


def test_a_motion_that_ends_is_reported_at_its_sample(monkeypatch):
    """What was computed ahead up to there is handed out first."""
    monkeypatch.setattr("rb_sim.ros.stepper.BUDGET", 1e9)
    simulation = Simulation("rolling_sphere_commanded", announce=None)
    plain = simulation.step_rows

    def ends(times, *arguments):
        if times[-1] > 0.1001:
            raise SimulationError("a wall")
        return plain(times, *arguments)

    monkeypatch.setattr(simulation, "step_rows", ends)
    ahead = Ahead(simulation, RATE)
    for k in range(1, 51):
        row = ahead.next(k, 0.0, None, NO_LIMITS)
        assert row is not None and row.t == pytest.approx(k / RATE)
    with pytest.raises(SimulationError, match="a wall"):
        ahead.next(51, 0.0, None, NO_LIMITS)
    assert simulation.time == pytest.approx(0.1)


def test_a_watch_that_ends_it_leaves_the_last_sample_the_last(monkeypatch):
    monkeypatch.setattr("rb_sim.ros.stepper.BUDGET", 1e9)
    simulation = Simulation("rolling_sphere_commanded", announce=None)
    ahead = Ahead(simulation, RATE)
    for k in range(1, 8):
        ahead.next(k, 0.0, None, NO_LIMITS)
    monkeypatch.setattr(simulation, "step_rows", lambda *_: [])
    assert ahead.next(8, 0.0, None, NO_LIMITS) is None
    assert simulation.time == pytest.approx(7 / RATE)


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
        stepper.rewind()  # without what was computed ahead
        counts.append(stepper.steps)
        change()
        assert stepper.steps == counts[-1]
    assert counts[0] > 20 and counts[1] == 2 * counts[0] and counts[2] > counts[1] + 20
