# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Geometry, active rows, force directions and friction of one contact at an instant.

They depend on the states of both bodies, the modes, and the directions at the start of the step
alone. The function is traced once for each kind of contact (`contact_laws`), and also runs in plain
Python.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rb_sim.catalogue.friction import NoResistance, resisting, traction
from rb_sim.catalogue.geometry.corners_and_rims import (
    Lean,
    PointOnSolid,
    RimOnCylinder,
    RimOnPlane,
    point_on_solid_touching,
    rim_on_cylinder_touching,
    rim_touching,
)
from rb_sim.catalogue.geometry.pairs import ContactPoint, carrier, touching
from rb_sim.catalogue.spec import BodyState, Vec3
from rb_sim.numerics.vectors import (
    ZERO,
    add,
    cross,
    dot,
    neg,
    norm,
    perpendicular,
    rotate,
    scale,
    sub,
    unrotate,
    where,
)

NONE, SLIDING, STUCK = 0.0, 1.0, 2.0
"""Modes of each kind of friction."""


class Kept(NamedTuple):
    """State of a contact that is constant within a step: modes, and directions at its start."""

    lean: Lean
    slide: float
    roll: float
    spin: float
    """NONE, SLIDING or STUCK."""
    side: float
    """sign of N, if it may be negative."""
    ahead: Vec3
    """direction of slip."""
    roll_direction: Vec3
    """direction of rolling."""
    spin_sign: float
    """sign of spinning."""
    velocity_tolerance: float
    """slip below which its direction is not followed [m/s]."""
    turn_tolerance: float
    """relative spin below which its direction is not followed [rad/s]."""


class Geometry(NamedTuple):
    """Geometry and relative motion of the surfaces, world axes."""

    gap: float
    gap_rate: float
    normal: Vec3
    point: Vec3
    slip: Vec3
    turn: Vec3
    spring: float
    """force of a compliant support, also if it would pull; 0 for a rigid one [N]."""
    fastest: float
    """upper bound of the speed of all points of body and support [m/s]."""
    lean: Lean
    """of a rim on a plane; unchanged for other pairs."""
    around: float
    """angle from the lowest point of a rim [rad]."""


class Forces(NamedTuple):
    """Forces and rows of a closed contact."""

    direct: Vec3
    direct_torque: Vec3
    """independent of N, world axes [N, N m]."""
    force: float
    """N of a compliant support."""
    rows: tuple
    """16 numbers of each row (see catalogue/constraints/rows), zero if it is not active."""
    force_rows: tuple
    """12 numbers of each row."""


class _Moving(NamedTuple):
    """States and accelerations of body and support."""

    B: BodyState
    A: BodyState
    a_A: Vec3
    alpha_A: Vec3
    driven: float
    at: ContactPoint
    r: Vec3
    sigma: Vec3
    moved: Vec3


def velocity_at(B, r):
    """Velocity of the point of a body at the arm r from C, world axes [m/s]."""
    return add(B.v_WC, cross(rotate(B.q_WB, B.w_WB_B), r))


def torque_of(B, r, force, moment):
    """Torque about C, body axes, of a force at the arm r and a moment, world axes [N m]."""
    return unrotate(B.q_WB, add(moment, cross(r, force)))


def contact_point_of(
    pair: Any, B: BodyState, A: BodyState, before: Lean
) -> tuple[ContactPoint, Lean, Any]:
    """(Touch, Lean, angle from the lowest point of a rim) of a contact."""
    if isinstance(pair, RimOnPlane):
        at, lean = rim_touching(pair, B, A, before)
        return at, lean, 1.0 - pair.along
    if isinstance(pair, RimOnCylinder):
        at, lean = rim_on_cylinder_touching(pair, B, A, before)
        return at, lean, pair.second
    if isinstance(pair, PointOnSolid):
        at, lean = point_on_solid_touching(pair, B, A, before)
        return at, lean, 0.0
    return touching(pair, B, A), before, 0.0


def geometry(row: Any, t: Any, B: BodyState, A: BodyState, before: Lean) -> tuple[Any, Any]:
    """(Geometry, input of `forces`) of a contact with states B of the body, A of the parent."""
    A, a_A, alpha_A, driven = carrier(row.carrier, t, A)
    at, lean, around = contact_point_of(row.pair, B, A, before)
    r, sigma = sub(at.point, B.p_WC), sub(at.point, A.p_WC)
    moved = velocity_at(A, sigma)
    speed = sub(velocity_at(B, r), moved)
    gap_rate = dot(at.normal, speed)
    slip = sub(speed, scale(gap_rate, at.normal))
    spring = -row.spring[0] * at.gap - row.spring[1] * gap_rate if row.spring else 0.0
    fastest = norm(sub(B.v_WC, A.v_WC)) + norm(B.w_WB_B) * norm(r) + norm(A.w_WB_B) * norm(sigma)
    turn = sub(rotate(B.q_WB, B.w_WB_B), rotate(A.q_WB, A.w_WB_B))
    found = Geometry(
        at.gap, gap_rate, at.normal, at.point, slip, turn, spring, fastest, lean, around
    )
    return found, _Moving(B, A, a_A, alpha_A, driven, at, r, sigma, moved)


def constraint_row(
    holds: Any, m: _Moving, force: Vec3, moment: Vec3, bias: Any, error: Any, rate: Any,
    holonomic: float,
) -> tuple:  # fmt: skip
    """16 numbers of a row; zero if it is not active."""
    numbers = (*wrench_columns(m, force, moment), bias, error, rate, holonomic)
    return where(holds, numbers, (0.0,) * len(numbers))


def wrench_columns(m: _Moving, force: Vec3, moment: Vec3) -> tuple:
    """12 numbers: forces and torques on B, and reactions on A, of a force at P and a moment, world
    axes."""
    torque_B, torque_A = torque_of(m.B, m.r, force, moment), torque_of(m.A, m.sigma, force, moment)
    return (*force, *torque_B, *neg(force), *neg(torque_A))


def forces(row: Any, g: Geometry, m: _Moving, kept: Kept) -> Forces:
    """Rows and force directions of a closed contact, and its forces independent of N."""
    B, A, n, sigma = m.B, m.A, m.at.normal, m.sigma
    spin_B, spin_A = rotate(B.q_WB, B.w_WB_B), rotate(A.q_WB, A.w_WB_B)
    r_dot, sigma_dot = sub(m.at.point_rate, B.v_WC), sub(m.at.point_rate, A.v_WC)
    drift = sub(
        cross(spin_B, r_dot), add(cross(spin_A, sigma_dot), add(m.a_A, cross(m.alpha_A, sigma)))
    )
    t1, t2 = perpendicular(n)
    rigid = not row.spring
    rows = []
    for i, d in enumerate((n, t1, t2)):
        holds, first = (rigid, 1.0) if i == 0 else (kept.slide > 0.5 * (SLIDING + STUCK), 0.0)
        # a compliant contact may have normal velocity while it sticks, and its tangents rotate
        turning = (
            dot(m.at.normal_rate, g.slip) if i == 0 else -g.gap_rate * dot(d, m.at.normal_rate)
        )
        bias = dot(d, drift) + turning
        rate = m.driven * dot(d, m.moved)
        rows.append(constraint_row(holds, m, d, ZERO, bias, first * g.gap, rate, first))
    if not isinstance(row.resistance, NoResistance):
        rows += turn_rows(m, (t1, t2, n), spin_A, g.turn, kept)
    sliding = (kept.slide > 0.5 * SLIDING) & (kept.slide < 0.5 * (SLIDING + STUCK))
    per_normal, direct = traction(
        row.friction, g.slip, kept.ahead, kept.velocity_tolerance, not rigid
    )
    per_normal, direct = where(sliding, per_normal, ZERO), where(sliding, direct, ZERO)
    modes = (kept.roll, kept.spin)
    torque = resisting(
        row.resistance, g.turn, n, modes, kept.roll_direction, kept.spin_sign, kept.turn_tolerance
    )
    per_normal, torque = scale(kept.side, per_normal), scale(kept.side, torque)
    force_rows = [values[:12] for values in rows]
    if rigid:
        rubbing = wrench_columns(m, per_normal, torque)
        force_rows[0] = tuple(a + b for a, b in zip(force_rows[0], rubbing, strict=True))
        torque = ZERO
    else:
        direct = add(direct, scale(g.spring, add(n, per_normal)))
        torque = scale(g.spring, torque)
    return Forces(direct, torque, g.spring, tuple(rows), tuple(force_rows))


def turn_rows(m: _Moving, axes: tuple, spin_A: Vec3, turn: Vec3, kept: Kept) -> list[tuple]:
    """Rolling and spinning rows of a contact."""
    n, n_dot, about = axes[2], m.at.normal_rate, dot(turn, axes[2])
    found = []
    for i, d in enumerate(axes):
        stuck = (kept.roll if i < 2 else kept.spin) > 0.5 * (SLIDING + STUCK)
        drift = dot(n_dot, turn) if d is n else -dot(d, n_dot) * about
        bias, rate = drift - dot(d, m.alpha_A), m.driven * dot(d, spin_A)
        found.append(constraint_row(stuck, m, ZERO, d, bias, 0.0, rate, 0.0))
    return found
