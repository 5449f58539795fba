# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Events in the order of their times, and what is done between the calls of the loop."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from tests.contact.scenes import G, ball, box, scene, touch


def test_events_are_reported_in_the_order_of_their_times() -> None:
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


# What is done between the calls of the loop: in one call or put together in Python, compiled or
# not, it is the same.


TILTED = {"axis": [1, 2, 0], "angle": 0.3}
FALLING = scene(
    box([0.2, 0.4, 0.1], [0.0, 0.0, 0.4], orientation=TILTED),
    touch(mu=0.4, kinetic=0.3, restitution=0.5, rolling_resistance=1e-3, spinning_resistance=1e-3),
)
JOINED = scene(
    {
        "body": box([0.2, 0.4, 0.1], [0.0, 0.0, 0.4], orientation=TILTED),
        "hanging": ball([0.3, 0.0, 0.4], radius=0.05),
    },
    {
        "floor": touch(mu=0.4, restitution=0.5),
        "joint": {
            "type": "fixed_point",
            "body": "hanging",
            "parent": "body",
            "point_B": [-0.1, 0.0, 0.0],
        },
        "ground": touch("hanging", mu=0.2, restitution=0.3),
    },
)


def run(mapping: Any, in_one_call: bool) -> tuple[Any, list[Any]]:
    """(coordinates at the end, events) of half a second."""
    simulation: Any = Simulation(load_scene(mapping))
    motion = simulation._motion
    assert motion._by_laws_alone
    motion._by_laws_alone = in_one_call
    motion.run_to(np.array([0.5]))
    return motion.coordinates, motion.events


@pytest.mark.parametrize("mapping", [FALLING, JOINED], ids=["alone", "joined"])
def test_one_call_does_what_the_parts_do(mapping: Any) -> None:
    y, events = run(mapping, True)
    parts, reported = run(mapping, False)
    assert len(events) > 20
    assert np.array_equal(y, parts)
    assert events == reported
