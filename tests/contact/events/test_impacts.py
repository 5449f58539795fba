# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Impacts: of several contacts at once, with friction, of faces; and what they leave open."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from benchmarks.contact.coupled_scenes import coupled_scene
from rb_sim import SceneError, Simulation, load_scene
from rb_sim.contact.events.shares import IMPACT, OPEN_SHARES
from tests.contact.scenes import ball, body, box, scene, touch

# Impacts of several contacts at once: all together, or one by one (Newton's cradle).


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
    block = Simulation(load_scene(mapping)).run(checks=False).block
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
        run = Simulation(mapping).run(checks=False)
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


# Friction without a corner that grows with the push rubs in impacts, too, as the push does.


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
    run = Simulation(load_scene(mapping)).run(checks=False)
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


# Impacts of a face, whose corners may share the push in many ways: one way, told if it matters.


TIMES = {"duration": 0.01, "rate": 100.0, "method": "dopri853", "tolerance": 1e-12}


def landed(thing: dict[str, Any], mu: float = MU) -> Simulation:
    mapping = scene(thing, touch(mu=mu)) | {"simulation": TIMES}
    simulation = Simulation(load_scene(mapping), announce=None)
    simulation.run(checks=False)
    return simulation


def reported(simulation: Simulation) -> int:
    return sum(event.kind == "ambiguous" for event in simulation.events)


def brick(slip: list[float], spin: float, tilt: float = 0.0) -> dict[str, Any]:
    """It comes down flat, but for the tilt [rad], slipping and spinning about the vertical."""
    moves = {"linear_velocity": [*slip, -1.0], "angular_velocity": [0.0, 0.0, spin]}
    turn = {"axis": [0.6, 0.8, 0.0], "angle": tilt}
    return box([0.3, 0.2, 0.1], [0.0, 0.0, 0.051], orientation=turn) | moves


def test_a_face_whose_corners_slip_apart_is_reported_and_no_rounding_decides() -> None:
    """Which corner bears more turns the slip; a tilt of rounding has no part in it."""
    ends = []
    for tilt in (0.0, 1e-15, -1e-15, 1e-13):
        simulation = landed(brick([1.0, 0.0], 5.0, tilt))
        assert reported(simulation) == 1
        ends.append(simulation.sample().block.linear_velocity)
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], atol=1e-9)


@pytest.mark.parametrize(
    ("slip", "spin", "mu"),
    [
        ([1.0, 0.5], 0.0, MU),
        ([0.0, 0.0], 0.0, MU),
        ([1.0, 0.0], 5.0, 0.0),
    ],
)
def test_a_face_whose_shares_change_nothing_is_not_reported(
    slip: list[float], spin: float, mu: float
) -> None:
    """All corners slip one way, or stick, or none rubs: the motion is unique."""
    assert reported(landed(brick(slip, spin), mu)) == 0


def test_three_points_share_a_push_in_one_way() -> None:
    feet = [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]]
    mapping = scene(brick([1.0, 0.0], 5.0), touch(mu=MU, points=feet)) | {"simulation": TIMES}
    simulation = Simulation(load_scene(mapping), announce=None)
    simulation.run(checks=False)
    assert reported(simulation) == 0
    assert sum(event.kind == "impact" for event in simulation.events) == 3


def test_feet_share_an_impact_by_the_least_impulses() -> None:
    """One of five feet stands near the middle: the least impulses that take away the fall, x, have
    the smallest sum of squares, whatever the inertia that each foot meets."""
    feet = np.array([[0.14, 0.09], [-0.14, 0.09], [-0.14, -0.09], [0.14, -0.09], [0.02, 0.01]])
    places = [[x, y, -0.05] for x, y in feet.tolist()]
    mapping = scene(brick([0.0, 0.0], 0.0), touch(points=places), gravity=False)
    mapping |= {"simulation": TIMES}
    simulation = Simulation(load_scene(mapping), announce=None)
    simulation.run(checks=False)
    events = [event for event in simulation.events if event.kind == "impact"]
    found = [event.impulse[2] for event in sorted(events, key=lambda event: event.contact)]
    J = np.column_stack([np.ones(5), feet[:, 1], -feet[:, 0]])  # of v_z, w_x, w_y
    mass = 12.0 / np.array([12.0, 0.2**2 + 0.1**2, 0.3**2 + 0.1**2])
    assert_allclose(found, np.linalg.pinv(J * mass @ J.T) @ np.ones(5), rtol=1e-9)


def test_a_box_that_tips_over_an_edge_ends_alike_at_every_tolerance() -> None:
    """On a belt: two corners bear when the other two strike, and all slip in several directions.
    Rounding chose the corners that had a part in it, and the ends were 5e-3 apart."""
    mapping = dict(coupled_scene(777, 63).mapping)
    ends = []
    for tolerance in (1e-10, 1e-11, 1e-12):
        times = {"duration": 0.5, "rate": 20.0, "method": "dopri853", "tolerance": tolerance}
        simulation = Simulation(load_scene(mapping | {"simulation": times}), announce=None)
        ends.append(simulation.run(checks=False).position["b"][-1])
        assert reported(simulation) == 1
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], atol=1e-8)


# Motions that the laws of contact leave open are told once, where other ends differ by more than
# the setting tells apart.


SIZE, SLIP_OPEN, SPIN, G = (0.3, 0.2, 0.1), 1.0, 5.0, 9.81
TIMES_OPEN = {"duration": 0.01, "rate": 100.0, "method": "dopri853"}


def sliding(slip: float, spin: float, mu: float = MU) -> dict[str, Any]:
    """A box of 1 kg flat on a floor."""
    moves = {"linear_velocity": [slip, 0.0, 0.0], "angular_velocity": [0.0, 0.0, spin]}
    return scene(box(list(SIZE), [0.0, 0.0, 0.05]) | moves, touch(mu=mu))


def told_of_open(mapping: dict[str, Any], **setting: Any) -> tuple[Simulation, list[str]]:
    """The run, and its warnings of what is ambiguous."""
    simulation = Simulation(
        load_scene(mapping | {"simulation": TIMES_OPEN | setting}), announce=None
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        simulation.run()
    lines = [str(warning.message) for warning in caught]
    return simulation, [line for line in lines if line.startswith("ambiguous")]


def apart_by_hand(slip: float, spin: float, length: float) -> float:
    """The largest change of a box's acceleration (v, length w) from that of the least pushes to
    that of others which push everywhere."""
    corners = np.array([[x, y, -0.05] for x in (-0.15, 0.15) for y in (-0.1, 0.1)])
    slips = np.array([slip, 0.0, 0.0]) + np.cross([0.0, 0.0, spin], corners)
    push = np.array([0.0, 0.0, 1.0]) - MU * slips / np.linalg.norm(slips, axis=1)[:, None]
    inertia = np.array([0.2**2 + 0.1**2, 0.3**2 + 0.1**2, 0.3**2 + 0.2**2]) / 12.0
    change = np.hstack([push, np.cross(corners, push) / inertia]).T
    held = change[[2, 3, 4]]  # heave, roll and pitch, which the floor stops
    least = np.linalg.lstsq(held, [G, 0.0, 0.0], rcond=None)[0]
    free = np.linalg.svd(held)[2][-1]
    ways = (free, -free)
    far = max(min(-n / z for n, z in zip(least, way, strict=True) if z < 0) for way in ways)
    weights = [1.0] * 3 + [length] * 3
    return far * float(np.linalg.norm(weights * (change @ free)))


def test_shares_of_a_face_that_slips_and_spins_are_reported() -> None:
    simulation, lines = told_of_open(sliding(SLIP_OPEN, SPIN), tolerance=1e-9)
    figure, t, contact, what, *_ = simulation.left_open
    assert (t, what, contact) == (0.0, OPEN_SHARES, "floor/1")
    length = simulation.compiled.system.length
    assert figure == pytest.approx(apart_by_hand(SLIP_OPEN, SPIN, length) / G, rel=1e-6)
    assert len(lines) == 1
    assert "floor/1" in lines[0]


@pytest.mark.parametrize(
    ("slip", "spin", "mu"),
    [
        (SLIP_OPEN, 0.0, MU),
        (0.0, SPIN, MU),
        (SLIP_OPEN, SPIN, 0.0),
        (0.0, 0.0, MU),
    ],
)
def test_shares_that_change_nothing_are_not_reported(slip: float, spin: float, mu: float) -> None:
    """All rubs one way, or shares turn and push by the same, or nothing rubs or moves."""
    simulation, lines = told_of_open(sliding(slip, spin, mu), tolerance=1e-9)
    assert simulation.left_open.figure == 0.0
    assert not lines


def test_what_differs_by_less_than_the_setting_tells_apart_is_not_reported() -> None:
    slow = sliding(SLIP_OPEN, 0.3)
    assert len(told_of_open(slow, tolerance=1e-9)[1]) == 1
    assert not told_of_open(slow, tolerance=1e-3)[1]


def test_an_impact_of_a_face_that_spins_is_reported_once_with_how_far_its_ends_are_apart() -> None:
    mapping = scene(brick([SLIP_OPEN, 0.0], SPIN), touch(mu=MU, restitution=0.5))
    simulation, lines = told_of_open(mapping, tolerance=1e-9)
    figure, t, contact, what, *_ = simulation.left_open
    assert (what, contact) == (IMPACT, "floor/1")
    assert t == next(event.t for event in simulation.events if event.kind == "ambiguous")
    assert 1e-3 < figure < 0.1
    assert len(lines) == 1
    assert not told_of_open(scene(brick([SLIP_OPEN, 0.0], 0.0), touch(mu=MU)), tolerance=1e-9)[1]


def test_a_new_start_forgets_what_was_left_open() -> None:
    simulation, _ = told_of_open(sliding(SLIP_OPEN, SPIN), tolerance=1e-9)
    assert simulation.left_open.figure > 0.0
    simulation.set_state({"body": {"angular_velocity": [0.0, 0.0, 0.0]}})
    assert simulation.left_open.figure == 0.0


def test_a_box_without_weight_has_no_load_to_share() -> None:
    """It slides over the floor and pushes nowhere: a share of nothing was divided by nothing."""
    floating = sliding(SLIP_OPEN, 0.0) | {"effects": {}}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation = Simulation(load_scene(floating | {"simulation": TIMES_OPEN}), announce=None)
        run = simulation.run()
    assert simulation.left_open.figure == 0.0
    assert run.block.position[-1, 0] == pytest.approx([SLIP_OPEN * 0.01, 0.0, 0.05], abs=1e-12)
