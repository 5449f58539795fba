# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Check of the initial state against the constraints: accepted, projected or refused."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np

from rb_sim.base.errors import SceneError
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.catalogue.constraints.rows import BIAS
from rb_sim.catalogue.spec import BodyState
from rb_sim.mechanics.initial_projection import relative, rows_matrix, start_on_manifold
from rb_sim.mechanics.samples import SampleLayout
from rb_sim.mechanics.systems.many_bodies import (
    BODY,
    INERTIA,
    MASS,
    PARENT,
    WIDTH,
    MultiBody,
    angles,
)
from rb_sim.mechanics.systems.multibody import write_rows
from rb_sim.numerics.rank import Ranked, null_space, ranked
from rb_sim.numerics.vectors import cross, rotate, sub
from rb_sim.scene.place import InitialPlace, vector
from rb_sim.scene.reduced import misfit, rolling_spin
from rb_sim.scene.schema import Body, Scene

# Linearly dependent constraint rows: permanently (redundant) or in one position only (singular).
#
# A combination nu of rows with nu^T G = 0 stays one along every motion u that the rows allow if
# nu^T dG/dt u = 0 for all such u. Otherwise the position is singular, a dead centre: the rows stop
# a motion that they allow to first order, or let it branch, and accelerations and reactions are not
# unique.


CHANGES = 1e-7
"""Rate at which a combination of rows changes, relative to the rate of the rows themselves, above
which the dependence is only momentary."""

INDEPENDENT = 1e-6
"""Smallest singular value of the normalised rows, relative to the largest, above which they are
clearly independent."""

WIDE = 1e9
"""Ratio of masses above which the check for rows hidden by masses is made."""

HIDDEN = 8e-12
"""Smallest eigenvalue of A (scaled to a unit diagonal), relative to the largest, below which a
solution keeps about five digits at most: constraints then drift from step to step."""

MOTIONS = 4
"""Number of random allowed motions that are tried; a motion that misses a dead centre is
isolated."""


def joint_lines(system: Any) -> int:
    """Number of rows of the joints; rows of contacts follow them."""
    return int(system.first_row[len(system.constraints)])


def rank_of_joints(system: Any, t: float, y: np.ndarray) -> Ranked:
    """Rank decomposition of A = G M^-1 G^T of the joints at (t, y)."""
    n = joint_lines(system)
    return ranked(rows_matrix(system, t, y)[:n, :n])


def jacobian(system: Any) -> np.ndarray:
    """G with respect to u = (v_C world, w body) of all bodies, (n, 6 N), from the rows last
    written."""
    n, bodies = joint_lines(system), len(system.bodies)
    G = np.zeros((n, 6 * bodies))
    for k in range(n):
        for column, body in ((0, system.row_table[k, BODY]), (6, system.row_table[k, PARENT])):
            if body >= 0:
                G[k, 6 * body : 6 * body + 6] += system.rows[k, column : column + 6]
    return G


def dead_centre(system: Any, t: float, y: np.ndarray) -> np.ndarray:
    """Indices of the rows that depend on each other at (t, y) but not in neighbouring positions.

    Overwrites the rows in `system`.
    """
    rank = rank_of_joints(system, t, y)
    n = joint_lines(system)
    if rank.rank == n:
        return np.zeros(0, int)
    write_rows(system, t, y)
    G = jacobian(system)
    allowed = allowed_motions(system, G)
    moved = np.zeros(rank.null.shape[1], bool)
    random = np.random.default_rng(0)
    for _ in range(MOTIONS if allowed.shape[1] else 0):
        u = (allowed @ random.normal(size=allowed.shape[1])).reshape(-1, 6)
        at = y.copy()
        for i, velocity in enumerate(u):
            at[WIDTH * i + 7 : WIDTH * i + 13] = velocity
        write_rows(system, t, at)
        change = np.abs(rank.null.T @ system.rows[:n, BIAS])
        moved |= change > CHANGES * (np.abs(rank.null).T @ rates(system, G, u))
    write_rows(system, t, y)
    combinations = np.abs(rank.null[:, moved])
    if combinations.size == 0:
        return np.zeros(0, int)
    return np.flatnonzero((combinations > WRITTEN_ROUNDING * combinations.max(axis=0)).any(axis=1))


def rates(system: Any, G: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Scale of |dG/dt u| for each row, as if it turned with the fastest body: size v^2 / length."""
    length = system.length
    speed = (np.linalg.norm(u[:, :3], axis=1) + length * np.linalg.norm(u[:, 3:], axis=1)).max()
    parts = G.reshape(len(G), -1, 6)
    sizes = (
        np.linalg.norm(parts[:, :, :3], axis=2) + np.linalg.norm(parts[:, :, 3:], axis=2) / length
    )
    return sizes.max(axis=1) * speed**2 / length


def hidden_by_masses(system: Any, t: float, y: np.ndarray) -> np.ndarray:
    """Indices of independent rows that A at (t, y) cannot distinguish from dependent ones.

    A heavy body that hangs on a light one makes two rows of A equal up to the ratio of their
    masses.
    """
    masses, n = system.bodies[:, MASS], joint_lines(system)
    if not n or not masses.max() > WIDE * masses.min():
        return np.zeros(0, int)
    A = np.array(rows_matrix(system, t, y)[:n, :n])
    sizes = 1.0 / np.sqrt(np.diag(A))
    values, vectors = np.linalg.eigh(A * sizes * sizes[:, None])
    write_rows(system, t, y)
    G = jacobian(system)
    spread = np.linalg.svd(G / np.linalg.norm(G, axis=1, keepdims=True), compute_uv=False)
    independent = n <= G.shape[1] and spread[-1] > INDEPENDENT * spread[0]
    if not independent or values[0] > HIDDEN * values[-1]:
        return np.zeros(0, int)
    share = np.abs(vectors[:, 0])
    return np.flatnonzero(share > 0.1 * share.max())


def allowed_motions(system: Any, G: np.ndarray) -> np.ndarray:
    """Basis of the u with G u = 0, orthonormal in the metric of M; (6 N, dimension)."""
    roots = []
    for body in system.bodies:
        xx, yy, zz, xy, xz, yz = body[INERTIA : INERTIA + 6]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        roots += [np.eye(3) / body[MASS] ** 0.5, np.linalg.inv(np.linalg.cholesky(inertia)).T]
    scaled = np.hstack([G[:, 3 * i : 3 * i + 3] @ root for i, root in enumerate(roots)])
    free = null_space(scaled)
    return np.vstack([root @ free[3 * i : 3 * i + 3] for i, root in enumerate(roots)])


def undetermined(system: Any, layout: SampleLayout, t: float, y: np.ndarray) -> tuple[str, ...]:
    """Names of the reactions with a row in a linear dependence of the constraint rows.

    Contacts are omitted, since they open and close.
    """
    null = rank_of_joints(system, t, y).null
    if null.shape[1] == 0:
        return ()
    moved = np.abs(null).max(axis=1) > WRITTEN_ROUNDING
    first = system.first_row
    names = []
    for o, name in enumerate(layout.reactions):
        parts = np.flatnonzero(system.members[o, 1 : 1 + len(system.constraints)])
        if any(moved[first[p] : first[p + 1]].any() for p in parts):
            names.append(name)
    return tuple(names)


MISFIT = 1e-6
"""Relative constraint violation up to which an initial state counts as rounded."""

UNITS = {"position": ("m", "rad"), "velocity": ("m/s", "rad/s")}
"""Units of an initial violation: (of a length, of an angle)."""


def _turns(system: Any, line: int) -> int:
    """1 if the error of a line is an angle or a spin, else 0."""
    rows = [constraint.row for constraint in system.constraints]
    row = rows[part_of(system, line)]
    return int(angles(rows)[line] or getattr(row, "linear", None) == (0.0, 0.0, 0.0))


def check_reduced(scene: Scene, place: InitialPlace, reduced: Any) -> None:
    """Refuse an initial state that the reduced coordinates cannot represent."""
    if scene.simulation.project_initial:
        return
    name = next(iter(scene.bodies))
    size, what, amount = misfit(place.state(name), reduced.state, reduced.length)
    if size > MISFIT:
        joint = next(k for k, s in scene.constraints.items() if s.type != "free")
        problem, cure = f"the initial {what} of {name} violates it by {amount}", ""
        if scene.constraints[joint].type == "rolling" and what.endswith("velocity"):
            slip, w = rolling_spin(reduced.system, place.state(name), MISFIT)
            problem = f"the contact point of {name} slips at {slip:.3g} m/s"
            cure = f"use {in_scene('angular_velocity', w)}" if w else cure
        cure = cure or _nearest(scene.bodies[name], reduced.state)
        refuse_initial(scene, joint, problem, cure)


def _nearest(body: Body, state: BodyState) -> str:
    """The values of a body in the scene file that differ at the nearest admissible state."""
    arm = vector(body.center_of_mass)
    nearest = {
        "position": sub(state.p_WC, rotate(state.q_WB, arm)),
        "orientation": state.q_WB,
        "linear_velocity": sub(state.v_WC, rotate(state.q_WB, cross(state.w_WB_B, arm))),
        "angular_velocity": state.w_WB_B,
    }
    written = {key: in_scene(key, value) for key, value in nearest.items()}
    other = [text for key, text in written.items() if text != in_scene(key, getattr(body, key))]
    return f"use {', '.join(other)}" if other else "correct it"


def in_scene(key: str, values: Sequence[float]) -> str:
    """A key and its values as a scene file has them, to six digits."""
    size = max(map(abs, values))
    rounded = (0.0 if abs(x) < WRITTEN_ROUNDING * size else x for x in values)
    return f"{key} [{', '.join(f'{x + 0.0:.6g}' for x in rounded)}]"


def refuse_initial(
    scene: Scene, constraint: str, problem: str, cure: str = "correct it"
) -> NoReturn:
    """Raise SceneError for a start that violates a constraint; problem: quantity and its amount."""
    raise SceneError(
        f"{problem} (must be 0); {cure} or set simulation.project_initial: true",
        key=f"constraints.{constraint}",
        file=scene.file,
    )


def check_maximal(
    scene: Scene,
    system: Any,
    y: np.ndarray,
    owners: list[str],
    t: float,
    scales: tuple[float, float],
) -> tuple[int, int]:
    """Refuse or project an initial state off the manifold, in place; returns (rank, rows).

    scales: length [m] and speed [m/s] to which violations are relative, see `start_scales`.
    """
    try:
        with np.errstate(all="ignore"):  # non-finite results are refused below
            before, after, rank = start_on_manifold(system, t, y)
    except ZeroDivisionError:
        _refuse_lines(scene, "have no direction: points that must be apart coincide")
    row_count = before.shape[1]
    checked = not scene.simulation.project_initial and row_count > 0
    misfits = zip(UNITS, before, relative(system, before, *scales), strict=True)
    for what, amounts, error in misfits if checked else ():
        if error.max() > MISFIT:
            line = int(error.argmax())
            amount = f"{amounts[line]:.2g} {UNITS[what][_turns(system, line)]}"
            problem = f"the initial {what} violates it by {amount}"
            refuse_initial(scene, owners[part_of(system, line)], problem)
    left = relative(system, after, system.length, system.speed)
    if not (left <= WRITTEN_ROUNDING).all():  # also true for NaN
        raise SceneError(
            "they contradict each other: no state near the initial one satisfies all of them",
            key="constraints",
            file=scene.file,
        )
    try:
        with np.errstate(all="ignore"):
            hidden = hidden_by_masses(system, t, y) if isinstance(system, MultiBody) else ()
            singular = dead_centre(system, t, y) if rank < row_count else np.zeros(0, int)
    except np.linalg.LinAlgError:
        _refuse_lines(scene, "overflow: lengths or masses are too large or too small")
    if len(hidden):
        found = dict.fromkeys(owners[part_of(system, int(k))] for k in hidden)
        _refuse_masses(scene, ", ".join(found))
    if len(singular):
        found = dict.fromkeys(owners[part_of(system, int(k))] for k in singular)
        raise SceneError(
            f"singular initial position: {', '.join(found)} lose rank there (a dead centre, or "
            "bearings too close together), so that accelerations and reactions are not unique; "
            "start in another position, move bearings apart, or remove one of these constraints",
            key="constraints",
            file=scene.file,
        )
    return int(rank), row_count


def _refuse_lines(scene: Scene, why: str) -> NoReturn:
    raise SceneError(
        f"their equations in the initial position {why}", key="constraints", file=scene.file
    )


def _refuse_masses(scene: Scene, constraints: str) -> None:
    masses = [body.mass for body in scene.bodies.values()]
    raise SceneError(
        f"masses of {min(masses):.3g} kg and {max(masses):.3g} kg connected by {constraints} "
        "differ too much for double precision; give the light body more mass (ratios up to about "
        "1e10 run), or remove it",
        key="constraints",
        file=scene.file,
    )


def part_of(system: Any, line: int) -> int:
    """Index of the constraint part that owns a row."""
    return int(np.searchsorted(system.first_row, line, side="right")) - 1
