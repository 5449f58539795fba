# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A step of impulses books the work of every contact force."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.contact.events.instant import Instant, bring_back, leap
from rb_sim.mechanics.contact.contact_bodies import GAP, GAP_RATE
from rb_sim.mechanics.systems.many_bodies import WIDTH
from tests.contact.scenes import G, ball, scene, touch
from tests.interpreted import interpreted

SOFT = {"compliance": {"stiffness": 3e3, "damping": 20.0}}
VISCOUS = {"friction": {"type": "viscous", "coefficient": 5.0}}


def energies(law: dict) -> tuple[float, float]:
    """Energy minus work of the contacts before and after a leap of 1 ms [J]."""
    z = 0.095 if "compliance" in law else 0.1
    moving = ball([0, 0, z], linear_velocity=[0.4, 0, -0.2 if z < 0.1 else 0.0])
    motion: Any = Simulation(load_scene(scene(moving, touch(**law))))._motion
    instant = Instant(motion.laws, motion._call, 0.0, np.array(motion.compiled.y))

    def balance() -> float:
        y = instant.y
        turning = 0.4 * 0.1**2 * float(y[10:13] @ y[10:13])
        return 0.5 * (float(y[7:10] @ y[7:10]) + turning) + G * float(y[2]) - float(y[WIDTH])

    before = balance()
    assert leap(instant, 1e-3) is not None
    return before, balance()


@pytest.mark.parametrize("law", [SOFT, VISCOUS, SOFT | VISCOUS], ids=["soft", "viscous", "both"])
def test_energy_minus_work_stays(law: dict) -> None:
    before, after = interpreted(energies, law)
    assert_allclose(after, before, rtol=0.0, atol=1e-14)


def jammed(law: dict) -> list[str]:
    """Kinds of event where no forces are found for a compliant contact that is closed."""
    moving = ball([0, 0, 0.095], linear_velocity=[0, 0, -0.2])
    motion: Any = Simulation(load_scene(scene(moving, touch(**law))))._motion
    y = np.array(motion.compiled.y)
    motion._jam(Instant(motion.laws, motion._call, 0.0, y), None)
    return [event.kind for event in motion.events]


def test_what_touches_compliantly_alone_is_leapt_over() -> None:
    assert "leaps" in interpreted(jammed, SOFT)


ROLLING: dict[str, Any] = {
    "mass": 1.0,
    "shape": {"type": "disk", "radius": 0.1, "axis_B": [0, 0, 1]},
    "orientation": {"axis": [0, 1, 0], "angle": 1.2},
    "position": [0, 0, 0.1 * math.sin(1.2)],
    "linear_velocity": [0, 2.0, 0],
    "angular_velocity": [0, 0, -20.0],
}
STICKY: dict[str, Any] = {"friction": {"type": "coulomb", "static": 0.9, "kinetic": 0.5}}


def one_leap(body: dict, contact: dict, length: float) -> tuple[Any, list[float]]:
    """Velocities after a leap of this length [s], by how much they differ from those of the motion,
    and the gap, its rate and the slip of the contact after it."""
    motion: Any = Simulation(load_scene(scene(body, contact)))._motion
    start = np.array(motion.compiled.y)
    instant = Instant(motion.laws, motion._call, 0.0, start)
    assert leap(instant, length) is not None
    bring_back(instant)
    left = [*instant.system.touch[0, [GAP, GAP_RATE]].tolist(), instant.slip_speed(0)]
    motion.run_to(np.array([length]))
    return instant.y[7:13], [float(np.abs(instant.y - motion._grid.y)[7:13].max()), *left]


def test_a_leap_keeps_what_rolls_on_its_way() -> None:
    """The point of contact of a leaning disk runs on: what keeps it from slipping there is an
    impulse of first order, and the rim neither sinks in nor leaves."""
    rim = touch(**STICKY, lies_flat=False)
    (error, *left), (half, *_) = (interpreted(one_leap, ROLLING, rim, h)[1] for h in (1e-4, 5e-5))
    assert np.abs(left).max() < 1e-14
    assert error < 1e-4 and half < 0.3 * error


def test_a_leap_holds_what_rests_on_a_support_that_gives_way() -> None:
    """Friction at rest takes the whole load along the slope, more than kinetic friction would."""
    normal = np.array([math.sin(0.6), 0, math.cos(0.6)])
    middle = (0.1 - G * normal[2] / 3e3) * normal
    surface = {"type": "plane", "normal": normal.tolist()}
    law = STICKY | {"compliance": {"stiffness": 3e3}, "surface": surface}
    block = {"mass": 1.0, "inertia": [1e6] * 3, "position": middle.tolist()}
    contact = touch(**law, points=[(-0.1 * normal).tolist()])
    velocities, _ = interpreted(one_leap, block, contact, 1e-3)
    assert np.abs(velocities).max() < 1e-8
