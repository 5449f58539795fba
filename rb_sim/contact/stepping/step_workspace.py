# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Workspace and memory of time stepping, and the limits of its steps."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rb_sim.catalogue.constraints.rows import ROW_WIDTH
from rb_sim.contact.gauss_seidel import MOST_TOGETHER
from rb_sim.contact.problem import BLOCK, CONTACT_ROWS, RULES, WIDTH, zeros_of
from rb_sim.integrate.layout import INTEGER, REAL
from rb_sim.mechanics.systems.many_bodies import WIDTH as STATE

GAP, NORMAL, POINT, MOVES, TURNS_AT, SPOT = 0, 1, 4, 7, 10, 13
"""Columns of the table of spots: gap, n, P, velocity and spin of a driven support."""
IMPULSE, TWIST, PLACE, USED, CLOSED, SLIDE, ROLL, SPIN, ANCHOR, STAYS, AIM = (
    0, 3, 6, 9, 10, 11, 12, 13, 14, 17, 18,
)  # fmt: skip
"""Columns of the table of memory: impulse and its moment about P in the last step, P in body axes,
whether the slot has a point of two boxes, modes, P at the end of the step, whether the contact
neither closed nor opened, and the change of velocity of its body by the normal impulse."""
THEN, ENDS, MEMORY = 21, 25, 29
"""Further columns: velocity of the body relative to its support at P, normal and tangential (3,
world axes), at the middle of the last step and at its end; number of columns."""
FEW_SWEEPS = 5
"""Minimum number of sweeps for a moving heap."""
SWEEPS, FIRST_SWEEPS = 100, 4_000
"""Maximum number of sweeps in a step, and in the first step."""
TOO_FAR = 0.1
"""Largest rotation [rad] of the arm from a body to its only closed contact point in half a step; a
longer step is reported, since the contact has an impact in each."""
QUIET = 1e-3
"""Speed relative to the scene's below which a heap is solved to rounding, so that it stays at rest.
"""
OFTEN, SELDOM = 0.02, 0.5
"""Steps per squared number of contacts between two solves of a quiet heap to rounding: after a
solve that converged, and after one that did not."""
NEAR, NEAREST, MOVES_AT = 0.1, 1e-4, 0.01
"""NEAR, NEAREST: gap between moving bodies up to which they count as touching, relative to the
displacement by their loads in a step and to the scene's length. MOVES_AT: speed above which bodies
move, relative to the speed that loads give in a step."""
SEPARATION_ROUNDS, SEPARATION_SWEEPS, SHIFT_ROUNDS = 6, 60, 40
"""Maximum number of rounds of separating bodies, of sweeps in each, and of rounds of shifting one
pair after them."""
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
"""Fields of `notes`, in order: work of the contacts in the step [J]; change in the last sweep;
sweeps; steps that did not converge, and their largest residual; steps and sweeps of the run; length
of the last step [s]; 1 before the first step; active contacts; step from which Newton's method may
be called again; steps with a point that turned too far (TOO_FAR), and with Painleve's paradox;
largest residual of a moving heap; energy dissipated in impacts of closed rigid contacts [J];
largest velocity by an impulse along a normal that rotated [m/s], its time [s] and point; energy
gained in rigid contacts in the step, and in the run [J]; steps in which a perfectly rough contact
slipped; change of velocities by non-unique contact forces in the step, relative to that by all
impulses, its point, and the same of the step before; the first one of the run, its time [s] and
point."""


class Workspace(NamedTuple):
    """Workspace of a step, with results of the run in `notes`."""

    spots: Annotated[np.ndarray, REAL, "points", SPOT]
    polygons: Annotated[np.ndarray, REAL, 4, 12, 5]
    active: Annotated[np.ndarray, INTEGER, "points"]
    """active points."""
    rows: Annotated[np.ndarray, REAL, "rows", WIDTH]
    targets: Annotated[np.ndarray, REAL, "rows"]
    rules: Annotated[np.ndarray, REAL, "points", RULES]
    bends: Annotated[np.ndarray, REAL, "points", 4]
    """bends (see geometry) of the active points."""
    held: Annotated[np.ndarray, REAL, "bodies"]
    """number of rows that act on each body."""
    blocks: Annotated[np.ndarray, REAL, "points", BLOCK]
    ends: Annotated[np.ndarray, INTEGER, "points", 2]
    x: Annotated[np.ndarray, REAL, "rows"]
    joint_rows: Annotated[np.ndarray, REAL, "joints", WIDTH]
    joint_targets: Annotated[np.ndarray, REAL, "joints"]
    joint_x: Annotated[np.ndarray, REAL, "joints"]
    """impulses of the joints; at the start of a step those of the step before."""
    joint_back: Annotated[np.ndarray, REAL, "joints"]
    """impulses of the joints by the projection of velocities at the end of a step, whose rows have
    rotated since its middle."""
    joint_factor: Annotated[np.ndarray, REAL, "together", "together"]
    joint_spare: Annotated[np.ndarray, REAL, 2, "joints"]
    u: Annotated[np.ndarray, REAL, "bodies", 6]
    """velocities."""
    turning: Annotated[np.ndarray, REAL, "bodies", 6]
    """velocities with the gyroscopic torque alone."""
    before: Annotated[np.ndarray, REAL, "state"]
    """coordinates before the corrections at the end of a step."""
    notes: Annotated[np.ndarray, REAL, NOTES]
    meets: Annotated[np.ndarray, REAL, "points"]
    """times at which fast pairs meet in the step [s], see step_kernels."""
    summed: Annotated[np.ndarray, REAL, "points", 6]
    """impulses and twists of the parts of a step."""
    joint_summed: Annotated[np.ndarray, REAL, "joints"]
    """impulses of the joints in the parts of a step."""
    scratch: Annotated[np.ndarray, REAL, 2 * STATE + SPOT]
    """arguments and results of the law of a pair or traction."""
    joint_out: Annotated[np.ndarray, REAL, "results"]
    """results of a law of the joints."""


def workspace_for(bodies: int, points: int, joints: int) -> Workspace:
    """The workspace for these numbers of bodies, contact points and rows of joints."""
    made = zeros_of(
        Workspace, bodies=bodies, points=points, joints=joints, rows=CONTACT_ROWS * points,
        together=joints if joints <= MOST_TOGETHER else 0, state=STATE * bodies + 1,
        results=STATE * bodies + ROW_WIDTH * joints + 1,
    )  # fmt: skip
    made.notes[FRESH], made.meets[:] = 1.0, -1.0
    return made


def memory_of(points: int) -> np.ndarray:
    """The initial memory of contact points."""
    return np.zeros((points, MEMORY))
