# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The lines of a contact: G u is the motion that they forbid, G du/dt + bias its rate."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import load_scene
from rb_sim.catalogue.constraints.rows import BIAS, ERROR, RATE
from rb_sim.mechanics.contact.constraint_tables import write_contacts
from rb_sim.mechanics.contact.contact_bodies import (
    CLOSED,
    GAP,
    GAP_RATE,
    NORMAL,
    POINT,
    RELATIVE_SPIN,
    ROLL,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    SPIN,
)
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.systems.many_bodies import WIDTH
from rb_sim.scene.compile import compile_scene
from tests.catalogue.geometry.test_pairs import FEW, SEEDS
from tests.moving import difference, flown, random_state

BODIES = {
    "ball": {"type": "sphere", "radius": 0.3},
    "ellipsoid": {"type": "ellipsoid", "semi_axes": [0.3, 0.2, 0.4], "center_B": [0.1, 0.0, 0.05]},
    "disk": {"type": "disk", "radius": 0.3, "axis_B": [0.0, 0.6, 0.8]},
}
PLANE = {"type": "plane", "point": [0.1, -0.2, 0.3], "normal": [0.48, -0.6, 0.64]}
SUPPORTS: dict[str, dict[str, Any]] = {
    "world": {},
    "body": {"parent": "a"},
    "turntable": {
        "motion": {"type": "turntable", "rate": 1.3, "axis": [0.6, 0.0, 0.8], "point": [1, 2, 3]}
    },
    "shaken": {
        "motion": {"type": "shaken", "direction": [0, 0.6, 0.8], "amplitude": 0.3, "frequency": 0.4}
    },
}
SURFACES = {
    "plane": PLANE,
    "sphere": {"type": "sphere", "radius": 0.5, "center": [0.1, 0.2, 0.3]},
    "bowl": {"type": "sphere", "radius": 5.0, "center": [0.1, 0.2, 0.3], "side": "inside"},
    "pipe": {"type": "cylinder", "radius": 5.0, "axis": [0.6, 0.0, 0.8]},
}


def system_of(shape: str, support: str, surface: str, **more: Any) -> Any:
    """A compiled scene of one contact that has all six lines; more: of its keys."""
    solid = {"mass": 1.3, "inertia": [0.02, 0.03, 0.04], "center_of_mass": [0.01, 0.02, 0.03]}
    away = {"position": [0.1, 0.2, 1.0]}  # from the middle of the supports
    contact = {
        "type": "contact",
        "body": "b",
        "surface": SURFACES[surface],
        "friction": {"type": "coulomb", "static": 0.4},
        "rolling_resistance": 0.01,
        "spinning_resistance": 0.02,
    }
    mapping = {
        "bodies": {"b": solid | away | {"shape": BODIES[shape]}, "a": solid},
        "constraints": {"c": contact | SUPPORTS[support] | more},
        "effects": {},
        "simulation": {"duration": 1.0, "tolerance": 1e-8, "project_initial": True},
    }
    return compile_scene(load_scene(mapping)).system


def coordinates(*states: Any) -> np.ndarray:
    return np.concatenate([*(np.concatenate(state) for state in states), [0.0]])


def lines(system: Any, t: float, *states: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(G u - rate, bias, G) of all lines held."""
    system.touch[:, CLOSED] = 1.0
    system.touch[:, [SLIDE, ROLL, SPIN]] = STUCK
    y = coordinates(*states)
    write_contacts(system.contacts, t, system, y, 0, True)
    u = np.concatenate([y[7:13], y[WIDTH + 7 : WIDTH + 13]])
    G = system.rows[:, :12].copy()
    if system.row_table[0, 1] < 0:
        G[:, 6:] = 0.0
    return G @ u - system.rows[:, RATE], system.rows[:, BIAS].copy(), G


def with_velocities(states: Any, u: np.ndarray) -> list[Any]:
    parts = np.split(u, 4)
    return [
        S._replace(v_WC=tuple(v.tolist()), w_WB_B=tuple(w.tolist()))
        for S, v, w in zip(states, parts[::2], parts[1::2], strict=True)
    ]


def example(system: Any, seed: int, held: list[int]) -> tuple[float, list[Any]]:
    """A random instant and states whose velocities satisfy the lines `held`."""
    rng = np.random.default_rng(seed)
    states = [random_state(rng), random_state(rng)]
    far = tuple((np.array(states[1].p_WC) + [2.0, 1.5, -1.0]).tolist())
    states[0], t = states[0]._replace(p_WC=far), float(rng.uniform(0.0, 3.0))
    excess, _, Gu = lines(system, t, *states)
    u = np.concatenate([x for S in states for x in (S.v_WC, S.w_WB_B)])
    u = u - np.linalg.lstsq(Gu[held], excess[held], rcond=None)[0]
    return t, with_velocities(states, u)


@pytest.mark.parametrize("support", SUPPORTS)
@pytest.mark.parametrize(("shape", "surface"), [(s, "plane") for s in BODIES])
@FEW
@given(SEEDS)
def test_bias_is_the_rate_at_constant_velocities(
    shape: str, surface: str, support: str, seed: int
) -> None:
    check_bias(shape, surface, support, seed)


@pytest.mark.parametrize("support", SUPPORTS)
@pytest.mark.parametrize("surface", ["sphere", "bowl", "pipe"])
@FEW
@given(SEEDS)
def test_bias_on_round_supports(surface: str, support: str, seed: int) -> None:
    check_bias("ball", surface, support, seed)


@pytest.mark.parametrize("support", ["world", "body"])
@pytest.mark.parametrize("surface", SURFACES)
@FEW
@given(SEEDS)
def test_bias_of_what_sticks_where_the_support_gives_way(
    surface: str, support: str, seed: int
) -> None:
    """Its surface comes nearer while it sticks, and the tangents turn with the normal."""
    system = system_of("ball", support, surface, compliance={"stiffness": 1.0})
    check_bias_of(system, [[1, 2], [1, 2, 3, 4, 5]], seed)


def check_bias(shape: str, surface: str, support: str, seed: int) -> None:
    """Closed: any velocities; stuck, rolling, spinning: those that the lines allow."""
    sticks, system = [0, 1, 2], system_of(shape, support, surface)
    check_bias_of(system, [[], sticks, [*sticks, 3, 4], [*sticks, 5], [*sticks, 3, 4, 5]], seed)


def check_bias_of(system: Any, sets: list[list[int]], seed: int) -> None:
    """Of each set of lines, at velocities that it allows."""
    for held in sets:
        checked = held or [0]
        t, states = example(system, seed, held)
        excess, bias, _ = lines(system, t, *states)
        assert np.abs(excess[held]).max(initial=0.0) <= 1e-12

        def later(s: float, t: float = t, states: Any = states) -> np.ndarray:
            return lines(system, t + s, *(flown(S, s) for S in states))[0]

        rate = difference(later)
        size = 1.0 + sum(np.linalg.norm(S.v_WC) + np.linalg.norm(S.w_WB_B) for S in states) ** 2
        assert_allclose(bias[checked], rate[checked], atol=2e-8 * size)


@pytest.mark.parametrize("support", SUPPORTS)
@pytest.mark.parametrize("shape", BODIES)
@FEW
@given(SEEDS)
def test_lines_are_gap_slip_and_turning(shape: str, support: str, seed: int) -> None:
    """Normal line: d(gap)/dt; tangents: slip; the others: relative turning."""
    system = system_of(shape, support, "plane")
    t, states = example(system, seed, [])
    excess, _, G = lines(system, t, *states)
    touch = system.touch[0]
    assert_allclose(system.rows[0, ERROR], touch[GAP])
    assert_allclose(touch[GAP_RATE], excess[0], atol=1e-12)

    def gap(s: float) -> float:
        lines(system, t + s, *(flown(S, s) for S in states))
        return float(system.touch[0, GAP])

    assert_allclose(difference(gap), excess[0], atol=1e-7)
    lines(system, t, *states)
    t1, t2, n = G[1, :3], G[2, :3], touch[NORMAL : NORMAL + 3]
    slip, turn = touch[SLIP : SLIP + 3], touch[RELATIVE_SPIN : RELATIVE_SPIN + 3]
    assert abs(slip @ n) <= 1e-12
    assert_allclose([t1 @ slip, t2 @ slip], excess[1:3], atol=1e-12)
    assert_allclose([t1 @ turn, t2 @ turn, n @ turn], excess[3:], atol=1e-12)
    assert_allclose([t1 @ t2, t1 @ n, t2 @ n], 0.0, atol=1e-14)


@pytest.mark.parametrize("support", ["world", "body"])
@FEW
@given(SEEDS)
def test_sliding_pushes_along_the_traction(support: str, seed: int) -> None:
    """W = n + T/N with its torque about C of either body, and G keeps to the normal."""
    system = system_of("ellipsoid", support, "plane")
    t, states = example(system, seed, [])
    lines(system, t, *states)
    system.touch[0, [SLIDE, ROLL, SPIN]] = SLIDING, 0.0, 0.0
    slip = system.touch[0, SLIP : SLIP + 3].copy()
    system.touch[0, SLIP_DIRECTION : SLIP_DIRECTION + 3] = slip / np.linalg.norm(slip)
    write_contacts(system.contacts, t, system, coordinates(*states), 0, True)
    n, p = system.touch[0, NORMAL : NORMAL + 3], system.touch[0, POINT : POINT + 3]
    push = n - 0.4 * slip / np.linalg.norm(slip)
    W = system.pushes[0]
    assert_allclose(W[:3], push, atol=1e-14)
    for S, columns, sign in zip(states, (W[:6], W[6:]), (1.0, -1.0), strict=True):
        if sign < 0.0 and support == "world":
            continue
        arm = p - np.array(S.p_WC)
        torque = Rotation.from_quat(S.q_WB).inv().apply(np.cross(arm, sign * push))
        assert_allclose(columns, np.concatenate([sign * push, torque]), atol=1e-13)
    assert_allclose(system.rows[0, :3], n, atol=1e-15)
    assert (system.rows[1:, :12] == 0.0).all()
