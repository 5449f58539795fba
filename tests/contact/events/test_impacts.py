# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rounds of impacts of balls at the floor, by Newton's rule and the balance of their energy."""

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
from rb_sim.contact.problem.impacts import NOTHING, STRUCK
from tests.contact.scenes import ball, body, box, scene, touch
from tests.interpreted import interpreted

E, SLIP = 0.6, 0.7
COULOMB, ROUGH = {"mu": 0.05}, {"friction": {"type": "rough"}}


def struck(
    speeds: list[float], law: dict[str, Any], alone: bool = False, plastic: int = -1,
    together: int = -1, in_rounds: tuple[int, int, int] | None = None, closed: float = 0.0,
) -> dict[str, Any]:  # fmt: skip
    """What one strike, or rounds of them, make of balls at the floor that come down at these speeds
    and slip along y."""
    from rb_sim import load_scene
    from rb_sim.contact.events.instant import Instant, Tasks
    from rb_sim.contact.problem import impacts
    from rb_sim.mechanics.contact.contact_bodies import CLOSED
    from rb_sim.scene.compile import compile_scene

    names = ("body", "other", "third")[: len(speeds)]
    bodies = {name: ball([k, 0.0, 0.1], mass=1.0 + k) for k, name in enumerate(names)}
    floors = {name: touch(name, restitution=E, **law) for name in names}
    compiled = compile_scene(load_scene(scene(bodies, floors)))
    y = np.array(compiled.y, dtype=float)
    for k, speed in enumerate(speeds):
        y[13 * k + 8 : 13 * k + 10] = SLIP, -speed
    at = Instant(compiled.contact_laws, Tasks(compiled.system), 0.0, y)
    workspace, count = at.workspace, len(speeds)
    at.system.touch[:, CLOSED] = closed
    for table, c in ((workspace.plastic, plastic), (workspace.together, together)):
        table[:] = 0
        if c >= 0:
            table[c] = 1
    if in_rounds is None:
        status, n = impacts.strike(at.system, workspace, 0.5, y, alone), 0
    else:
        status, n = impacts.strike_in_rounds(at.system, workspace, 0.5, y, *in_rounds)
    return {
        "status": int(status), "round": int(n), "rebounding": workspace.rebounding.tolist(),
        "rises": [float(y[13 * k + 9]) for k in range(count)],
        "slips": [float(y[13 * k + 8]) for k in range(count)],
        "work": float(y[13 * count]), "notes": workspace.notes[: workspace.written[0]].tolist(),
        "undetermined": workspace.undetermined.tolist(),
    }  # fmt: skip


def lost(before: list[float], after: list[float]) -> float:
    return sum(
        0.5 * (1.0 + k) * (v * v - w * w)
        for k, (v, w) in enumerate(zip(after, before, strict=True))
    )


def test_all_that_come_down_rebound_by_e_and_contacts_do_the_work() -> None:
    found = interpreted(struck, [2.0, 0.5, 0.0], {})
    assert found["status"] == STRUCK and found["rebounding"] == [1, 1, 0]
    assert_allclose(found["rises"], [2.0 * E, 0.5 * E, 0.0], atol=1e-12)
    assert_allclose(found["slips"], SLIP)
    assert_allclose(found["work"], lost([2.0, 0.5, 0.0], found["rises"]), rtol=1e-12)
    assert found["undetermined"][1] == 0.0 and found["notes"] == []


def test_one_at_a_time_the_fastest_strikes() -> None:
    found = interpreted(struck, [0.5, 2.0, 1.0], {}, True)
    assert_allclose(found["rises"], [-0.5, 2.0 * E, -1.0], atol=1e-12)
    assert found["rebounding"] == [0, 1, 0]


def test_nothing_strikes_that_stays_or_leaves() -> None:
    found = interpreted(struck, [0.0, -1.0], {})
    assert found["status"] == NOTHING and found["rises"] == [0.0, 1.0] and found["work"] == 0.0
    assert interpreted(struck, [0.0, 1e-11], COULOMB)["status"] == NOTHING


def test_what_is_rough_stops_its_slip_once_it_strikes() -> None:
    """To 5/7 of it: the ball rolls then. So does what has just come to be closed, without a push;
    what obeys Coulomb slips on."""
    found = interpreted(struck, [2.0, 1.0], ROUGH)
    assert_allclose(found["rises"], [2.0 * E, E], atol=1e-12)
    assert_allclose(found["slips"], [5.0 / 7.0 * SLIP] * 2, rtol=1e-12)
    lies = interpreted(struck, [0.0, 0.0], ROUGH, False, -1, -1, None, 1.0)
    assert lies["status"] == STRUCK and lies["rises"] == pytest.approx([0.0, 0.0])
    assert_allclose(lies["slips"], [5.0 / 7.0 * SLIP] * 2, rtol=1e-12)
    assert interpreted(struck, [0.0, 0.0], COULOMB, False, -1, -1, None, 1.0)["status"] == NOTHING
    assert interpreted(struck, [-1.0, -1.0], ROUGH, False, -1, -1, None, 1.0)["status"] == NOTHING
    rubs = interpreted(struck, [2.0, 1.0], COULOMB)
    assert_allclose(rubs["slips"], SLIP - 0.05 * (1.0 + E) * np.array([2.0, 1.0]), rtol=1e-12)


@pytest.mark.parametrize(
    ("single", "rounds", "struck_first"), [(0, 1, [0, 1, 2]), (9, 3, [1, 2, 0])]
)
def test_rounds_go_on_until_nothing_approaches(
    single: int, rounds: int, struck_first: list[int]
) -> None:
    """All at once, or one after the other, the fastest first; each is noted with its impulse."""
    speeds = [0.5, 2.0, 1.0]
    found = interpreted(struck, speeds, {}, False, -1, -1, (0, 50, single))
    assert (found["status"], found["round"]) == (NOTHING, rounds)
    assert_allclose(found["rises"], E * np.array(speeds), atol=1e-12)
    contacts = [int(note[1]) for note in found["notes"]]
    assert contacts == struck_first and all(
        note[0] == 0.5 and note[2] == 0 for note in found["notes"]
    )
    impulses = [note[5] for note in found["notes"]]
    assert_allclose(impulses, [(1.0 + E) * (1.0 + c) * speeds[c] for c in contacts], rtol=1e-12)
    cut = interpreted(struck, speeds, {}, False, -1, -1, (0, 2, 9))
    assert (cut["round"], len(cut["notes"])) == (2, 2)
    late = interpreted(struck, speeds, {}, False, -1, -1, (3, 50, 2))  # beyond them all is plastic
    assert_allclose(late["rises"], 0.0, atol=1e-12)
    late = interpreted(struck, speeds, {}, False, -1, -1, (1, 50, 1))
    assert_allclose(late["rises"], 0.0, atol=1e-12)


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


# Friction without a corner that grows with the push rubs in impacts, too, as the push does.


SLIP_CORNERLESS, FALL, E_CORNERLESS, MASS = 2.0, 1.5, 0.4, 1.0
PUSH = (1.0 + E_CORNERLESS) * MASS * FALL
MU, ROUNDED = 0.3, 0.01


def slip_after(friction: dict[str, Any], slip: float = SLIP_CORNERLESS, **simulation: Any) -> float:
    """Slip of a point mass that has bounced once on a floor, without weight [m/s]."""
    start = body(
        {"type": "sphere", "radius": 0.1}, [0.0, 0.0, 0.1], linear_velocity=[slip, 0.0, -FALL]
    )
    start |= {"position": [0.0, 0.0, 0.05]}
    floor = touch(restitution=E_CORNERLESS, friction=friction, points=[[0.0, 0.0, 0.0]])
    mapping = scene(start, floor, gravity=False)
    mapping["simulation"] = {"duration": 0.1, "rate": 100.0} | simulation
    run = Simulation(load_scene(mapping)).run()
    assert run.linear_velocity["body"][-1, 2] == pytest.approx(E_CORNERLESS * FALL, rel=1e-9)
    return float(run.linear_velocity["body"][-1, 0])


def test_regularised_friction_takes_what_coulombs_does_of_a_fast_slip() -> None:
    """s falls by mu P / m, up to (v/s)^2/2; before, it went on as fast as it came."""
    law = {"type": "regularised", "coefficient": MU, "speed": ROUNDED}
    after = slip_after(law)
    assert after == pytest.approx(SLIP_CORNERLESS - MU * PUSH / MASS, rel=1e-4)
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
    assert SLIP_CORNERLESS - after == pytest.approx(
        SLIP_CORNERLESS * (1.0 - math.exp(-c * PUSH / MASS)), rel=2e-3
    )


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
MU_UNDETERMINED = 0.3


def landed(thing: dict[str, Any], mu: float = MU_UNDETERMINED) -> Simulation:
    mapping = scene(thing, touch(mu=mu)) | {"simulation": TIMES}
    simulation = Simulation(load_scene(mapping), announce=None)
    simulation.run()
    return simulation


def told(simulation: Simulation) -> int:
    return sum(event.kind == "ambiguous" for event in simulation.events)


def brick(slip: list[float], spin: float, tilt: float = 0.0) -> dict[str, Any]:
    """It comes down flat, but for the tilt [rad], slipping and spinning about the vertical."""
    moves = {"linear_velocity": [*slip, -1.0], "angular_velocity": [0.0, 0.0, spin]}
    turn = {"axis": [0.6, 0.8, 0.0], "angle": tilt}
    return box([0.3, 0.2, 0.1], [0.0, 0.0, 0.051], orientation=turn) | moves


def test_a_face_whose_corners_slip_apart_is_told_and_no_rounding_decides() -> None:
    """Which corner bears more turns the slip; a tilt of rounding has no part in it."""
    ends = []
    for tilt in (0.0, 1e-15, -1e-15, 1e-13):
        simulation = landed(brick([1.0, 0.0], 5.0, tilt))
        assert told(simulation) == 1
        ends.append(simulation.sample().block.linear_velocity)
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], atol=1e-9)


@pytest.mark.parametrize(
    ("slip", "spin", "mu"),
    [
        ([1.0, 0.5], 0.0, MU_UNDETERMINED),
        ([0.0, 0.0], 0.0, MU_UNDETERMINED),
        ([1.0, 0.0], 5.0, 0.0),
    ],
)
def test_a_face_whose_shares_change_nothing_is_not_told(
    slip: list[float], spin: float, mu: float
) -> None:
    """All corners slip one way, or stick, or none rubs: the motion is unique."""
    assert told(landed(brick(slip, spin), mu)) == 0


def test_three_points_share_a_push_in_one_way() -> None:
    feet = [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]]
    mapping = scene(brick([1.0, 0.0], 5.0), touch(mu=MU_UNDETERMINED, points=feet)) | {
        "simulation": TIMES
    }
    simulation = Simulation(load_scene(mapping), announce=None)
    simulation.run()
    assert told(simulation) == 0
    assert sum(event.kind == "impact" for event in simulation.events) == 3


def test_a_box_that_tips_over_an_edge_ends_alike_at_every_tolerance() -> None:
    """On a belt: two corners bear when the other two strike, and all slip in several directions.
    Rounding chose the corners that had a part in it, and the ends were 5e-3 apart."""
    mapping = dict(coupled_scene(777, 63).mapping)
    ends = []
    for tolerance in (1e-10, 1e-11, 1e-12):
        times = {"duration": 0.5, "rate": 20.0, "method": "dopri853", "tolerance": tolerance}
        simulation = Simulation(load_scene(mapping | {"simulation": times}), announce=None)
        ends.append(simulation.run().position["b"][-1])
        assert told(simulation) == 1
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], atol=1e-8)


# Motions that the laws of contact leave open are told once, where other ends differ by more than
# the setting tells apart.


SIZE, SLIP_OPEN, SPIN, G = (0.3, 0.2, 0.1), 1.0, 5.0, 9.81
TIMES_OPEN = {"duration": 0.01, "rate": 100.0, "method": "dopri853"}


def sliding(slip: float, spin: float, mu: float = MU_UNDETERMINED) -> dict[str, Any]:
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
    push = (
        np.array([0.0, 0.0, 1.0]) - MU_UNDETERMINED * slips / np.linalg.norm(slips, axis=1)[:, None]
    )
    inertia = np.array([0.2**2 + 0.1**2, 0.3**2 + 0.1**2, 0.3**2 + 0.2**2]) / 12.0
    change = np.hstack([push, np.cross(corners, push) / inertia]).T
    held = change[[2, 3, 4]]  # heave, roll and pitch, which the floor stops
    least = np.linalg.lstsq(held, [G, 0.0, 0.0], rcond=None)[0]
    free = np.linalg.svd(held)[2][-1]
    ways = (free, -free)
    far = max(min(-n / z for n, z in zip(least, way, strict=True) if z < 0) for way in ways)
    weights = [1.0] * 3 + [length] * 3
    return far * float(np.linalg.norm(weights * (change @ free)))


def test_shares_of_a_face_that_slips_and_spins_are_told() -> None:
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
        (SLIP_OPEN, 0.0, MU_UNDETERMINED),
        (0.0, SPIN, MU_UNDETERMINED),
        (SLIP_OPEN, SPIN, 0.0),
        (0.0, 0.0, MU_UNDETERMINED),
    ],
)
def test_shares_that_change_nothing_are_not_told(slip: float, spin: float, mu: float) -> None:
    """All rubs one way, or shares turn and push by the same, or nothing rubs or moves."""
    simulation, lines = told_of_open(sliding(slip, spin, mu), tolerance=1e-9)
    assert simulation.left_open.figure == 0.0
    assert not lines


def test_what_differs_by_less_than_the_setting_tells_apart_is_not_told() -> None:
    slow = sliding(SLIP_OPEN, 0.3)
    assert len(told_of_open(slow, tolerance=1e-9)[1]) == 1
    assert not told_of_open(slow, tolerance=1e-3)[1]


def test_an_impact_of_a_face_that_spins_is_told_once_with_how_far_its_ends_are_apart() -> None:
    mapping = scene(brick([SLIP_OPEN, 0.0], SPIN), touch(mu=MU_UNDETERMINED, restitution=0.5))
    simulation, lines = told_of_open(mapping, tolerance=1e-9)
    figure, t, contact, what, *_ = simulation.left_open
    assert (what, contact) == (IMPACT, "floor/1")
    assert t == next(event.t for event in simulation.events if event.kind == "ambiguous")
    assert 1e-3 < figure < 0.1
    assert len(lines) == 1
    assert not told_of_open(
        scene(brick([SLIP_OPEN, 0.0], 0.0), touch(mu=MU_UNDETERMINED)), tolerance=1e-9
    )[1]


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
