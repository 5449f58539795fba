# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a contact would fall with if it were open, while the others are as they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation, load_scene
from rb_sim.contact.events.instant import Instant, Tasks
from rb_sim.contact.events.shares import choose_modes
from rb_sim.contact.problem.impacts import (
    free_normal_acceleration,
)
from tests.contact.scenes import G, ball, box, scene, touch


def falls(data: dict[str, Any]) -> list[float]:
    """-free_normal_acceleration of every contact at the start, with its modes chosen [m/s^2]."""
    motion: Any = Simulation(load_scene(data))._motion
    call = Tasks(motion.system)
    at = Instant(motion.laws, call, 0.0, np.array(motion.compiled.y))
    choose_modes(at)
    contacts = range(len(motion.laws))
    return [-free_normal_acceleration(at.system, at.workspace, at.t, at.y, c) for c in contacts]


@pytest.mark.parametrize("bodies", [1, 2])
def test_the_other_contacts_hold_meanwhile(bodies: int) -> None:
    """A corner of a box that lies does not fall: the other corners hold the box. A ball does."""
    lies = box([0.2, 0.4, 0.1], [0.0, 0.0, 0.05])
    far = {"far": ball([50.0, 0.0, 5.0])} if bodies == 2 else {}
    held = falls(scene({"body": lies} | far, touch(mu=0.5)))
    assert len(held) >= 4
    assert_allclose(held, 0.0, atol=1e-12)
    alone = falls(scene({"body": ball([0.0, 0.0, 0.1])} | far, touch(mu=0.5)))
    assert_allclose(alone, G, rtol=1e-14)


def test_events_are_told_in_the_order_of_their_times() -> None:
    """That a ball rests is known at its last bounce, and takes place after it: dropped by h, after
    sqrt(2 h/g) and, of its bounces, twice that times e + e^2 + e^3 ..."""
    data = scene({"body": ball([0.0, 0.0, 0.2])}, touch(mu=0.5, restitution=0.5))
    run = Simulation(load_scene(data)).run(duration=1.0, rate=50)
    kinds = [event.kind for event in run.events]
    times = [event.t for event in run.events]
    assert times == sorted(times)
    fall = (2.0 * 0.1 / G) ** 0.5
    assert times[kinds.index("rests")] == pytest.approx(fall * (1.0 + 0.5) / (1.0 - 0.5), rel=1e-9)
    assert kinds.count("rests") == 1 and kinds.count("impact") > 10
