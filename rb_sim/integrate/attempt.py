# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One attempt of a step, and the projection of its end state onto the constraints."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rb_sim.base.rounding import SUM_ROUNDING
from rb_sim.integrate.layout import (
    ALONG,
    AT,
    BACK,
    CHOICE,
    CHOSEN,
    DY,
    GAP,
    INSIDE,
    JACOBIAN,
    LEFT_DOMAIN,
    LENGTH,
    NOT_FINITE,
    POSITION,
    RATE,
    SETTLE,
    SHARE,
    SLOPES,
    STEP,
    TOLERANCE,
    VELOCITY,
    WAYS,
    WHOLE,
)
from rb_sim.numerics.kernels import call_law, call_step, dispatch, part

# Newton's iteration on the positions g(q) = 0 of constraint rows.
#
# A class with rows registers two kernels: the largest error, and one step of the iteration. The
# stopping rule is defined here only.


POSITION_SWEEPS = 8
ON_MANIFOLD = 2e-15
"""Position error, relative to the length of the scene, at which Newton's iteration ends: only
rounding is left."""
NEAR = 1e-9
"""Position error, relative to the scene's length, below which one step of Newton's iteration, whose
error is its square, suffices; above it more steps follow."""
LOST = 1e-6
"""Position error before the last sweep, relative to the scene's length, above which the iteration
has not converged and the state becomes NaN."""


@dispatch
def position_error(way, t, y):
    """(largest position error of the rows at (t, y) [m], these rows as `correct_positions` takes
    them)."""
    raise TypeError(f"{type(way)}: no constraint rows")


@dispatch
def correct_positions(way, t, y, rows):
    """One step of Newton's iteration on the position errors found last; y changes in place."""
    raise TypeError(f"{type(way)}: no constraint rows")


def return_to_positions(way, t, y, length, near):
    """Newton's iteration to g(q) = 0; y changes in place, velocities stay unchanged.

    It ends at rounding, when the error no longer falls, or after a step from an error within `near`
    of the scene's length (0: never). Returns (largest error found last [m], whether the rows
    evaluated last are those of the returned y).
    """
    worst, last = 0.0, math.inf
    for _ in range(POSITION_SWEEPS):
        worst, rows = position_error(way, t, y)
        if worst <= ON_MANIFOLD * length or not worst < last:
            return worst, True
        last = worst
        correct_positions(way, t, y, rows)
        if worst <= near * length:
            break
    return worst, False


# Projection of a state at the end of a step: the increment is added with compensation, quaternions
# are normalised, and the bodies are projected onto the manifold of their constraints.


def accumulate(n, y, dy, carry):
    """y + dy by Kahan's compensated summation, in place: rounding does not accumulate over the
    steps."""
    for i in range(n):
        d = dy[i] + carry[i]
        s = y[i] + d
        carry[i] = d - (s - y[i])
        y[i] = s


def copy(n, to, of):
    """Copy n numbers of array `of` into array `to`."""
    for i in range(n):
        to[i] = of[i]


class ByLaws(NamedTuple):
    """The constraint rows of a scene as laws: GAP is their largest error, POSITION an iteration
    step."""

    laws: Any
    p: Any
    at: Any
    """workspace for n coordinates."""
    n: Any


@position_error.register(ByLaws)
def error_by_laws(way, t, y):
    """The largest error, from the law GAP; the rows are a dummy 0, since POSITION knows them."""
    call_law(way.laws[GAP], t, y, way.p, way.at)
    return way.at[0], 0


@correct_positions.register(ByLaws)
def correct_by_laws(way, t, y, rows):
    """The coordinates after one iteration step, from the law POSITION."""
    call_law(way.laws[POSITION], t, y, way.p, way.at)
    copy(way.n, y, way.at)


def project_once(laws, setting, n, t, y, p, work):
    """Normalise quaternions and project y onto the constraint manifold, in place; NaN if that
    fails.

    The velocity is projected to the nearest admissible one after the position.
    """
    at, length = part(work, AT * n), setting[LENGTH]
    worst, _ = return_to_positions(ByLaws(laws, p, at, n), t, y, length, NEAR)
    if not worst <= LOST * length:
        y[0] = math.nan
    call_law(laws[VELOCITY], t, y, p, at)
    copy(n, y, at)


def project(laws, setting, n, t, y, p, work):
    """Project y onto the constraint manifold, in place."""
    if laws[BACK]:
        at = part(work, AT * n)  # fills the next row, DY, too: the increment is no longer needed
        call_law(laws[BACK], t, y, p, at)
        if at[n] <= NEAR * setting[LENGTH]:
            copy(n, y, at)
            return
    if laws[SETTLE]:
        call_law(laws[SETTLE], t, y, p, part(work, AT * n))
        copy(n, y, part(work, AT * n))
    if laws[POSITION]:
        project_once(laws, setting, n, t, y, p, work)


# One attempt of a step of given length: increment and error, then the row of the end, and the
# fraction of the step after which a piece of a law ends.


MOST_CUTS = 8
"""Most attempts to end a step where a piece of a law ends."""


def root(order, x):
    """x^(1/order)."""
    if order == 8.0:
        return math.sqrt(math.sqrt(math.sqrt(x)))
    return x ** (1.0 / order)


def relative(setting, error):
    """The error relative to the tolerance; 0 for a fixed step."""
    return error / setting[TOLERANCE] if setting[TOLERANCE] > 0.0 else 0.0


def attempt(laws, setting, n, t, old, h, p, last, work, new):
    """One step of length h from the row `old`; returns its error relative to the tolerance.

    A step that is one law writes the row `new`, otherwise `finish` does; `last` is the index of h
    among the inputs.
    """
    if laws[WHOLE]:
        p[last] = h
        call_law(laws[WHOLE], t, old, p, new)
        return relative(setting, new[2 * n + 1])
    dy = part(work, DY * n)
    error = call_step(laws[STEP], laws[RATE], laws[JACOBIAN], n, t, old, h, p, dy, work)
    return relative(setting, error)


def finish(laws, setting, n, t, old, p, work, new):
    """Write the row `new` for the end t of an accepted step."""
    if laws[WHOLE]:
        return
    copy(2 * n, new, old)
    accumulate(n, new, part(work, DY * n), part(new, n))
    project(laws, setting, n, t, new, p, work)
    total = 0.0
    for i in range(n):
        total += new[i]
    new[2 * n] = total


def share_of(laws, setting, n, t0, t, old, p, work, new):
    """Fraction of a step from the row `old` after which a piece of a law ends; 1 if none ends.

    The slopes of its stages, no longer needed, serve as workspace.
    """
    if not laws[SHARE]:
        return 1.0
    ways, workspace = int(setting[WAYS]), part(work, SLOPES * n)
    if laws[WHOLE]:
        at = new
    else:
        at = part(work, AT * n)
        for i in range(n):
            at[i] = old[i] + work[DY * n + i]
    call_law(laws[ALONG], t0, old, p, part(workspace, 2))
    call_law(laws[ALONG], t, at, p, part(workspace, 2 + 2 * ways))
    workspace[0], workspace[1] = t - t0, max(setting[TOLERANCE], SUM_ROUNDING)
    found = part(workspace, 2 + 4 * ways)
    call_law(laws[SHARE], t, workspace, p, found)
    return found[0]


def begin(laws, setting, n, t, y, p, last, work):
    """Write the inputs that are carried over or chosen for a step from the row y at t; `last` is
    the index of the step's length among them.

    They are not updated at the end of the previous step: samples within it use the same law.
    """
    if laws[CHOICE]:
        at, count = part(work, AT * n), int(setting[CHOSEN])
        call_law(laws[CHOICE], t, y, p, at)
        copy(count, part(p, last - count), at)


def ended(laws, n, t, y, p, work, status):
    """The status of a step that ended in the row y at t; `status` if the state is valid."""
    if not math.isfinite(y[2 * n]):
        return NOT_FINITE
    if laws[INSIDE]:
        at = part(work, AT * n)
        call_law(laws[INSIDE], t, y, p, at)
        if at[0] == 0.0:
            return LEFT_DOMAIN
    return status
