"""Rounds of impacts of balls at the floor, by Newton's rule and the balance of their energy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.contact.problem import order
from rb_sim.contact.problem.impacts import NOTHING, STRUCK
from tests.contact.scenes import ball, scene, touch
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
    from rb_sim.contact.events.instant import Instant
    from rb_sim.contact.events.tasks import Tasks
    from rb_sim.contact.problem import impacts
    from rb_sim.mechanics.contact.contact_table import CLOSED
    from rb_sim.scene.compile import compile_scene

    names = ("body", "other", "third")[: len(speeds)]
    bodies = {name: ball([k, 0.0, 0.1], mass=1.0 + k) for k, name in enumerate(names)}
    floors = {name: touch(name, restitution=E, **law) for name in names}
    compiled = compile_scene(load_scene(scene(bodies, floors)))
    y = np.array(compiled.y, dtype=float)
    for k, speed in enumerate(speeds):
        y[13 * k + 8 : 13 * k + 10] = SLIP, -speed
    at = Instant(compiled.contact_laws, Tasks(compiled.system), 0.0, y)
    room, count = at.room, len(speeds)
    at.system.touch[:, CLOSED] = closed
    for table, c in ((room.plastic, plastic), (room.together, together)):
        table[:] = 0
        if c >= 0:
            table[c] = 1
    if in_rounds is None:
        status, n = impacts.strike(at.system, room, 0.5, y, alone), 0
    else:
        status, n = impacts.strike_in_rounds(at.system, room, 0.5, y, *in_rounds)
    return {
        "status": int(status), "round": int(n), "rebounding": room.rebounding.tolist(),
        "rises": [float(y[13 * k + 9]) for k in range(count)],
        "slips": [float(y[13 * k + 8]) for k in range(count)],
        "work": float(y[13 * count]), "notes": room.notes[: room.written[0]].tolist(),
        "undetermined": room.undetermined.tolist(),
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


@pytest.mark.parametrize("which", ["plastic", "together"])
def test_what_is_not_to_part_stays(which: str) -> None:
    """Where contacts are to stay together the others do not rebound either."""
    found = interpreted(
        struck, [2.0, 1.0], {}, False, *((0, -1) if which == "plastic" else (-1, 0))
    )
    assert_allclose(found["rises"], [0.0, E if which == "plastic" else 0.0], atol=1e-12)
    leaves = interpreted(struck, [2.0, -1.0], {}, False, -1, 1)
    assert_allclose(leaves["rises"], [0.0, 0.0], atol=1e-12)


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


def apart(e: float, heavy: float, speeds: tuple[float, float]) -> tuple[list[float], list[float]]:
    """By how much the two orders differ of a ball that strikes the floor as another one strikes it
    from above, asked both ways, and what the ball above has besides: a slip of 3 m/s."""
    from rb_sim import load_scene
    from rb_sim.contact.events.instant import Instant
    from rb_sim.contact.events.tasks import Tasks
    from rb_sim.contact.problem.order import apart_in_order
    from rb_sim.scene.compile import compile_scene

    bodies = {"body": ball([0.0, 0.0, 0.1]), "upper": ball([0.0, 0.0, 0.3], mass=heavy)}
    stack = {"type": "contact", "body": "upper", "parent": "body", "surface": {"type": "shape"}}
    contacts = {"floor": touch(restitution=e), "stack": stack | {"restitution": e}}
    compiled = compile_scene(load_scene(scene(bodies, contacts)))
    y = np.array(compiled.y, dtype=float)
    y[9], y[22], y[20] = *speeds, 3.0
    at = Instant(compiled.contact_laws, Tasks(compiled.system), 0.0, y)
    at.room.plastic[:] = at.room.together[:] = 1
    lines = at.room.J.copy()
    found = [
        float(apart_in_order(at.system, at.room, 0.0, y, *order)) for order in ((0, 1), (1, 0))
    ]
    assert (at.room.J == lines).all()
    return found, y[[9, 22, 20]].tolist()


def ends(e: float, heavy: float, speeds: tuple[float, float], floor_first: bool) -> list[float]:
    """Both velocities after impacts in turns, by Newton's rule."""
    a, b = speeds
    floor = floor_first
    for _ in range(50):
        if floor and a < 0.0:
            a = -e * a
        elif not floor and b < a:
            middle, part = (a + heavy * b) / (1.0 + heavy), e * (a - b)
            a, b = middle - part * heavy / (1.0 + heavy), middle + part / (1.0 + heavy)
        floor = not floor
    return [a, b]


@pytest.mark.parametrize("e", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("heavy", [1.0, 2.0])
@pytest.mark.parametrize("speeds", [(-1.0, -2.0), (-2.0, -2.5), (0.0, -1.0)])
def test_two_impacts_in_both_orders(e: float, heavy: float, speeds: tuple[float, float]) -> None:
    """Balls of the same mass that lose nothing end alike in both; what is there stays as it is."""
    one, other = (np.array(ends(e, heavy, speeds, first)) for first in (True, False))
    found, after = interpreted(apart, e, heavy, speeds)
    if speeds[0] < 0.0:  # else the floor has no part at first
        assert_allclose(found, np.abs(one - other).max(), atol=1e-12)
        assert e < 1.0 or heavy > 1.0 or found[0] < 1e-12
    assert after == [*speeds, 3.0]


def test_a_series_without_end_is_taken_to_differ() -> None:
    """A heavy ball on a light one that loses nothing: more than twenty impacts."""
    assert interpreted(apart, 1.0, 5000.0, (-1.0, -2.0))[0] == [1e300, 1e300]


@pytest.mark.parametrize(
    ("followed", "wanted"), [((True, True), 5.0 + 0.5 * 13.0), ((True, False), 1e300)]
)
def test_turns_count_by_the_length_of_the_scene(
    monkeypatch: pytest.MonkeyPatch, followed: tuple[bool, bool], wanted: float
) -> None:
    """Of the body whose velocities differ most: 5 m/s and 13 rad/s over 0.5 m, beside 6 m/s."""
    ways = np.zeros((2, 12))
    ways[0, 2], ways[:, 6:9], ways[:, 9:12] = 6.0, [[1, 3, 1], [1, 0, 5]], [[3, 1, 0], [0, 5, 12]]
    asked: list[tuple[int, int]] = []

    def end(system: Any, room: Any, t: float, y: Any, first: int, second: int, out: Any) -> bool:
        out[:] = ways[len(asked)]
        asked.append((first, second))
        return followed[len(asked) - 1]

    monkeypatch.setattr(order, "end_of_order", end)
    monkeypatch.setattr(order, "write_lines", lambda *of: None)
    system = SimpleNamespace(touch=np.zeros((4, 1)), bodies=np.zeros((2, 1)), length=0.5)
    room = SimpleNamespace(free_accelerations=np.zeros(12), plastic=np.ones(4), together=np.ones(4))
    assert order.apart_in_order(system, room, 0.0, None, 1, 3) == pytest.approx(wanted)
    assert asked == [(1, 3), (3, 1)] and not room.plastic.any() and not room.together.any()
