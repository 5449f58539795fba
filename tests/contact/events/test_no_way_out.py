# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where a law of friction has no motion the run ends in one line, and nothing slips or sinks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.problem.impacts import STRUCK, strike
from rb_sim.mechanics.contact.contact_bodies import CLOSED
from tests.contact.scenes import ball, scene, touch
from tests.contact_runs import contact_run
from tests.interpreted import interpreted

ROUGH = {"type": "rough"}


def hopping_hoop(rate: float, **more: Any) -> Any:
    """A ball with its weight near the surface that rolls: at this rate it would have to be pulled
    down to go on (Littlewood's hoop)."""
    heavy = ball([0, 0, 0.1], inertia=[6e-4] * 3, center_of_mass=[0, 0, 0.08])
    moving = {"angular_velocity": [0, rate, 0], "linear_velocity": [0.1 * rate, 0, 0]}
    return scene(heavy | moving, touch(friction=ROUGH, rolling_resistance=1e-3, **more))


@pytest.mark.parametrize("rate", [9.0, 12.0])
def test_what_is_perfectly_rough_does_not_slip_after_bounces(rate: float) -> None:
    """It leaves and is pressed back at once: bounces, after which it slid on without friction."""
    with pytest.raises(RbSimError, match="perfectly rough contact floor would have to pull"):
        contact_run(hopping_hoop(rate, restitution=0.24), np.linspace(0.0, 0.3, 4))


def test_nothing_ends_a_slip_at_once_on_a_support_that_gives_way() -> None:
    thrown = ball([0, 0, 0.11], linear_velocity=[1, 0, 0])
    soft = touch(friction=ROUGH, compliance={"stiffness": 1e4, "damping": 0.0})
    with pytest.raises(RbSimError, match="perfectly rough contact floor slips on a compliant"):
        contact_run(scene(thrown, soft), np.linspace(0.0, 0.1, 3))


def test_a_rough_ball_that_lies_on_such_a_support_rolls() -> None:
    rolling = ball([0, 0, 0.1 - 9.81e-4], linear_velocity=[1, 0, 0])
    rolling["angular_velocity"] = [0, 10, 0]
    soft = touch(friction=ROUGH, compliance={"stiffness": 1e4, "damping": 0.0})
    r = contact_run(scene(rolling, soft), np.linspace(0.0, 0.1, 3)).trajectory
    assert np.abs(r.linear_velocity["body"][:, 0] - 1.0).max() < 1e-9
    assert (r.contact_state["floor"] == 2.0).all()


@pytest.mark.parametrize("per_normal", [False, True])
def test_a_drag_that_lifts_its_body_off_is_refused(per_normal: bool) -> None:
    """The drag at a point ahead of the centre of mass turns it up; without it, it falls back."""
    sledge = {"mass": 1.0, "inertia": [2e-3] * 3, "position": [0, 0, 0.1]}
    drag = {"type": "viscous", "coefficient": 0.2 if per_normal else 2.0, "per_normal": per_normal}
    points = touch(points=[[0.1, 0, -0.1]], friction=drag)
    mapping = scene(sledge | {"linear_velocity": [-2, 0, 0]}, points)
    if per_normal:
        contact_run(mapping, np.linspace(0.0, 0.05, 3))
        return
    with pytest.raises(RbSimError, match="viscous contact floor can neither stay closed nor open"):
        contact_run(mapping, np.linspace(0.0, 0.05, 3))


@pytest.mark.parametrize("per_normal", [False, True])
def test_so_is_one_on_a_support_that_gives_way_and_has_a_damper(per_normal: bool) -> None:
    """Apart, the damper presses it back at once: it opened and closed a million times."""
    sledge = {"mass": 1.0, "inertia": [2e-3] * 3, "position": [0, 0, 0.1]}
    drag = {"type": "viscous", "coefficient": 0.2 if per_normal else 2.0, "per_normal": per_normal}
    soft = touch(
        points=[[0.1, 0, -0.1]], friction=drag, compliance={"stiffness": 1e4, "damping": 20.0}
    )
    mapping = scene(sledge | {"linear_velocity": [-2, 0, 0]}, soft)
    if per_normal:
        contact_run(mapping, np.linspace(0.0, 0.05, 3))
        return
    with pytest.raises(RbSimError, match="viscous contact floor can neither stay closed nor open"):
        contact_run(mapping, np.linspace(0.0, 0.05, 3))


def slip_after_one_impact() -> float:
    """Of a perfectly rough ball that lies on the floor, was given a slip, and strikes [m/s]."""
    lying = scene(ball([0, 0, 0.1]), touch(friction=ROUGH))
    motion: Any = Simulation(load_scene(lying))._motion
    y = np.array(motion.compiled.y)
    y[7] = 0.1
    motion.system.touch[0, CLOSED] = 1.0
    instant = Instant(motion.laws, motion._call, 0.0, y)
    assert instant.slip_speed(0) > 0.05
    assert strike(instant.system, instant.workspace, 0.0, y, False) == STRUCK
    return instant.slip_speed(0)


def test_one_impact_stops_what_is_perfectly_rough_and_lies() -> None:
    """It needs no push for that; an impact without any impulse was repeated without end."""
    assert interpreted(slip_after_one_impact) < 1e-15
