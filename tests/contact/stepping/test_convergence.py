# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Time stepping tends to the exact motion where a rim lands at an angle, and books its work."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.accuracy.checks.check import effort_of
from rb_sim.accuracy.checks.check_list import CheckList
from rb_sim.simulation.simulation import Simulation
from tests.contact.scenes import body, scene, touch

SHAPE = {"type": "disk", "radius": 0.1}
START = body(
    SHAPE,
    [0.0, 0.0, 0.2],
    orientation={"axis": [0.0, 1.0, 0.0], "angle": 0.9},
    linear_velocity=[0.2, 0.1, -1.0],
    angular_velocity=[3.0, 1.0, 2.0],
)


def stepping(duration: float, rate: float, step: float) -> dict[str, Any]:
    """A run by time stepping."""
    return {"duration": duration, "rate": rate, "method": "time_stepping", "step": step}


def stepped(step: float) -> Any:
    """The trajectory over 0.25 s of a disk that lands on its rim, without friction."""
    mapping = scene(START, touch())
    mapping["simulation"] = stepping(0.25, 40.0, step)
    return Simulation(mapping).run(checks=False)


def test_a_disk_that_lands_on_its_rim() -> None:
    """Its place and energy after the impact tend to a limit with the step, and energy changes by
    the work that is booked, at any step."""
    runs = [stepped(step) for step in (8e-4, 4e-4, 2e-4, 1e-4, 5e-5, 2e-6)]
    for run in runs:
        assert run.contact_work[-1] < -0.05  # it has struck
        assert_allclose(run.energy - run.energy[0], run.contact_work, atol=1e-9)
    last = runs[-1]
    energy = [abs(run.energy[-1] - last.energy[-1]) for run in runs[:-1]]
    place = [
        np.abs(run.position["body"][-1] - last.position["body"][-1]).max() for run in runs[:-1]
    ]
    for errors in (energy, place):
        assert errors[-1] <= 0.25 * errors[0]
    assert energy[-1] <= 0.02 * last.energy[0]


def watched(mapping: dict[str, Any]) -> tuple[Simulation, Any, str]:
    """The simulation after its run, the trajectory, and what the checks say."""
    simulation = Simulation(mapping)
    check_list = CheckList(simulation.scene, simulation.layout)
    run = simulation.run()
    check_list.add(run.block, effort_of(simulation))
    return simulation, run, " ".join(str(finding) for finding in check_list.findings)


def reported(start: Any, step: float, mu: float) -> tuple[int, str]:
    """(steps told as too long for a point that runs around its body, what the checks say)."""
    mapping = scene(start, touch(mu=mu))
    mapping["simulation"] = stepping(0.2, 40.0, step)
    simulation, _, text = watched(mapping)
    return simulation.circling_steps, text


def test_a_step_too_long_for_a_thin_disk_is_reported() -> None:
    """Where the disk is nearly flat its lowest point runs around the rim within a step, and is
    struck here and there; a wheel that rolls upright, however fast, and a ball are none of that."""
    low = START | {"position": [0.0, 0.0, 0.1], "angular_velocity": [0.3, 0.1, 0.2]}
    steps, text = reported(low, 1e-3, 0.0)
    assert steps > 0 and "contact steps" in text and "try step" in text
    upright = {"axis": [1.0, 0.0, 0.0], "angle": np.pi / 2.0}
    wheel = body(SHAPE, [0.0, 0.0, 0.1], orientation=upright, linear_velocity=[3.0, 0.0, 0.0],
                 angular_velocity=[0.0, 0.0, -30.0])  # fmt: skip
    round_ = {"type": "sphere", "radius": 0.1}
    ball = body(round_, [0.0, 0.0, 0.15], angular_velocity=[9.0, 2.0, 5.0])
    for start in (wheel, ball):
        steps, text = reported(start, 5e-3, 0.5)
        assert steps == 0 and "contact steps" not in text


def paradox(mu: float, step: float = 1e-3) -> tuple[int, str]:
    """(steps with Painleve's paradox, what the checks say) of a rod that slides on its end."""
    rod = body(
        {"type": "rod", "length": 1.0},
        [0.5 * np.cos(0.8), 0.0, 0.5 * np.sin(0.8)],  # 0.8 rad from the floor, on its lower end
        orientation={"axis": [0.0, 1.0, 0.0], "angle": np.pi / 2.0 - 0.8},
        linear_velocity=[-10.0, 0.0, 0.0],
    )
    mapping = scene(rod, touch(mu=mu))
    mapping["simulation"] = stepping(0.05, 100.0, step)
    simulation, _, text = watched(mapping)
    return simulation.paradox_steps, text


def test_painleves_paradox_is_reported() -> None:
    """A rod whose end slides away from under it jams on a rough floor; on one where friction never
    pulls it down by more than the floor lifts it, it slides."""
    steps, text = paradox(2.0)
    assert steps > 0 and "paradox" in text and "event-driven" in text
    steps, text = paradox(0.3)
    assert steps == 0 and "paradox" not in text


def rolls() -> int:
    """Steps with Painleve's paradox of a stone that rolls on a rough floor."""
    semi_axes = [0.2, 0.05, 0.03]
    lean = 1.2
    height = float(np.hypot(semi_axes[1] * np.sin(lean), semi_axes[2] * np.cos(lean)))
    stone = body(
        {"type": "ellipsoid", "semi_axes": semi_axes},
        [0.0, 0.0, height],
        orientation={"axis": [1.0, 0.0, 0.0], "angle": lean},
        angular_velocity=[2.0, 1.0, 3.0],
    )
    mapping = scene(stone, touch(mu=50.0))
    mapping["simulation"] = stepping(0.2, 50.0, 2e-3)
    simulation = Simulation(mapping)
    simulation.run(checks=False)
    return simulation.paradox_steps


def test_what_rolls_has_no_paradox() -> None:
    """Its point of contact moves on within the step and has a speed there, but does not slip."""
    assert rolls() == 0


def rough_slips(shape: dict[str, Any], low: float) -> tuple[int, str, Any]:
    """(steps in which a perfectly rough contact slips, what the checks say, the run) of a body
    that falls on a sphere by a micrometre, and goes sideways."""
    start = body(shape, [0.06, 0.0, 0.500001 + low], linear_velocity=[0.6, 0.1, 0.0])
    rough = touch(surface={"type": "sphere", "radius": 0.5}) | {"friction": {"type": "rough"}}
    mapping = scene(start, rough)
    mapping["simulation"] = stepping(0.02, 1000.0, 1e-4)
    simulation, run, text = watched(mapping)
    return simulation.slipping_steps, text, run


def test_what_may_not_slip_and_does_is_reported() -> None:
    """Friction that stops a box beside its middle would lift it, with no push left to rub; as with
    a very large coefficient it goes on for 10 ms.  A ball is stopped at once."""
    steps, text, run = rough_slips({"type": "box", "size": [0.5, 0.3, 0.1]}, 0.05)
    assert 50 < steps < 150 and "a perfectly rough contact slips" in text
    assert run.linear_velocity["body"][5, 0] > 0.2  # it is on its way yet
    steps, text, run = rough_slips({"type": "sphere", "radius": 0.05}, 0.05)
    assert steps == 0 and "rough" not in text


def in_a_bowl(step: float) -> tuple[float, float, float, str]:
    """Energy at the start, lost, and where contacts bore; what the checks say of a ball that
    slides in a bowl without friction, which keeps its energy."""
    bowl = {"type": "sphere", "center": [0.0, 0.0, 1.0], "radius": 1.0, "side": "inside"}
    mapping = scene(
        body({"type": "sphere", "radius": 0.1}, [0.0, 0.0, 0.1], linear_velocity=[3.0, 0.0, 0.0]),
        touch(surface=bowl),
    )
    mapping["simulation"] = stepping(1.0, 50.0, step)
    simulation, run, text = watched(mapping)
    return 4.5, float(run.energy[0] - run.energy[-1]), simulation.restruck_energy, text


def test_energy_lost_where_a_contact_bears_already_is_reported() -> None:
    """Where a step is long its point moves on along a curved wall by more than the step before
    tells, and is struck anew; of second order."""
    start, lost, restruck, text = in_a_bowl(5e-2)
    assert lost > 0.02 * start
    assert 0.3 * lost < restruck < 3.0 * lost
    assert "contact steps" in text and "try step" in text
    _, less, _, text = in_a_bowl(1e-2)
    assert less < 0.05 * lost and "contact steps" not in text


def test_a_lift_off_where_the_end_could_as_well_push_is_reported() -> None:
    """At mu 1.6 it slides into the paradox. A step of 1e-4 s lifts it off there, where the end that
    has borne until then could as well jam, as it does with exact events."""
    steps, text = paradox(1.6, 1e-4)
    assert steps > 0 and "paradox" in text


@pytest.mark.parametrize("step", [1e-2, 1e-3, 1e-4])
def test_a_table_that_shakes_carries_a_ball(step: float) -> None:
    """It stays on it, and is pushed by m (g - A w^2 sin w t), of which g is 70 times the rest: what
    the table lifts costs it no speed."""
    amplitude, frequency = 1e-3, 12.0  # [m, rad/s]
    lying = body(
        {"type": "sphere", "radius": 0.2},
        [0, 0, 0.2],
        linear_velocity=[0, 0, amplitude * frequency],
    )
    shaken = {"type": "shaken", "direction": [0, 0, 1], "amplitude": amplitude}
    contact = touch(motion=shaken | {"frequency": frequency / (2.0 * np.pi)})
    mapping = scene(lying, contact) | {"simulation": stepping(0.6, 100.0, step)}
    run = Simulation(mapping).run(checks=False)
    t, a = run.t, amplitude * frequency**2
    speed = run.linear_velocity["body"][:, 2]
    assert_allclose(speed, a / frequency * np.cos(frequency * t), atol=0.015 * step)
    push = run.reaction["floor"].force[:, 2]
    weight = mapping["effects"]["weight"]["acceleration"][2]
    assert_allclose(push[2:], -weight - a * np.sin(frequency * t)[2:], atol=0.15 * a)
