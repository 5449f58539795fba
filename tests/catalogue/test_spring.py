"""Springs and dampers between two moving bodies by their formulas, in numpy and scipy."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.effects import spring as springs
from rb_sim.catalogue.types import WORLD, BodyState, potential, wrench
from tests.moving import random_state

R_B, R_A = (0.3, -0.2, 0.5), (-0.4, 0.1, 0.6)
K, C, LENGTH = 30.0, 4.0, 0.7


class Ends(NamedTuple):
    """The ends of a spring in world axes."""

    away: np.ndarray
    """from the parent's point to the body's."""
    rate: np.ndarray
    """of both points."""
    past: np.ndarray
    """velocity of the body's point past the parent's material point that is there."""
    turn: Rotation
    """of the body."""


def ends(B: Any, A: Any) -> Ends:
    turn, other = Rotation.from_quat(B.q_WB), Rotation.from_quat(A.q_WB)
    p_B, p_A = B.p_WC + turn.apply(R_B), A.p_WC + other.apply(R_A)
    v_B = B.v_WC + np.cross(turn.apply(B.w_WB_B), turn.apply(R_B))
    spin = other.apply(A.w_WB_B)
    v_A = A.v_WC + np.cross(spin, other.apply(R_A))
    past = v_B - (A.v_WC + np.cross(spin, p_B - A.p_WC))
    return Ends(p_B - p_A, v_B - v_A, past, turn)


def force_of(row: Any, e: Ends) -> np.ndarray:
    """On the body, world axes."""
    length = np.linalg.norm(e.away)
    u = e.away / length
    if isinstance(row, springs.SpringRow):
        return -K * (length - LENGTH) * u
    if isinstance(row, springs.DamperRow):
        return -C * (u @ e.rate) * u
    return -K * e.away if isinstance(row, springs.BushingRow) else -C * e.past


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    "row",
    [
        springs.SpringRow(R_B, R_A, K, LENGTH),
        springs.DamperRow(R_B, R_A, C),
        springs.BushingRow(R_B, R_A, K),
        springs.BushingDamperRow(R_B, R_A, C),
    ],
)
def test_wrench_about_the_centre_of_mass(row: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    B, A = random_state(rng), random_state(rng)
    e = ends(B, A)
    expected = force_of(row, e)
    force, torque = wrench(row, 0.0, None, B, A)
    assert_allclose(force, expected, rtol=1e-12, atol=1e-13)
    assert_allclose(torque, np.cross(R_B, e.turn.inv().apply(expected)), rtol=1e-12, atol=1e-13)
    if isinstance(row, springs.SpringRow):
        stored = 0.5 * K * (np.linalg.norm(e.away) - LENGTH) ** 2
        assert_allclose(potential(row, 0.0, None, B, A), stored, rtol=1e-12)
    elif isinstance(row, springs.BushingRow):
        assert_allclose(potential(row, 0.0, None, B, A), 0.5 * K * e.away @ e.away, rtol=1e-12)


class AtOrigins:
    """A Place in which every body's centre of mass is its origin."""

    def from_com(self, body: str | None, point: Any) -> Any:
        return point

    def state(self, body: str | None) -> BodyState:
        """The body apart from its parent, both at rest."""
        return WORLD._replace(p_WC=(0.0, 3.0, 0.0)) if body == "b" else WORLD


@pytest.mark.parametrize("rest", [0.0, LENGTH])
def test_rows_are_those_that_the_numbers_ask_for(rest: float) -> None:
    """Spring and damper apart; without a rest length those of a bushing."""
    kinds = (
        (springs.SpringRow, springs.DamperRow)
        if rest
        else (springs.BushingRow, springs.BushingDamperRow)
    )
    for k, c in ((K, C), (K, 0.0), (0.0, C), (0.0, 0.0)):
        given = {"stiffness": k, "damping": c, "rest_length": rest, "point_B": R_B, "point_A": R_A}
        rows = springs.Spring(type="spring", body="b", parent="a", **given).rows(AtOrigins())  # type: ignore[arg-type]
        asked = [kind for kind, number in zip(kinds, (k, c), strict=True) if number]
        assert [type(row) for row, *_ in rows] == asked
        assert all(names == ["b", "a"] and row[:2] == (R_B, R_A) for row, *names in rows)
