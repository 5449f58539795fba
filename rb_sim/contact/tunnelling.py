# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tunnelling checks: sides of bodies that sink into a support between their contact points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.base.errors import SimulationError
from rb_sim.base.rounding import SOLVED
from rb_sim.catalogue.contact import Sides, edges_of_box
from rb_sim.catalogue.geometry.pairs import BallOnCylinder, Resting, carrier
from rb_sim.catalogue.geometry.solids import Box, Cylinder
from rb_sim.catalogue.spec import WORLD
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import WIDTH, state_of
from rb_sim.numerics.rotations import conjugate, product
from rb_sim.numerics.rotations import rotate as turned
from rb_sim.numerics.vectors import cross, norm, rotate, sub, unrotate

# Edges of boxes and rods between their contact points.
#
# A box touches another box or cylinder with its corners, a rod with its ends. If an edge between
# them crosses the support, no contact point shows it. Here the depth of the edges is computed in
# the poses of a run; if it is larger than that of the ends, the run ends.


GOLDEN = 0.5 * (5.0**0.5 - 1.0)
ROUNDS = 48
"""Number of golden-section steps, after which the error of the depth is rounding."""
LEAST_MOVE = 0.1
"""Motion, relative to the allowed depth, below which a side counts as at rest."""


def depth_in(support: NamedTuple, x: Array) -> Array:
    """Signed distance of points (..., 3) from the support's surface, negative inside [m]."""
    if isinstance(support, Box):
        out = np.abs(x - np.array(support.centre)) - np.array(support.half)
        return np.linalg.norm(np.maximum(out, 0.0), axis=-1) + np.minimum(out.max(axis=-1), 0.0)
    if isinstance(support, Cylinder):
        far, e = x - np.array(support.centre), np.array(support.axis)
        along = far @ e
        wide = np.linalg.norm(far - along[..., None] * e, axis=-1) - support.radius
        out = np.stack([wide, np.abs(along) - support.half], axis=-1)
        return np.linalg.norm(np.maximum(out, 0.0), axis=-1) + np.minimum(out.max(axis=-1), 0.0)
    assert isinstance(support, BallOnCylinder)
    far, e = x - np.array(support.r_A), np.array(support.axis_A)
    return np.linalg.norm(far - (far @ e)[..., None] * e, axis=-1) - support.curved


def deepest_of_edges(support: NamedTuple, edges: Array) -> tuple[Array, Array]:
    """(least signed distance along the edges, least one of their ends), (n,), for edges (n, k, 2,
    3).

    The distance from a convex body is convex along an edge, and its slope is at most 1.
    """
    start, along = edges[:, :, 0], edges[:, :, 1] - edges[:, :, 0]
    first, last = depth_in(support, start), depth_in(support, start + along)
    least = np.minimum(first, last)
    ends = least.min(axis=1)
    some = first + last < np.linalg.norm(along, axis=-1)
    least[some] = np.minimum(least[some], least_along(support, start[some], along[some]))
    return least.min(axis=1), ends


def least_along(support: NamedTuple, start: Array, along: Array) -> Array:
    """Least signed distance of each edge, (m,), by the golden section."""
    low, high = np.zeros((len(start), 1)), np.ones((len(start), 1))
    for _ in range(ROUNDS):
        a, b = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        left = depth_in(support, start + a * along)[:, None]
        right = depth_in(support, start + b * along)[:, None]
        low, high = np.where(left > right, a, low), np.where(left > right, high, b)
    return depth_in(support, start + 0.5 * (low + high) * along)


def entering(sides: Sides, turn: Array, shift: Array) -> Array:
    """Least signed distance of the support's edges (of a box) or extreme rim points (of a cylinder)
    from the body's own box, (n,).

    turn, shift: from the parent's coordinates to the body's.
    """
    support, own = sides.support, sides.own
    if isinstance(support, Box):
        edges = edges_of_box(support).reshape(-1, 3)
        at = np.stack([turned(turn, point) + shift for point in edges], axis=1)
        return deepest_of_edges(own, at.reshape(len(shift), -1, 2, 3))[0]  # type: ignore[arg-type]
    if not isinstance(support, Cylinder):
        return np.full(len(shift), np.inf)
    e, centre = turned(turn, np.array(support.axis)), turned(turn, np.array(support.centre)) + shift
    found = []
    for normal in np.concatenate([np.eye(3), -np.eye(3)]):
        across = normal - (e @ normal)[:, None] * e
        size = np.linalg.norm(across, axis=1, keepdims=True)
        rim = support.radius * across / np.maximum(size, 1e-300)
        for end in (support.half, -support.half):
            found.append(depth_in(own, centre + end * e - rim))  # type: ignore[arg-type]
    return np.array(found, dtype=float).min(axis=0)


def poses(sides: Sides, times: Array, y: Array) -> tuple[Array, Array]:
    """(turn, shift) from the body's coordinates to the support's, at each of the rows of y."""
    b, a = WIDTH * sides.body, WIDTH * sides.parent
    turn_B, p_B = y[:, b + 3 : b + 7], y[:, b : b + 3]
    if sides.parent >= 0:
        turn_A, p_A = y[:, a + 3 : a + 7], y[:, a : a + 3]
    elif isinstance(sides.motion, Resting):
        return turn_B, p_B
    else:
        states = [carrier(sides.motion, t, WORLD)[0] for t in times]
        turn_A = np.array([state.q_WB for state in states])
        p_A = np.array([state.p_WC for state in states])
    back = conjugate(turn_A)
    return product(back, turn_B), turned(back, p_B - p_A)


def moved(edges: Array, least: float) -> NDArray[np.intp]:
    """Indices of the first pose, and of those in which an end is farther from there than
    `least`."""
    away = np.abs(edges - edges[0]).max(axis=(1, 2, 3)) > least
    away[0] = True
    return np.flatnonzero(away)


def refuse_sunk(all_sides: tuple[Sides, ...], times: Any, y: Array, sunk: float = SOLVED) -> None:
    """Raise SimulationError if a side is deeper in its support than its contact points.

    y: states at the times, (n, at least WIDTH per body); sunk: allowed depth relative to the
    thickness of side and support, so that small bodies in wide scenes are judged by their own size.
    """
    if not len(times):
        return
    for sides in all_sides:
        allowed = sunk * thickness(sides)
        turn, shift = poses(sides, times, y)
        flat = [turned(turn, point) + shift for point in sides.edges.reshape(-1, 3)]
        edges = np.stack(flat, axis=1).reshape(len(shift), -1, 2, 3)
        seen = moved(edges, LEAST_MOVE * allowed)
        least, ends = deepest_of_edges(sides.support, edges[seen])
        if sides.own is not None:
            turn, shift = poses(sides, np.asarray(times)[seen], y[seen])
            back = conjugate(turn)
            least = np.minimum(least, entering(sides, back, -turned(back, shift)))
        deeper = np.minimum(ends, 0.0) - least
        bad = np.flatnonzero(deeper > allowed)
        if len(bad):
            depth, t = deeper[bad[0]], times[seen[bad[0]]]
            raise SimulationError(
                f"the body penetrates the support of contact {sides.name} by {depth:.2g} m at "
                f"t = {t:.9g} s: only its corners and ends make contact here; add points between "
                "them, or use simulation.method time_stepping for two boxes"
            )


# Checks between samples, so that nothing passes through a support if samples are rare.
#
# Sides are checked at samples, and whenever bodies may have moved relative to each other by a
# fraction of the thickness of the support; distant bodies are not checked, bodies at rest once in a
# step. A check is a sample of its own, so that the motion does not change.


SHARE = 0.05
"""Relative motion of the bodies between two checks, relative to the thickness of the support."""
MOST = 64
"""Maximum number of checks that are planned from one state."""
BETWEEN = 4.0
"""Largest speed of a side within a step, relative to the larger one at its ends."""


def thickness(sides: Sides) -> float:
    """Smaller one of the support's thickness and the longest edge [m]."""
    support: Any = sides.support
    if isinstance(support, Box):
        through = 2.0 * min(support.half)
    elif isinstance(support, Cylinder):
        through = 2.0 * min(support.radius, support.half)
    else:
        through = 2.0 * support.curved
    if isinstance(sides.own, Box):
        return min(through, 2.0 * max(sides.own.half))
    return min(through, float(np.linalg.norm(sides.edges[0, 1] - sides.edges[0, 0])))


def reach(sides: Sides) -> float:
    """Distance of the farthest point of the sides from C [m]."""
    return float(np.linalg.norm(sides.edges, axis=-1).max())


def way_there(sides: Sides, t: float, y: Array) -> float:
    """Lower bound of the distance of the sides from the support [m]."""
    _, shift = poses(sides, np.array([t]), y[None, :])
    return max(0.0, float(depth_in(sides.support, shift)[0]) - reach(sides))


def speed_over(sides: Sides, t: float, y: Array) -> float:
    """Upper bound of the speed of the sides relative to the support [m/s]."""
    B, A = state_of(y, sides.body), state_of(y, sides.parent)
    if sides.parent < 0:
        A, _, _, _ = carrier(sides.motion, t, WORLD)
    w_B, w_A = rotate(B.q_WB, B.w_WB_B), rotate(A.q_WB, A.w_WB_B)
    of_centre = sub(sub(B.v_WC, A.v_WC), cross(w_A, sub(B.p_WC, A.p_WC)))
    spin = unrotate(B.q_WB, sub(w_B, w_A))  # spin of a rod about its axis does not move its side
    return float(norm(of_centre) + np.linalg.norm(np.cross(spin, sides.edges), axis=-1).max())


def quiet(all_sides: tuple[Sides, ...], t: float, y: Array, t1: float, y1: Array) -> bool:
    """Whether no side moves far in the step from t to t1, by the speeds at both ends."""
    for sides in all_sides:
        fastest = max(speed_over(sides, t, y), speed_over(sides, t1, y1))
        if BETWEEN * fastest * (t1 - t) > SHARE * thickness(sides):
            return False
    return True


def next_looks(
    all_sides: tuple[Sides, ...], system: Any, t: float, y: Array, most: int = MOST
) -> Array:
    """The times of the next checks after t, if accelerations are at most the scene's."""
    pull = system.speed**2 / system.length
    after = []
    for sides in all_sides:
        v, part = speed_over(sides, t, y), SHARE * thickness(sides)
        ways = way_there(sides, t, y) + part * np.arange(1, most + 1)
        after.append(2.0 * ways / (v + np.sqrt(v * v + 2.0 * pull * ways)))
    looks: Array = t + np.array(after).min(axis=0)
    return looks[looks > t]


def run_looking(
    motion: Any,
    run: Callable[[Array, Array | None], int],
    all_sides: tuple[Sides, ...],
    times: Array,
    out: Array | None,
    sunk: float = SOLVED,
) -> int:
    """Call `run` to the times, and check the sides at samples and between them; see Motion.run_to.

    Checks beyond the last time are kept in `motion.looks` for the next call, so that the times of
    checks depend on the motion alone. Raises SimulationError as `refuse_sunk`.
    """
    times = np.asarray(times, dtype=float)
    if not all_sides:
        return run(times, out)
    done = 0
    while done < len(times):
        looks = _planned(motion, all_sides)
        upto = len(times)  # without distinct times of checks
        if len(looks):
            upto = done + int(np.searchsorted(times[done:], looks[-1], side="right"))
        now = looks[looks < times[-1]]
        at = np.union1d(times[done:upto], now)
        rows = np.zeros((len(at), motion.width))
        try:
            run(at, rows)
        finally:
            if out is not None:
                out[done:upto] = rows[np.searchsorted(at, times[done:upto])]
        seen = np.isin(at, looks) if out is None else np.full(len(at), True)
        refuse_sunk(all_sides, at[seen], rows[seen], sunk)
        motion.looks = at[-1], np.array(motion.coordinates), looks[looks > at[-1]]
        done = upto
    return done


def _planned(motion: Any, all_sides: tuple[Sides, ...]) -> Array:
    """The times of the next checks: those that remain, unless the state has been set since."""
    t, y = motion.time, np.asarray(motion.coordinates)
    if motion.looks is not None:
        planned, there, looks = motion.looks
        if len(looks) and planned == t and np.array_equal(there, y):
            return looks
    t1, y1 = motion.step_end
    if t1 > t and quiet(all_sides, t, y, t1, y1):
        return next_looks(all_sides, motion.compiled.system, t1, y1, most=1)
    return next_looks(all_sides, motion.compiled.system, t, y)
