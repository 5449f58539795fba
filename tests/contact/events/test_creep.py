# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors of an adaptive method do not keep a slip alive that the laws of friction have ended."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.contact.toss_scenes import toss
from rb_sim import Simulation, load_scene
from rb_sim.mechanics.contact.accelerations import contact_accelerations
from rb_sim.mechanics.contact.contact_bodies import SLIP
from rb_sim.mechanics.contact.motion_kernels import contact_rate
from tests.interpreted import interpreted

SLIPS = 1e-8
"""Slip [m/s] down to which the reference follows the motion; it is over some 10 ns later."""


def rim(**simulation: Any) -> dict[str, Any]:
    """A steep rim on a log, near Painleve's paradox: what friction gives the slip is a thousand
    times as much as what ends it, which is left over between friction and load."""
    disk = {
        "mass": 0.28148861906596,
        "position": [0.15080630583432086, -0.10935163017609772, 0.0018273431568666468],
        "orientation": [
            0.09312090267696181, 0.9888969271053489, 0.11577049720342819, -0.002925239049561024,
        ],
        "linear_velocity": [-0.5510872271783878, 0.1065095611264689, 0.6964864682770493],
        "angular_velocity": [3.736967916823091, -38.3102854581243, -5.929731892254288],
        "shape": {"type": "disk", "radius": 0.10144063901073133, "axis_B": [0.0, 0.0, 1.0]},
    }  # fmt: skip
    log = {
        "type": "cylinder",
        "axis": [1, 0, 0],
        "point": [0, 0, -1],
        "radius": 1.0,
        "side": "outside",
    }
    friction = {"type": "coulomb", "static": 0.7135794479297964}
    contact = {"type": "contact", "body": "b", "surface": log, "friction": friction}
    return {
        "bodies": {"b": disk},
        "constraints": {"c": contact},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"duration": 2e-4} | simulation,
    }


@cache
def expected_end() -> float:
    """The same for all tolerances."""
    return interpreted(end_by_an_implicit_method)


def end_by_an_implicit_method() -> float:
    """When the slip is over [s], by SciPy's Radau on the equations of the slip alone, which is
    stable however fast friction turns it."""
    motion: Any = Simulation(load_scene(rim(method="dopri853", tolerance=1e-13)))._motion
    system, start = motion.system, np.array(motion.coordinates)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        dy = np.zeros_like(y)
        contact_rate(system, t, y, dy)
        return dy

    def slip(t: float, y: np.ndarray) -> float:
        contact_accelerations(system, t, y)
        return float(np.linalg.norm(system.touch[0, SLIP : SLIP + 3])) - SLIPS

    slip.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(
        rate, (0.0, 1e-4), start, "Radau", events=slip, first_step=1e-8, rtol=1e-9, atol=1e-11
    )
    return float(found.t_events[0][0])


@pytest.mark.parametrize("tolerance", [1e-8, 1e-10, 1e-12])
def test_a_slip_ends_when_its_laws_say_so(tolerance: float) -> None:
    """At 1e-10 it lasted twice as long, 40 us, in two million steps at the bound of stability."""
    simulation = Simulation(load_scene(rim(method="dopri853", tolerance=tolerance)))
    simulation.run(watched=False)
    (end,) = (event.t for event in simulation.events if event.kind == "sticks")
    assert end == pytest.approx(expected_end(), abs=2e-8 + 10.0 * tolerance)
    assert simulation.steps < 10_000


def test_a_slip_at_the_bound_of_friction_takes_no_steps_without_end() -> None:
    """What would end it is less than a ten-thousandth of what friction gives: in steps that no
    error turns aside it went on for millions of them."""
    simulation = Simulation(load_scene(toss(271, 9).mapping))
    simulation.run(watched=False)
    assert simulation.time == pytest.approx(0.6)
    assert simulation.steps < 10_000
