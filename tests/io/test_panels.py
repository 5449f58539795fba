# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Panels of the plots: work where commands jump, runs that begin anew, fewer points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.io.panels import Balance
from rb_sim.io.sink import Envelope, Thinned, Timeline
from rb_sim.mechanics.samples import SampleBlock, concatenate

RATE = 100


@pytest.mark.parametrize("frame", ["world", "body"])
@pytest.mark.parametrize("together", [True, False], ids=["in one block", "sample by sample"])
def test_work_is_the_change_of_energy_though_commands_jump(frame: str, together: bool):
    """A controller that holds its command for a period; without the jumps it is another one."""
    simulation = Simulation("rolling_sphere_commanded")
    blocks = [simulation.sample().block]
    for k in range(1, 60):
        force, torque = (3.0 * np.sin(2.3 * k), 2.0 * np.cos(k), 0.0), (0.0, 0.1 * (-1) ** k, 0.02)
        simulation.apply_wrench("ball", force, torque, frame)
        simulation.advance(1 / RATE)
        blocks.append(replace(simulation.sample().block, inputs=simulation.take_inputs()))
    balance = Balance(simulation.scene, simulation.layout)
    parts = [concatenate(blocks, simulation.layout)] if together else blocks
    change, work = np.concatenate([balance(part) for part in parts]).T
    assert np.abs(change).max() > 0.005
    np.testing.assert_allclose(work, change, atol=2e-3 * np.abs(change).max())


# Energy against work in the plots where a run is reset or a state is set: both begin anew.


RATE_RESTARTS, RESET, SET, END = 100, 40, 70, 100
"""Samples per second; the sample that shows the reset, the one of the state, and how many."""
A = 0.1
"""[m], the sphere's radius."""
ROLLING = {
    "position": (3.0, 0.0, A),
    "linear_velocity": (2.0, 0.0, 0.0),
    "angular_velocity": (0.0, 2.0 / A, 0.0),
}


def run() -> tuple[Simulation, list[SampleBlock]]:
    """The sphere, pushed; what it has gained is taken away, then it is put elsewhere and rolls.
    Stamps go on, as a node's do."""
    simulation = Simulation("rolling_sphere_commanded")
    blocks = [simulation.sample().block]
    simulation.apply_wrench("ball", (3.0, 1.0, 0.0), (0.0, 0.1, 0.02))
    for k in range(1, END):
        if k == RESET:
            simulation.reset()
        elif k == SET:
            simulation.set_state({"ball": ROLLING})
        else:
            if k == RESET + 1:
                simulation.apply_wrench("ball", (-2.0, 0.0, 0.0), (0.0, 0.0, 0.0))
            simulation.advance(1 / RATE_RESTARTS)
        block = replace(simulation.sample().block, inputs=simulation.take_inputs())
        blocks.append(replace(block, t=np.array([k / RATE_RESTARTS])))
    return simulation, blocks


@pytest.mark.parametrize("together", [True, False], ids=["in one block", "sample by sample"])
def test_a_reset_is_no_lost_energy_and_a_new_state_no_work(together: bool):
    simulation, blocks = run()
    balance = Balance(simulation.scene, simulation.layout)
    parts = [concatenate(blocks, simulation.layout)] if together else blocks
    change, work = np.concatenate([balance(part) for part in parts]).T
    assert change[RESET - 1] > 0.2 and change[SET - 1] > 0.05 and change[END - 1] < -0.5
    assert change[RESET] == work[RESET] == change[SET] == work[SET] == 0.0
    np.testing.assert_allclose(work, change, atol=2e-3 * np.abs(change).max())


# Fewer points in bounded memory, with every peak kept.


def feed(envelope: Envelope, t, values, sizes) -> None:
    first = 0
    while first < len(t):
        n = int(sizes.integers(1, 700))
        envelope.add(t[first : first + n], values[first : first + n])
        first += n


@pytest.mark.parametrize("n", [0, 1, 7, 63, 64, 65, 1000, 30_011])
def test_envelope_keeps_the_extremes(n):
    """Buckets of 2^k samples hold exactly the least and greatest of theirs."""
    random = np.random.default_rng(n)
    t, values = np.arange(n) * 0.5, random.normal(size=(n, 3))
    envelope = Envelope(3, capacity=32)
    feed(envelope, t, values, random)
    times, curves = envelope.curves()
    if n < 64:
        np.testing.assert_array_equal(times, t)
        np.testing.assert_array_equal(curves, values)
        return
    assert len(times) <= 2 * 64
    stride = 2 ** int(np.log2(n / 64) + 1)
    starts = np.arange(0, n, stride)
    np.testing.assert_array_equal(times[::2], t[starts])
    np.testing.assert_array_equal(curves[::2], np.minimum.reduceat(values, starts))
    np.testing.assert_array_equal(curves[1::2], np.maximum.reduceat(values, starts))


def test_thinned_keeps_both_ends():
    random = np.random.default_rng(0)
    rows = np.c_[np.arange(10_007.0), np.arange(10_007.0) ** 2]
    thinned, first = Thinned(2, capacity=50), 0
    while first < len(rows):
        n = int(random.integers(0, 300))
        thinned.add(rows[first : first + n])
        first += n
    kept = thinned.rows
    assert len(kept) <= 51
    np.testing.assert_array_equal(kept[0], rows[0])
    np.testing.assert_array_equal(kept[-1], rows[-1])
    assert set(np.diff(kept[:-1, 0])) == {256.0}


def test_timeline_goes_on_after_a_reset():
    timeline = Timeline()
    follow = [timeline.follow(np.array(t)) for t in ([0.0, 1, 2], [], [2.0, 3, 0, 1], [0.0, 5])]
    expected = [0, 1, 2, 2, 3, 3, 4, 4, 9]
    np.testing.assert_array_equal(np.concatenate(follow), expected)
