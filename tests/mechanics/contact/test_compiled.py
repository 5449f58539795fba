"""What loops call by address hands on what it is given, and gives back what it has found."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim.mechanics.contact import contact_laws


@pytest.mark.parametrize(("flag", "everywhere"), [(0.0, False), (1.0, True), (2.0, True)])
def test_accelerations_tell_the_rank_and_the_lines_that_hold(
    monkeypatch: pytest.MonkeyPatch, flag: float, everywhere: bool
) -> None:
    """Everywhere where the first number is not 0."""
    asked: list[Any] = []

    def found(*told: Any) -> tuple[int, int]:
        asked.append(told)
        return 3, 5

    monkeypatch.setattr(contact_laws, "accelerations_in", found)
    y, out = np.array([7.0]), np.array([flag, 9.0, 9.0])
    contact_laws.accelerate.function(1.5, y, "system", out)
    assert asked == [("system", 1.5, y, everywhere)]
    assert out.tolist() == [3.0, 5.0, 9.0]


@pytest.mark.parametrize(
    ("name", "calls", "gives"),
    [
        ("free", "unconstrained_here", False),
        ("bring_back", "bring_to_manifold", False),
        ("rate_of_change", "contact_rate", True),
    ],
)
def test_the_others_ask_their_system(
    monkeypatch: pytest.MonkeyPatch, name: str, calls: str, gives: bool
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(contact_laws, calls, lambda *told: asked.append(told))
    y, out = np.array([7.0]), np.array([9.0])
    getattr(contact_laws, name).function(1.5, y, "system", out)
    assert asked == [("system", 1.5, y, out) if gives else ("system", 1.5, y)]
