"""How long flights may be, and steps beside what comes and goes with time alone: by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.events import stepping
from rb_sim.contact.problem import bounces
from rb_sim.contact.problem.bounces import time_of_flights
from rb_sim.mechanics.contact.contact_table import CLOSED, DRAGS, GAP, GAP_RATE, TOUCH_WIDTH

LENGTH, SPEED = 0.5, 2.0


def flights(
    monkeypatch: pytest.MonkeyPatch, contacts: list[tuple[float, float, float]],
    fixed: bool = False, **columns: list[float],
) -> tuple[float, int]:  # fmt: skip
    """Of contacts (gap, its rate, its acceleration), all open but for what `columns` say."""
    touch = np.zeros((len(contacts), TOUCH_WIDTH))
    touch[:, GAP], touch[:, GAP_RATE] = [g for g, _, _ in contacts], [v for _, v, _ in contacts]
    for name, values in columns.items():
        touch[:, {"closed": CLOSED, "drags": DRAGS}[name]] = values
    first = np.array([0, *range(0, 3 * len(contacts) + 1, 3)])
    system = SimpleNamespace(touch=touch, length=LENGTH, speed=SPEED, first_row=first, joints=1)
    asked: list[Any] = []
    monkeypatch.setattr(bounces, "contact_accelerations", lambda *of: asked.append(of))
    pulls = {3 * c: a for c, (_, _, a) in enumerate(contacts)}
    monkeypatch.setattr(bounces, "acceleration_along", lambda system, workspace, k: pulls[k])
    found = time_of_flights(system, None, 3.0, "y", fixed)
    assert asked == [(system, 3.0, "y")]
    return found


def test_a_flight_ends_within_twice_the_way_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """2.4 times to its top, the shortest of all; at its top where steps are fixed or rounding of
    1e-10 of the length may hide it."""
    up = (0.0, 0.3, -10.0)
    assert flights(monkeypatch, [up]) == (pytest.approx(2.4 * 0.03), 0)
    assert flights(monkeypatch, [up, (0.0, 0.2, -10.0), (0.0, 0.5, -10.0)])[0] == pytest.approx(
        0.048
    )
    assert flights(monkeypatch, [up], True)[0] == pytest.approx(0.03)
    for part, times in ((0.99, 1.0), (1.01, 2.4)):
        low = (part * 2.0 * 1e-10 * LENGTH * 10.0) ** 0.5
        found = flights(monkeypatch, [(0.0, low, -10.0)])[0]
        assert found == pytest.approx(times * low / 10.0)


@pytest.mark.parametrize(
    "contact",
    [(0.0, 0.3, 10.0), (0.0, 1.9e-10, -10.0), (0.6e-10, 0.3, -10.0), (-0.6e-10, 0.3, -10.0)],
)
def test_what_does_not_fly_has_no_end(monkeypatch: pytest.MonkeyPatch, contact: Any) -> None:
    """What rises ever faster, hardly rises, or is not at its support; or what is closed."""
    assert flights(monkeypatch, [contact], drags=[1.0]) == (math.inf, 1 if contact[1] < 1e-9 else 0)
    assert flights(monkeypatch, [(0.0, 0.3, -10.0)], closed=[1.0]) == (math.inf, 0)
    assert flights(monkeypatch, [(0.4e-10, 0.3, -10.0)])[0] < 1.0


def test_what_its_drag_lifts_and_falls_back_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """By more than 1e-6 of 2^2 / 0.5 m/s^2; the first of them."""
    rests = [(0.0, 0.0, -0.9 * 8e-6), (0.0, 0.0, -1.1 * 8e-6), (0.0, 0.0, -9.0)]
    assert flights(monkeypatch, rests, drags=[1.0, 1.0, 1.0]) == (math.inf, 2)
    assert flights(monkeypatch, rests, drags=[1.0, 0.0, 1.0]) == (math.inf, 3)
    assert flights(monkeypatch, rests, drags=[1.0, 0.0, 0.0]) == (math.inf, 0)


def test_steps_are_an_eighth_of_the_shortest_period(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of forces, of what is shaken, and of what wobbles as it turns."""
    effects: list[Any] = []
    contacts: list[Any] = []
    system = SimpleNamespace(effects=effects, contacts=(contacts,), length=1.0)
    compiled: Any = SimpleNamespace(system=system, y=None)
    monkeypatch.setattr(stepping, "wobbles", lambda compiled, contact: contact.wobbles)
    monkeypatch.setattr(stepping, "WorldHarmonicRow", SimpleNamespace)

    def method(largest: float) -> Any:
        found: Any = SimpleNamespace(largest_step=largest)
        found._replace = lambda largest_step: largest_step
        return found

    def force(rate: float) -> Any:
        return SimpleNamespace(row=SimpleNamespace(angular_frequency=rate))

    def support(carrier: Any, wobbles: bool = True) -> Any:
        return SimpleNamespace(row=SimpleNamespace(carrier=carrier), wobbles=wobbles)

    def like(kind: type, **fields: Any) -> Any:
        return kind(**{name: fields.get(name) for name in kind._fields})  # type: ignore[attr-defined]

    assert (
        stepping.shortest_period(compiled) == math.inf
        and stepping.paced(compiled, method(0.3)) == 0.3
    )
    effects += [force(0.0), force(-2.0), SimpleNamespace(row=None)]
    assert stepping.shortest_period(compiled) == pytest.approx(math.pi)
    contacts += [support(None), support(like(stepping.Shaken, frequency=3.0))]
    assert stepping.shortest_period(compiled) == pytest.approx(2.0 * math.pi / 3.0)
    turning = like(stepping.Turntable, spin=(0.0, 3.0, -4.0))
    contacts.append(support(turning, False))
    assert stepping.shortest_period(compiled) == pytest.approx(2.0 * math.pi / 3.0)
    contacts.append(support(turning))
    assert stepping.shortest_period(compiled) == pytest.approx(2.0 * math.pi / 5.0)
    assert stepping.paced(compiled, method(0.3)) == pytest.approx(math.pi / 20.0)
    assert stepping.paced(compiled, method(0.1)) == 0.1
    fixed: Any = SimpleNamespace(step=0.1)
    assert stepping.paced(compiled, fixed) is fixed


@pytest.mark.parametrize(
    ("spin", "change", "wobbles"),
    [
        ((0.0, 3.0, -4.0), 3e-9, True),
        ((0.0, 3.0, -4.0), 1.9e-9, False),
        ((0.0, 0.0, 0.0), 1.0, False),
    ],
)
def test_a_support_wobbles_that_does_not_turn_into_itself(
    monkeypatch: pytest.MonkeyPatch, spin: tuple[float, ...], change: float, wobbles: bool
) -> None:
    """Whose gap changes in one turn, of 2 pi/5 s, by more than 1e-9 of 2 m."""
    asked: list[float] = []

    def gap(pair: Any, B: Any, A: float) -> Any:
        assert pair == "pair" and B == "body 1"
        asked.append(A)
        return SimpleNamespace(gap=7.0 - change * (len(asked) == 4))

    monkeypatch.setattr(stepping, "touching", gap)
    monkeypatch.setattr(stepping, "carrier", lambda motion, t, A: (t, None))
    monkeypatch.setattr(stepping, "state_of", lambda y, body: f"body {body}")
    compiled: Any = SimpleNamespace(system=SimpleNamespace(length=2.0), y=None)
    row = SimpleNamespace(carrier=SimpleNamespace(spin=spin), pair="pair")
    found = stepping.wobbles(compiled, SimpleNamespace(row=row, body=1))
    assert found is wobbles
    if any(spin):
        times = 2.0 * math.pi / 5.0 * np.array([0.0, *stepping.PHASES])
        np.testing.assert_allclose(asked, times)
