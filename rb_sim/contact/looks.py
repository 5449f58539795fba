"""Looks at sides between samples: nothing goes through a support where samples are rare.

A run is looked at not only where samples are asked for but each time that the bodies may have moved
over each other by a part of the support's thickness.  What is far away is not looked at, what rests
once in a step.  A look is a sample of its own, so that the motion is the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.catalogue.types import WORLD
from rb_sim.contact.geometry.carriers import carrier
from rb_sim.contact.geometry.solids import Box, Cylinder
from rb_sim.contact.sides import SUNK, depth_in, poses, refuse_sunk
from rb_sim.engine.systems.many_bodies import state_of
from rb_sim.maths.vectors import cross, norm, rotate, sub

if TYPE_CHECKING:
    from rb_sim.contact.scene.sides import Sides
    from rb_sim.engine.samples import Array

SHARE = 0.05
"""Part of the thickness of a support that bodies may move over each other between two looks."""
MOST = 64
"""Looks between which speeds are not read anew."""
BETWEEN = 4.0
"""Times the larger speed at its ends that a side may have within a step."""


def thickness(sides: Sides) -> float:
    """What a side has at least to cross to go through the support [m]."""
    support: Any = sides.support
    if isinstance(support, Box):
        through = 2.0 * min(support.half)
    elif isinstance(support, Cylinder):
        through = 2.0 * min(support.radius, support.half)
    else:
        through = 2.0 * support.curved
    longest = float(np.linalg.norm(sides.edges[:, 1] - sides.edges[:, 0], axis=1).max())
    return min(through, longest)


def reach(sides: Sides) -> float:
    """Distance of the farthest point of the sides from C [m]."""
    return float(np.linalg.norm(sides.edges, axis=-1).max())


def way_there(sides: Sides, t: float, y: Array) -> float:
    """Distance at least that a point of the sides has to go to be in the support [m]."""
    _, shift = poses(sides, np.array([t]), y[None, :])
    return max(0.0, float(depth_in(sides.support, shift)[0]) - reach(sides))


def speed_over(sides: Sides, t: float, y: Array) -> float:
    """Speed that no point of the sides has over the support [m/s]."""
    B, A = state_of(y, sides.body), state_of(y, sides.parent)
    if sides.parent < 0:
        A, _, _, _ = carrier(sides.motion, t, WORLD)
    w_B, w_A = rotate(B.q_WB, B.w_WB_B), rotate(A.q_WB, A.w_WB_B)
    of_centre = sub(sub(B.v_WC, A.v_WC), cross(w_A, sub(B.p_WC, A.p_WC)))
    return float(norm(of_centre) + norm(sub(w_B, w_A)) * reach(sides))


def quiet(all_sides: tuple[Sides, ...], t: float, y: Array, t1: float, y1: Array) -> bool:
    """Whether no side goes far in the step from t to t1, by the speeds at both ends."""
    for sides in all_sides:
        fastest = max(speed_over(sides, t, y), speed_over(sides, t1, y1))
        if BETWEEN * fastest * (t1 - t) > SHARE * thickness(sides):
            return False
    return True


def next_looks(
    all_sides: tuple[Sides, ...], system: Any, t: float, y: Array, most: int = MOST
) -> Array:
    """The instants after t at which to look, if speeds grow no faster than those of the scene do
    over its length."""
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
    sunk: float = SUNK,
) -> int:
    """`run` to the times, looking at the sides there and between; see Motion.run_to.

    Raises SimulationError where one lies deeper in its support than `sunk` over the scene's length.
    """
    times = np.asarray(times, dtype=float)
    if not all_sides:
        return run(times, out)
    system, done = motion.compiled.system, 0
    while done < len(times):
        t, y = motion.time, np.asarray(motion.coordinates)
        t1, y1 = motion.step_end
        if t1 > t and quiet(all_sides, t, y, t1, y1):
            looks = next_looks(all_sides, system, t1, y1, most=1)
        else:
            looks = next_looks(all_sides, system, t, y)
        if len(looks):
            upto = done + int(np.searchsorted(times[done:], looks[-1], side="right"))
            looks = looks[looks < times[-1]]
        else:  # so fast that the clock does not tell one look from the next
            upto = len(times)
        at = np.union1d(times[done:upto], looks)
        rows = np.zeros((len(at), motion.width))
        try:
            run(at, rows)
        finally:
            if out is not None:
                out[done:upto] = rows[np.searchsorted(at, times[done:upto])]
        refuse_sunk(all_sides, at, rows, system.length, sunk)
        done = upto
    return done
