"""What is noted of contacts, on tables by hand: events, changes without end, wrong tools."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.geometry.pairs import BallOnSolid
from rb_sim.contact.events.event_motion import bearing, lifting
from rb_sim.contact.events.limits import STALLED_EVENTS, Progress, pairs_of_solids, refuse_edges
from rb_sim.contact.events.next_event import speed_of
from rb_sim.contact.events.search import way_apart
from rb_sim.contact.problem import event_workspace as journals
from rb_sim.contact.problem.bounces import Chatter, at_one_instant
from rb_sim.contact.problem.event_workspace import (
    KINDS,
    MODES_WIDTH,
    Journal,
    note_changes,
    note_impulses,
    take_before,
    workspace_left,
)
from rb_sim.mechanics.contact.contact_bodies import SLIP_BEGINS, SLIP_ENDS, TOUCH_DOWN
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.mechanics.contact.contact_table import (
    BILATERAL,
    CLOSED,
    COMPLIANT,
    EVENT_FUNCTIONS_BEFORE,
    NORMAL,
    NORMAL_FORCE,
    ROLL,
    ROLLING_ARM,
    SLIDE,
    SLIP_DIRECTION,
    SPIN,
    SPINNING_ARM,
    STATIC,
    TOUCH_WIDTH,
)
from rb_sim.mechanics.systems.many_bodies import BODY, PARENT


def tables(contacts: int = 1) -> tuple[Any, Any]:
    """A system whose contacts have three lines each behind one of a joint, and its room."""
    touch = np.zeros((contacts, TOUCH_WIDTH))
    lines = np.zeros((1 + 3 * contacts, max(BODY, PARENT) + 1), dtype=int)
    lines[1:, BODY] = 1
    first = np.array([0, *range(1, 2 + 3 * contacts, 3)])
    system = SimpleNamespace(touch=touch, lines=lines, first_row=first, joints=1)
    workspace = SimpleNamespace(
        notes=np.zeros((20, 6)), written=np.zeros(1, dtype=int), J=np.zeros((len(lines), 12)),
        before=np.zeros((contacts, MODES_WIDTH)), impulses=np.zeros(len(lines)),
    )  # fmt: skip
    return system, workspace


def told(workspace: Any) -> list[str]:
    return [KINDS[int(kind)] for kind in workspace.notes[: workspace.written[0], 2]]


@pytest.mark.parametrize(
    ("before", "after", "kinds"),
    [
        ((0, NONE, NONE, NONE), (1, SLIDING, NONE, NONE), ["closes", "slips"]),
        ((1, SLIDING, STUCK, STUCK), (0, NONE, NONE, NONE), ["opens"]),
        (
            (1, SLIDING, SLIDING, STUCK),
            (1, STUCK, STUCK, SLIDING),
            ["sticks", "stops rolling", "spins"],
        ),
        (
            (1, STUCK, STUCK, SLIDING),
            (1, SLIDING, SLIDING, STUCK),
            ["slips", "rolls", "stops spinning"],
        ),
        ((1, STUCK, STUCK, STUCK), (1, STUCK, STUCK, STUCK), []),
        ((1, SLIDING, NONE, NONE), (1, SLIDING, NONE, NONE), ["reverses"]),
    ],
)
def test_changes_of_modes_are_noted_by_their_names(before: Any, after: Any, kinds: Any) -> None:
    """A slip that goes on backwards reverses; what has no bound has no mode to tell."""
    system, workspace = tables()
    touch = system.touch
    touch[0, [STATIC, ROLLING_ARM, SPINNING_ARM]] = 0.5, 0.1, 0.2
    touch[0, [CLOSED, SLIDE, ROLL, SPIN]] = before
    touch[0, SLIP_DIRECTION : SLIP_DIRECTION + 3] = 0.6, 0.8, 0.0
    take_before(system, workspace)
    touch[0, [CLOSED, SLIDE, ROLL, SPIN]] = after
    touch[0, SLIP_DIRECTION : SLIP_DIRECTION + 3] = -0.8, 0.59, 0.0
    note_changes(system, workspace, 4.0)
    assert told(workspace) == kinds and (workspace.notes[: len(kinds), 0] == 4.0).all()
    assert not workspace.notes[:, 3:].any()
    assert workspace_left(workspace) == 20 - len(kinds)
    touch[0, SLIP_DIRECTION : SLIP_DIRECTION + 3] = (
        -0.8,
        0.61,
        0.0,
    )  # turned by less than a right angle
    touch[0, [ROLLING_ARM, SPINNING_ARM]], workspace.written[0] = 0.0, 0
    note_changes(system, workspace, 4.0)
    alone = {"closes", "opens", "slips", "sticks"}
    assert told(workspace) == [kind for kind in kinds if kind in alone]


def test_impulses_are_noted_in_axes_of_the_world() -> None:
    """Of lines that push the body along them; of contacts whose impulses are none, nothing."""
    system, workspace = tables(3)
    axes = Rotation.from_rotvec([0.3, -0.7, 1.1]).as_matrix()
    for k in (1, 4, 7):
        workspace.J[k : k + 3, 6:9] = axes
    workspace.impulses[:] = 50.0, 2.0, -0.5, 0.3, 4e-8, 3e-8, -2e-8, 0.0, 0.0, 6e-8
    note_impulses(system, workspace, 7.0, 0)
    assert told(workspace) == ["impact", "impact"] and workspace.notes[:2, 1].tolist() == [0.0, 2.0]
    np.testing.assert_allclose(workspace.notes[0, 3:], np.array([2.0, -0.5, 0.3]) @ axes)
    np.testing.assert_allclose(workspace.notes[1, 3:], 6e-8 * axes[2])
    assert (workspace.notes[:2, 0] == 7.0).all()


def test_a_journal_calls_events_as_laws_do_and_forgets_the_earliest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(journals, "MOST_EVENTS", 3)
    laws: Any = [
        SimpleNamespace(closes="closes", opens="opens"),
        SimpleNamespace(closes="taut", opens="slack"),
    ]
    journal = Journal(("floor", "rope"), laws)
    _, workspace = tables()
    workspace.notes[:3] = [[0.1, 1, 2, 0, 0, 0], [0.2, 1, 3, 0, 0, 0], [0.3, 0, 0, 1.0, 2.0, 3.0]]
    workspace.written[0] = 3
    journal.take(workspace)
    assert workspace.written[0] == 0
    assert [(e.t, e.contact, e.kind) for e in journal.events] == [
        (0.1, "rope", "taut"), (0.2, "rope", "slack"), (0.3, "floor", "impact"),
    ]  # fmt: skip
    assert journal.events[2].impulse == (1.0, 2.0, 3.0)
    journal.note(0.4, 0, 5)
    journal.note(0.5, 0, 4)
    assert len(journal.events) == 5 and journal.forgotten == 0
    assert journal.events[4].impulse == journal.events[3].impulse == (0.0, 0.0, 0.0)
    journal.note(0.6, 0, 5)
    assert [e.kind for e in journal.events] == ["sticks", "slips", "sticks"]
    assert journal.forgotten == 3


def test_changes_at_one_instant_are_counted() -> None:
    """Within 1e-12 of the time, or of a second; more than fifty after the first have no end."""
    assert at_one_instant(0.0) == at_one_instant(-0.5) == 1e-12 and at_one_instant(-30.0) == 3e-11
    chatter = Chatter(1.0)
    assert [chatter.at_once(5.0 + 4e-12 * k) for k in range(60)].index(True) == 51
    assert not chatter.at_once(5.1) and not chatter.at_once(5.1)
    for _ in range(48):
        assert not chatter.at_once(5.1)
    chatter.leapt(5.1, 1e-6)  # they are told apart from those before a leap
    assert not any(chatter.at_once(5.1) for _ in range(50)) and chatter.at_once(5.1)
    chatter = Chatter(1.0)
    assert not any(chatter.at_once(5.0 + 6e-12 * k) for k in range(60))


def test_slips_that_come_to_nothing_let_friction_hold_firmer() -> None:
    """Of a unit of 2 s a slip is short up to 2e-6 s; after six friction holds by 1e-9 more, then by
    four times that, up to 1e-6.  A slip of 2e-3 s and more is one between them."""
    chatter = Chatter(2.0)

    def slips(count: int, lasting: float) -> list[bool]:
        found = []
        for k in range(count):
            assert not chatter.holds_firmer(float(k), SLIP_BEGINS)
            found.append(chatter.holds_firmer(k + lasting, SLIP_ENDS))
        return found

    assert slips(6, 1.9e-6) == [False] * 5 + [True] and chatter.grip == 1e-9
    assert slips(5, 1.9e-6) == [False] * 5
    assert slips(4, 2.1e-6) == [False] * 4  # says nothing
    assert slips(1, 1.9e-6) == [True] and chatter.grip == 4e-9
    slips(5, 1.9e-6)
    assert slips(1, 2.1e-3) == [False] and slips(5, 1.9e-6) == [False] * 5
    assert not chatter.holds_firmer(9.0, TOUCH_DOWN)
    for _ in range(40):
        slips(6, 1e-7)
    assert chatter.grip == pytest.approx(2.56e-7) and slips(12, 1e-7) == [False] * 12


def test_dense_changes_are_leapt_over_by_longer_and_longer_times() -> None:
    """Fifty within 1e-6 of the unit of 2 s; four times as long where one leap follows the other."""
    chatter = Chatter(2.0)
    assert not any(chatter.is_dense(1.0 + 1e-8 * k, TOUCH_DOWN) for k in range(90))
    found = [chatter.is_dense(1.0 + 4e-8 * k, SLIP_ENDS) for k in range(60)]
    assert found == [False] * 49 + [True] * 11
    assert chatter.length_of_leap(1.0) == 2e-6
    chatter.leapt(1.0, 2e-6)
    assert not chatter.is_dense(1.0, SLIP_ENDS)
    assert chatter.length_of_leap(1.0 + 1.9e-5) == 8e-6
    assert chatter.length_of_leap(1.0 + 2.1e-5) == 2e-6
    chatter.leapt(2.0, 1e-3)
    assert chatter.length_of_leap(2.001) == 2e-3
    sparse = Chatter(2.0)
    assert not any(sparse.is_dense(1.0 + 5e-8 * k, SLIP_ENDS) for k in range(60))


def test_a_run_that_hardly_advances_is_refused() -> None:
    """2,000 events within 1e-3 of the unit."""
    progress = Progress(2.0)
    for k in range(STALLED_EVENTS - 1):
        progress.add(3.0 + 0.99e-6 * k, "floor")
    with pytest.raises(SimulationError, match="2000 events in the last 0.002 s .*contact rope"):
        progress.add(3.0 + 0.99e-6 * STALLED_EVENTS, "rope")
    progress = Progress(2.0)
    for k in range(2 * STALLED_EVENTS):
        progress.add(3.0 + 1.01e-6 * k, "floor")


def test_points_of_a_pair_that_touch_with_two_normals_are_refused() -> None:
    system, _ = tables(4)
    system.touch[:, NORMAL : NORMAL + 3] = [[0, 0, 1], [1, 0, 0], [0, 0, 1], [1e-4, 0, 1]]
    system.touch[:, NORMAL + 3] = 5.0, 6.0, -7.0, 8.0
    here: list[int] = []
    at: Any = SimpleNamespace(system=system, t=0.5, touching=lambda: here)
    for pair, touching, refused in (
        ((0, 1), [0, 1], "contacts a and b"),
        ((0, 2, 1), [0, 1, 2], "contacts a and b"),
        ((0, 2), [0, 1, 2], ""),
        ((0, 1), [0, 2], ""),
        ((0, 3), [0, 3], ""),
    ):
        here[:] = touching
        if refused:
            with pytest.raises(SimulationError, match=refused):
                refuse_edges(at, ((0, 2), pair), ("a", "b", "c", "d"))
        else:
            refuse_edges(at, (pair,), ("a", "b", "c", "d"))


def test_points_of_one_body_on_the_solid_of_another_are_a_pair() -> None:
    solid = BallOnSolid(*[None] * len(BallOnSolid._fields))  # type: ignore[arg-type]

    def one(body: int, parent: int, pair: Any = solid) -> Any:
        return SimpleNamespace(body=body, parent=parent, row=SimpleNamespace(pair=pair))

    groups = (one(0, 1), one(2, 1), one(0, 1, None)), (one(0, 1), one(1, 0), one(2, 1), one(0, 1))
    system: Any = SimpleNamespace(contacts=groups)
    assert pairs_of_solids(system) == ((0, 3, 6), (1, 5))


def test_who_lifts_off_at_one_instant() -> None:
    """Whose push has fallen since 2 s and is over at 4 s but for rounding: 2 s at a rest of 1e-12
    of a push that falls by 1 unit, 50 N, are 2e-12 s, of 4e-12 s that are one instant."""
    system, _ = tables(6)
    touch = system.touch
    system.mass, system.speed, system.length = 2.0, 5.0, 1.0
    touch[:, CLOSED], touch[:, EVENT_FUNCTIONS_BEFORE] = 1.0, 1.0
    touch[:, NORMAL_FORCE] = 50.0 * np.array([1e-12, 3e-12, 1e-12, 1e-12, -1.0, 2.0])
    touch[2, BILATERAL] = touch[3, COMPLIANT] = 1.0
    assert lifting(system, 2.0, 4.0) == {0, 4}
    touch[4, CLOSED] = 0.0
    assert lifting(system, 2.0, 4.0) == {0}
    assert bearing(system, frozenset({0})) and not bearing(system, frozenset({0, 1, 2, 3, 5}))


def test_the_speed_of_a_body_and_the_way_between_two_states() -> None:
    """(v, A w) of 3 m/s and A (1, 0, 0) = (0, 4, 0) m/s; of places 3 m, and a turn by 4/5 in
    quaternions twice over the length of 5 m."""
    y, other, arms = np.zeros(26), np.zeros(26), np.zeros((2, 9))
    arms[1, 3] = 4.0
    y[20:26] = 1.0, 2.0, 2.0, 1.0, 7.0, 7.0
    assert speed_of(y, 1, arms) == pytest.approx(5.0)
    y[13:20], other[13:20] = (
        (2.0, 1.0, 2.0, 0.6, 0.0, 0.0, 0.8),
        (0.0, 0.0, 0.0, 0.6, 0.0, 0.8, 0.8),
    )
    assert way_apart(y, other, 1, 5.0) == pytest.approx(3.0 + 2.0 * 5.0 * 0.8)
    assert speed_of(y, 0, arms) == way_apart(y, other, 0, 5.0) == 0.0
