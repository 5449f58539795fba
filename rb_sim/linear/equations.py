"""The equations of motion of N bodies, on numbers or on symbols, and their exact derivatives.

M du/dt = f + G^T lambda and G du/dt = -bias (LL 38.2).  With accelerations and multipliers held at
their values every equation below is explicit, so that its derivatives by the state need no
elimination: those of accelerations and multipliers follow from one solve with the matrix of the
instant (implicit function theorem).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy import linalg

from rb_sim.catalogue.constraints.rows import BIAS, ERROR, RATE
from rb_sim.graph.derivative import jacobian
from rb_sim.graph.machine import PlainLaw
from rb_sim.graph.symbols import Graph
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import (
    BODY,
    INERTIA,
    LOAD,
    PARENT,
    MultiBody,
    anchor_all,
    apply_effects,
    fill_all,
    six,
    state_of,
    vec,
)
from rb_sim.numerics.vectors import add, cross, gyroscopic, rotate, sub


class HeldMotion(NamedTuple):
    """What is kept at its value while the equations are differentiated."""

    acceleration: Sequence[float]
    """(a_C world, dw/dt body) of each body, 6 N numbers."""
    multipliers: Sequence[float]
    direction: Sequence[float]
    """6 N numbers c; G c is among the equations."""


class Equations(NamedTuple):
    """Lists of numbers or symbols."""

    push: list[Any]
    """f + G^T lambda, 6 N."""
    bias: list[Any]
    """bias + G du/dt of each line."""
    error: list[Any]
    """g of each line; 0 where it is not holonomic."""
    slip: list[Any]
    """G u - b of each line."""
    along: list[Any]
    """G c of each line."""
    reactions: list[Any]
    """force, torque about the anchor of each reaction, world axes, 6 K."""


def line_times(system: MultiBody, k: int, u: Sequence[Any]) -> Any:
    """G u of line k, for u of all bodies (6 N)."""
    total: Any = 0.0
    for column, body in ((0, system.lines[k, BODY]), (6, system.lines[k, PARENT])):
        if body >= 0:
            for i in range(6):
                total = total + system.rows[k, column + i] * u[6 * body + i]
    return total


def on(system: MultiBody, t: float, y: Any) -> MultiBody:
    """The system with loads, lines and anchors at (t, y) in tables that hold numbers or symbols."""
    here = system._replace(
        bodies=system.bodies.astype(object),
        rows=np.zeros(system.rows.shape, object),
        anchors=np.zeros(system.anchors.shape, object),
    )
    here.bodies[:, LOAD : LOAD + 6] = 0.0
    apply_effects(here.effects, t, here, y)
    fill_all(here.constraints, t, here, y, 0)
    anchor_all(here.constraints, here, y, 0)
    return here


def reactions(system: MultiBody, y: Any, multipliers: Sequence[Any]) -> list[Any]:
    """Force and torque about the anchor of each reaction, world axes."""
    found: list[Any] = []
    for main, *counted in system.members.tolist():
        B = state_of(y, int(system.lines[system.first_row[main], BODY]))
        force: Any = (0.0, 0.0, 0.0)
        torque: Any = (0.0, 0.0, 0.0)
        for part in np.flatnonzero(counted):
            for k in range(system.first_row[part], system.first_row[part + 1]):
                x = multipliers[k]
                force = add(force, tuple(x * r for r in vec(system.rows, k, 0)))
                torque = add(torque, tuple(x * r for r in vec(system.rows, k, 3)))
        arm = sub(B.p_WC, vec(system.anchors, main, 0))
        found += [*force, *add(rotate(B.q_WB, torque), cross(arm, force))]
    return found


def equations(system: MultiBody, t: float, y: Any, held: HeldMotion) -> Equations:
    """The equations at (t, y) on what is held."""
    here = on(system, t, y)
    lines, bodies = range(len(here.lines)), range(len(here.bodies))
    push: list[Any] = []
    velocities: list[Any] = []
    for i in bodies:
        B = state_of(y, i)
        turn = gyroscopic(six(here.bodies, i, INERTIA), B.w_WB_B)
        push += [*vec(here.bodies, i, LOAD), *sub(vec(here.bodies, i, LOAD + 3), turn)]
        velocities += [*B.v_WC, *B.w_WB_B]
    for k in lines:
        for column, body in ((0, here.lines[k, BODY]), (6, here.lines[k, PARENT])):
            if body >= 0:
                for i in range(6):
                    at = 6 * body + i
                    push[at] = push[at] + held.multipliers[k] * here.rows[k, column + i]
    return Equations(
        push,
        [here.rows[k, BIAS] + line_times(here, k, held.acceleration) for k in lines],
        [here.rows[k, ERROR] for k in lines],
        [line_times(here, k, velocities) - here.rows[k, RATE] for k in lines],
        [line_times(here, k, held.direction) for k in lines],
        reactions(here, y, held.multipliers),
    )


class Derivatives(NamedTuple):
    """Of each list of Equations: by the state (rows, 13 N) and by the inputs (rows, m)."""

    by_state: dict[str, Array]
    by_input: dict[str, Array]


def derivatives(
    system: MultiBody,
    t: float,
    y: Array,
    held: HeldMotion,
    inputs: int,
    commanded: Callable[[MultiBody, Sequence[Any]], MultiBody],
) -> Derivatives:
    """Exact derivatives of the equations; commanded(system, symbols) adds the inputs' wrenches.

    Raises TypeError for laws that cannot be differentiated.
    """
    graph = Graph()
    state, wrench = graph.vector("y", len(y)), graph.vector("p", inputs)
    found = equations(commanded(system, wrench), t, state, held)
    by_state, by_input = {}, {}
    for name, outputs in found._asdict().items():
        sparse = jacobian(outputs, (*state, *wrench))
        values = np.zeros(len(sparse.values))
        PlainLaw(sparse.values)(t, y, np.zeros(inputs + 1), values)
        matrix = np.zeros(sparse.shape)
        matrix[list(sparse.rows), list(sparse.columns)] = values
        by_state[name], by_input[name] = matrix[:, : len(y)], matrix[:, len(y) :]
    return Derivatives(by_state, by_input)


# Deviations z = (position, rotation, velocity, spin) of N bodies from a moving state.
#
# All positions and rotations (small rotation vectors) come first, then all velocities and spins;
# in world axes unless a frame says otherwise.


Axes = Literal["world", "body"]


def block_diag(*blocks: Array) -> Array:
    """The blocks along the diagonal of one matrix."""
    return np.asarray(linalg.block_diag(*blocks), dtype=float)


def skew(a: Any) -> Array:
    """The matrix of a x."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]], float)


def rotation(q: Any) -> Array:
    """The matrix of a quaternion, body to world, (3, 3)."""
    return np.array([rotate(q, tuple(e)) for e in np.eye(3)]).T


def from_world(y: Array, bodies: int) -> Array:
    """dy for deviations z = (positions, rotations, velocities, spins), world axes: (13 N, 12 N).

    A rotation phi (world) turns q by (phi, 0) q / 2 and leaves of a spin W the body components
    R^T (dW - phi x W).
    """
    matrix = np.zeros((13 * bodies, 12 * bodies))
    for i in range(bodies):
        B = state_of(y, i)
        p, phi, v, w = columns(i, bodies)
        x, yy, z, s = B.q_WB
        R, W = rotation(B.q_WB), rotate(B.q_WB, B.w_WB_B)
        k = 13 * i
        matrix[k : k + 3, p] = matrix[k + 7 : k + 10, v] = np.eye(3)
        matrix[k + 3 : k + 7, phi] = 0.5 * np.array(
            [[s, z, -yy], [-z, s, x], [yy, -x, s], [-x, -yy, -z]]
        )
        matrix[k + 10 : k + 13, w] = R.T
        matrix[k + 10 : k + 13, phi] = R.T @ skew(W)
    return matrix


def columns(i: int, bodies: int) -> list[slice]:
    """Where the position, rotation, velocity and spin of body i are in z."""
    pose, twist = 6 * i, 6 * (bodies + i)
    return [slice(a, a + 3) for a in (pose, pose + 3, twist, twist + 3)]


def turned_spin(y: Array, bodies: int) -> Array:
    """From (a_C, dw/dt body) to (a_C, R dw/dt) of all bodies."""
    return block_diag(
        *(block for i in range(bodies) for block in (np.eye(3), rotation(state_of(y, i).q_WB)))
    )


def world_dynamics(y: Array, bodies: int, held: HeldMotion, du: Array) -> Array:
    """F of z' = F z, world axes; phi' = dW + W x phi, (R alpha)' = phi x R alpha + R d alpha."""
    F = np.zeros((12 * bodies, 12 * bodies))
    F[6 * bodies :] = turned_spin(y, bodies) @ du
    for i in range(bodies):
        B = state_of(y, i)
        p, phi, v, w = columns(i, bodies)
        F[p, v] = F[phi, w] = np.eye(3)
        F[phi, phi] = skew(rotate(B.q_WB, B.w_WB_B))
        alpha = rotate(B.q_WB, tuple(held.acceleration[6 * i + 3 : 6 * i + 6]))
        F[w, phi] -= skew(alpha)
    return F


def frame_of(
    y: Array, bodies: int, held: HeldMotion, axes: Axes, turning: float
) -> tuple[Array, Array]:
    """(T, dT/dt T^-1) for z in the chosen axes, T z.

    In axes of the body the spin's deviation is that of its components there, dw = R^T dW + w x phi.
    """
    size = 12 * bodies
    T, rate, shear, shear_rate = (
        np.eye(size),
        np.zeros((size, size)),
        np.eye(size),
        np.zeros((size, size)),
    )
    for i in range(bodies):
        B = state_of(y, i)
        p, phi, v, w = columns(i, bodies)
        own = axes == "body"
        for part in (p, phi, v, w):
            T[part, part] = rotation(B.q_WB).T if own else np.eye(3)
            rate[part, part] = -skew(B.w_WB_B if own else (0.0, 0.0, turning))
        if own:
            shear[w, phi] = skew(B.w_WB_B)
            shear_rate[w, phi] = skew(held.acceleration[6 * i + 3 : 6 * i + 6])
    back = np.linalg.inv(shear)
    return shear @ T, shear_rate @ back + shear @ rate @ back
