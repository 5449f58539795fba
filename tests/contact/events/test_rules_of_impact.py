"""Which rule of impact follows where one has no impulses, or gains energy: the rules stood for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rb_sim.contact.problem import impacts
from rb_sim.contact.problem.forces import NOT_FINITE, SOLVED, UNSOLVED
from rb_sim.mechanics.contact.contact_table import GAP_RATE, RESTITUTION, TOUCH_WIDTH

GAINS, NONE_, FINE, LOST = "gains", "none", "fine", "lost"
"""What a rule comes to: impulses that gain energy, none, some that do not, no numbers."""
NEWTON, POISSON, PLASTIC, TOGETHER, STOP = "newton", "poisson", "plastic", "together", "stop"


def rules_asked(
    monkeypatch: pytest.MonkeyPatch, comes_to: dict[str, str], together: bool = False,
    approach: float = -1.0,
) -> tuple[list[str], int, list[list[float]]]:  # fmt: skip
    """The rules asked in turn, the status, and e of each contact as they had it."""
    asked: list[str] = []
    rebounds: list[list[float]] = []

    def answer(name: str) -> int:
        asked.append(name)
        return {NONE_: UNSOLVED, LOST: NOT_FINITE}.get(comes_to[name], SOLVED)

    def newton(system: Any, workspace: Any, before: Any, rebound: Any, x: Any) -> int:
        rebounds.append(rebound.tolist())
        return answer(NEWTON if rebound.any() else PLASTIC)

    def poisson(system: Any, workspace: Any, before: Any, rebound: Any, x: Any) -> int:
        rebounds.append(rebound.tolist())
        return answer(POISSON)

    def other(system: Any, workspace: Any, before: Any, rule: Any, x: Any) -> int:
        assert not rule.rebound.any() and not rule.least.any()
        assert rule.together is not rule.stop
        return answer(TOGETHER if rule.together else STOP)

    monkeypatch.setattr(impacts, "newton_impulses", newton)
    monkeypatch.setattr(impacts, "poisson_impulses", poisson)
    monkeypatch.setattr(impacts, "impulses_with", other)
    monkeypatch.setattr(impacts, "gains_energy", lambda *of: comes_to[asked[-1]] == GAINS)
    touch = np.zeros((4, TOUCH_WIDTH))
    touch[:, RESTITUTION], touch[1, GAP_RATE] = (0.4, 0.5, 0.6, 0.7), approach
    workspace = SimpleNamespace(
        taking_part=np.array([1, 1, 1, 0]), plastic=np.array([1, 0, 0, 0]),
        together=np.array([0, 0, int(together), 0]), undetermined=np.ones(7),
    )  # fmt: skip
    first = np.array([0, 0, 3, 6, 9, 12])
    system = SimpleNamespace(touch=touch, first_row=first, joints=1, speed=1.0)
    v = np.zeros(12)
    v[[0, 3, 6, 9]] = -1.0, -1.0, 1.0, -1.0
    before = SimpleNamespace(v=v, u=np.zeros(6))
    status = impacts.impulses_of_strike(system, workspace, before, 1, np.zeros(12))
    assert workspace.undetermined[0] == 0.0
    return asked, status, rebounds


@pytest.mark.parametrize(
    ("comes_to", "asked", "status"),
    [
        ({NEWTON: FINE}, [NEWTON], SOLVED),
        ({NEWTON: LOST}, [NEWTON], NOT_FINITE),
        ({NEWTON: NONE_, POISSON: FINE}, [NEWTON, POISSON], SOLVED),
        ({NEWTON: GAINS, POISSON: FINE}, [NEWTON, POISSON], SOLVED),
        ({NEWTON: GAINS, POISSON: LOST}, [NEWTON, POISSON], NOT_FINITE),
        ({NEWTON: GAINS, POISSON: GAINS, PLASTIC: FINE}, [NEWTON, POISSON, PLASTIC], SOLVED),
        ({NEWTON: NONE_, POISSON: NONE_, PLASTIC: NONE_}, [NEWTON, POISSON, PLASTIC], UNSOLVED),
        ({NEWTON: NONE_, POISSON: NONE_, PLASTIC: GAINS}, [NEWTON, POISSON, PLASTIC], SOLVED),
    ],
)
def test_newtons_rule_then_poissons_then_none_rebounds(
    monkeypatch: pytest.MonkeyPatch, comes_to: dict[str, str], asked: list[str], status: int
) -> None:
    """With e of what takes part, approaches and is not to stay."""
    found, end, rebounds = rules_asked(monkeypatch, comes_to)
    assert (found, end) == (asked, status)
    assert rebounds[:2] == [[0.0, 0.5, 0.0, 0.0]] * min(2, len(rebounds))


@pytest.mark.parametrize(
    ("together", "approach", "comes_to", "asked"),
    [
        (True, -1.0, {TOGETHER: FINE}, [TOGETHER]),
        (True, -1.0, {TOGETHER: NONE_, NEWTON: FINE}, [TOGETHER, NEWTON]),
        (True, 0.0, {TOGETHER: NONE_, STOP: FINE}, [TOGETHER, STOP]),
        (False, 0.0, {STOP: FINE}, [STOP]),
        (False, -0.9e-10, {STOP: NONE_, NEWTON: FINE}, [STOP, NEWTON]),
        (False, -1.1e-10, {NEWTON: FINE}, [NEWTON]),
    ],
)
def test_what_stays_together_or_only_stops_slipping_comes_first(
    monkeypatch: pytest.MonkeyPatch, together: bool, approach: float, comes_to: Any, asked: Any
) -> None:
    """Where contacts are not to part; where nothing approaches faster than what is still."""
    assert rules_asked(monkeypatch, comes_to, together, approach)[0] == asked
