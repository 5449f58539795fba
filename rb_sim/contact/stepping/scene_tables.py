"""A scene with contacts as plain tables: what the kernels of time stepping see of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.errors import SceneError
from rb_sim.catalogue.contacts import friction
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.geometry import carriers, corners_and_rims, pairs, solids
from rb_sim.catalogue.geometry.boxes import MOST_POINTS
from rb_sim.catalogue.geometry.corners_and_rims import PointOnSolid
from rb_sim.catalogue.geometry.smooth_surfaces import EllipsoidSurface, SphereSurface
from rb_sim.graph.machine import interpreted
from rb_sim.integrate.layout import RATE, VELOCITY
from rb_sim.mechanics.contact.contact_bodies import AMONG_LINES, DEPENDENT
from rb_sim.mechanics.contact.contact_laws import traction_law
from rb_sim.mechanics.inputs import numbers
from rb_sim.mechanics.laws import reference
from rb_sim.scene.compiled import Compiled

POINT_PLANE, BALL_PLANE, ELLIPSOID_PLANE, RIM_PLANE, BALL_SPHERE, BALL_CYLINDER = 0, 1, 2, 3, 4, 5
BALL_BOX, BALL_SOLID_CYLINDER, BOX_SPHERE, CYLINDER_SPHERE, ROD_SPHERE = 6, 7, 8, 9, 10
BOX_BOX, OTHER = 11, 12
"""Kinds of pairs.  OTHER: what the catalogue's own function finds, called from Python."""
KIND, BODY, PARENT, FIRST, CARRIER = 0, 1, 2, 3, 4
"""Columns of Tables.entries."""
RESTS, TURNS, SHAKES = 0, 1, 2
"""Kinds of carriers."""
SIZES = 16
NEAR_WIDTH = 4
"""Columns of Tables.near."""
(STATIC, KINETIC, TRACTION, FIRST_CONSTANT, RESTITUTION, ROLLING, SPINNING,
 BILATERAL, COMPLIANT, STIFFNESS, DAMPING, ALONE, LAWS) = range(13)  # fmt: skip
"""Columns of Tables.laws; TRACTION: place of its law of traction in Tables.addresses, 0 if KINETIC
bounds the friction of what slips; FIRST_CONSTANT: where the constants of that law begin; ALONE:
whether the contact has this point only."""
LOADS = 0
"""Place in Tables.addresses of the law of the effects other than gravity."""
ROWS = RATE
"""Place of the law of the rows of the joints in Tables.joint_laws; SETTLE, GAP, POSITION and
VELOCITY lie as in all loops (integrate.layout), and VELOCITY also gives the impulses it takes."""
PERFECTLY_ROUGH = 1e300
"""Coefficient of what may not slip, which is infinite elsewhere."""


class Tables(NamedTuple):
    """Constants of a scene of N bodies with E pairs that have C points of contact."""

    bodies: np.ndarray
    """as MultiBody.bodies: mass, inertia, its inverse, work space; shape (N, 25)."""
    gravity: np.ndarray
    """acceleration of each body by uniform gravity [m/s^2], shape (N, 3)."""
    entries: np.ndarray
    """kind, body, parent (-1: world), first point, kind of carrier of each pair; (E, 5)."""
    sizes: np.ndarray
    """fields of the pair, flat, in the order of its class, shape (E, SIZES)."""
    motions: np.ndarray
    """fields of the carrier, flat, shape (E, 8)."""
    laws: np.ndarray
    """friction, restitution, compliance of each point, shape (C, LAWS)."""
    owners: np.ndarray
    """body and parent of each point, shape (C, 2)."""
    joints: np.ndarray
    """of each line of the joints body, parent, and 1 if it depends on others, shape (n, 3)."""
    joint_rows: np.ndarray
    """lines of the joints (see catalogue.constraints.rows), written from Python, shape (n, 16)."""
    scales: np.ndarray
    """length [m] and speed [m/s] of the scene."""
    near: np.ndarray = np.zeros((0, NEAR_WIDTH))
    """of each body where it was when neighbours were looked for, and its radius [m]; (N, 4), or
    (0, 4) where every pair that may touch has an entry."""
    shares: np.ndarray = np.zeros((0, 4), np.int64)
    """of each point, those of the entries that never change among them: number of the reaction on
    its body and on its parent, of the contact of the body and of the parent; (C, 4)."""
    margin: np.ndarray = np.zeros(1)
    """distance [m] below which pairs are neighbours."""
    addresses: np.ndarray = np.zeros(1, np.int64)
    """traced laws: of the loads of all effects but gravity (0: there are none), of tractions."""
    inputs: np.ndarray = np.zeros(1)
    """of the law of the loads, see mechanics.inputs; the last is not used."""
    loads: np.ndarray = np.zeros(0)
    """what that law gives: force and torque of each body, then, where some are kept from step to
    step, the inputs of the next step."""
    constants: np.ndarray = np.zeros(1)
    """of the laws of traction; the last is not used."""
    joint_laws: np.ndarray = np.zeros(VELOCITY + 1, np.int64)
    """traced laws of the joints, 0 without joints."""
    joint_inputs: np.ndarray = np.zeros(1)
    """of these laws; the last is not used."""


def flat(row: Any) -> list[float]:
    """All numbers of a row of the catalogue, in order."""
    found: list[float] = []
    for field in row:
        found += flat(field) if isinstance(field, tuple) else [float(field)]
    return found


SURFACES_ON_PLANE = {SphereSurface: BALL_PLANE, EllipsoidSurface: ELLIPSOID_PLANE}
SOLIDS_UNDER_BALL = {solids.Box: BALL_BOX, solids.Cylinder: BALL_SOLID_CYLINDER}
SOLIDS_ON_SPHERE = {
    solids.Box: BOX_SPHERE,
    solids.Cylinder: CYLINDER_SPHERE,
    solids.Rod: ROD_SPHERE,
}
PLAIN = {
    pairs.PointOnPlane: POINT_PLANE,
    corners_and_rims.RimOnPlane: RIM_PLANE,
    pairs.BallOnSphere: BALL_SPHERE,
    pairs.BallOnCylinder: BALL_CYLINDER,
}
NESTED = {
    pairs.SurfaceOnPlane: SURFACES_ON_PLANE,
    pairs.BallOnSolid: SOLIDS_UNDER_BALL,
    PointOnSolid: SOLIDS_UNDER_BALL,
    pairs.SolidOnSphere: SOLIDS_ON_SPHERE,
}
CARRIERS = {carriers.Resting: RESTS, carriers.Turntable: TURNS, carriers.Shaken: SHAKES}


def kind_of_pair(pair: Any) -> int:
    """The kind under which the kernels know a pair of the catalogue."""
    if type(pair) in NESTED:
        return NESTED[type(pair)].get(type(pair.surface), OTHER)
    return PLAIN.get(type(pair), OTHER)


class Tractions:
    """The traced laws of traction that the points of a scene have, and their constants.

    A step takes friction as a round cone, or as a force against the slip in proportion to it; the
    law says how wide the cone is, or how large the proportion, at the slip before the step.
    """

    def __init__(self) -> None:
        self.laws: list[Any] = []
        self.constants: list[float] = []
        self._found: dict[Any, tuple[int, int]] = {}

    def of(self, rubs: Any, name: str) -> tuple[int, int]:
        """(place of its law in Tables.addresses, place of its first constant); zeros of friction
        whose bound does not depend on the slip.

        Raises SceneError if a step cannot take such a friction; name: of the contact.
        """
        if isinstance(rubs, friction.BOUNDED):
            return 0, 0
        if rubs not in self._found:
            refuse_traction(rubs, name)
            self.laws.append(traction_law(rubs))
            self._found[rubs] = len(self.laws), len(self.constants)
            self.constants += [value for _, value in numbers(rubs)]
        return self._found[rubs]

    def written(self, tables: Tables) -> Tables:
        """The tables with the laws that are known so far."""
        loads = tables.addresses[:1].tolist()
        return tables._replace(
            addresses=addresses([*loads, *map(reference, self.laws)]),
            constants=np.array([*self.constants, 0.0]),
        )


def addresses(found: Sequence[Any]) -> np.ndarray:
    """Addresses of laws as loops take them; interpreted, the laws themselves."""
    return np.array(found, object if interpreted() else np.int64)


SLIPS = (0.01, 1.0, 30.0)
"""[m/s]: speeds at which a law of friction is looked at."""
ALONG = ((1.0, 0.0, 0.0), (0.0, 0.6, -0.8), (-0.36, 0.48, 0.8))
ASKEW = 1e-9
"""Part of a traction across the slip, or of one direction beside another, that is rounding."""


def refuse_traction(rubs: Any, name: str) -> None:
    """Raise SceneError unless the traction points against the slip, is as large in each direction,
    and, if the contact sticks, is proportional to N."""
    for speed in SLIPS:
        sizes = []
        for along in ALONG:
            s = tuple(speed * x for x in along)
            found = np.array(friction.traction(rubs, s, along, 0.0, False))
            sizes.append(found @ along)
            askew = np.abs(found - np.outer(sizes[-1], along)).max()
            if askew > ASKEW * np.abs(found).max() or sizes[-1].max() > 0.0:
                what = "a traction against the slip"
                raise refused(rubs, name, what)
        if np.ptp(np.array(sizes), axis=0).max() > ASKEW * np.abs(sizes).max():
            raise refused(rubs, name, "the same traction in each direction")
        if rubs.static > 0.0 and np.abs(np.array(sizes)[:, 1]).max() > 0.0:
            raise refused(rubs, name, "a traction proportional to N if it can stick")


def refused(rubs: Any, name: str, allowed: str) -> SceneError:
    return SceneError(
        f"got the law of friction {type(rubs).__name__}; must be one with {allowed} for method "
        "time_stepping; event-driven methods take it",
        key=f"constraints.{name.split('/')[0]}.friction",
    )


def tables_of(compiled: Compiled, tractions: Tractions) -> tuple[Tables, tuple[Any, ...]]:
    """(tables, the pairs of kind OTHER with None for the rest, in the order of the entries)."""
    system = compiled.system
    contacts = [placed for group in system.contacts for placed in group]
    boxes = {box.first: box for box in compiled.box_pairs}
    entries, sizes, motions, others, c = [], [], [], [], 0
    while c < len(contacts):
        placed = contacts[c]
        row, box = placed.row, boxes.get(c)
        kind = BOX_BOX if box is not None else kind_of_pair(row.pair)
        carrier = CARRIERS[type(row.carrier)]
        entries.append([kind, placed.body, placed.parent, c, carrier])
        numbers = box.sizes if box is not None else [] if kind == OTHER else flat(row.pair)
        sizes.append(padded(numbers, SIZES))
        motions.append(padded(flat(row.carrier), 8))
        others.append(row.pair if kind == OTHER else None)
        c += MOST_POINTS if box is not None else 1
    rows = int(system.first_row[len(system.constraints)])
    tables = Tables(
        bodies=system.bodies.copy(),
        gravity=gravity_of(system),
        entries=np.array(entries, np.int64).reshape(-1, 5),
        sizes=np.array(sizes).reshape(-1, SIZES),
        motions=np.array(motions).reshape(-1, 8),
        laws=laws_of(compiled, contacts, tractions),
        owners=np.array([[p.body, p.parent] for p in contacts], np.int64).reshape(-1, 2),
        joints=joint_ends(system.lines[:rows]),
        joint_rows=np.zeros((rows, system.rows.shape[1])),
        scales=np.array([system.length, system.speed]),
    )
    return tractions.written(tables), tuple(others)


def joint_ends(lines: np.ndarray) -> np.ndarray:
    """Body, parent, and whether a line depends on others."""
    dependent = (lines[:, DEPENDENT] & AMONG_LINES) != 0
    return np.column_stack([lines[:, :2], dependent]).astype(np.int64)


def padded(numbers: list[float], width: int) -> list[float]:
    return [*numbers, *[0.0] * (width - len(numbers))]


def gravity_of(system: Any) -> np.ndarray:
    """Uniform gravity on each body."""
    total = np.zeros((len(system.bodies), 3))
    for placed in system.effects:
        if isinstance(placed.row, GravityRow):
            total[placed.body] += placed.row.acceleration_W
    return total


def laws_of(compiled: Compiled, contacts: list[Any], tractions: Tractions) -> np.ndarray:
    """The table of laws, one row per point."""
    table = np.zeros((len(contacts), LAWS))
    parts = compiled.system.members[:, 1 + len(compiled.system.constraints) :]
    several = parts[parts.sum(axis=1) > 1].any(axis=0)
    table[:, ALONE] = ~several
    names = compiled.layout.contacts
    for c, (placed, law) in enumerate(zip(contacts, compiled.contact_laws, strict=True)):
        write_law(table[c], tractions.of(placed.row.friction, names[c]), law)
    return table


def write_law(row: np.ndarray, traction: tuple[int, int], law: Any) -> None:
    """Fill the row of a point in the table of laws; traction: as of `Tractions.of`."""
    row[[STATIC, KINETIC]] = min(law.static, PERFECTLY_ROUGH), min(law.kinetic, PERFECTLY_ROUGH)
    row[[TRACTION, FIRST_CONSTANT]] = traction
    row[[RESTITUTION, ROLLING, SPINNING]] = law.restitution, law.rolling_arm, law.spinning_arm
    row[[BILATERAL, COMPLIANT]] = law.bilateral, law.compliant
    row[[STIFFNESS, DAMPING]] = law.spring
