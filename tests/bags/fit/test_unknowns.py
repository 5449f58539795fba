# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Fits of numbers that a scene takes up to a limit only, which may be another number of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene
from rb_sim.bags.fit.fit import Fitted, Recording, fit
from rb_sim.bags.fit.unknowns import (
    STEP,
    Limits,
    bounds,
    difference,
    free_numbers,
)
from rb_sim.bags.tracks import tracks_of_blocks

NOISE = (1e-3, 2e-3)
FRICTION = "constraints.floor.friction"
KINETIC, STATIC = f"{FRICTION}.kinetic", f"{FRICTION}.static"
TRUTH = {"static": 0.5, "kinetic": 0.31}


def ball(static: float, kinetic: float) -> dict[str, Any]:
    """Slips with the deceleration kinetic g until t = 2 v / (7 kinetic g) = 0.28 s, then rolls."""
    return {
        "bodies": {"ball": {"mass": 2.0, "shape": {"type": "sphere", "radius": 0.1},
                            "position": [0.0, 0.0, 0.1], "linear_velocity": [3.0, 0.0, 0.0]}},
        "constraints": {"floor": {"type": "contact", "body": "ball", "friction":
                                  {"type": "coulomb", "static": static, "kinetic": kinetic}}},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 0.6, "rate": 50, "method": "dopri853", "tolerance": 1e-9},
    }  # fmt: skip


def recorded(data: dict[str, Any]) -> Recording:
    """The motion of the only body, with noise."""
    scene = load_scene(data)
    simulation = Simulation(scene)
    tracks = tracks_of_blocks(
        [simulation.run(checks=False).block], scene, simulation.layout, "truth"
    )
    (body,) = tracks.bodies
    track, rng = tracks.bodies[body], np.random.default_rng(1)
    track.position = track.position + rng.normal(0, NOISE[0], track.position.shape)
    turn = Rotation.from_rotvec(rng.normal(0, NOISE[1], (len(track.t), 3)))
    track.orientation = (turn * Rotation.from_quat(track.orientation)).as_quat()
    return Recording(tracks, {body: body})


@pytest.fixture(scope="module")
def slipped() -> Recording:
    return recorded(ball(**TRUTH))


def refit(recording: Recording, data: dict[str, Any], *keys: str) -> Fitted:
    return fit(recording, load_scene(data), data, list(keys))


def within(found: Fitted, k: int, truth: float) -> bool:
    return 0.0 < found.errors[k] < 1e-2 and abs(found.values[k] - truth) < 4.0 * found.errors[k]


def test_kinetic_friction_that_starts_as_the_static_one(slipped: Recording) -> None:
    """The scene takes no more of it: the difference is to one side, and it comes down."""
    found = refit(slipped, ball(0.5, 0.5), KINETIC)
    assert within(found, 0, TRUTH["kinetic"])
    assert not found.limited and not found.correlation_left


def test_it_ends_at_the_static_one_and_says_so(slipped: Recording) -> None:
    found = refit(slipped, ball(0.2, 0.15), KINETIC)
    assert found.values[0] == pytest.approx(0.2, rel=1e-6)
    assert found.limited == [KINETIC] and found.correlation_left > 0.5


def test_both_kinds_of_friction_go_up_together(slipped: Recording) -> None:
    """From 0.2 and 0.2: the slip tells the kinetic one; the static one only has to be as large."""
    keys = STATIC, KINETIC
    found = refit(slipped, ball(0.2, 0.2), *keys)
    values = dict(zip(keys, found.values, strict=True))
    assert within(found, keys.index(KINETIC), TRUTH["kinetic"])
    assert values[STATIC] >= values[KINETIC]
    assert found.undetermined == [STATIC] and np.isinf(found.errors[keys.index(STATIC)])


def test_a_ball_that_begins_on_the_floor(slipped: Recording) -> None:
    """A place lower is inside the floor; along it the search goes on."""
    data = ball(0.5, 0.31)
    data["bodies"]["ball"]["position"] = [0.02, -0.01, 0.1]
    found = refit(slipped, data, "bodies.ball.position")
    assert within(found, 0, 0.0) and within(found, 1, 0.0)
    assert abs(found.values[2] - 0.1) < 4.0 * NOISE[0]


def test_an_inertia_at_the_edge_of_what_a_body_can_have() -> None:
    """The guess is a plate in the plane x y, I_z = I_x + I_y; more of I_z alone is no body's."""
    body = {"mass": 1.0, "angular_velocity": [3.0, 0.3, 1.0]}
    times = {"duration": 1.0, "rate": 40, "method": "rk4", "step": 0.0125}
    truth = {"bodies": {"nut": body | {"inertia": [0.1, 0.2, 0.27]}}, "simulation": times}
    data = {"bodies": {"nut": body | {"inertia": [0.1, 0.2, 0.3]}}, "simulation": times}
    found = refit(recorded(truth), data, "bodies.nut.inertia")
    ratios = found.values / found.values[0]  # a free body tells no more
    assert ratios == pytest.approx([1.0, 2.0, 2.7], rel=0.02)
    assert not found.correlation_left


def line(x: np.ndarray) -> np.ndarray:
    return np.array([np.sin(x[0]) + 2.0 * x[1], x[0] ** 3])


def test_a_difference_to_the_side_that_is_possible() -> None:
    """As exact as the central one; nothing where neither side is possible."""
    x, slope = np.array([0.7, 0.2]), [np.cos(0.7), 3.0 * 0.7**2]
    for low, high in ((-9, 9), (0.7, 9), (-9, 0.7), (0.7 - 1.5 * STEP, 0.7)):

        def f(y: np.ndarray, low: float = low, high: float = high) -> np.ndarray:
            return line(y) if low <= y[0] <= high else np.full(2, np.nan)

        rough = 1e-4 if low > 0 and high < 1 else 1e-8
        assert difference(f, x, 0) == pytest.approx(slope, abs=rough)
    shut = difference(lambda y: line(y) if y[0] == x[0] else np.full(2, np.nan), x, 0)
    assert (shut == 0.0).all()


def test_limits_stand_only_where_the_way_down_is_shut() -> None:
    """x_0 wants up and may not; x_1 wants down and may; x_2 wants up and may not either way."""

    def possible(y: np.ndarray) -> bool:
        return y[0] <= 1.0 and y[1] <= 2.0 and y[2] == 3.0

    x, open_ = np.array([1.0, 2.0, 3.0]), Limits(np.full(3, -np.inf), np.full(3, np.inf))
    limits = open_.at(x, np.array([-1.0, 1.0, -1.0]), possible)
    assert limits.high.tolist() == [1.0, np.inf, 3.0]
    assert limits.low.tolist() == [-np.inf, -np.inf, 3.0]
    assert limits.fixed.tolist() == [False, False, True]
    assert limits.reached(x).tolist() == [True, False, True]


def test_bounds_of_numbers_that_depend_on_another() -> None:
    data = ball(0.5, 0.4)
    for keys, low, high in (
        ([KINETIC], [1e-3], [0.5 / 0.4]),
        ([STATIC], [0.4 / 0.5], [np.inf]),
        ([KINETIC, STATIC], [1e-3, 1e-3], [1.0, np.inf]),
    ):
        found = bounds(free_numbers(data, keys), data)
        assert found[0] == pytest.approx(low) and found[1] == pytest.approx(high)


def test_a_size_that_only_steps_of_adaptive_length_tell() -> None:
    """A ball with a spin that slips on a floor has no mass but beside its inertia: all of them
    twice as large is the same motion. Its derivatives are differences, of motions that a tolerance
    leaves uncertain."""
    data = ball(0.5, 0.31)
    data["simulation"]["tolerance"] = 1e-6
    spun = {"inertia": [0.010, 0.012, 0.014], "angular_velocity": [1.0, 2.0, 3.0]}
    data["bodies"]["ball"] |= spun
    keys = ["bodies.ball.mass", "bodies.ball.inertia"]
    found = refit(recorded(data), data, *keys)
    assert len(found.undetermined) == 1 and np.isinf(found.errors).all()
    assert found.values == pytest.approx([2.0, *spun["inertia"]], rel=0.02)
