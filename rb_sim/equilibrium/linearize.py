# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Linearisation x' = A x + B f about a state, in minimal coordinates on the constraint manifold.

Deviations z = (position, rotation, velocity, spin) of all bodies obey z' = F z + H f with the exact
derivatives F, H of the Newton-Euler equations with multipliers. The constraints and their rates
leave fewer of them independent: column pivoting chooses the states x among them (of the bodies
named first, if well conditioned), z = Z x. Since the choice is constant, x' = (rows of F) Z x holds
also about a motion, without the rate of Z.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy import linalg

from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.constraints.rows import BIAS, ERROR, HOLONOMIC, RATE
from rb_sim.compiler.graph.derivative import jacobian
from rb_sim.compiler.graph.machine import PlainLaw
from rb_sim.compiler.graph.symbols import Graph
from rb_sim.equilibrium.state_space import LinearModel
from rb_sim.mechanics.samples import Array, SampleLayout
from rb_sim.mechanics.systems.many_bodies import (
    BODY,
    INERTIA,
    LOAD,
    MASS,
    PARENT,
    MultiBody,
    anchor_all,
    apply_effects,
    fill_all,
    six,
    state_of,
    vec,
)
from rb_sim.mechanics.systems.multibody import reaction
from rb_sim.numerics.rank import Ranked, ranked, scaled_rows, solved
from rb_sim.numerics.vectors import add, gyroscopic, rotate, sub

# Equations of motion of N bodies, on numbers or symbols, and their exact derivatives.
#
# M du/dt = f + G^T lambda and G du/dt = -bias (LL 38.2). With accelerations and multipliers held
# constant every equation below is explicit, so that its derivatives by the state need no
# elimination; those of accelerations and multipliers follow from one linear solve (implicit
# function theorem).


class HeldMotion(NamedTuple):
    """Values held constant while the equations are differentiated."""

    acceleration: Sequence[float]
    """(a_C world, dw/dt body) of each body, 6 N numbers."""
    multipliers: Sequence[float]
    direction: Sequence[float]
    """6 N components c; G c is one of the equations."""


class Equations(NamedTuple):
    """The equations as lists of numbers or symbols."""

    load: list[Any]
    """generalised force f + G^T lambda, 6 N."""
    bias: list[Any]
    """acceleration residual bias + G du/dt of each row."""
    error: list[Any]
    """position error g of each row; 0 if it is not holonomic."""
    slip: list[Any]
    """velocity error G u - b of each row."""
    along: list[Any]
    """G c of each row."""
    reactions: list[Any]
    """force, torque about the anchor of each reaction, world axes, 6 K."""


def row_times(system: MultiBody, k: int, u: Sequence[Any]) -> Any:
    """G u of row k; u: velocities of all bodies (6 N)."""
    total: Any = 0.0
    for column, body in ((0, system.row_table[k, BODY]), (6, system.row_table[k, PARENT])):
        if body >= 0:
            for i in range(6):
                total = total + system.rows[k, column + i] * u[6 * body + i]
    return total


def on(system: MultiBody, t: float, y: Any) -> MultiBody:
    """The system with loads, rows and anchors at (t, y), in tables of numbers or symbols."""
    here = system._replace(
        bodies=system.bodies.astype(object),
        rows=np.zeros(system.rows.shape, object),
        anchors=np.zeros(system.anchors.shape, object),
    )
    here.bodies[:, LOAD : LOAD + 6] = 0.0
    apply_effects(here.effects, t, here, y)
    fill_all(here.constraints, t, here, y)
    anchor_all(here.constraints, here, y)
    return here


def reactions(system: MultiBody, y: Any, multipliers: Sequence[Any]) -> list[Any]:
    """Force and torque about the anchor of each reaction, world axes."""
    found: list[Any] = []
    for o in range(len(system.members)):
        force, torque, _ = reaction(system, y, o, multipliers)
        found += [*force, *torque]
    return found


def equations(system: MultiBody, t: float, y: Any, held: HeldMotion) -> Equations:
    """The equations at (t, y) for the held values."""
    here = on(system, t, y)
    rows, bodies = range(len(here.row_table)), range(len(here.bodies))
    load: list[Any] = []
    velocities: list[Any] = []
    for i in bodies:
        B = state_of(y, i)
        turn = gyroscopic(six(here.bodies, i, INERTIA), B.w_WB_B)
        load += [*vec(here.bodies, i, LOAD), *sub(vec(here.bodies, i, LOAD + 3), turn)]
        velocities += [*B.v_WC, *B.w_WB_B]
    for k in rows:
        for column, body in ((0, here.row_table[k, BODY]), (6, here.row_table[k, PARENT])):
            if body >= 0:
                for i in range(6):
                    at = 6 * body + i
                    load[at] = load[at] + held.multipliers[k] * here.rows[k, column + i]
    return Equations(
        load,
        [here.rows[k, BIAS] + row_times(here, k, held.acceleration) for k in rows],
        [here.rows[k, ERROR] for k in rows],
        [row_times(here, k, velocities) - here.rows[k, RATE] for k in rows],
        [row_times(here, k, held.direction) for k in rows],
        reactions(here, y, held.multipliers),
    )


class Derivatives(NamedTuple):
    """Derivatives of each list of Equations by state (rows, 13 N) and by inputs (rows, m)."""

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
    """Exact derivatives of the equations. commanded(system, symbols) adds the inputs' wrenches.

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
# All positions and rotations (small rotation vectors) come first, then all velocities and spins; in
# world axes unless stated otherwise.


Axes = Literal["world", "body"]


def block_diag(*blocks: Array) -> Array:
    """Block-diagonal matrix."""
    return np.asarray(linalg.block_diag(*blocks), dtype=float)


def skew(a: Any) -> Array:
    """Skew-symmetric matrix of a x, (3, 3)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]], float)


def rotation(q: Any) -> Array:
    """Rotation matrix of a quaternion, body to world, (3, 3)."""
    return np.array([rotate(q, tuple(e)) for e in np.eye(3)]).T


def from_world(y: Array, bodies: int) -> Array:
    """Matrix from deviations z in world axes to dy, (13 N, 12 N).

    A rotation phi (world) changes q by (phi, 0) q / 2, and the body components of a spin W by R^T
    (dW - phi x W).
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
    """Slices of position, rotation, velocity and spin of body i in z."""
    pose, twist = 6 * i, 6 * (bodies + i)
    return [slice(a, a + 3) for a in (pose, pose + 3, twist, twist + 3)]


def turned_spin(y: Array, bodies: int) -> Array:
    """Matrix from (a_C, dw/dt in body axes) to (a_C, R dw/dt) of all bodies, (6 N, 6 N)."""
    return block_diag(
        *(block for i in range(bodies) for block in (np.eye(3), rotation(state_of(y, i).q_WB)))
    )


def world_dynamics(y: Array, bodies: int, held: HeldMotion, du: Array) -> Array:
    """F of z' = F z in world axes; phi' = dW + W x phi, (R alpha)' = phi x R alpha + R d alpha."""
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
    """(T, dT/dt T^-1) for the deviations T z in the chosen axes.

    In body axes the spin's deviation is that of its body components, dw = R^T dW + w x phi.
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


POSITIONS_FIRST = 8.0
"""Weight of positions over angles in the choice of dependent coordinates."""

LEAST_PIVOT = 1e-9
"""Pivot of the scaled rows, relative to the largest, at or below which a coordinate stays free.
Larger than in the rank rule: the choice of states is free, and a bad one amplifies errors."""

GOOD_PIVOT = 1e-3
"""Relative pivot above which a coordinate of a later body is made dependent, so that the states
belong to the bodies named first in the scene. Errors grow at most by its inverse."""

KINDS = ("position", "angle", "velocity", "spin")


def linearize(
    system: MultiBody,
    layout: SampleLayout,
    t: float,
    y: Array,
    commands: dict[str, tuple[int, ...]],
    axes: Axes = "world",
    turning: float = 0.0,
) -> LinearModel:
    """The linear model about the state y (13 N maximal coordinates, on the manifold) at t [s].

    axes: of the states, of pose, twist and inputs; "body" axes turn with their body. turning: rate
    [rad/s] at which the world axes rotate about the vertical z, for motions steady in that rotating
    frame. Raises SimulationError if a law has no derivative.
    """
    bodies = len(system.bodies)
    G, inverse_mass, held, rank = held_at(system, t, y)
    kinds = ("force", "torque")
    names = tuple(f"{body}/{kind}_{x}" for body in commands for kind in kinds for x in "xyz")

    def commanded(changed: MultiBody, wrench: Sequence[Any]) -> MultiBody:
        return with_inputs(changed, commands, wrench, axes)

    try:
        exact = derivatives(system, t, y, held, len(names), commanded)
    except TypeError as error:
        raise SimulationError(f"the scene cannot be linearised: {error}") from None
    to_y = from_world(y, bodies)
    by_z = {name: matrix @ to_y for name, matrix in exact.by_state.items()}
    du, dmultipliers = implicit(G, inverse_mass, rank, by_z)
    du_f, dmultipliers_f = implicit(G, inverse_mass, rank, exact.by_input)
    F = world_dynamics(y, bodies, held, du)
    H = np.vstack([np.zeros((6 * bodies, len(names))), turned_spin(y, bodies) @ du_f])
    frame, rates = frame_of(y, bodies, held, axes, turning)
    to_z = np.asarray(np.linalg.inv(frame), float)
    F = frame @ F @ to_z + rates
    H = frame @ H
    Z, chosen = free_deviations(system, G, y, by_z["slip"] @ to_z, to_z)
    rows = np.array(reaction_rows(system, t, y))
    reaction_x = (by_z["reactions"] + rows @ dmultipliers) @ to_z @ Z
    reaction_f = exact.by_input["reactions"] + rows @ dmultipliers_f
    labels = state_names(layout.bodies)
    return LinearModel(
        t=t,
        A=F[chosen] @ Z,
        B=H[chosen],
        C=np.vstack([Z, reaction_x]),
        D=np.vstack([np.zeros((12 * bodies, len(names))), reaction_f]),
        states=tuple(labels[i] for i in chosen),
        inputs=names,
        outputs=(*labels, *reaction_names(layout)),
    )


def held_at(system: MultiBody, t: float, y: Array) -> tuple[Array, Array, HeldMotion, Ranked]:
    """(G (n, 6 N), M^-1 (6 N, 6 N), accelerations and multipliers, rank of the rows) at (t, y)."""
    bodies, rows = len(system.bodies), len(system.row_table)
    none = HeldMotion([0.0] * 6 * bodies, [0.0] * rows, [0.0] * 6 * bodies)
    free = equations(system, t, y, none)
    here = on(system, t, y)
    unit = np.eye(6 * bodies)
    G = np.array([[row_times(here, k, e.tolist()) for e in unit] for k in range(rows)], float)
    G = G.reshape(rows, 6 * bodies)
    mass = [np.diag([system.bodies[i, MASS]] * 3) for i in range(bodies)]
    inertia = [symmetric(six(system.bodies, i, INERTIA)) for i in range(bodies)]
    blocks = [block for pair in zip(mass, inertia, strict=True) for block in pair]
    inverse_mass = block_diag(*(np.asarray(np.linalg.inv(block), float) for block in blocks))
    force = np.array(free.load, float)
    rank = ranked(G @ inverse_mass @ G.T)
    multipliers = rank.least(-(np.array(free.bias, float) + G @ inverse_mass @ force))
    direction = inverse_mass @ G.T @ rank.least(multipliers)
    acceleration = inverse_mass @ (force + G.T @ multipliers)
    held = HeldMotion(acceleration.tolist(), multipliers.tolist(), direction.tolist())
    return G, inverse_mass, held, rank


def symmetric(s: Sequence[float]) -> Array:
    """Symmetric matrix (3, 3) from (xx, yy, zz, xy, xz, yz)."""
    return np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]])


def implicit(
    G: Array, inverse_mass: Array, rank: Ranked, by: dict[str, Array]
) -> tuple[Array, Array]:
    """Derivatives of (du/dt, lambda): M d(du/dt) = d load + G^T d lambda, G d(du/dt) = -d bias.

    For redundant rows lambda remains the minimum-norm solution; its component in the null space of
    G M^-1 G^T changes as that space rotates.
    """
    dmultipliers = -rank.least(by["bias"] + G @ inverse_mass @ by["load"])
    dmultipliers = dmultipliers + rank.null @ (rank.null.T @ by["along"])
    return inverse_mass @ (by["load"] + G.T @ dmultipliers), dmultipliers


def free_deviations(
    system: MultiBody, G: Array, y: Array, slip: Array, to_z: Array
) -> tuple[Array, list[int]]:
    """(Z (12 N, n), indices of the states in z): deviations compatible with the constraints."""
    bodies = len(system.bodies)
    half = 6 * bodies
    turns = [rotation(state_of(y, i).q_WB).T for i in range(bodies)]
    to_body = block_diag(*(block for turn in turns for block in (np.eye(3), turn)))
    rows = G @ to_body @ to_z[:half, :half]
    holonomic = on(system, 0.0, y).rows[:, HOLONOMIC] != 0.0
    pose, free_pose = allowed(rows[holonomic], system.length, bodies)
    twist, free_twist = allowed(rows, system.length, bodies)
    Z = np.zeros((2 * half, len(free_pose) + len(free_twist)))
    Z[:half, : len(free_pose)] = pose
    Z[half:, len(free_pose) :] = twist
    bound = [i for i in range(half) if i not in free_twist]
    if bound:
        right = -slip[:, :half] @ pose
        Z[[half + i for i in bound], : len(free_pose)] = solved(rows[:, bound], right)
    return Z, [*free_pose, *(half + i for i in free_twist)]


def allowed(rows: Array, length: float, bodies: int) -> tuple[Array, list[int]]:
    """(basis of the rows' null space with the identity at its free indices, the free indices)."""
    size = rows.shape[1]
    if len(rows) == 0:
        return np.eye(size), list(range(size))
    weight = np.tile([POSITIONS_FIRST * length] * 3 + [1.0] * 3, bodies)
    bound = bound_by(scaled_rows(rows * weight))
    free = sorted(set(range(size)) - set(bound))
    basis = np.zeros((size, len(free)))
    basis[free, range(len(free))] = 1.0
    basis[bound] = -solved(rows[:, bound], rows[:, free])
    return basis, free


def bound_by(rows: Array) -> list[int]:
    """Columns determined by the others; those of the last bodies if well conditioned."""
    left, bound = rows.copy(), list[int]()
    largest = float(np.linalg.norm(left, axis=0).max())

    def take(columns: Sequence[int], least: float) -> None:
        while True:
            sizes = np.linalg.norm(left[:, columns], axis=0)
            if not sizes.max() > least * largest:
                return
            best = columns[int(np.argmax(sizes))]
            unit = left[:, best] / np.linalg.norm(left[:, best])
            bound.append(best)
            left[:] -= np.outer(unit, unit @ left)
            left[:, bound] = 0.0

    for first in range(rows.shape[1] - 6, -1, -6):
        take(range(first, first + 6), GOOD_PIVOT)
    take(range(rows.shape[1]), LEAST_PIVOT)
    return bound


def reaction_rows(system: MultiBody, t: float, y: Array) -> Array:
    """Matrix from multipliers to force and torque of each reaction, (6 K, n)."""
    here = on(system, t, y)
    unit = np.eye(len(system.row_table))
    found = [reactions(here, y, e.tolist()) for e in unit]
    return np.array(found, float).reshape(len(unit), 6 * len(system.members)).T


def with_inputs(
    system: MultiBody, commands: dict[str, tuple[int, ...]], wrench: Sequence[Any], axes: Axes
) -> MultiBody:
    """The system with the wrenches added to its commands."""
    effects = list(system.effects)
    force, torque = ("force_B", "torque_B") if axes == "body" else ("force_W", "torque_W")
    for m, indices in enumerate(commands.values()):
        f, k = wrench[6 * m : 6 * m + 3], wrench[6 * m + 3 : 6 * m + 6]
        for i in indices:
            row = effects[i].row
            more = {force: add(getattr(row, force), f), torque: add(getattr(row, torque), k)}
            effects[i] = effects[i]._replace(row=row._replace(**more))
    return system._replace(effects=tuple(effects))


def state_names(bodies: Sequence[str]) -> list[str]:
    """Names of the components of z."""
    return [
        f"{body}/{kind}_{axis}"
        for kinds in (KINDS[:2], KINDS[2:])
        for body in bodies
        for kind in kinds
        for axis in "xyz"
    ]


def reaction_names(layout: SampleLayout) -> list[str]:
    """Names of the outputs of all reactions: NAME/force_x ... NAME/torque_z."""
    return [
        f"{name}/{kind}_{axis}"
        for name in layout.reactions
        for kind in ("force", "torque")
        for axis in "xyz"
    ]
