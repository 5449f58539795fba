# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reactions and motions that the contact laws do not determine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.contact.assembly import inverse_mass, spread
from rb_sim.contact.event_workspace import OPEN
from rb_sim.contact.events.instant import (
    CHOOSE,
    WRITE,
    Instant,
    Tasks,
    eigenvalues,
    not_finite,
    require_finite,
    singular_values,
)
from rb_sim.contact.events.search import LAG, LAG_TIME, ROUNDED, ROUNDED_TIME
from rb_sim.contact.grid_motion import OPEN_SHARES, LeftOpen
from rb_sim.contact.modes import JAMMED_ONES, TOO_LARGE, lay_out_held
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.contact.accelerations import OF_JOINTS, slides_with_friction
from rb_sim.mechanics.contact.contact_bodies import (
    JAMMED,
    NORMAL_SIGN,
    SHARES,
    SPRING,
)
from rb_sim.mechanics.samples import Array
from rb_sim.numerics.complementarity import EQUALITY, UNILATERAL
from rb_sim.numerics.rank import JUDGED_BY_CONTACT, solved, split

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rb_sim.contact.event_workspace import Workspace
    from rb_sim.numerics.cone_program import Cones


# Motions that are not unique.
#
# If a body has more contacts than needed, the laws do not determine how these share the load. If
# all slip in the same direction, or none slips, the motion is the same for all shares. If they slip
# in several directions, like the corners of a spinning face, friction and motion depend on them.


FAR = 1e6
"""Largest reactions that are considered, relative to the largest of the least ones."""
HALVINGS = 30
"""Number of bisections for the bounds of the shares."""

NO_SETTING = "no setting decides this; the motion from here has an error of this size"
"""Advice if no setting of the method determines the motion."""


IMPACT = "relative difference between the velocities that the impact laws allow"
LAGGED = "speed of slips too slow for the tolerance, relative to the body's,"
TURNED_BY_ROUNDING = "rotation by rounding of the tilt direction of a nearly flat rim"
PARTED = "relative difference in normal acceleration between lift-off and slip"


def reach(cones: Cones, y: Array, way: Array) -> float:
    """Largest distance along `way` from y within all bounds, at most FAR."""
    if cones.admits(y + FAR * way):
        return FAR
    inside, outside = 0.0, 1.0
    while cones.admits(y + outside * way):
        inside, outside = outside, 2.0 * outside
    for _ in range(HALVINGS):
        middle = 0.5 * (inside + outside)
        within = cones.admits(y + middle * way)
        inside, outside = (middle, outside) if within else (inside, middle)
    return inside


def open_in(at: Instant, reactions: Reactions, cones: Cones, y: Array) -> float:
    """Largest change of accelerations by other shares than y within all bounds, relative to the
    largest by loads or reactions; angular ones count by the scene's length."""
    workspace = at.workspace
    responses = at.inverse_mass @ at.pushes[reactions.held].T
    loads = workspace.free_accelerations.reshape(-1)
    weights = np.tile([1.0] * 3 + [at.system.length] * 3, len(loads) // 6)
    terms = weights * (np.abs(responses) @ np.abs(reactions.least))
    size, ways = np.linalg.svd(weights[:, None] * (responses @ reactions.self_stress))[1:]
    if not size[0] > OPEN * terms.max():
        return 0.0
    far = max(reach(cones, y, ways[0]), reach(cones, y, -ways[0]))
    if not far > 0.0:  # there is no load to share
        return 0.0
    own = responses @ reactions.least, loads / reactions.unit
    return float(far * size[0] / max(np.abs(weights * a).max() for a in own))


def note_shares(at: Instant, reactions: Reactions, cones: Cones, y: Array) -> None:
    """Store the non-uniqueness of the motion with the shares y, if it is the largest of the run."""
    table = at.system.contact_table
    sliding = [c for c in range(len(table)) if slides_with_friction(table, c)]
    if sliding:
        figure = open_in(at, reactions, cones, y)
        if figure > at.workspace.undetermined[4]:
            at.workspace.undetermined[4:7] = figure, at.t, sliding[0]


def widest_of(workspace: Workspace, names: Sequence[str]) -> LeftOpen:
    """The largest non-uniqueness by impacts and shares."""
    found = []
    for first, what in ((1, IMPACT), (4, OPEN_SHARES)):
        figure, t, contact = workspace.undetermined[first : first + 3].tolist()
        found.append(LeftOpen(figure, t, names[int(contact)], what))
    return max(found)


def widest_kept(kept: Array, names: Sequence[str]) -> LeftOpen:
    """The largest error in the table of slow slips (search): energy that friction on a slow slip
    has not dissipated, and rotation of a rim's tilt by rounding."""

    def most(figure: int, time: int) -> tuple[float, float, str]:
        c = int(np.argmax(kept[:, figure]))
        return float(kept[c, figure]), float(kept[c, time]), names[c]

    slow = LeftOpen(*most(LAG, LAG_TIME), LAGGED, by_setting=True)
    turned = LeftOpen(*most(ROUNDED, ROUNDED_TIME), TURNED_BY_ROUNDING, advice=NO_SETTING)
    return max(slow, turned)


# Shares of the reactions at rest.
#
# With redundant contacts the reactions are x = x0 + Z y, with Z the states of self-stress. The loop
# uses the least x. If these violate a bound although others do not, the loop is given the
# self-stress with the largest margin (equilibrium/equilibrium). As long as there is one with a
# margin, no contact opens or slips.


LEAST_MARGIN = 1e-11
"""Margin of the reactions from their bounds, relative to the largest reaction, below which a
contact opens or slips."""


class Reactions(NamedTuple):
    """x = x0 + Z y of the active rows, in the unit of force."""

    held: list[int]
    least: Array
    self_stress: Array
    unit: float
    bounds: int
    """number of friction bounds in the workspace."""


def share_load(at: Instant, recent: bool = False) -> bool:
    """Choose the self-stress of the contacts at rest, and write it into SHARES.

    recent: use the largest margin even if the least reactions are within all bounds. Returns False
    if the reactions are unique or there is no margin, so that a contact may open or slip; then the
    shares are just within all bounds or, if that is impossible, the least ones.
    """
    at.system.vectors[SHARES] = 0.0
    reactions = reactions_of(at)
    if reactions is None:
        return False
    from rb_sim.numerics.cone_program import moderate, widest

    cones, none = cones_of(at, reactions), np.zeros(reactions.self_stress.shape[1])
    if not recent and cones.admits(none):
        note_shares(at, reactions, cones, none)
        return True
    y = widest(cones).y
    stands = bool(cones.slack(y).min() >= LEAST_MARGIN)
    if stands:
        y = moderate(cones, y).y
        note_shares(at, reactions, cones, y)
    if stands or cones.admits(y):
        x = reactions.least + reactions.self_stress @ y
        at.system.vectors[SHARES, reactions.held] = reactions.unit * x
    return stands


def reactions_of(at: Instant) -> Reactions | None:
    """All reactions of the active rows; None if they are unique, or without contacts."""
    count, bounds = lay_out_held(at.system, at.workspace)
    if count == at.first[0]:
        return None
    held, workspace = at.workspace.used[:count].tolist(), at.workspace
    J = at.rows[held]
    A = J @ at.inverse_mass @ at.pushes[held].T
    b = J @ workspace.free_accelerations.reshape(-1) + workspace.row_bias[held]
    of = f"the reactions at rest at t = {at.t:.9g} s"
    require_finite(of, A, b)
    u, s, vt = singular_values(A, of)
    found = split(u, s, vt, JUDGED_BY_CONTACT)
    if found.rank == len(held):
        return None
    x, null = -found.least(b), found.null
    counts = np.where(np.array(held) < at.first[0], OF_JOINTS, 1.0)
    x -= null @ solved(counts[:, None] * null, counts * x)  # the least ones as `least_reactions`
    unit = float(np.abs(x).max()) or 1.0
    return Reactions(held, x / unit, null, unit, bounds)


def cones_of(at: Instant, reactions: Reactions):  # type: ignore[no-untyped-def]
    """The bounds of all closed contacts as conditions on y, each in units of a normal force."""
    from rb_sim.numerics.cone_program import Cones

    table, work, freedom = at.system.contact_table, at.workspace, reactions.self_stress.shape[1]
    count, round_ = len(reactions.held), []

    def line(i: int, factor: float = 1.0) -> tuple[float, Array]:
        factor /= work.units[i]
        return factor * float(reactions.least[i]), factor * reactions.self_stress[i]

    linear = [line(i) for i in np.flatnonzero(work.rules[:count] == UNILATERAL).tolist()]
    for m in range(reactions.bounds):
        (first, second, push), limit, c = work.bounds[m], work.limits[m], work.moves[m, 0]
        if not math.isfinite(limit):
            continue
        if push < 0:
            normal = float(table[c, SPRING]) / reactions.unit, np.zeros(freedom)
            limit /= table[c, SPRING]
        else:
            pulls = work.rules[push] == EQUALITY and table[c, NORMAL_SIGN] < 0.0
            normal = line(push, -1.0 if pulls else 1.0)
        if second >= 0:
            h, g = zip(normal, line(first, 1.0 / limit), line(second, 1.0 / limit), strict=True)
            round_.append((h, g))
        else:
            v, w = line(first, 1.0 / limit)
            linear += [(normal[0] + sign * v, normal[1] + sign * w) for sign in (1.0, -1.0)]
    return Cones(
        np.array([h for h, _ in linear]),
        np.array([g for _, g in linear]).reshape(-1, freedom),
        np.array([h for h, _ in round_]).reshape(-1, 3),
        np.array([g for _, g in round_]).reshape(-1, 3, freedom),
    )


OF = "the laws of contact"


class JammedError(SimulationError):
    """No force prevents a slipping contact from penetrating (Painleve's paradox)."""

    def __init__(self, t: float) -> None:
        super().__init__(f"no contact force satisfies Coulomb's law at t = {t:.9g} s")
        self.t = t


def choose_modes(
    at: Instant, code: tuple[int, int] | None = None, opened: frozenset[int] = frozenset()
) -> tuple[int, ...]:
    """Choose the modes of all contacts, and project y onto their manifold.

    code: (contact, kind) of the event that led here, whose mode has ended; opened: further contacts
    that must not close. Returns slipping contacts that have opened but could as well stay closed
    (negative effective pivot: Painleve). Raises SimulationError, JammedError.
    """
    at.workspace.opened[list(opened)] = 1
    contact, kind = code or (-1, -1)
    status = at.call(CHOOSE, at.t, at.y, (contact, kind, 0))
    at.workspace.opened[:] = 0  # later events may close them again
    if status == TOO_LARGE:
        raise not_finite(OF)
    if status == JAMMED_ONES:
        raise JammedError(at.t)
    if at.call.undecided:
        share_load(at)
    parted = np.flatnonzero(at.workspace.parted).tolist()
    return tuple(c for c in parted if at.effective_pivot(c) < JAMMED)


# Reactions that are not unique with redundant contacts: multipliers x without effect, W^T x = 0,
# may be added (a box on four corners, a table on four legs).


MOST_CONTACTS = 24
"""Maximum number of contact points whose modes at the start are computed for this; heaps have more,
and hardly any unique reaction."""


def undetermined_at_start(compiled: Compiled) -> tuple[str, ...]:
    """Names of the reactions that are not unique in the modes at the start."""
    laws = compiled.contact_laws
    if not laws or len(laws) > MOST_CONTACTS:
        return compiled.indeterminate
    system = compiled.system._replace(contact_table=compiled.system.contact_table.copy())
    y, call = np.array(compiled.y), Tasks(system)
    try:
        choose_modes(Instant(laws, call, 0.0, y))
    except SimulationError:  # jams at the start, with unknown forces
        return compiled.indeterminate
    call(WRITE, 0.0, y)
    directions = spread(system, system.force_rows)
    holding = np.flatnonzero(np.abs(directions).any(axis=1))
    if not len(holding):
        return compiled.indeterminate
    W = directions[holding]
    values, vectors = eigenvalues(W @ inverse_mass(system) @ W.T, "the reactions at the start")
    free = vectors[:, values <= JUDGED_BY_CONTACT * values[-1]]
    part = np.searchsorted(system.first_row, holding, side="right") - 1
    names = []
    for o, name in enumerate(compiled.layout.reactions):
        own = system.members[o, 1 + part].astype(bool)
        wrench = W[own].T @ free[own]
        if np.abs(wrench).max(initial=0.0) > OPEN * np.abs(W).max():
            names.append(name)
    return tuple(names)
