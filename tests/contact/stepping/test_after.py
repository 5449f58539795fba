"""What is told of a step that is over: paradoxes, and points that ran around their body."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rb_sim.contact.solvers.graph import LINES
from rb_sim.contact.solvers.one_contact import ROUGH
from rb_sim.contact.stepping.after import is_paradox, slips_though_rough
from rb_sim.contact.stepping.geometry import ANCHOR, POINT
from rb_sim.contact.stepping.normal_change import has_turned
from rb_sim.contact.stepping.scene_tables import LAWS, PERFECTLY_ROUGH, STATIC
from rb_sim.contact.stepping.step_workspace import TOO_FAR
from rb_sim.mechanics.systems.many_bodies import WIDTH

COLUMNS = 64
"""Columns of tables of which few are read."""


@pytest.mark.parametrize(("mu", "expected"), [(2.4, False), (2.6, True)])
def test_paradox_where_friction_pulls_together_by_more_than_the_push_parts(
    mu: float, expected: bool
) -> None:
    """Slip s = (0.3, 0.4) on its support: W_nn - mu W_nt . s/|s| = 1 - mu (2 0.6 - 1 0.8)."""
    y = np.zeros(2 * WIDTH)
    y[WIDTH + 7 : WIDTH + 10] = 0.4, 0.6, 5.0
    rows, targets = np.zeros((2 * LINES, COLUMNS)), np.zeros(2 * LINES)
    rows[LINES + 1, 0] = rows[LINES + 2, 1] = 1.0
    bends = np.array([[5.0, 5.0, 5.0], [5.0, 0.7, -0.4]])
    targets[LINES + 1 : LINES + 3] = 0.1 - 0.7, 0.2 + 0.4
    blocks = np.zeros((2, COLUMNS))
    blocks[1, :3] = 1.0, 2.0, -1.0
    assert is_paradox(blocks, rows, targets, bends, y, 1, 1, -1, mu, 0.49) == expected
    assert not is_paradox(blocks, rows, targets, bends, y, 1, 1, -1, mu, 0.51)  # it hardly slips


@pytest.mark.parametrize("part", [0.9, -0.9, 1.1, -1.1])
def test_a_point_runs_around_its_body(part: float) -> None:
    """The body has moved on by half a step meanwhile, by more than its own size."""
    h, arm, v, place = 0.1, 0.2, np.array([30.0, -20.0, 8.0]), np.array([1.0, 2.0, 3.0])
    angle = part * TOO_FAR
    y, memory, spots = np.zeros(2 * WIDTH), np.zeros((3, COLUMNS)), np.zeros((3, COLUMNS))
    y[WIDTH : WIDTH + 3], y[WIDTH + 7 : WIDTH + 10] = place, v
    y[WIDTH + 6] = 1.0
    memory[2, ANCHOR : ANCHOR + 3] = place - 0.5 * h * v + [0.0, 0.0, -arm]
    turned = np.array([math.sin(angle), 0.0, -math.cos(angle)])
    spots[2, POINT : POINT + 3] = place + 0.5 * arm * turned
    assert has_turned(memory, spots, y, 2, 1, h) == (abs(part) > 1.0)


@pytest.mark.parametrize(
    ("push", "static", "expected"),
    [
        (0.95, PERFECTLY_ROUGH, True),
        (1.2, PERFECTLY_ROUGH, False),
        (0.95, 1e9, False),
        (0.0, PERFECTLY_ROUGH, True),
    ],
)
def test_what_is_rough_slips_where_its_friction_is_at_the_bound(
    push: float, static: float, expected: bool
) -> None:
    """Friction (3, 4) N s is at 0.95 of what solvers allow, and at 1.2; Coulomb's law slips."""
    laws, x = np.zeros((2, LAWS)), np.zeros(2 * LINES)
    laws[1, STATIC] = static
    x[LINES : LINES + 3] = push * 5.0 / ROUGH, 3.0, 4.0
    assert slips_though_rough(laws, x, LINES, 1) == expected
    assert not slips_though_rough(laws, np.zeros(2 * LINES), LINES, 1)
