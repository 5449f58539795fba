"""Supports that move as prescribed: their rates are the derivatives of where they are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from tests.interpreted import interpreted

POINT, SPIN = (1.0, -2.0, 3.0), (0.4, 0.9, -1.2)
MOTIONS = ("turntable", "a turntable that stands", "shaken")
H = 1e-5


def at(kind: str, t: float) -> Any:
    """(state, acceleration, angular acceleration, driven) of a support."""
    from rb_sim.catalogue.geometry import carriers as c
    from rb_sim.catalogue.types import BodyState

    motion = {
        "turntable": c.Turntable(POINT, SPIN),
        "a turntable that stands": c.Turntable(POINT, (0.0, 0.0, 0.0)),
        "shaken": c.Shaken((0.2, -0.1, 0.05), 7.0, 0.6),
        "resting": c.Resting(),
    }[kind]
    rest = BodyState((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0))
    return c.carrier(motion, t, rest)


@pytest.mark.parametrize("kind", MOTIONS)
def test_rates_are_derivatives(kind: str) -> None:
    ahead, here, behind = (interpreted(at, kind, 0.7 + s * H) for s in (1.0, 0.0, -1.0))
    state, acceleration, turning, driven = here

    def rate(of: Any) -> Any:
        return (np.array(of(ahead)) - np.array(of(behind))) / (2.0 * H)

    assert_allclose(state.v_WC, rate(lambda s: s[0].p_WC), atol=1e-8)
    assert_allclose(acceleration, rate(lambda s: s[0].v_WC), atol=1e-8)
    turned = Rotation.from_quat(ahead[0].q_WB) * Rotation.from_quat(behind[0].q_WB).inv()
    spin = Rotation.from_quat(state.q_WB).apply(state.w_WB_B)
    assert_allclose(spin, turned.as_rotvec() / (2.0 * H), atol=1e-8)
    assert_allclose(turning, rate(lambda s: s[0].w_WB_B), atol=1e-8)
    assert driven == 1.0


@pytest.mark.parametrize("t", [0.0, 0.7, 40.0])
def test_a_turntable_turns_about_its_point(t: float) -> None:
    state = interpreted(at, "turntable", t)[0]
    turn = Rotation.from_rotvec(t * np.array(SPIN))
    for fixed in (0.0, 1.5):  # points of its axis
        point = np.array(POINT) + fixed * np.array(SPIN)
        there = np.array(state.p_WC) + Rotation.from_quat(state.q_WB).apply(point)
        assert_allclose(there, point, atol=1e-12)
    assert_allclose((Rotation.from_quat(state.q_WB) * turn.inv()).magnitude(), 0.0, atol=1e-12)


def test_what_is_shaken_is_where_it_is_told_to_be() -> None:
    state = interpreted(at, "shaken", 0.7)[0]
    assert state.q_WB == (0.0, 0.0, 0.0, 1.0)
    assert state.w_WB_B == (0.0, 0.0, 0.0)
    assert_allclose(state.p_WC, np.sin(7.0 * 0.7 + 0.6) * np.array([0.2, -0.1, 0.05]), atol=1e-15)


def test_what_rests_is_the_parent() -> None:
    state, acceleration, turning, driven = interpreted(at, "resting", 0.7)
    assert state.p_WC == (1.0, 2.0, 3.0)
    assert state.v_WC == (4.0, 5.0, 6.0)
    assert acceleration == turning == (0.0, 0.0, 0.0)
    assert driven == 0.0
