"""A motion from event to event, where it is put together: what starts, what is kept, what grips."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import SimulationError
from rb_sim.contact.events import event_motion as events
from rb_sim.contact.events.event_motion import ContactMotion
from rb_sim.contact.events.limits import STALLED_TIME
from rb_sim.contact.events.shares import IMPACT, PARTED, LeftOpen
from rb_sim.contact.events.tasks import AT_IMPACTS, AT_MODES, DONE, LEAVE, PASS
from rb_sim.contact.problem.bounces import DENSE
from rb_sim.contact.problem.event_workspace import AMBIGUOUS
from rb_sim.mechanics.contact.contact_bodies import (
    EVENT_KINDS,
    JAMS,
    LIFT_OFF,
    ROLL_BEGINS,
    ROLL_ENDS,
    SLIP_BEGINS,
    SLIP_ENDS,
    TOUCH_DOWN,
)
from rb_sim.mechanics.contact.contact_table import CLOSED, CREEPS, NORMAL_FORCE, ROLL, SLIDE, STATIC
from tests.contact.scenes import ball, box, scene, touch


def flying(**contact: Any) -> Any:
    """The motion of a ball 1 m above its floor."""
    mapping = scene(ball([0, 0, 1.1]), touch(**contact))
    motion: Any = Simulation(load_scene(mapping))._motion
    assert isinstance(motion, ContactMotion)
    return motion


def test_nothing_is_left_open_at_the_start() -> None:
    """What impacts and shares have left open is forgotten where a motion starts again."""
    motion = flying(mu=0.3)
    assert motion.left_open[:2] == (0.0, 0.0)
    motion._call.workspace.undetermined[:4] = 0.0, 0.25, 1.5, 0.0
    assert motion.left_open[:4] == (0.25, 1.5, "floor", IMPACT)
    motion.reset()
    assert motion.left_open.figure == 0.0 and motion.left_open.t == 0.0


def test_the_widest_of_all_that_is_left_open_is_told() -> None:
    motion = flying(mu=0.3)
    motion._lifted_off = LeftOpen(0.5, 2.0, "floor", "figure")
    assert motion.left_open == LeftOpen(0.5, 2.0, "floor", "figure")


def test_a_command_makes_another_motion_of_it() -> None:
    motion = flying(mu=0.3)
    assert motion.as_compiled
    motion._due = 5
    motion.change_law(motion.system._replace(still=0.0, creep=7.0))
    assert not motion.as_compiled and motion._due == -1
    assert motion.system.still == 30.0 * motion.method.tolerance
    assert motion.system.creep == pytest.approx(1e-9 * motion.system.speed)
    motion.reset()
    assert motion.as_compiled


@pytest.mark.parametrize(
    ("contact", "alone"),
    [
        ({"mu": 0.3}, True),
        ({"friction": {"type": "viscous", "coefficient": 1.0}}, False),
        ({"friction": {"type": "rough"}}, False),
    ],
)
def test_what_the_laws_alone_decide(contact: Any, alone: bool) -> None:
    motion = flying(**contact)
    assert motion._by_laws_alone is alone
    disk = {"type": "disk", "radius": 0.1}
    rolling = scene({"mass": 1.0, "shape": disk, "position": [0, 0, 1.0]}, touch(mu=0.3))
    assert not Simulation(load_scene(rolling))._motion._by_laws_alone  # type: ignore[attr-defined]
    edges = {"a": box([1, 1, 1], [0, 0, -0.5]), "body": box([0.1, 0.1, 0.1], [0, 0, 1])}
    solids = scene(edges, touch(mu=0.3, parent="a", surface={"type": "shape"}))
    assert Simulation(load_scene(solids))._motion._by_laws_alone is not bool(  # type: ignore[attr-defined]
        Simulation(load_scene(solids))._motion._pairs  # type: ignore[attr-defined]
    )


def test_friction_at_its_bound_holds_firmer_where_slips_end_as_they_begin() -> None:
    """By a share of the coefficient that is given, not of that at hand."""
    motion = flying(mu=0.3)
    for holds, static in ((False, 0.3), (True, 0.3 * 1.25), (True, 0.3 * 1.25)):
        asked: list[Any] = []

        def firmer(t: float, kind: int, holds: bool = holds, asked: Any = asked) -> bool:
            asked.append((t, kind))
            return holds

        motion._chatter = SimpleNamespace(grip=0.25, holds_firmer=firmer)
        motion._hold_firmer(2.0, SLIP_BEGINS)
        assert asked == [(2.0, SLIP_BEGINS)]
        assert motion.laws[0].static == motion.system.touch[0, STATIC] == pytest.approx(static)
    motion.reset()
    assert motion.laws[0].static == 0.3


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize(
    ("before", "flight", "first"),
    [(0.0, 0.1, 0.1), (0.05, 0.1, 0.05), (0.2, 0.1, 0.1), (0.2, math.inf, 0.2), (0.0, math.inf, 0)],
)
def test_the_first_step_after_an_event_ends_no_later_than_a_flight(
    fixed: bool, before: float, flight: float, first: float
) -> None:
    """Steps of fixed length pause there instead."""
    motion = flying(mu=0.3)
    motion.method = SimpleNamespace(step=0.2, tolerance=0.0 if fixed else 1e-6)
    call = SimpleNamespace(workspace=motion._call.workspace, found=flight)
    begun: list[Any] = []
    kind = type("Told", (ContactMotion,), {
        "_call": call, "_continue_from": lambda self, *at: begun.append(at)})  # fmt: skip
    motion.__class__ = kind
    motion._grid = motion._grid._replace(h=before)
    y = np.arange(14.0)
    motion._begin_flights(2.0, y)
    ((t, at, h),) = begun
    assert (t, h) == (2.0, first) and at is y
    assert motion._pause == (2.0 + flight if fixed else math.inf)


class At(SimpleNamespace):
    """An instant at 4 s."""


def standing(*pushes: float, **columns: Any) -> Any:
    """A motion of so many balls with these pushes, which stands at an event."""
    names = [f"b{i}" for i in range(len(pushes))]
    bodies = {name: ball([i, 0, 1.1]) for i, name in enumerate(names)}
    more: dict[str, Any] = {"mode": "bilateral"} if columns.pop("bilateral", False) else {}
    floors = {f"on_{name}": touch(name, mu=0.3, **more) for name in names}
    mapping = scene(bodies, floors)
    if more:
        for given in bodies.values():
            given["position"][2] = 0.1
    motion: Any = Simulation(load_scene(mapping))._motion
    motion.system.touch[:, NORMAL_FORCE] = pushes
    for name, values in columns.items():
        motion.system.touch[:, {"creeps": CREEPS, "closed": CLOSED}[name]] = values
    return motion


def answering(patch: pytest.MonkeyPatch, **given: Any) -> list[Any]:
    """Let functions that a motion asks give these answers; lists one by one, JammedError is raised.
    Returns what they are asked: (name, all but the first argument)."""
    asked: list[Any] = []

    def answer(name: str) -> Any:
        def found(*arguments: Any) -> Any:
            asked.append((name, *arguments[1:]))
            value = given[name].pop(0) if isinstance(given[name], list) else given[name]
            if value is events.JammedError:
                raise value(4.0)
            return value

        return found

    for name in given:
        patch.setattr(ContactMotion if name.startswith("_") else events, name, answer(name))
    return asked


@pytest.mark.parametrize(
    ("pushes", "lifted", "kind", "lifts"),
    [
        ((1e-8, 1.0), (), SLIP_BEGINS, True),
        ((-1e-8, 1.0), (), SLIP_BEGINS, True),
        ((1e-6, 1.0), (), SLIP_BEGINS, False),
        ((1e-6, -1.0), (), ROLL_BEGINS, False),
        ((1e-6, 1.0), (0, 1), SLIP_BEGINS, True),
        ((1e-6, 1.0), (1,), LIFT_OFF, True),
    ],
)
def test_friction_reaches_its_bound_as_a_push_ends(
    monkeypatch: pytest.MonkeyPatch, pushes: Any, lifted: Any, kind: int, lifts: bool
) -> None:
    """Where contact 0 pushes with less than 1e-7 of the largest; others may lift with it."""
    motion = standing(*pushes)
    answering(monkeypatch, lifting=frozenset(lifted), _call=None)
    found = motion._as_lift_off(At(t=4.0, y=None), (0, kind))
    assert found == (0, LIFT_OFF if lifts else kind)
    assert motion._lifted == (frozenset(lifted) if lifts else frozenset())


def test_a_contact_that_may_pull_does_not_lift(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = standing(0.0, 1.0, bilateral=True)
    answering(monkeypatch, lifting=frozenset(), _call=None)
    assert motion._as_lift_off(At(t=4.0, y=None), (0, SLIP_BEGINS)) == (0, SLIP_BEGINS)


@pytest.mark.parametrize("stops", [True, False])
@pytest.mark.parametrize(
    ("kind", "mode", "begins"), [(SLIP_ENDS, SLIDE, SLIP_BEGINS), (ROLL_ENDS, ROLL, ROLL_BEGINS)]
)
def test_a_motion_that_ends_begins_anew_where_nothing_rests(
    monkeypatch: pytest.MonkeyPatch, stops: bool, kind: int, mode: int, begins: int
) -> None:
    """All that creep end together, with one of them; another one alone."""
    for c, ends in ((1, [0, 1]), (2, [2])):
        motion = standing(1.0, 1.0, 1.0, creeps=(1e-9, 1e-9, 0.0))
        asked = answering(monkeypatch, stop=stops)
        assert motion._stopped(None, (c, kind)) == (c, kind if stops else begins)
        ((_, found, of, arms),) = asked
        monkeypatch.undo()
        assert (found, of, arms.shape) == (ends, mode, (3, 3, 3))


def test_what_jams_may_jam_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five times, each stopped in an impact; then what is found is taken, or raised."""
    motion, at, jammed = standing(1.0), At(t=4.0), events.JammedError
    stops = {"_jam": None, "_strike": None}
    asked = answering(monkeypatch, choose_modes=[jammed, jammed, (0,)], **stops)
    assert motion._found_modes(at, (0, SLIP_BEGINS)) == (0,)
    assert [name for name, *_ in asked] == [*["choose_modes", *stops] * 2, "choose_modes"]
    codes = [told[0] for name, *told in asked if name == "choose_modes"]
    assert codes == [(0, SLIP_BEGINS), None, None]
    answering(monkeypatch, choose_modes=[*[jammed] * 5, (0,)], **stops)
    assert motion._found_modes(at, (0, JAMS)) == (0,)
    answering(monkeypatch, choose_modes=[jammed] * 6, **stops)
    with pytest.raises(jammed):
        motion._found_modes(at, (0, JAMS))


@pytest.mark.parametrize(
    ("closed", "again", "refused"), [(1.0, [], False), (1.0, [0], True), (0.0, [], True)]
)
def test_what_never_slips_is_stopped_at_once(
    monkeypatch: pytest.MonkeyPatch, closed: float, again: list[int], refused: bool
) -> None:
    """Refused where it opens for it, or slips again."""
    motion = standing(1.0, closed=closed)
    rest = {"_stop_at_once": None, "refuse_rough": None}
    asked = answering(monkeypatch, choose_modes=[(), (0,)], slipping_rough=[[0], again], **rest)
    assert motion._unjammed(At(t=4.0), (0, SLIP_BEGINS)) == (0,)
    names = [name for name, *_ in asked]
    assert names.count("_stop_at_once") == 1
    assert ("refuse_rough" in names) is refused
    asked = answering(monkeypatch, choose_modes=[()], slipping_rough=[[]], **rest)
    assert motion._unjammed(At(t=4.0), None) == ()
    assert [name for name, *_ in asked] == ["choose_modes", "slipping_rough"]


def leaving(patch: pytest.MonkeyPatch, dragged: int) -> Any:
    """A motion of two balls of which that one, counted from 1, is dragged off as it leaves."""
    motion = standing(1.0, 1.0)
    asked: list[Any] = []

    def call(self: Any, task: int, t: float, y: Any, numbers: Any = (0, 0, 0)) -> int:
        asked.append((task, t, numbers))
        return dragged

    patch.setattr(ContactMotion, "_call", call)
    patch.setattr(ContactMotion, "_begin_flights", lambda self, *at: asked.append(at))
    motion._journal = SimpleNamespace(
        take=lambda workspace: asked.append("taken"), note=lambda *told: asked.append(told)
    )
    return motion, asked


def test_what_drags_its_body_off_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for dragged, name in ((1, "on_b0"), (2, "on_b1")):
        motion, _ = leaving(monkeypatch, dragged)
        with pytest.raises(SimulationError, match=f"viscous contact {name} can neither"):
            motion._leave(At(t=4.0, y=None, workspace=None))
        monkeypatch.undo()
    motion, asked = leaving(monkeypatch, 0)
    motion._leave(At(t=4.0, y=5, workspace=None))
    assert asked == [(LEAVE, 4.0, (0, 0, 0)), (4.0, 5)]


def test_a_lift_off_that_may_slip_on_as_well_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """As wide as it can be: both have the normal acceleration that the other one has not."""
    motion, asked = leaving(monkeypatch, 0)
    answering(monkeypatch, _unjammed=(1,), refuse_edges=None, letting_go=frozenset())
    monkeypatch.setattr(ContactMotion, "_leave", lambda self, at: None)
    motion._go_on(At(t=4.0, y=None), None)
    assert asked == [(4.0, 1, AMBIGUOUS)]
    assert motion._lifted_off == LeftOpen(1.0, 4.0, "on_b1", PARTED)


@pytest.mark.parametrize("possible", [True, False])
def test_a_leap_goes_on_behind_it_or_is_refused(
    monkeypatch: pytest.MonkeyPatch, possible: bool
) -> None:
    motion = standing(1.0, 1.0)
    at, motion._grid = At(t=4.0), motion._grid._replace(t1=4.0)
    gone = answering(monkeypatch, _instant=at, _leapt_over=possible, _go_on=None)
    if possible:
        motion._leap(1)
    else:
        with pytest.raises(SimulationError, match=r"t = 4 s \(contact on_b1\)"):
            motion._leap(1)
    names = [name for name, *_ in gone]
    assert names == ["_instant", "_leapt_over", *(["_go_on"] if possible else [])]
    assert gone[1][2] == 1 and motion._lifted == frozenset()


def test_what_goes_on_without_end_is_told_in_the_scenes_own_time() -> None:
    motion = flying(mu=0.3)
    unit = motion.system.length / motion.system.speed
    assert motion._chatter._short == pytest.approx(DENSE * unit)
    assert motion._progress._shortest == pytest.approx(STALLED_TIME * unit)


@pytest.mark.parametrize(
    ("done", "strikes", "goes_on"), [(DONE, 0, 0), (AT_IMPACTS, 1, 1), (AT_MODES, 0, 1)]
)
def test_a_touch_down_is_put_together_from_where_laws_alone_do_not_decide(
    monkeypatch: pytest.MonkeyPatch, done: int, strikes: int, goes_on: int
) -> None:
    """Impacts are struck only where they are not done with."""
    motion, asked = leaving(monkeypatch, done)
    monkeypatch.setattr(events, "Instant", lambda laws, call, t, y: At(t=t, y=y, workspace=None))
    names = {"_strike": None, "_go_on": None}
    told = answering(monkeypatch, **names)
    motion._touch_down(4.0, 5, (1, TOUCH_DOWN))
    assert asked[0] == (PASS, 4.0, (1, 0, 0))
    kinds = [name for name, *_ in told]
    assert (kinds.count("_strike"), kinds.count("_go_on")) == (strikes, goes_on)
    assert ((4.0, 5) in asked) is (done == DONE)


@pytest.mark.parametrize(
    ("kind", "at_once", "dense", "leaps"),
    [
        (TOUCH_DOWN, False, False, False),
        (TOUCH_DOWN, True, False, True),
        (SLIP_ENDS, False, True, True),
        (SLIP_ENDS, False, False, False),
    ],
)
def test_an_event_is_that_of_its_contact(
    monkeypatch: pytest.MonkeyPatch, kind: int, at_once: bool, dense: bool, leaps: bool
) -> None:
    """Events without end are leapt over."""
    motion = standing(1.0, 1.0)
    motion._grid, motion._due = motion._grid._replace(t1=4.0), EVENT_KINDS * 1 + kind
    motion._chatter = SimpleNamespace(
        at_once=lambda t: at_once, is_dense=lambda t, of: dense and (t, of) == (4.0, kind)
    )
    added: list[Any] = []
    motion._progress = SimpleNamespace(add=lambda *told: added.append(told))
    asked = answering(monkeypatch, _hold_firmer=None, _leap=None, _happen=None)
    motion._event()
    assert added == [(4.0, "on_b1")] and motion._due == -1
    then = ("_leap", 1) if leaps else ("_happen", (1, kind))
    assert asked == [("_hold_firmer", 4.0, kind), then]
