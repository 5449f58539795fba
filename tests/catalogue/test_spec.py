# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Field types of the specs: what they accept, what they make of it, what they refuse."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from pydantic import TypeAdapter, ValidationError
from scipy.spatial.transform import Rotation

from rb_sim.catalogue.spec import (
    Finite,
    Name,
    NonNegative,
    Numbers,
    Points,
    Positive,
    Positive3,
    Spec,
    UnitQuaternion,
    UnitVector3,
    Vector3,
    body_references,
    spec_of_type,
)
from rb_sim.scene.shapes import SymmetricInertia

components = st.floats(min_value=-1e300, max_value=1e300)


class Hinge(Spec):
    type: Literal["hinge"] = "hinge"
    body: Name
    parent: Name | None = None
    stiffness: Positive = 1.0
    locked: bool = False


class Field(Spec):
    type: Literal["field"] = "field"
    bodies: tuple[Name, ...] = ()


def read(field: Any, value: object) -> Any:
    return TypeAdapter(field).validate_python(value)


def message(field: Any, value: object) -> str:
    with pytest.raises(ValidationError) as caught:
        read(field, value)
    return caught.value.errors()[0]["msg"]


NUMBER_FIELDS = (Finite, Positive, NonNegative)
READ: list[tuple[Any, Any, Any]] = [
    (Finite, -2, -2.0),
    (NonNegative, 0, 0.0),
    *((Vector3, value, (1.0, 2.0, 3.0)) for value in ([1, 2, 3], (1, 2, 3), np.arange(1.0, 4.0))),
    (Positive3, [1, 2, 3], (1.0, 2.0, 3.0)),
    (Numbers, [1], (1.0,)),
    (Points, [[1, 2, 3]], ((1.0, 2.0, 3.0),)),
    *(
        (Name, name, name)
        for name in ("a", "Ball_2", "x" * 64, "2a", "a b", "a-b", "é", "gear (1)", "v1.2")
    ),
]
NOT_READ: list[tuple[Any, Any]] = [
    *(
        (field, value)
        for field in NUMBER_FIELDS
        for value in ("1", True, math.nan, math.inf, None, [1.0], 10**400)
    ),
    (Positive, 0.0),
    (NonNegative, -1e-300),
    *(
        (Name, name)
        for name in ("", "_a", "a ", " a", "a/b", "a=b", "a[0]", "a\n", "x" * 65, 3, None)
    ),
    *(
        (Vector3, value)
        for value in ([1, 2], [1, 2, 3, 4], "123", 3, {"x": 1}, [1, 2, "3"], [1, 2, True])
    ),
    (Positive3, [1, 0, 3]),
    (Numbers, []),
    (Points, []),
    (Points, [1, 2, 3]),
    (UnitQuaternion, [0, 0, 0, 0]),
    (UnitQuaternion, [0, 0, 1]),
    (UnitQuaternion, "0 0 0 1"),
    (UnitQuaternion, {"axis": [0, 0, 0], "angle": 1}),
    (UnitQuaternion, {"axis": [0, 0, 1]}),
    (UnitQuaternion, {"axis": [0, 0, 1], "angle": 1, "degrees": True}),
    (UnitQuaternion, {"axis": [0, 0, 1], "angle": "1"}),
]


@pytest.mark.parametrize(("field", "value", "expected"), READ)
def test_what_is_read(field: Any, value: Any, expected: Any) -> None:
    assert read(field, value) == expected


@pytest.mark.parametrize(("field", "value"), NOT_READ)
def test_what_is_refused(field: Any, value: Any) -> None:
    with pytest.raises((ValidationError, OverflowError)):
        read(field, value)


@given(st.tuples(components, components, components))
def test_unit_vector_has_length_one_and_keeps_the_direction(value: tuple[float, ...]) -> None:
    if not any(value):
        assert message(UnitVector3, value) == "must be a direction: 3 numbers, not all zero"
        return
    unit = np.array(read(UnitVector3, value))
    assert abs(np.linalg.norm(unit) - 1.0) < 1e-15
    scaled = np.array(value) / max(abs(c) for c in value)
    assert np.allclose(np.cross(unit, scaled), 0.0, atol=1e-15)
    assert unit @ scaled > 0.0


def test_what_is_normalised_stays_bit_for_bit() -> None:
    for value in ((0.6, 0.8, 0.0), (0.0, -1.0, 0.0), (1 / 3, 2 / 3, 2 / 3)):
        assert read(UnitVector3, value) == value
    once = read(UnitQuaternion, [0.1, -0.7, 0.3, 0.2])
    assert read(UnitQuaternion, once) == once


def test_tiny_and_huge_directions() -> None:
    assert read(UnitVector3, [0, 0, 5e-324]) == (0.0, 0.0, 1.0)
    assert read(UnitVector3, [1.5e308, 1.5e308, 0]) == pytest.approx((0.5**0.5, 0.5**0.5, 0.0))


def test_quaternion_from_axis_and_angle_is_scipys() -> None:
    axis, angle = np.array([1.0, -2.0, 0.5]), 2.3
    expected = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_quat()
    got = read(UnitQuaternion, {"axis": axis, "angle": angle})
    assert np.allclose(got, expected, atol=1e-15)


def test_inertia_from_principal_moments_or_rows() -> None:
    rows = ((1.0, 0.1, 0.0), (0.1, 2.0, 0.0), (0.0, 0.0, 2.5))
    assert read(SymmetricInertia, [1, 2, 2.5]) == ((1, 0, 0), (0, 2, 0), (0, 0, 2.5))
    assert read(SymmetricInertia, [list(row) for row in rows]) == rows
    assert read(SymmetricInertia, np.array(rows)) == rows


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_plane_bodies_and_thin_rods_have_an_inertia(scale: float) -> None:
    for moments in ((1, 1, 2), (0.1, 0.2, 0.3), (1, 1, 1e-9), (1, 3, 4 * (1 - 1e-12))):
        read(SymmetricInertia, [scale * moment for moment in moments])


@pytest.mark.parametrize(
    ("value", "part"),
    [
        ([1, 1, 2.00001], "2.00001 > 1 + 1"),
        ([1, 2, -2], "one is -2"),
        ([1, 1, 0], "moments > 0"),
        ([0, 0, 0], "moments > 0"),
        ([[1, 0.1, 0], [0.2, 1, 0], [0, 0, 1]], "symmetric"),
        ([[1, 2, 0], [2, 1, 0], [0, 0, 1]], "one is -1"),
        ([1, 2], "3 principal moments"),
        ([[1, 0], [0, 1]], "3 principal moments"),
        ([1, 1, [0, 0, 1]], "3 principal moments"),
        (1.0, "3 principal moments"),
    ],
)
def test_bad_inertia(value: object, part: str) -> None:
    assert part in message(SymmetricInertia, value)


@given(st.lists(st.tuples(*[st.floats(-10, 10)] * 3, st.floats(0.1, 10)), min_size=4, max_size=8))
def test_every_set_of_point_masses_in_space_has_an_inertia(
    points: list[tuple[float, float, float, float]],
) -> None:
    """The tensor of real masses is accepted, and one moment enlarged beyond the sum is not."""
    x, mass = np.array(points)[:, :3], np.array(points)[:, 3]
    x = x - mass @ x / mass.sum()
    second = np.einsum("n,ni,nj->ij", mass, x, x)
    tensor = np.trace(second) * np.eye(3) - second
    moments, axes = np.linalg.eigh(tensor)
    if moments[0] < 1e-6 * moments[2] or moments[2] < 1e-6:
        return
    read(SymmetricInertia, tensor)
    moments[2] = (moments[0] + moments[1]) * (1.0 + 1e-6)
    with pytest.raises(ValidationError):
        read(SymmetricInertia, axes @ np.diag(moments) @ axes.T)


def test_a_tensor_that_is_symmetric_but_for_rounding_becomes_its_mean() -> None:
    """Each product of inertia for itself."""
    even = np.array([[2.0, 0.1, -0.2], [0.1, 2.5, 0.3], [-0.2, 0.3, 3.0]])
    assert_allclose(read(SymmetricInertia, even), even, rtol=1e-15)
    off = even + 1e-10 * np.array([[0.0, 1.0, 2.0], [0.0, 0.0, 3.0], [0.0, 0.0, 0.0]])
    found = np.array(read(SymmetricInertia, off))
    assert (found == found.T).all()
    assert_allclose(found, 0.5 * (off + off.T), rtol=1e-15)


def test_specs_are_strict_and_frozen() -> None:
    hinge = Hinge(body="a", stiffness=2)
    with pytest.raises(ValidationError, match="frozen"):
        hinge.stiffness = 3.0  # type: ignore[misc]
    for wrong in ({"stiffness": "2"}, {"stiffness": True}, {"locked": 1}, {"locked": "yes"}):
        with pytest.raises(ValidationError):
            Hinge.model_validate({"body": "a"} | wrong)
    assert hash(hinge) == hash(Hinge(body="a", stiffness=2.0))


def test_unknown_key_names_the_known_ones() -> None:
    with pytest.raises(ValidationError) as caught:
        Hinge.model_validate({"body": "a", "stifness": 1.0})
    (error,) = caught.value.errors()
    assert error["loc"] == ("stifness",)
    assert error["msg"] == ("must be stiffness, or one of body, locked, parent, type")


def test_spec_of_type_chooses_the_class() -> None:
    kinds: dict[str, type[Spec]] = {"hinge": Hinge, "field": Field}
    assert spec_of_type(kinds, {"type": "hinge", "body": "a"}) == Hinge(body="a")
    assert spec_of_type(kinds, Hinge(body="b")) == Hinge(body="b")
    for value in (None, "hinge", {"body": "a"}, {"type": "hing"}, {"type": ["hinge"]}):
        with pytest.raises(ValueError, match="must be"):
            spec_of_type(kinds, value)


def test_body_references() -> None:
    """Of a checked entry and of the same as it stands in a file."""
    pair = {"body": "a", "parent": "b"}
    for entry in (Hinge(body="a", parent="b"), pair):
        assert [*body_references(entry)] == [(("body",), "a"), (("parent",), "b")]
    assert [*body_references(Hinge(body="a"))] == [(("body",), "a")]
    listed = [(("bodies", 0), "a"), (("bodies", 1), "b")]
    assert [*body_references(Field(bodies=("a", "b")))] == listed
    assert [*body_references({"bodies": ["a", "b"], "body": None, "parent": 3})] == listed
