# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Heaps under time stepping: they stand where the laws say rest, and none ends in silence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.heaps import scenes
from rb_sim import Simulation, load_scene
from rb_sim.contact.stepping.stepping_motion import SteppedContacts

pytestmark = pytest.mark.filterwarnings("error::rb_sim.AccuracyWarning")
"""What stands or falls as the laws say is not reported as lost."""

G = scenes.G


def run(mapping: dict[str, Any], duration: float, step: float) -> tuple[Any, SteppedContacts]:
    """(trajectory, motion) of a heap; kernels are compiled once for all of them."""
    options = mapping["simulation"] | {"duration": duration, "step": step, "rate": 4.0 / duration}
    simulation = Simulation(load_scene(mapping | {"simulation": options}))
    trajectory = simulation.run(check=False)
    motion = simulation._motion
    assert isinstance(motion, SteppedContacts)
    return trajectory, motion


def moved(trajectory: Any) -> float:
    """Largest change of any coordinate."""
    block = trajectory.block
    change = [np.abs(a - a[0]).max() for a in (block.position, block.orientation)]
    return float(max(change))


@pytest.mark.parametrize(
    ("count", "step", "duration"),
    [
        (2, 1e-2, 100.0), (2, 1e-4, 0.5), (5, 1e-3, 1.0), (10, 1e-2, 20.0), (10, 1e-4, 0.1),
    ],
)  # fmt: skip
def test_a_stack_stands(count: int, step: float, duration: float) -> None:
    """Not one coordinate changes, and each box carries the weight of those above."""
    trajectory, motion = run(scenes.stack(count), duration, step)
    assert moved(trajectory) == 0.0
    assert motion.unsolved_steps == 0
    for i in range(1, count):
        force = trajectory.reaction[f"c{i}"].force
        assert_allclose(force, np.tile([0.0, 0.0, 0.5 * G * (count - i)], (5, 1)), atol=1e-9)
    assert_allclose(trajectory.reaction["floor"].force[:, 2], 0.5 * G * count, rtol=1e-10)


@pytest.mark.parametrize("over", [0.001, 0.049, 0.0501, 0.08])
def test_a_box_that_hangs_over(over: float) -> None:
    """It stands as long as its centre is above the one below, and tips over beyond; one contact,
    whose body is the upper box, or the lower one."""
    mapping = scenes.stack(2)
    mapping["bodies"]["b1"]["position"][0] = over
    for body, parent in (("b1", "b0"), ("b0", "b1")):
        mapping["constraints"]["c1"] |= {"body": body, "parent": parent}
        trajectory, _ = run(mapping, 0.5, 5e-4)
        tipped = moved(trajectory) > 1e-4
        assert tipped == (over > 0.05)
        if not tipped:
            assert moved(trajectory) == 0.0


def test_a_box_on_the_edge_of_another() -> None:
    """Edge on edge, crossed, both turned by 45 degrees: for a few steps the one point bears it."""
    root = float(np.sqrt(0.5))
    mapping = scenes.stack(2)
    a, half = 0.1, 0.5 * np.pi / 2.0
    mapping["bodies"]["b0"] |= {
        "position": [0.0, 0.0, a * root],
        "orientation": [float(np.sin(half / 2.0)), 0.0, 0.0, float(np.cos(half / 2.0))],
    }
    mapping["bodies"]["b1"] |= {
        "position": [0.0, 0.0, 3.0 * a * root],
        "orientation": [0.0, float(np.sin(half / 2.0)), 0.0, float(np.cos(half / 2.0))],
    }
    trajectory, _ = run(mapping, 0.004, 1e-3)
    assert_allclose(trajectory.reaction["c1"].force[0], [0.0, 0.0, 0.5 * G], atol=1e-6)
    assert np.abs(trajectory.position["b1"][-1] - trajectory.position["b1"][0]).max() < 1e-5


def test_a_pyramid_stands() -> None:
    trajectory, motion = run(scenes.pyramid(), 0.2, 1e-3)
    assert moved(trajectory) == 0.0 and motion.unsolved_steps == 0
    floor = sum(trajectory.reaction[f"floor{i}"].force[-1] for i in range(5))
    assert_allclose(floor, [0.0, 0.0, 15 * 0.5 * G], atol=1e-8)


@pytest.mark.parametrize("name", ["break_shot", "dominoes", "balls_in_bin"])
def test_heaps_run(name: str) -> None:
    """Sixteen balls with 136 contacts, falling slabs, thirty balls with 585 contacts: no overlap,
    no energy gained, and what is lost is the work of the contacts."""
    trajectory, _ = run(getattr(scenes, name)(), 0.1, 1e-3)
    assert np.isfinite(trajectory.block.position).all()
    assert trajectory.block.residual.max() <= 1e-9
    lost = trajectory.energy - trajectory.energy[0]
    assert lost.max() <= 1e-9 * trajectory.energy[0]
    assert_allclose(lost, trajectory.contact_work, atol=1e-5 * trajectory.energy[0])


def test_balls_that_wedge_each_other_are_solved() -> None:
    """Ten balls fall into a narrow bin, where rubbing they have no rigid solution near by: every
    step is solved with a small give of friction, nothing overlaps, and in the end all rests."""
    trajectory, motion = run(scenes.piled_balls(), 2.0, 1e-3)
    assert motion.unsolved_steps == 0
    assert motion.solver_residual <= 1e-6
    assert 0.0 < motion.solver_give <= 1e-2
    assert trajectory.block.residual.max() <= 1e-9
    assert trajectory.energy[-1] < trajectory.energy[0]
    speeds = [np.abs(v[-1]).max() for v in trajectory.linear_velocity.values()]
    assert max(speeds) <= 1e-9


def test_dominoes_fall() -> None:
    """The first pushes the next one over, and so on."""
    trajectory, _ = run(scenes.dominoes(4), 1.0, 5e-4)
    for i in range(4):
        q = trajectory.orientation[f"d{i}"][-1]
        upright = 1.0 - 2.0 * (q[0] ** 2 + q[1] ** 2)
        assert upright < 0.9, i
