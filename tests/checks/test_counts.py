"""What watches count and add up, on samples by hand: events, exchanged energy, gaps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim.base.diagnostic import Finding
from rb_sim.checks.balance import FIRST_EVENTS, Events, Exchanged, farthest
from rb_sim.checks.check import Seen
from rb_sim.checks.sample_integrals import EARLY, CheckedQuadrature, Gaps
from rb_sim.checks.steps import CHATTER, chatter
from rb_sim.mechanics.samples import ContactEvent
from tests.checks.blocks import Block


def events(count: int, contact: str, kind: str = "impact") -> tuple[ContactEvent, ...]:
    return tuple(ContactEvent(0.1 * k, contact, kind) for k in range(count))


def test_a_contact_chatters_by_the_count_of_its_own_events() -> None:
    """More than CHATTER of them, and more than 50 between two samples; the last time is told."""
    run: Any = None
    look = chatter(run)

    def told(end: float, samples: int, *happened: ContactEvent) -> list[Finding]:
        rest: Any = (None, None, None)
        return [*look(Seen(Block([0.5, 0.6, end], events=happened), *rest, samples))]

    assert not told(1.0, 1)
    for end in (1.0, 2.0):  # no more than so many
        assert not told(end, 10, *events(CHATTER // 2, "a"), *events(9, "b"))
    assert not told(2.5, 21, *events(1, "a"))  # 47.7 a sample
    (found,) = told(3.0, 20)
    assert (found.where, found.t) == ("a", 3.0)
    assert found.figure == pytest.approx((CHATTER + 1) / 20) and found.bound == 50.0


def test_events_are_counted_by_kind_listed_and_their_impulses_added() -> None:
    log = Events()
    struck = (
        ContactEvent(0.1, "floor", "impact", (1.0, 0.0, 2.0)),
        ContactEvent(0.2, "floor", "impact", (0.0, -4.0, 8.0)),
        ContactEvent(0.3, "wall", "impact", (0.5, 0.0, 0.0)),
    )
    log.add(struck)
    log.add(events(5, "floor", "slips"))
    log.add(events(5, "floor", "slips"))
    told = log.as_dict()
    assert told["events"] == {"impact": 3, "slips": 10}
    assert told["impulses"] == {"floor": [1.0, -4.0, 10.0], "wall": [0.5, 0.0, 0.0]}
    assert len(told["first_events"]) == FIRST_EVENTS == 10
    assert told["first_events"][1] == {
        "t": 0.2, "contact": "floor", "kind": "impact", "impulse": [0.0, -4.0, 8.0],
    }  # fmt: skip


def energies(t: list[float], kinetic: list[float], potential: list[float], work: list[float]):
    """Of one body of which a load of 3 N and 4 N acts within 5 m."""
    return Block(
        t,
        kinetic_energy=kinetic,
        potential_energy=potential,
        contact_work=work,
        reaction_force=[[[3.0, 0.0, 4.0]]] * len(t),
        position=[[[-5.0, 1.0, 2.0]]] * len(t),
    )


def test_what_a_run_has_exchanged() -> None:
    """2 J at the start, a fall from -7 J to -10 J, 6 J at contacts, and the work of a power that
    goes from 1 W to -1 W and to 0 over 1 s each: 1 J and 1/2 J as sizes are told by trapezoids."""
    found, power = Exchanged(), CheckedQuadrature(1)
    first = energies([0.0, 0.5, 1.0, 2.0], [2.0, 9.0, 8.0, 7.0], [-7.0, -9.0, -8.0, -8.0],
                     [-1.0, -6.0, 0.0, 0.0])  # fmt: skip
    last = energies([2.5, 3.0], [30.0, 1.0], [-10.0, -8.0], [3.0, 0.0])
    found.add(first)
    power.add(np.array([0.0, 0.5, 1.0, 2.0]), np.array([[1.0], [0.5], [0.0], [-1.0]]))
    found.add(last)
    power.add(np.array([2.5, 3.0]), np.array([[-0.5], [0.0]]))
    size, signed = power.by_trapezoids()[0].tolist()
    assert signed == pytest.approx(-0.5, rel=1e-15)
    found.work(size)
    assert found.scale == pytest.approx(2.0 + 3.0 + 6.0 + 1.5, rel=1e-15)
    # the load makes 25 J of a rounding of 1e-13, beside the potential
    assert found.rounding == pytest.approx(1e-13 * (7.0 + 25.0), rel=1e-12)
    found.saw(energies([3.0, 4.0], [0.0] * 2, [-16.0, 9.0], [0.0] * 2))
    assert found.scale == pytest.approx(2.0 + 9.0 + 6.0 + 1.5, rel=1e-15)


def test_what_is_left_of_velocities_that_constraints_took_is_rounding() -> None:
    """Of 1e27 J given 1e1 J are."""
    found = Exchanged(1e27)
    found.add(energies([0.0], [9.0], [0.0], [0.0]))
    assert found.rounding == pytest.approx(10.0, rel=1e-9) and found.scale == 0.0
    assert farthest(np.array([[1.0, -7.0], [5.0, 2.0]])) == 7.0
    assert farthest(np.array([[1.0, -2.0], [5.0, 2.0]])) == 5.0


@pytest.mark.parametrize("pieces", [1, 3, 50])
@pytest.mark.parametrize("usual", [400, EARLY + 200])
def test_the_integral_over_gaps_alone(pieces: int, usual: int) -> None:
    """Two intervals of 1.5 s and 4 s among many of 0.1 s, of 1 s and of 1e-3 s: those are none."""
    steps = np.full(usual, 0.1)
    steps[:30] = 1e-3
    steps[40], steps[usual // 2], steps[usual - 3] = 1.5, 1.0 - 1e-9, 4.0
    t = np.append(0.0, np.cumsum(steps))
    f = np.column_stack((np.sin(t), -2.0 - t))
    gaps = Gaps(2)
    for part in np.array_split(np.arange(len(t)), pieces):
        gaps.add(t[part], f[part])
    wanted = sum(0.5 * steps[k] * (abs(f[k]) + abs(f[k + 1])) for k in (40, usual - 3))
    assert gaps.total() == pytest.approx(wanted, rel=1e-12)


def test_what_takes_half_of_the_time_is_the_usual_interval() -> None:
    gaps = Gaps(1)
    gaps.add(np.array([0.0, 1.0, 2.0, 30.0]), np.ones((4, 1)))
    assert not gaps.total().any() and not Gaps(3).total().any()
