# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Work space of a step, the thresholds of stepping, and what a step tells."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import ROW_WIDTH
from rb_sim.contact.gauss_seidel import MOST_TOGETHER
from rb_sim.contact.problem import BLOCK, CONTACT_ROWS, RULES, WIDTH
from rb_sim.mechanics.systems.many_bodies import WIDTH as STATE

GAP, NORMAL, POINT, MOVES, TURNS_AT, SPOT = 0, 1, 4, 7, 10, 13
"""Columns of the table of spots: distance, n, P, velocity and spin of a support that is driven."""
IMPULSE, TWIST, PLACE, USED, CLOSED, SLIDE, ROLL, SPIN, ANCHOR, STAYS, AIM = (
    0, 3, 6, 9, 10, 11, 12, 13, 14, 17, 18,
)  # fmt: skip
"""Columns of the table of memory: impulse and its moment about P in the last step, P in the body's
axes, whether a point of two boxes is there, modes, P at the end of the step, and whether it neither
closes nor opens then; change of velocity that the normal impulse of the step is for its body."""
THEN, ENDS, MEMORY = 21, 25, 29
"""The same: velocity of the body relative to its support at P, along the normal and across it (3,
world axes), with which the step ended, in its middle and at its end."""
FEW_SWEEPS = 5
"""Sweeps of a moving heap that are made in any case."""
SWEEPS, FIRST_SWEEPS = 100, 4_000
"""At most in one step, the bound of its work; in the first, which has nothing to start from."""
TOO_FAR = 0.1
"""Turn [rad] of the arm from a body to its only point of contact, in half a step in which it bears,
above which the step is reported as too long: bearing here and then there, it is struck each
time."""
QUIET = 1e-3
"""Speed, relative to the scene's, below which a heap is solved to rounding, so that it rests."""
OFTEN, SELDOM = 0.02, 0.5
"""Steps per squared contact from one solve of a quiet heap to rounding to the next: where it has
been reached, and where it has not."""
NEAR, NEAREST, MOVES_AT = 0.1, 1e-4, 0.01
"""Of what their loads could move bodies in a step, and of the scene's length: a gap between bodies
that move which is left as it is; of the speed that loads give in a step, above which they move."""
SEPARATION_ROUNDS, SEPARATION_SWEEPS, SHIFT_ROUNDS = 6, 60, 40
"""Rounds of moving bodies apart, sweeps in each; rounds of shifting one pair alone after them."""
GYROSCOPIC_ROUNDS = 12

(
    WORK,
    RESIDUAL,
    SWEPT,
    UNSOLVED,
    WORST,
    STEPS,
    ALL_SWEEPS,
    LENGTH,
    FRESH,
    ACTIVE,
    NEXT,
    TURNED,
    SEVERAL,
    GAVE,
    STRUCK,
    ASTRAY,
    ASTRAY_AT,
    ASTRAY_OF,
    GAINED,
    MADE,
    ROUGH_SLIPS,
    OPEN_NOW,
    OPEN_OF_NOW,
    OPEN_BEFORE,
    OPEN,
    OPEN_AT,
    OPEN_OF,
    NOTES,
) = range(28)
"""Fields of `notes`: work of the contacts in the step [J]; change of the last sweep, sweeps;
steps that did not converge and the worst residual, steps and sweeps of the run; length of the last
step [s]; 1 before the first step; contacts that took part; step from which Newton's method may be
called again; steps in which a point has turned too far,
and in which a contact has Painleve's paradox; the most that contacts of a moving heap gave way, as
natural map of the laws over the largest impulse; energy that went where a rigid contact bore
already and was struck anew [J]; the largest velocity that a normal impulse gave in a direction that
the normal has left by the end of its step [m/s], when [s], and at which point;
energy that rigid contacts have given in the step, and that they have made in the run [J];
steps in which a perfectly rough contact slipped;
change of velocities that shares of a load left open in the step, relative to what impulses gave,
at which point, and in the step before; the first of the run, when [s], and at which point."""


class Workspace(NamedTuple):
    """Work space of a step, and what it tells."""

    spots: np.ndarray
    """shape (C, SPOT)."""
    polygons: np.ndarray
    """shape (4, 12, 5)."""
    active: np.ndarray
    """points that take part, shape (C,)."""
    rows: np.ndarray
    """shape (CONTACT_ROWS C, WIDTH)."""
    targets: np.ndarray
    rules: np.ndarray
    bends: np.ndarray
    """see `bends`, of the points that take part, shape (C, 4)."""
    held: np.ndarray
    """rows that hold each body, shape (N,)."""
    blocks: np.ndarray
    ends: np.ndarray
    x: np.ndarray
    joint_rows: np.ndarray
    joint_targets: np.ndarray
    joint_x: np.ndarray
    """impulses of the joints, also those of the step before."""
    joint_back: np.ndarray
    """impulses of the joints that bring velocities back to their manifold at the end of a step:
    their rows turn from its middle on, where `joint_x` holds them."""
    joint_factor: np.ndarray
    joint_spare: np.ndarray
    u: np.ndarray
    """velocities, shape (N, 6)."""
    turning: np.ndarray
    """velocities with the gyroscopic torque alone, shape (N, 6)."""
    before: np.ndarray
    """coordinates kept aside, shape (13 N + 1,)."""
    notes: np.ndarray
    """shape (NOTES,)."""
    meets: np.ndarray
    """when fast pairs meet in the step [s], see `parts`, shape (C,)."""
    summed: np.ndarray
    """impulses and twists of the parts of a step, shape (C, 6)."""
    joint_summed: np.ndarray
    """impulses of the joints in them."""
    scratch: np.ndarray
    """what the law of a pair or of a traction gets and gives, shape (2 STATE + SPOT,)."""
    joint_out: np.ndarray
    """what a law of the joints gives."""


def workspace_for(bodies: int, points: int, joints: int) -> Workspace:
    """Work space for so many bodies, points of contact and rows of joints."""
    together = joints if joints <= MOST_TOGETHER else 0
    notes = np.zeros(NOTES)
    notes[FRESH] = 1.0
    return Workspace(
        np.zeros((points, SPOT)),
        np.zeros((4, 12, 5)),
        np.zeros(points, np.int64),
        np.zeros((CONTACT_ROWS * points, WIDTH)),
        np.zeros(CONTACT_ROWS * points),
        np.zeros((points, RULES)),
        np.zeros((points, 4)),
        np.zeros(bodies),
        np.zeros((points, BLOCK)),
        np.zeros((points, 2), np.int64),
        np.zeros(CONTACT_ROWS * points),
        np.zeros((joints, WIDTH)),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros((together, together)),
        np.zeros((2, joints)),
        np.zeros((bodies, 6)),
        np.zeros((bodies, 6)),
        np.zeros(STATE * bodies + 1),
        notes,
        np.full(points, -1.0),
        np.zeros((points, 6)),
        np.zeros(joints),
        np.zeros(2 * STATE + SPOT),
        np.zeros(STATE * bodies + ROW_WIDTH * joints + 1),
    )


def memory_of(points: int) -> np.ndarray:
    """What the points of contact keep from step to step, at the start."""
    return np.zeros((points, MEMORY))
