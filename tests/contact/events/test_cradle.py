# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Impacts of several contacts at once: all together, or one by one (Newton's cradle)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import SceneError, load_scene
from tests.contact.scenes import ball, box, scene, touch

RADIUS, SPEED = 0.1, 1.2


def row_of_balls(masses: list[float], first: int, e: float, impacts: str) -> dict[str, Any]:
    """Balls in a row that touch, but for a gap before the first that rest; `first` of them come."""
    bodies, constraints = {}, {}
    for i, mass in enumerate(masses):
        x = 2.0 * RADIUS * i - (0.03 if i < first else 0.0)
        speed = SPEED if i < first else 0.0
        bodies[f"b{i}"] = ball([x, 0, 0], RADIUS, linear_velocity=[speed, 0, 0]) | {"mass": mass}
        if i > 0:
            surface = {"type": "shape"}
            pair = {"type": "contact", "body": f"b{i}", "parent": f"b{i - 1}"}
            constraints[f"c{i}"] = pair | {"surface": surface, "restitution": e}
    mapping = scene(bodies, constraints, gravity=False)
    options = {"duration": 0.1, "rate": 10.0, "impacts": impacts}
    return mapping | {"simulation": mapping["simulation"] | options}


def speeds(masses: list[float], first: int, e: float, impacts: str) -> list[float]:
    """Of all balls, after they have struck."""
    from rb_sim import Simulation

    mapping = row_of_balls(masses, first, e, impacts)
    block = Simulation(load_scene(mapping)).run().block
    return block.linear_velocity[-1, :, 0].tolist()


@pytest.mark.parametrize(("count", "first"), [(3, 1), (5, 2)])
def test_as_many_balls_leave_a_cradle_as_come(count: int, first: int) -> None:
    """Equal elastic balls exchange their velocities, pair by pair."""
    left = speeds([1.0] * count, first, 1.0, "one_by_one")
    assert_allclose(left, [0.0] * (count - first) + [SPEED] * first, atol=1e-12)


def test_unequal_balls_hand_the_impact_on() -> None:
    """Each pair in turn, u_2 = (1 + e) m_1 v / (m_1 + m_2): the heavier ones do not come back."""
    m, e = [1.0, 2.0, 3.0], 0.9
    v, expected = SPEED, []
    for a, b in zip(m, m[1:], strict=False):
        after = (1.0 + e) * a * v / (a + b)
        expected.append(v - b / a * after)
        v = after
    assert_allclose(speeds(m, 1, e, "one_by_one"), [*expected, v], atol=1e-12)


def test_what_is_as_fast_strikes_as_one() -> None:
    """A box that lands on an edge goes on turning about that edge's direction alone, wherever it
    looks to: P = (1 + e) m v / (1 + m d^2 / I), of which one corner after the other would make a
    roll to one side."""
    from rb_sim import Simulation

    lean, v, e, half = 0.4, 1.0, 0.5, np.array([0.1, 0.15, 0.05])
    d = half[0] * np.cos(lean) - half[2] * np.sin(lean)
    inertia = (half[0] ** 2 + half[2] ** 2) / 3.0
    push = (1.0 + e) * v / (1.0 + d * d / inertia)
    for heading in (0.0, 0.7, 2.0):
        turn = Rotation.from_euler("ZY", [heading, lean])
        height = half[0] * np.sin(lean) + half[2] * np.cos(lean) + 0.01
        start = box(
            (2.0 * half).tolist(),
            [0.0, 0.0, height],
            orientation=turn.as_quat(),
            linear_velocity=[0.0, 0.0, -v],
        )
        mapping = scene(start, touch(restitution=e), gravity=False)
        mapping["simulation"] = {"duration": 0.02, "rate": 50.0, "impacts": "one_by_one"}
        run = Simulation(mapping).run()
        spin = turn.apply(run.angular_velocity["body"][-1])
        across = np.array([-np.sin(heading), np.cos(heading), 0.0])
        assert_allclose(run.linear_velocity["body"][-1], [0.0, 0.0, push - v], atol=1e-9)
        assert_allclose(np.abs(spin @ across), d * push / inertia, atol=1e-7)
        assert_allclose(spin - (spin @ across) * across, 0.0, atol=1e-9)


@pytest.mark.parametrize("middle", [1.0, 0.1])
def test_a_series_of_impacts_without_end_is_ended(middle: float) -> None:
    """Without rebound each pair moves on as one, over and over: in the limit all do.  The lighter
    the ball between the others, the slower."""
    left = speeds([1.0, middle, 1.0], 1, 0.0, "one_by_one")
    assert_allclose(left, np.full(3, SPEED / (2.0 + middle)), atol=1e-9)


def test_together_all_move_on() -> None:
    """One problem with v_n+ = -e v_n- at each contact, which those at rest have as zero: the first
    comes back, the others move on as one."""
    left = speeds([1.0] * 3, 1, 1.0, "together")
    assert_allclose(left, [-SPEED / 3.0, 2.0 * SPEED / 3.0, 2.0 * SPEED / 3.0], atol=1e-12)


def test_time_stepping_has_its_own_law() -> None:
    mapping = row_of_balls([1.0, 1.0], 1, 1.0, "one_by_one")
    options = {"method": "time_stepping", "impacts": "one_by_one"}
    with pytest.raises(SceneError, match=r"simulation.impacts.*together for method time_stepping"):
        load_scene(mapping | {"simulation": options})
