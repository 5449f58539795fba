# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which points of a body touch which support, for every shape and surface by hand."""

from __future__ import annotations

import math
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import TypeAdapter
from pydantic_core import PydanticCustomError

from rb_sim.catalogue import surfaces
from rb_sim.catalogue.geometry import corners_and_rims, curved, pairs, smooth_surfaces, solids
from rb_sim.catalogue.geometry.corners_and_rims import RimOnCylinder
from rb_sim.catalogue.geometry.hull import hull_of
from rb_sim.graph.symbols import leaves
from rb_sim.scene.shapes import AnyShape

COM = {"b": np.array([0.5, -0.25, 0.125]), "a": np.array([1.0, 2.0, 3.0]), None: np.zeros(3)}
"""Centres of mass in body coordinates; the world's points are its own."""
CENTRE = [0.1, 0.2, 0.3]
"""Of each shape, in body coordinates."""
AXIS, E = [0.0, 3.0, 4.0], np.array([0.0, 0.6, 0.8])
SHAPES: dict[str, dict[str, Any]] = {
    "sphere": {"radius": 0.3},
    "ellipsoid": {"semi_axes": [0.3, 0.2, 0.4]},
    "disk": {"radius": 0.3, "axis_B": AXIS},
    "cylinder": {"radius": 0.3, "length": 0.5, "axis_B": AXIS},
    "box": {"size": [0.4, 0.6, 1.2]},
    "rod": {"length": 0.8, "axis_B": AXIS},
}
AT = np.array(CENTRE) - COM["b"]
"""The centre of a shape of the body, from its centre of mass."""
ON = np.array([2.0, 1.0, -1.0])
"""A point of the surfaces, in coordinates of the parent or of the world."""
PLANE = surfaces.PlaneSurface(point=tuple(ON), normal=(0.0, 0.6, 0.8))
OWN = surfaces.BodySurface()


def ball(side: str, radius: float = 2.0) -> Any:
    return surfaces.SphereSurface(center=tuple(ON), radius=radius, side=side)  # type: ignore[arg-type]


def pipe(side: str, radius: float = 2.0) -> Any:
    return surfaces.CylinderSurface(
        point=tuple(ON),
        axis=(0.0, 0.6, 0.8),
        radius=radius,
        side=side,  # type: ignore[arg-type]
    )


def found(shape: str | None, surface: Any, parent: str | None = None, **more: Any) -> list[Any]:
    """The pairs of a body of that shape; `own`: the parent's shape."""
    given = {"b": shape, "a": more.pop("own", None)}
    models = {name: None if kind is None else model(kind) for name, kind in given.items()}
    place: Any = SimpleNamespace(
        shape=models.get, from_com=lambda name, p: tuple((np.array(p) - COM[name]).tolist())
    )
    return surfaces.pairs_of(place, "b", parent, surface, more.pop("points", None), **more)


def model(kind: str) -> Any:
    return TypeAdapter(AnyShape).validate_python({"type": kind, "center_B": CENTRE} | SHAPES[kind])


def same(one: Any, other: Any) -> None:
    """Lists of pairs of the same types and numbers."""
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        assert type(a) is type(b)
        for part, wanted in zip(a, b, strict=True):
            if hasattr(wanted, "_fields"):
                assert type(part) is type(wanted)
        got, numbers = (np.array(list(leaves(x)), dtype=float) for x in (a, b))
        assert_allclose(got, numbers, atol=1e-15)


def refused(*arguments: Any, **more: Any) -> str:
    with pytest.raises(PydanticCustomError) as error:
        found(*arguments, **more)
    return str(error.value)


@pytest.mark.parametrize("parent", [None, "a"])
def test_a_ball_on_all_that_there_is(parent: Any) -> None:
    """Places of the parent are taken from its centre of mass."""
    at, on = tuple(AT), tuple(ON - COM[parent])
    n = (0.0, 0.6, 0.8)
    same(
        found("sphere", PLANE, parent),
        [pairs.SurfaceOnPlane(smooth_surfaces.SphereSurface(at, 0.3), on, n)],
    )
    for side, sign in (("outside", 1.0), ("inside", -1.0)):
        same(found("sphere", ball(side), parent), [pairs.BallOnSphere(at, 0.3, on, 2.0, sign)])
        expected = [pairs.BallOnCylinder(at, 0.3, on, n, 2.0, sign)]
        same(found("sphere", pipe(side), parent), expected)


def test_the_parents_own_shape_is_a_support() -> None:
    at, middle = tuple(AT), tuple(np.array(CENTRE) - COM["a"])
    own = found("sphere", OWN, "a", own="sphere")
    same(own, [pairs.BallOnSphere(at, 0.3, middle, 0.3, 1.0)])
    box = solids.Box(middle, (0.2, 0.3, 0.6))
    same(found("sphere", OWN, "a", own="box"), [pairs.BallOnSolid(at, 0.3, box)])
    drum = solids.Cylinder(middle, 0.3, 0.25, tuple(E))
    same(found("sphere", OWN, "a", own="cylinder"), [pairs.BallOnSolid(at, 0.3, drum)])
    assert "a has none" in refused("sphere", OWN, "a")
    assert "a has rod" in refused("sphere", OWN, "a", own="rod")


def test_a_ball_fits_into_what_it_is_in() -> None:
    for inside, kind in ((ball, "sphere"), (pipe, "cylinder")):
        for radius in (0.3, 0.2):
            reported = refused("sphere", inside("inside", radius))
            assert f"smaller than the {kind}" in reported and f"({radius:g} m)" in reported
        assert len(found("sphere", inside("inside", 0.31))) == 1
        assert len(found("sphere", inside("outside", 0.2))) == 1


CORNERS = [AT + np.array([i * 0.2, j * 0.3, k * 0.6]) for k, j, i in product((-1, 1), repeat=3)]
ENDS = [AT + 0.4 * E, AT - 0.4 * E]


@pytest.mark.parametrize(("shape", "points"), [("box", CORNERS), ("rod", ENDS)])
def test_corners_and_ends(shape: str, points: list[np.ndarray]) -> None:
    """But outside of a sphere, where the whole surface touches."""
    n, on = (0.0, 0.6, 0.8), tuple(ON)
    at = [tuple(p) for p in points]
    same(found(shape, PLANE), [pairs.PointOnPlane(p, on, n) for p in at])
    same(found(shape, ball("inside")), [pairs.BallOnSphere(p, 0.0, on, 2.0, -1.0) for p in at])
    same(found(shape, pipe("outside")), [pairs.BallOnCylinder(p, 0.0, on, n, 2.0, 1.0) for p in at])
    solid = (
        solids.Box(tuple(AT), (0.2, 0.3, 0.6))
        if shape == "box"
        else solids.Rod(tuple(AT - 0.4 * E), tuple(E), 0.8)
    )
    same(found(shape, ball("outside")), [pairs.SolidOnSphere(solid, on, 2.0)])


def test_points_that_the_scene_lists() -> None:
    """One of them on a sphere is a ball of no size, several are the hull of them."""
    listed = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    at = [tuple(np.array(p) - COM["b"]) for p in listed]
    on, n = tuple(ON), (0.0, 0.6, 0.8)
    for shape in (None, "disk"):
        same(found(shape, PLANE, points=listed), [pairs.PointOnPlane(p, on, n) for p in at])
        one = [pairs.BallOnSphere(at[1], 0.0, on, 2.0, 1.0)]
        same(found(shape, ball("outside"), points=listed[1:2]), one)
    (pair,) = found(None, ball("outside"), points=listed)
    assert isinstance(pair, pairs.SolidOnSphere) and pair[1:] == (on, 2.0)
    for part, wanted in zip(pair[0], hull_of(at), strict=True):
        assert_allclose(part, wanted, atol=1e-15)
    inside = [pairs.BallOnSphere(p, 0.0, on, 2.0, -1.0) for p in at]
    same(found(None, ball("inside"), points=listed), inside)


RIM_CENTRES = {"disk": [AT], "cylinder": [AT + 0.25 * E, AT - 0.25 * E]}


@pytest.mark.parametrize("shape", RIM_CENTRES)
@pytest.mark.parametrize(
    ("asked", "rigid"), [(None, True), (None, False), (True, False), (False, True)]
)
def test_rims_on_a_plane(shape: str, asked: bool | None, rigid: bool) -> None:
    """Their low points first; what may lie flat has five more at angles of 60 degrees."""
    flat = asked if asked is not None else shape == "cylinder" and rigid
    on, n = tuple(ON), (0.0, 0.6, 0.8)

    def point(centre: np.ndarray, i: int) -> Any:
        c, s = math.cos(math.pi * i / 3.0), math.sin(math.pi * i / 3.0)
        return corners_and_rims.RimOnPlane(
            tuple(centre), 0.3, tuple(E), c, s, 0.0 if flat else 1.0, on, n
        )

    rest = [point(r, i) for r in RIM_CENTRES[shape] for i in range(1, 6)] if flat else []
    expected = [point(r, 0) for r in RIM_CENTRES[shape]] + rest
    same(found(shape, PLANE, lies_flat=asked, opens_rigidly=rigid), expected)


def test_what_has_no_rim_on_a_plane_cannot_lie_flat() -> None:
    for flat in (True, False):
        for shape, surface, points in (
            ("box", PLANE, None), ("disk", pipe("inside"), None), ("disk", PLANE, [[0, 0, 0]]),
            (None, PLANE, [[0, 0, 0]]),
        ):  # fmt: skip
            assert "lies_flat" in refused(shape, surface, points=points, lies_flat=flat)


@pytest.mark.parametrize("shape", RIM_CENTRES)
def test_rims_on_what_is_round(shape: str) -> None:
    """Two points of each in a pipe, of which a contact that may pull keeps one."""
    on, n = tuple(ON), (0.0, 0.6, 0.8)
    centres = [tuple(r) for r in RIM_CENTRES[shape]]

    def rim(second: float, side: float) -> list[Any]:
        given = on, n, 2.0, side, second
        return [RimOnCylinder(r, 0.3, tuple(E), *given) for r in centres]

    same(found(shape, pipe("inside")), rim(0.0, -1.0) + rim(1.0, -1.0))
    same(found(shape, pipe("inside"), bilateral=True), rim(0.0, -1.0))
    lying = [smooth_surfaces.LyingRimSurface(r, 0.3, tuple(E)) for r in centres]
    bowl = [curved.SurfaceOnSphere(surface, on, 2.0, -1.0) for surface in lying]
    same(found(shape, ball("inside")), bowl)
    solid = solids.Cylinder(tuple(AT), 0.3, 0.25 if shape == "cylinder" else 0.0, tuple(E))
    same(found(shape, ball("outside")), [pairs.SolidOnSphere(solid, on, 2.0)])
    if shape == "disk":
        same(found(shape, pipe("outside")), rim(0.0, 1.0) + rim(1.0, 1.0))
    else:
        assert "its cylinder can touch" in refused(shape, pipe("outside"))
    assert f"its {shape} can touch" in refused(shape, OWN, "a", own="box")


def test_an_ellipsoid() -> None:
    """Its largest radius of curvature is 0.4^2 / 0.2 m."""
    surface, on, n = (
        smooth_surfaces.EllipsoidSurface(tuple(AT), (0.3, 0.2, 0.4)),
        tuple(ON),
        (0.0, 0.6, 0.8),
    )
    same(found("ellipsoid", PLANE), [pairs.SurfaceOnPlane(surface, on, n)])
    for side, sign in (("outside", 1.0), ("inside", -1.0)):
        same(found("ellipsoid", ball(side)), [curved.SurfaceOnSphere(surface, on, 2.0, sign)])
        same(found("ellipsoid", pipe(side)), [curved.SurfaceOnCylinder(surface, on, n, 2.0, sign)])
    assert "its ellipsoid can touch" in refused("ellipsoid", OWN, "a", own="box")
    for hollow in (ball, pipe):
        reported = refused("ellipsoid", hollow("inside", 0.79))
        assert "0.79 m" in reported and "0.8 m" in reported
        assert len(found("ellipsoid", hollow("inside", 0.81))) == 1
        assert len(found("ellipsoid", hollow("outside", 0.79))) == 1


def test_a_body_without_a_shape_touches_with_points() -> None:
    assert "b has none" in refused(None, PLANE)
