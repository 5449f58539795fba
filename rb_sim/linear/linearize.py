"""x' = A x + B f about a state, in minimal coordinates on the manifold of the constraints.

Deviations z = (position, rotation, velocity, spin) of all bodies obey z' = F z + H f with the exact
derivatives F, H of Newton-Euler with multipliers.  The constraints and their rates leave fewer of
them free: by column pivoting some are chosen as the states x (of the bodies named first, where
that is well conditioned), z = Z x, and since the choice is constant, x' = (rows of F) Z x holds
also about a motion, without the rate of Z.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.constraints.rows import HOLONOMIC
from rb_sim.linear.equations import (
    Axes,
    HeldMotion,
    block_diag,
    derivatives,
    equations,
    frame_of,
    from_world,
    line_times,
    on,
    reactions,
    rotation,
    turned_spin,
    world_dynamics,
)
from rb_sim.linear.state_space import LinearModel
from rb_sim.mechanics.samples import Array, SampleLayout
from rb_sim.mechanics.systems.many_bodies import INERTIA, MASS, MultiBody, six, state_of
from rb_sim.numerics.rank import Ranked, ranked, scaled_lines, solved
from rb_sim.numerics.vectors import add

POSITIONS_FIRST = 8.0
"""Weight of positions over angles where either could be left to the constraints."""

LEAST_PIVOT = 1e-9
"""Pivot of the lines at length 1, relative to the largest, at or below which a coordinate stays
free. Wider than the rank rule: which ones are states is a choice, and a bad one magnifies."""

GOOD_PIVOT = 0.1
"""Pivot, likewise relative, above which a coordinate of a later body is left to the constraints, so
that the states are of the bodies that a scene names first. Errors grow by its inverse at most."""

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
    """The linear model about the state y (13 N maximal coordinates, on the manifold) at t.

    axes: of the states, of pose, twist and inputs; "body" axes turn with their body. turning: rate
    [rad/s] at which the world's axes turn about the vertical z, for motions that are steady as seen
    from there. Raises SimulationError where a law has no derivative.
    """
    bodies = len(system.bodies)
    G, inverse_mass, held, rank = held_at(system, t, y)
    names = _input_names(commands)

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
    lines = np.array(reaction_lines(system, t, y))
    reaction_x = (by_z["reactions"] + lines @ dmultipliers) @ to_z @ Z
    reaction_f = exact.by_input["reactions"] + lines @ dmultipliers_f
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
    """(G (n, 6 N), M^-1 (6 N, 6 N), accelerations and multipliers, rank of the lines) at (t, y)."""
    bodies, lines = len(system.bodies), len(system.lines)
    none = HeldMotion([0.0] * 6 * bodies, [0.0] * lines, [0.0] * 6 * bodies)
    free = equations(system, t, y, none)
    here = on(system, t, y)
    unit = np.eye(6 * bodies)
    G = np.array([[line_times(here, k, e.tolist()) for e in unit] for k in range(lines)], float)
    G = G.reshape(lines, 6 * bodies)
    mass = [np.diag([system.bodies[i, MASS]] * 3) for i in range(bodies)]
    inertia = [symmetric(six(system.bodies, i, INERTIA)) for i in range(bodies)]
    blocks = [block for pair in zip(mass, inertia, strict=True) for block in pair]
    inverse_mass = block_diag(*(np.asarray(np.linalg.inv(block), float) for block in blocks))
    force = np.array(free.push, float)
    rank = ranked(G @ inverse_mass @ G.T)
    multipliers = rank.least(-(np.array(free.bias, float) + G @ inverse_mass @ force))
    direction = inverse_mass @ G.T @ rank.least(multipliers)
    acceleration = inverse_mass @ (force + G.T @ multipliers)
    held = HeldMotion(acceleration.tolist(), multipliers.tolist(), direction.tolist())
    return G, inverse_mass, held, rank


def symmetric(s: Sequence[float]) -> Array:
    """(xx, yy, zz, xy, xz, yz) as a matrix."""
    return np.array([[s[0], s[3], s[4]], [s[3], s[1], s[5]], [s[4], s[5], s[2]]])


def implicit(
    G: Array, inverse_mass: Array, rank: Ranked, by: dict[str, Array]
) -> tuple[Array, Array]:
    """Derivatives of (du/dt, lambda): M d(du/dt) = d push + G^T d lambda, G d(du/dt) = -d bias.

    Where lines are redundant lambda stays the one of least norm: its part along what A maps to
    zero changes as that space turns.
    """
    dmultipliers = -rank.least(by["bias"] + G @ inverse_mass @ by["push"])
    dmultipliers = dmultipliers + rank.null @ (rank.null.T @ by["along"])
    return inverse_mass @ (by["push"] + G.T @ dmultipliers), dmultipliers


def free_deviations(
    system: MultiBody, G: Array, y: Array, slip: Array, to_z: Array
) -> tuple[Array, list[int]]:
    """(Z (12 N, n), indices of the states in z): deviations that the constraints allow."""
    bodies = len(system.bodies)
    half = 6 * bodies
    turns = [rotation(state_of(y, i).q_WB).T for i in range(bodies)]
    to_body = block_diag(*(block for turn in turns for block in (np.eye(3), turn)))
    lines = G @ to_body @ to_z[:half, :half]
    pose, free_pose = allowed(lines[holonomic_lines(system, y)], system.length, bodies)
    twist, free_twist = allowed(lines, system.length, bodies)
    Z = np.zeros((2 * half, len(free_pose) + len(free_twist)))
    Z[:half, : len(free_pose)] = pose
    Z[half:, len(free_pose) :] = twist
    bound = [i for i in range(half) if i not in free_twist]
    if bound:
        right = -slip[:, :half] @ pose
        Z[[half + i for i in bound], : len(free_pose)] = solved(lines[:, bound], right)
    return Z, [*free_pose, *(half + i for i in free_twist)]


def holonomic_lines(system: MultiBody, y: Array) -> list[int]:
    """Which lines restrict positions, too."""
    here = on(system, 0.0, y)
    return [k for k in range(len(here.lines)) if here.rows[k, HOLONOMIC]]


def allowed(lines: Array, length: float, bodies: int) -> tuple[Array, list[int]]:
    """(basis with the identity in its free rows, the free rows) of what the lines map to zero."""
    size = lines.shape[1]
    if len(lines) == 0:
        return np.eye(size), list(range(size))
    weight = np.tile([POSITIONS_FIRST * length] * 3 + [1.0] * 3, bodies)
    bound = bound_by(scaled_lines(lines * weight))
    free = sorted(set(range(size)) - set(bound))
    basis = np.zeros((size, len(free)))
    basis[free, range(len(free))] = 1.0
    basis[bound] = -solved(lines[:, bound], lines[:, free])
    return basis, free


def bound_by(lines: Array) -> list[int]:
    """Columns that the lines give by the others: of the last bodies, if their pivots are good."""
    left, bound = lines.copy(), list[int]()
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

    for first in range(lines.shape[1] - 6, -1, -6):
        take(range(first, first + 6), GOOD_PIVOT)
    take(range(lines.shape[1]), LEAST_PIVOT)
    return bound


def reaction_lines(system: MultiBody, t: float, y: Array) -> Array:
    """Force and torque of each reaction by the multipliers, (6 K, n)."""
    here = on(system, t, y)
    unit = np.eye(len(system.lines))
    found = [reactions(here, y, e.tolist()) for e in unit]
    return np.array(found, float).reshape(len(unit), 6 * len(system.members)).T


def _input_names(commands: dict[str, tuple[int, ...]]) -> tuple[str, ...]:
    return tuple(
        f"{body}/{kind}_{axis}"
        for body in commands
        for kind in ("force", "torque")
        for axis in "xyz"
    )


def with_inputs(
    system: MultiBody, commands: dict[str, tuple[int, ...]], wrench: Sequence[Any], axes: Axes
) -> MultiBody:
    """The system with the wrenches added to what is commanded."""
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
    """Of z."""
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
