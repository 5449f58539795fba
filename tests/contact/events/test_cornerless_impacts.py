# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction without a corner that grows with the push rubs in impacts, too, as the push does."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rb_sim import Simulation, load_scene
from tests.contact.scenes import body, scene, touch

SLIP, FALL, E, MASS = 2.0, 1.5, 0.4, 1.0
PUSH = (1.0 + E) * MASS * FALL
MU, ROUNDED = 0.3, 0.01


def slip_after(friction: dict[str, Any], slip: float = SLIP, **simulation: Any) -> float:
    """Slip of a point mass that has bounced once on a floor, without weight [m/s]."""
    start = body(
        {"type": "sphere", "radius": 0.1}, [0.0, 0.0, 0.1], linear_velocity=[slip, 0.0, -FALL]
    )
    start |= {"position": [0.0, 0.0, 0.05]}
    floor = touch(restitution=E, friction=friction, points=[[0.0, 0.0, 0.0]])
    mapping = scene(start, floor, gravity=False)
    mapping["simulation"] = {"duration": 0.1, "rate": 100.0} | simulation
    run = Simulation(load_scene(mapping)).run()
    assert run.linear_velocity["body"][-1, 2] == pytest.approx(E * FALL, rel=1e-9)
    return float(run.linear_velocity["body"][-1, 0])


def test_regularised_friction_takes_what_coulombs_does_of_a_fast_slip() -> None:
    """s falls by mu P / m, up to (v/s)^2/2; before, it went on as fast as it came."""
    law = {"type": "regularised", "coefficient": MU, "speed": ROUNDED}
    after = slip_after(law)
    assert after == pytest.approx(SLIP - MU * PUSH / MASS, rel=1e-4)
    coulomb = slip_after({"type": "coulomb", "static": MU})
    assert after == pytest.approx(coulomb, rel=1e-4)


def test_a_slip_slower_than_the_rounding_is_damped_by_as_much() -> None:
    """ds = -mu (s/v) P/m, of which the impact takes the share with the slip before it."""
    wide, slip = 50.0, 0.5
    law = {"type": "regularised", "coefficient": MU, "speed": wide}
    taken = MU * PUSH / MASS * slip / math.hypot(slip, wide)
    assert slip_after(law, slip) == pytest.approx(slip - taken, rel=1e-9)


def test_viscous_friction_per_normal_damps_as_the_push_goes_on() -> None:
    """Over an impact ds/dP = -c s/m: s exp(-c P/m), to first order in c P/m."""
    c = 1e-3
    after = slip_after({"type": "viscous", "coefficient": c, "per_normal": True})
    assert SLIP - after == pytest.approx(SLIP * (1.0 - math.exp(-c * PUSH / MASS)), rel=2e-3)


def test_no_impact_turns_a_slip_round() -> None:
    law = {"type": "regularised", "coefficient": MU, "speed": ROUNDED}
    assert slip_after(law, 0.1) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    "law",
    [
        {"type": "regularised", "coefficient": MU, "speed": ROUNDED},
        {"type": "regularised", "coefficient": MU, "speed": 50.0},
        {"type": "viscous", "coefficient": 0.1, "per_normal": True},
    ],
)
def test_time_stepping_and_events_agree(law: dict[str, Any]) -> None:
    """One took the friction of an impact with the slip before it, the other none at all."""
    stepped = slip_after(law, method="time_stepping", step=1e-3)
    assert stepped == pytest.approx(slip_after(law), rel=1e-9)
