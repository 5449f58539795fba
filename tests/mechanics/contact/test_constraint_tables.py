# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The traced law of every kind of contact gives what its Python gives, to the last bit."""

from __future__ import annotations

import ctypes
from itertools import cycle
from typing import Any

import numpy as np
import pytest

from rb_sim.catalogue import friction
from rb_sim.catalogue.contact import ContactRow
from rb_sim.catalogue.geometry import corners_and_rims, curved, hull, pairs, smooth_surfaces, solids
from rb_sim.catalogue.geometry.corners_and_rims import RimOnCylinder
from rb_sim.catalogue.spec import WORLD, BodyState
from rb_sim.compiler.graph.machine import interpreted
from rb_sim.compiler.graph.symbols import leaves
from rb_sim.mechanics.contact.constraint_tables import GEOMETRY, OUTPUTS
from rb_sim.mechanics.contact.contact_kinematics import Kept, forces, geometry
from rb_sim.mechanics.contact.contact_laws import laws_of_kind, with_packed_hulls
from rb_sim.mechanics.inputs import numbers

STATES = 30
CORNERS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.7, 0.7, 0.7)]


class Random:
    """Points, directions and states."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def point(self, size: float = 0.3) -> Any:
        return tuple((size * self._rng.normal(size=3)).tolist())

    def unit(self, n: int = 3) -> Any:
        a = self._rng.normal(size=n)
        return tuple((a / np.linalg.norm(a)).tolist())

    def state(self) -> BodyState:
        return BodyState(self.point(1.0), self.unit(4), self.point(), self.point())

    def one_of(self, *values: float) -> float:
        return float(self._rng.choice(values))

    def kept(self) -> Kept:
        lean = corners_and_rims.Lean(self.unit(), self.point(0.3), self.one_of(-1, 0, 1, 2))
        modes = [self.one_of(0, 1, 2) for _ in range(3)]
        ahead = self.one_of(-1, 1), self.unit(), self.unit(), self.one_of(-1, 1)
        return Kept(*(lean, *modes, *ahead, 1e-9, 1e-9))


def every_pair() -> list[Any]:
    r = Random(1)
    ellipsoid = smooth_surfaces.EllipsoidSurface(r.point(0.05), (0.3, 0.2, 0.4))
    lying = smooth_surfaces.LyingRimSurface(r.point(), 0.3, r.unit())
    surfaces = [ellipsoid, lying, smooth_surfaces.SphereSurface(r.point(), 0.3)]
    bodies = [
        solids.Box(r.point(0.05), (0.3, 0.2, 0.1)),
        solids.Cylinder(r.point(0.05), 0.3, 0.2, r.unit()),
        solids.Rod(r.point(), r.unit(), 0.7),
        hull.hull_of(CORNERS),
    ]
    return [
        pairs.PointOnPlane(r.point(), r.point(), r.unit()),
        *(pairs.SurfaceOnPlane(surface, r.point(), r.unit()) for surface in surfaces),
        pairs.BallOnSphere(r.point(), 0.2, r.point(), 0.5, 1.0),
        pairs.BallOnCylinder(r.point(), 0.2, r.point(), r.unit(), 0.5, -1.0),
        *(pairs.BallOnSolid(r.point(), 0.2, body) for body in bodies),
        *(pairs.SolidOnSphere(body, r.point(), 0.4) for body in bodies),
        curved.SurfaceOnSphere(ellipsoid, r.point(), 3.0, 1.0),
        curved.SurfaceOnCylinder(ellipsoid, r.point(), r.unit(), 3.0, 1.0),
        curved.SurfaceOnSphere(lying, r.point(), 3.0, -1.0),
        corners_and_rims.RimOnPlane(r.point(), 0.3, r.unit(), 1.0, 0.0, 0.0, r.point(), r.unit()),
        corners_and_rims.RimOnPlane(r.point(), 0.3, r.unit(), 0.6, 0.8, 1.0, r.point(), r.unit()),
        RimOnCylinder(r.point(), 0.3, r.unit(), r.point(), r.unit(), 3.0, -1.0, 1.0),
        RimOnCylinder(r.point(), 0.3, r.unit(), r.point(), r.unit(), 0.5, 1.0, 0.0),
    ]


def every_row() -> list[ContactRow]:
    r = Random(2)
    laws = cycle(
        [
            friction.Coulomb(0.4, 0.3),
            friction.Viscous(0.3),
            friction.ViscousPerNormal(0.3),
            friction.Regularised(0.3, 0.1),
            friction.Rough(),
        ]
    )
    turning = cycle([friction.NoResistance(), friction.Resistance(0.1, 0.2)])
    motions = cycle(
        [
            pairs.Resting(),
            pairs.Turntable(r.point(), r.unit()),
            pairs.Shaken(r.point(), 3.0, 0.2),
        ]
    )
    springs = cycle([(), (), (100.0, 3.0)])
    return [
        ContactRow(pair, next(laws), next(turning), next(motions), next(springs))
        for pair in every_pair()
    ]


def called(law: Any, *arrays: np.ndarray) -> None:
    """law(0.7, arguments, constants, outputs)."""
    address, real = ctypes.c_void_p, ctypes.c_double
    function = ctypes.CFUNCTYPE(None, real, address, address, address)(law.address)
    function(0.7, *(array.ctypes.data for array in arrays))


def name(row: ContactRow) -> str:
    pair: Any = row.pair
    return f"{type(pair).__name__}-{type(getattr(pair, 'surface', pair)).__name__}"


@pytest.mark.skipif(interpreted(), reason="nothing is compiled")
@pytest.mark.parametrize("row", every_row(), ids=name)
def test_law_of_a_kind_is_its_python(row: ContactRow) -> None:
    r, kept_tables = Random(3), []
    in_world = not isinstance(row.carrier, pairs.Resting)
    packed = with_packed_hulls(row, kept_tables)
    opened, closed = laws_of_kind(packed, in_world)
    constants = np.array([value for _, value in numbers(packed)])
    for _ in range(STATES):
        body, parent = r.state(), WORLD if in_world else r.state()
        kept = r.kept()
        found, moving = geometry(row, 0.7, body, parent, kept.lean)
        done = forces(row, found, moving, kept)
        wanted = np.array(list(leaves((found, done))), dtype=float)
        arguments = np.array(list(leaves((body, parent, kept))), dtype=float)
        out = np.zeros((2, OUTPUTS))
        called(opened, arguments, constants, out[0])
        called(closed, arguments, constants, out[1])
        np.testing.assert_allclose(out[1, : len(wanted)], wanted, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(out[0, :GEOMETRY], wanted[:GEOMETRY], rtol=1e-12, atol=1e-13)


@pytest.mark.skipif(interpreted(), reason="nothing is compiled")
def test_kinds_share_their_laws() -> None:
    """Contacts that differ in numbers only have one law."""
    r = Random(4)
    rows = [
        ContactRow(
            pairs.PointOnPlane(r.point(), r.point(), r.unit()),
            friction.Coulomb(0.1 * k, 0.05 * k),
            friction.NoResistance(),
            pairs.Resting(),
            (),
        )
        for k in (1.0, 2.0)
    ]
    assert laws_of_kind(rows[0], True) == laws_of_kind(rows[1], True)
    assert laws_of_kind(rows[0], True) != laws_of_kind(rows[0], False)
