# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What keeps touching, or rolls, keeps its energy to second order in the step, and gains none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim.simulation.simulation import Simulation
from tests.contact.scenes import G, ball, body, scene, touch

BOWL = {"type": "sphere", "center": [0.0, 0.0, 1.0], "radius": 1.0, "side": "inside"}
HUMP = {"type": "sphere", "center": [0.0, 0.0, -1.0], "radius": 1.0}
STONE = body(
    {"type": "ellipsoid", "semi_axes": [0.13, 0.1, 0.08]},
    [0.0, 0.0, 0.08],
    linear_velocity=[0.2, 0.1, 0.0],
    angular_velocity=[-0.1 / 0.08, 0.2 / 0.08, 0.5],
)
"""It rolls on its flattest side."""
SCENES = {
    "slides in a bowl": (
        ball([0.0, 0.0, 0.1], linear_velocity=[3.0, 0.0, 0.0]),
        touch(surface=BOWL),
    ),
    "rolls in a bowl": (
        ball([0.0, 0.0, 0.1], linear_velocity=[2.0, 0.0, 0.0], angular_velocity=[0.0, 20.0, 0.0]),
        touch(mu=5.0, surface=BOWL),
    ),
    "slides off a hump": (
        ball([0.0, 0.0, 0.1], linear_velocity=[0.8, 0.0, 0.0]),
        touch(surface=HUMP),
    ),
    "rolls on a floor": (STONE, touch(mu=5.0)),
}


def run_of(name: str, **how: Any) -> Any:
    mapping = scene(*SCENES[name])
    mapping["simulation"] = {"duration": 0.4, "rate": 50.0} | how
    return Simulation(mapping).run()


@pytest.mark.parametrize("name", list(SCENES))
def test_what_keeps_touching_moves_as_with_exact_events_to_second_order(name: str) -> None:
    """With the velocity along the normal, or of what sticks, zero in the middle of each step, it
    would do so to first order, and lose or gain some percent of its energy in steps of 2 ms."""
    exact = run_of(name, tolerance=1e-11)
    runs = [run_of(name, method="time_stepping", step=step) for step in (4e-3, 2e-3, 1e-3)]
    errors = [np.abs(run.block.position - exact.block.position).max() for run in runs]
    assert errors[1] < 1e-4
    assert 3.9 < errors[0] / errors[1] < 4.1
    assert 3.9 < errors[1] / errors[2] < 4.1
    energy = np.abs(runs[1].energy - runs[1].energy[0]).max()
    assert energy <= 1e-4 * (runs[1].block.kinetic_energy.max() + 0.1 * G)


def hopping(step: float) -> tuple[float, float]:
    """(energy at the start, the most that it rises by) of a ball that leaves a floor at less than
    its weight gives in a step."""
    start = ball([0.0, 0.0, 0.1], linear_velocity=[0.0, 0.0, 0.04])
    mapping = scene(start, touch())
    mapping["simulation"] = {"duration": 0.1, "rate": 1.0 / step}
    mapping["simulation"] |= {"method": "time_stepping", "step": step}
    run = Simulation(mapping).run()
    return float(run.energy[0]), float((run.energy - np.minimum.accumulate(run.energy)).max())


def test_what_leaves_and_is_brought_back_in_a_step_gains_nothing() -> None:
    """Stopped where half of the step has carried it, it would keep that height for nothing: 2e-3 J,
    more than the 8e-4 J of its speed."""
    start, gained = hopping(1e-2)
    assert start > G * 0.1
    assert gained <= 1e-12


def stopped_on_a_slope(step: float) -> tuple[float, float, float]:
    """(energy made as it is told, gained over the run, closed form) of a block that slides up a
    slope and sticks within the step: stopped at once it has come g sin(lean) h/2 per speed, and
    lost its own energy."""
    lean, speed = 0.3, 0.01
    up = np.array([-np.cos(lean), 0.0, np.sin(lean)])
    normal = np.array([np.sin(lean), 0.0, np.cos(lean)])
    size = [0.2, 0.2, 0.2]
    block = body(
        {"type": "box", "size": size},
        0.1 * normal,
        orientation={"axis": [0.0, 1.0, 0.0], "angle": lean},
        linear_velocity=speed * up,
    )
    plane = {"type": "plane", "normal": normal.tolist()}
    mapping = scene(block, touch(mu=0.5, surface=plane))
    mapping["simulation"] = {"duration": step, "rate": 1.0 / step}
    mapping["simulation"] |= {"method": "time_stepping", "step": step}
    simulation = Simulation(mapping)
    run = simulation.run()
    expected = 0.5 * speed * (G * np.sin(lean) * step - speed)
    return simulation.made_energy, float(run.energy[-1] - run.energy[0]), expected


def test_energy_that_contacts_make_is_counted() -> None:
    made, gained, expected = stopped_on_a_slope(1e-2)
    assert expected > 9e-5
    assert abs(gained - expected) < 1e-9
    assert abs(made - expected) < 1e-9
