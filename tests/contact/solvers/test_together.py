"""Sweeps and Newton's method in turns: who is asked when, and what is handed over; stood for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.solvers import least_shares, proximal_newton
from rb_sim.contact.solvers.graph import LINES

SPELL = proximal_newton.SPELL


def solved(
    monkeypatch: pytest.MonkeyPatch, rests: list[float], sweeps: int, plain: bool = True
) -> tuple[Any, list[Any]]:
    """What comes of it, and what was asked for in turn."""
    asked: list[Any] = []
    left = iter(rests)

    def sweep(graph: Any, u: Any, x: Any, joints: Any, size: float, till: float, spell: int) -> Any:
        assert (graph, u, x, joints, size, till) == ("graph", "u", "x", "joints", 3.0, 0.5)
        asked.append(spell)
        return next(left), spell

    def newton(graph: Any, bodies: Any, u: Any, x: Any, till: float) -> None:
        assert (graph, bodies, u, x) == ("graph", "bodies", "u", "x")
        asked.append(f"newton {till}")

    monkeypatch.setattr(proximal_newton, "gauss_seidel", sweep)
    monkeypatch.setattr(proximal_newton, "is_plain", lambda graph: plain)
    monkeypatch.setattr(proximal_newton, "proximal_newton", newton)
    found = proximal_newton.solve_exactly("graph", "bodies", "u", "x", "joints", 3.0, 0.5, sweeps)
    return found, asked


def test_spells_of_sweeps_grow_and_newtons_method_goes_between(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each twice as long as the one before, until what is left has settled."""
    found, asked = solved(monkeypatch, [0.9, 0.8, 0.4], 100 * SPELL)
    assert asked == [SPELL, "newton 0.0", 2 * SPELL, "newton 0.0", 4 * SPELL]
    assert found == (0.4, 7 * SPELL)
    found, asked = solved(monkeypatch, [0.9, 0.8, 0.7], 3 * SPELL + 1)
    assert asked == [SPELL, "newton 0.0", 2 * SPELL, "newton 0.0", 1]
    assert found == (0.7, 3 * SPELL + 1)
    assert solved(monkeypatch, [0.3], 100)[1] == [min(SPELL, 100)]


def test_sweeps_go_alone_where_newtons_method_does_not_serve(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert solved(monkeypatch, [0.9, 0.4], 100 * SPELL, False)[1] == [SPELL, 2 * SPELL]


def test_impulses_are_taken_over_with_their_velocities(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the chosen contacts the first three lines; what they change is pushed."""
    pushed: list[Any] = []
    monkeypatch.setattr(
        least_shares, "push", lambda rows, k, u, b, a, x: pushed.append((k, b, a, x))
    )
    graph = SimpleNamespace(ends=np.array([[0, -1], [1, 0], [2, 1]]), rows="rows")
    x = np.arange(3.0 * LINES)
    least_shares.take_over(
        graph, "u", x, np.array([2, 0]), np.array([9.0, 8.0, 7.0, 6.0, 5.0, 4.0])
    )
    k = 2 * LINES
    assert pushed == [
        (k, 2, 1, 9.0 - k), (k + 1, 2, 1, 8.0 - k - 1), (k + 2, 2, 1, 7.0 - k - 2),
        (0, 0, -1, 6.0), (1, 0, -1, 4.0), (2, 0, -1, 2.0),
    ]  # fmt: skip
    assert x[k : k + 3].tolist() == [9.0, 8.0, 7.0] and x[:3].tolist() == [6.0, 5.0, 4.0]
    assert (x[3:k] == np.arange(3.0, k)).all() and (x[k + 3 :] == np.arange(k + 3.0, len(x))).all()
