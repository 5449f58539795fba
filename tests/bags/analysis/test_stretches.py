# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Balances of runs of ours with commands, a reset and a state that was set."""

from __future__ import annotations

from pathlib import Path

import pytest

from rb_sim.bags.analysis.run import analyze
from tests.bags.scenes import Commander, record_node
from tests.interpreted import interpreted

WORK = """\
bodies:
  box: {mass: 2.0, inertia: [0.02, 0.03, 0.04], center_of_mass: [0.1, 0.0, 0.05]}
effects:
  drive: {type: commanded_wrench, body: box}
simulation: {duration: 1.0, method: rk4, step: 5.0e-3, rate: 100}
"""
FORCE = 3.0
AT = (10, 30, 55)
"""Samples from which on the force is another one."""


def _node(folder: Path, reset_at: int, set_at: int) -> Path:
    """Forces along x that change, a reset, and a box that is put elsewhere at rest."""
    from rb_sim import Simulation, load_scene
    from rb_sim.io.bag.sink import BagSink
    from rb_sim.ros.stepper import Stepper

    simulation = Simulation(load_scene(WORK))
    sink = BagSink(folder, run={"by": "node"})
    sink.open(simulation.scene, simulation.layout)
    plan = {k: [((FORCE * (i + 1), 0.0, 0.0), (0.0,) * 3, "world")] for i, k in enumerate(AT)}
    stepper = Stepper(simulation, Commander(plan), [sink], 100.0)  # type: ignore[arg-type]
    stepper.emit()
    for k in range(100):
        if k == reset_at:
            stepper.reset()
        elif k == set_at:
            put = {"position": (5.0, 0.0, 0.0), "linear_velocity": (0.0, 7.0, 0.0)}
            stepper.set_state({"box": put}, project=False)
        else:
            stepper.step(0.0)
    sink.close({})
    return folder


@pytest.fixture(scope="module")
def bag(tmp_path_factory) -> Path:
    pytest.importorskip("rclpy")
    return interpreted(_node, tmp_path_factory.mktemp("node") / "bag", 40, 80)


def test_nothing_is_balanced_across_a_reset_or_a_state_that_was_set(bag):
    """The momentum that a reset takes away is no error, nor is the energy that a new state has."""
    found = analyze(bag)
    balance = found.balance
    assert balance is not None and balance["stretches"] == 3
    assert abs(balance["energy"]["error"]) < 1e-5 * balance["energy"]["scale"]
    for part in ("linear", "angular"):
        assert balance["momentum"][part]["error"] < 1e-5 * balance["momentum"][part]["scale"]
    assert any(note.startswith("reset or put elsewhere 2 times (t = 0.41, 0.81 s)")
               for note in found.notes)  # fmt: skip


def test_nothing_is_differentiated_across_them(bag):
    """All forces are along x; across the new velocity it would be some 700 N along y."""
    found = analyze(bag).as_dict()["bodies"]["box"]
    assert found["wrench"]["Fy"]["largest"] < 0.05
    assert found["apart"]["force"] < FORCE


def test_the_work_of_commands_that_change(bag):
    """It is what each stretch has gained. A change acts from the sample before the one that shows
    it, and the power jumps there."""
    from rb_sim.io.bag.reader import BagReader

    (block,) = BagReader(bag).blocks()
    gained = block.kinetic_energy[[40, 80, 100]] - block.kinetic_energy[[0, 41, 81]]
    found = analyze(bag)
    assert found.balance is not None
    assert found.balance["energy"]["work"] == pytest.approx(gained.sum(), rel=1e-5)


def test_commands_in_body_axes_and_a_reset(tmp_path):
    """The box that turns at 2 rad/s, sampled 50 times a second."""
    pytest.importorskip("rclpy")
    found = analyze(interpreted(record_node, tmp_path / "bag"))
    assert found.balance is not None
    assert found.balance["stretches"] == 2
    assert abs(found.balance["energy"]["error"]) < 1e-4 * found.balance["energy"]["scale"]
    assert found.balance["momentum"]["linear"]["error"] < 1e-4
