# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tables of a scene with contacts for the loop of time stepping."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.errors import SceneError
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.catalogue import friction
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.geometry.pairs import (
    BallOnCylinder,
    BallOnSolid,
    BallOnSphere,
    Resting,
    SolidOnSphere,
    touching,
)
from rb_sim.catalogue.geometry.solids import MOST_POINTS, box_points
from rb_sim.compiler.graph.machine import interpreted
from rb_sim.contact.stepping.step_workspace import Workspace, memory_of, workspace_for
from rb_sim.integrate.layout import RATE, VELOCITY
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.contact.contact_bodies import (
    AMONG_ROWS,
    DEPENDENT,
    KINETIC,
    PARAMETERS_WIDTH,
    STATIC,
    write_parameters,
)
from rb_sim.mechanics.contact.contact_laws import spot_law, traction_law, with_packed_hulls
from rb_sim.mechanics.inputs import numbers
from rb_sim.mechanics.laws import reference
from rb_sim.mechanics.systems.many_bodies import WIDTH as STATE
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.numerics.vectors import add, norm, rotate
from rb_sim.scene.initial import MISFIT, refuse_initial
from rb_sim.scene.pairs_of_bodies import Between, Pair, PairRows

LAW, BODY, PARENT, FIRST, CONSTANT, RESTS, COLUMNS = range(7)
"""Columns of Tables.entries: index of the law of the pair in Tables.addresses (BOXES: two boxes),
body, parent (-1: world), first point, index of the first constant of the law in Tables.constants, 1
if the point depends only on the poses of both bodies."""
BOXES = 0
RADIUS, ARM = 0, 1
"""Columns of Tables.sizes of a pair that is not two boxes: distance [m] over which the normal of a
round surface turns by 1 rad, or 0; distance [m] of the contact point from the body's C."""
SHARP = 0.05
"""Radius of corners and edges, relative to the scene's length."""
SIZES = 12
"""Number of columns of Tables.sizes."""
NEAR_WIDTH = 4
"""Number of columns of Tables.near."""
TRACTION, FIRST_CONSTANT, ALONE, LAWS = range(PARAMETERS_WIDTH, PARAMETERS_WIDTH + 4)
"""Columns of Tables.laws after those of contact_bodies.PARAMETERS; TRACTION: index of the law of
traction in Tables.addresses, 0 if KINETIC bounds the friction of a slip; FIRST_CONSTANT: index of
its first constant; ALONE: whether the contact has only this point."""
LOADS = 0
"""Index in Tables.addresses of the law of the effects other than gravity."""
ROWS = RATE
"""Index in Tables.joint_laws of the law of the rows; SETTLE, GAP, POSITION and VELOCITY as in all
loops (integrate/layout). The law of VELOCITY here also computes the impulses."""
PERFECTLY_ROUGH = 1e300
"""Coefficient of friction of a perfectly rough contact, which is infinite elsewhere."""


class Tables(NamedTuple):
    """Constants of a scene of N bodies with E pairs that have C points of contact."""

    bodies: np.ndarray
    """as MultiBody.bodies: mass, inertia, its inverse, workspace; shape (N, 25)."""
    gravity: np.ndarray
    """acceleration of each body by uniform gravity [m/s^2], shape (N, 3)."""
    entries: np.ndarray
    """integers of each pair, shape (E, COLUMNS)."""
    sizes: np.ndarray
    """centre and half edges of both if two boxes; else RADIUS and ARM; shape (E, SIZES)."""
    laws: np.ndarray
    """friction, restitution, compliance of each point, shape (C, LAWS)."""
    owners: np.ndarray
    """body and parent of each point, shape (C, 2)."""
    joints: np.ndarray
    """body, parent, and 1 if dependent, for each row of the joints; shape (n, 3)."""
    joint_rows: np.ndarray
    """rows of the joints (see catalogue/constraints/rows), shape (n, 16)."""
    scales: np.ndarray
    """length [m] and speed [m/s] of the scene."""
    near: np.ndarray = np.zeros((0, NEAR_WIDTH))
    """position of each body at the last search for neighbours, and its radius [m]; (N, 4), or (0,
    4) if every pair that may touch has a permanent entry."""
    shares: np.ndarray = np.zeros((0, 4), np.int64)
    """for each point, also of permanent entries: index of the reaction on its body and on its
    parent, and of the contact of each; (C, 4)."""
    margin: np.ndarray = np.zeros(1)
    """distance [m] below which pairs are neighbours."""
    addresses: np.ndarray = np.zeros(1, np.int64)
    """traced laws: of the loads of all effects except gravity (0: none), of pairs, of tractions."""
    inputs: np.ndarray = np.zeros(1)
    """of the law of the loads, see mechanics/inputs; the last is not used."""
    loads: np.ndarray = np.zeros(0)
    """results of that law: force and torque on each body, then inputs carried to the next step."""
    constants: np.ndarray = np.zeros(1)
    """of the laws of pairs and tractions; the last is not used."""
    joint_laws: np.ndarray = np.zeros(VELOCITY + 1, np.int64)
    """traced laws of the joints, 0 without joints."""
    joint_inputs: np.ndarray = np.zeros(1)
    """of these laws; the last is not used."""


class PointLaws:
    """The traced laws of the pairs and tractions of a scene, and their constants.

    A step uses friction as a circular cone, or as a force against the slip and proportional to it;
    the law computes the coefficient at the slip before the step.
    """

    def __init__(self) -> None:
        self.laws: list[Any] = []
        self.constants: list[float] = []
        self._places: dict[int, int] = {}
        self._tractions: dict[Any, tuple[int, int]] = {}
        self._hulls: list[np.ndarray] = []

    def _placed(self, law: Any, constants: list[float]) -> tuple[int, int]:
        """(index of the law in Tables.addresses, index of its first constant)."""
        if id(law) not in self._places:
            self.laws.append(law)
            self._places[id(law)] = len(self.laws)
        first = len(self.constants)
        self.constants += constants
        return self._places[id(law)], first

    def of_pair(self, row: Any, in_world: bool) -> tuple[int, int]:
        """(index of the law, of its first constant) of the pair and the carrier of a contact."""
        row = with_packed_hulls(row, self._hulls)
        law = spot_law(row.pair, row.carrier, in_world)
        return self._placed(law, [value for _, value in numbers((row.pair, row.carrier))])

    def of_traction(self, friction_law: Any, name: str) -> tuple[int, int]:
        """The same for a friction law; zeros if its bound does not depend on the slip.

        Raises SceneError if time stepping does not support the law; name: of the contact.
        """
        if isinstance(friction_law, friction.BOUNDED):
            return 0, 0
        if friction_law not in self._tractions:
            refuse_traction(friction_law, name)
            constants = [value for _, value in numbers(friction_law)]
            self._tractions[friction_law] = self._placed(traction_law(friction_law), constants)
        return self._tractions[friction_law]

    def written(self, tables: Tables) -> Tables:
        """The tables with all laws so far."""
        loads = tables.addresses[:1].tolist()
        return tables._replace(
            addresses=addresses([*loads, *map(reference, self.laws)]),
            constants=np.array([*self.constants, 0.0]),
        )


def sizes_of_pair(pair: Any, length: float) -> list[float]:
    """RADIUS and ARM of a pair; length: of the scene."""
    if isinstance(pair, BallOnSphere | BallOnCylinder):
        outside = pair.radius + pair.curved if pair.side > 0.0 else 0.0
        return [outside, norm(pair.r_B)]
    if isinstance(pair, BallOnSolid):
        return [max(pair.radius, SHARP * length), norm(pair.r_B)]
    return [pair.curved if isinstance(pair, SolidOnSphere) else 0.0, length]


def addresses(found: Sequence[Any]) -> np.ndarray:
    """Addresses of laws for loops; interpreted, the laws themselves."""
    return np.array(found, object if interpreted() else np.int64)


SLIPS = (0.01, 1.0, 30.0)
"""Speeds at which a friction law is tested [m/s]."""
ALONG = ((1.0, 0.0, 0.0), (0.0, 0.6, -0.8), (-0.36, 0.48, 0.8))


def refuse_traction(friction_law: Any, name: str) -> None:
    """Raise SceneError unless the traction is against the slip, equal in all directions and, if the
    contact can stick, proportional to N."""
    for speed in SLIPS:
        sizes = []
        for along in ALONG:
            s = tuple(speed * x for x in along)
            found = np.array(friction.traction(friction_law, s, along, 0.0, False))
            sizes.append(found @ along)
            askew = np.abs(found - np.outer(sizes[-1], along)).max()
            if askew > WRITTEN_ROUNDING * np.abs(found).max() or sizes[-1].max() > 0.0:
                what = "a traction against the slip"
                raise refused(friction_law, name, what)
        if np.ptp(np.array(sizes), axis=0).max() > WRITTEN_ROUNDING * np.abs(sizes).max():
            raise refused(friction_law, name, "the same traction in each direction")
        if friction_law.static > 0.0 and np.abs(np.array(sizes)[:, 1]).max() > 0.0:
            raise refused(friction_law, name, "a traction proportional to N if it can stick")


def refused(friction_law: Any, name: str, allowed: str) -> SceneError:
    """The error for a friction law that time stepping does not support; allowed: what it does."""
    return SceneError(
        f"got the law of friction {type(friction_law).__name__}; must be one with {allowed} for "
        "method time_stepping; event-driven methods take it",
        key=f"constraints.{name.split('/')[0]}.friction",
    )


def tables_of(compiled: Compiled, laws: PointLaws) -> Tables:
    """The tables of a scene; adds the laws of its points to `laws`."""
    system = compiled.system
    contacts = [placed for group in system.contacts for placed in group]
    boxes = {box.first: box for box in compiled.box_pairs}
    entries, sizes, c = [], [], 0
    while c < len(contacts):
        placed, box = contacts[c], boxes.get(c)
        entry, size = entry_of(
            placed.row, box.sizes if box else None, placed.parent < 0, laws, system.length
        )
        entries.append([entry[0], placed.body, placed.parent, c, *entry[1:]])
        sizes.append(size)
        c += MOST_POINTS if box is not None else 1
    rows = int(system.first_row[len(system.constraints)])
    tables = Tables(
        bodies=system.bodies.copy(),
        gravity=gravity_of(system),
        entries=np.array(entries, np.int64).reshape(-1, COLUMNS),
        sizes=np.array(sizes).reshape(-1, SIZES),
        laws=laws_of(compiled, contacts, laws),
        owners=np.array([[p.body, p.parent] for p in contacts], np.int64).reshape(-1, 2),
        joints=joint_ends(system.row_table[:rows]),
        joint_rows=np.zeros((rows, system.rows.shape[1])),
        scales=np.array([system.length, system.speed]),
    )
    return laws.written(tables)


def entry_of(
    row: Any, boxes: list[float] | None, in_world: bool, laws: PointLaws, length: float
) -> tuple[list[int], list[float]]:
    """((LAW, CONSTANT, RESTS), sizes) of a pair; boxes: centres and half edges of two boxes."""
    if boxes is not None:
        return [BOXES, 0, 0], padded(boxes, SIZES)
    law, constant = laws.of_pair(row, in_world)
    rests = int(isinstance(row.carrier, Resting))
    return [law, constant, rests], padded(sizes_of_pair(row.pair, length), SIZES)


def joint_ends(row_table: np.ndarray) -> np.ndarray:
    """Body, parent, and whether the row is dependent, for each row."""
    dependent = (row_table[:, DEPENDENT] & AMONG_ROWS) != 0
    return np.column_stack([row_table[:, :2], dependent]).astype(np.int64)


def padded(numbers: list[float], width: int) -> list[float]:
    """The numbers, followed by zeros up to this width."""
    return [*numbers, *[0.0] * (width - len(numbers))]


def gravity_of(system: Any) -> np.ndarray:
    """Uniform gravity on each body."""
    total = np.zeros((len(system.bodies), 3))
    for placed in system.effects:
        if isinstance(placed.row, GravityRow):
            total[placed.body] += placed.row.acceleration_W
    return total


def laws_of(compiled: Compiled, contacts: list[Any], laws: PointLaws) -> np.ndarray:
    """The table of laws, one row per point."""
    table = np.zeros((len(contacts), LAWS))
    parts = compiled.system.members[:, 1 + len(compiled.system.constraints) :]
    several = parts[parts.sum(axis=1) > 1].any(axis=0)
    table[:, ALONE] = ~several
    names = compiled.layout.contacts
    for c, (placed, law) in enumerate(zip(contacts, compiled.contact_laws, strict=True)):
        write_law(table[c], laws.of_traction(placed.row.friction, names[c]), law)
    return table


def write_law(row: np.ndarray, traction: tuple[int, int], law: Any) -> None:
    """Fill the row of a point in the table of laws; traction: as of `PointLaws.of_traction`."""
    write_parameters(row, law)
    row[[STATIC, KINETIC]] = np.minimum(row[[STATIC, KINETIC]], PERFECTLY_ROUGH)
    row[[TRACTION, FIRST_CONSTANT]] = traction


# Tables of a scene with a contact `between` bodies: entries of neighbouring pairs only.
#
# The entries of constraints come first and are permanent. Those of neighbours follow, in the order
# of their bodies, so that the motion does not depend on when neighbours were searched for.


STEPS_AHEAD = 20.0
"""Approximate number of steps at the present speed for which a list of neighbours is valid."""
LEAST_MARGIN = 0.1
"""Margin of neighbours at rest, relative to the smallest radius of a body."""


class Neighbours:
    """The neighbouring pairs, and the indices of their points in the tables."""

    def __init__(
        self, compiled: Compiled, between: Between, fixed: Tables, laws: PointLaws
    ) -> None:
        self._between, self._fixed, self._laws = between, fixed, laws
        self._points = len(fixed.owners)
        reactions = {name: k for k, name in enumerate(compiled.layout.reactions)}
        contacts = {name: k for k, name in enumerate(compiled.layout.contacts)}
        self._shares = {
            group: {i: (reactions[name], contacts[name]) for i, name in members.items()}
            for group, members in between.groups.items()
        }
        balls = between.radii[between.radii > 0.0]
        self._least = LEAST_MARGIN * float(balls.min())
        self._numbers: dict[int, Any] = {}
        """results of `_numbers_of` by identity of the set of points."""
        refuse_overlaps(between, compiled.y, compiled.system.length)
        self.first: dict[tuple[str, Pair], tuple[int, int]] = {}
        """first point and number of points of each pair."""

    def look(self, y: np.ndarray, h: float) -> Tables:
        """The tables with the neighbouring pairs at y; h: length of the next steps [s]."""
        fixed = self._fixed
        state = y[:-1].reshape(-1, STATE)
        speeds = np.linalg.norm(state[:, 7:10], axis=1)
        speeds += self._between.radii * np.linalg.norm(state[:, 10:13], axis=1)
        pull = np.linalg.norm(fixed.gravity, axis=1).max()
        fastest = speeds.max() + STEPS_AHEAD * h * pull
        way = (2.0 + STEPS_AHEAD) * h * (fastest + h * pull)
        margin = max(self._least, 2.0 * way, 4.0 * (2.0 + STEPS_AHEAD) * h * h * pull)
        entries, sizes, laws, owners, shares = [], [], [], [], []
        self.first = {}
        c = self._points
        for group, pair in self._between.near(y, margin):
            made, body, parent = self._between.placed(group, pair)
            found, rules = self._numbers_of(made, group)
            self.first[group, pair] = c, len(rules)
            for entry, size in found:
                entries.append((entry[0], body, parent, c, *entry[1:]))
                sizes.append(size)
                c += len(rules) // len(found)
            laws.append(rules)
            B, A = self._shares[group][body], self._shares[group][parent]
            owners += [(body, parent)] * len(rules)
            shares += [(B[0], A[0], B[1], A[1])] * len(rules)
        near = np.concatenate((state[:, :3], self._between.radii[:, None]), axis=1)
        none = np.zeros((self._points, 4), np.int64)
        added = np.array(entries, np.int64).reshape(-1, COLUMNS)
        return self._laws.written(fixed)._replace(
            entries=np.concatenate((fixed.entries, added)),
            sizes=np.concatenate((fixed.sizes, np.array(sizes).reshape(-1, SIZES))),
            laws=np.concatenate((fixed.laws, *laws)),
            owners=np.concatenate((fixed.owners, np.array(owners, np.int64).reshape(-1, 2))),
            near=np.ascontiguousarray(near.reshape(-1, NEAR_WIDTH)),
            shares=np.concatenate((none, np.array(shares, np.int64).reshape(-1, 4))),
            margin=np.array([margin]),
        )

    def _numbers_of(self, made: PairRows, group: str) -> tuple[list[Any], np.ndarray]:
        """(entries and sizes as in `entry_of`, laws of the points) of a pair."""
        if id(made) not in self._numbers:
            boxes, length = made.boxes, float(self._fixed.scales[0])
            rows = made.rows[:1] if boxes is not None else made.rows
            found = [entry_of(row, boxes, False, self._laws, length) for row in rows]
            points = MOST_POINTS if boxes is not None else len(rows)
            laws = np.zeros((points, LAWS))
            traction = self._laws.of_traction(made.rows[0].friction, group)
            for row in laws:
                write_law(row, traction, made.law)
            laws[:, ALONE] = points == 1
            self._numbers[id(made)] = found, laws
        return self._numbers[id(made)]

    def moved(
        self, before: dict[tuple[str, Pair], tuple[int, int]], memory: np.ndarray, points: int
    ) -> np.ndarray:
        """The memory of the points in their present order; before: their previous indices."""
        out = memory_of(points)
        out[: self._points] = memory[: self._points]
        for key, (first, count) in self.first.items():
            if key in before:
                at = before[key][0]
                out[first : first + count] = memory[at : at + count]
        return out


def resized(workspace: Workspace, bodies: int, points: int, joints: int) -> Workspace:
    """A workspace for another number of points, with the notes of the previous one."""
    made = workspace_for(bodies, points, joints)
    for name in ("notes", "joint_x", "joint_back", "joint_summed"):
        getattr(made, name)[:] = getattr(workspace, name)
    return made


def refuse_overlaps(between: Between, y: np.ndarray, length: float) -> None:
    """Raise SceneError if two bodies overlap at y, unless project_initial separates them."""
    if between.scene.simulation.project_initial:
        return
    for group, pair in between.near(y, 0.0):
        made, body, parent = between.placed(group, pair)
        gap = least_gap(made, state_of(y, body), state_of(y, parent))
        if not made.law.compliant and gap < -MISFIT * length:
            names = " and ".join(between.names[i] for i in pair)
            refuse_initial(between.scene, group, f"{names} overlap by {-gap:.2g} m at the start")


def least_gap(made: PairRows, B: Any, A: Any) -> float:
    """Distance of two bodies [m], negative if they overlap."""
    if made.boxes is None:
        return min(float(touching(row.pair, B, A).gap) for row in made.rows)
    s = made.boxes
    c_B = add(B.p_WC, rotate(B.q_WB, tuple(s[0:3])))
    c_A = add(A.p_WC, rotate(A.q_WB, tuple(s[6:9])))
    points, _ = box_points(A.q_WB, c_A, tuple(s[9:12]), B.q_WB, c_B, tuple(s[3:6]), 0.0)
    return float(points[:, 3].min(initial=np.inf))
