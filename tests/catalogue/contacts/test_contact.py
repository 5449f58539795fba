"""What the mapping of a contact says to the laws, and to the points of it."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rb_sim.base.errors import SceneError
from rb_sim.catalogue.contacts import contact as contacts
from rb_sim.catalogue.contacts import friction
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.place import InitialPlace
from tests.contact.scenes import ball, box, scene, touch

COULOMB = {"type": "coulomb", "static": 0.5, "kinetic": 0.4}
SOFT = {"compliance": {"stiffness": 100.0, "damping": 2.0}}


def spec(body: dict[str, Any] | None = None, **more: Any) -> tuple[Any, InitialPlace]:
    given = scene_from_mapping(scene(body or ball([0.0, 0.0, 0.1]), touch(**more)))
    return given.constraints["floor"], InitialPlace(given)


@pytest.mark.parametrize(
    ("law", "static", "kinetic", "drags"),
    [
        (COULOMB, 0.5, 0.4, False),
        ({"type": "coulomb", "static": 0.5}, 0.5, 0.5, False),
        ({"type": "coulomb", "static": 0.0}, 0.0, 0.0, False),
        ({"type": "rough"}, math.inf, math.inf, False),
        ({"type": "viscous", "coefficient": 3.0}, 0.0, 0.0, True),
        ({"type": "regularised", "coefficient": 0.3, "speed": 0.01}, 0.0, 0.0, False),
    ],
)
def test_the_law_of_friction(law: Any, static: float, kinetic: float, drags: bool) -> None:
    found = spec(friction=law)[0].law()
    assert (found.static, found.kinetic, found.drags) == (static, kinetic, drags)


def test_a_law_without_friction_is_that_of_a_smooth_contact() -> None:
    contact, place = spec(friction={"type": "coulomb", "static": 0.0})
    (part,) = contact.parts(place)
    assert isinstance(part.row.friction, friction.Smooth)
    (part,) = spec(friction=COULOMB)[0].parts(place)
    assert part.row.friction == friction.Coulomb(0.5, 0.4)


def test_how_a_contact_opens() -> None:
    for more, both, soft in (
        ({}, False, False),
        ({"mode": "bilateral"}, True, False),
        (SOFT, False, True),
    ):
        contact = spec(restitution=0.0, **more)[0]  # type: ignore[arg-type]
        found = contact.law()
        assert (found.bilateral, found.compliant) == (both, soft)
        assert contact.opens_rigidly is not (both or soft)
        assert found.spring == ((100.0, 2.0) if soft else (0.0, 0.0))
    assert spec(restitution=0.25)[0].law().restitution == 0.25
    with pytest.raises(SceneError, match="at most static"):
        spec(friction={"type": "coulomb", "static": 0.4, "kinetic": 0.5})


@pytest.mark.parametrize(("rolls", "spins"), [(0.0, 0.0), (0.1, 0.0), (0.0, 0.2)])
def test_resistances_are_in_a_point_where_one_of_them_is(rolls: float, spins: float) -> None:
    more = {"rolling_resistance": rolls, "spinning_resistance": spins, "friction": COULOMB}
    contact, place = spec(**more)
    (part,) = contact.parts(place)
    assert part.outputs == ("",) and part.row.spring == ()
    if rolls or spins:
        assert part.row.resistance == friction.Resistance(rolls, spins)
    else:
        assert isinstance(part.row.resistance, friction.NoResistance)
    assert (contact.law().rolling_arm, contact.law().spinning_arm) == (rolls, spins)


def test_points_are_numbered_where_there_are_several() -> None:
    contact, place = spec(box([0.2, 0.2, 0.2], [0.0, 0.0, 0.1]))
    assert [part.outputs for part in contact.parts(place)] == [("", str(k)) for k in range(1, 9)]


@pytest.mark.parametrize("mode", ["unilateral", "bilateral"])
def test_what_a_point_is_told_of_how_it_opens(monkeypatch: pytest.MonkeyPatch, mode: str) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(contacts, "pairs_of", lambda place, *what: asked.append(what) or [])
    contact, place = spec(mode=mode)
    assert contact.parts(place) == []
    body, parent, _, points, lies_flat, opens, both = asked[0]
    assert (body, parent, points, lies_flat) == ("body", None, None, contact.lies_flat)
    assert both is (mode == "bilateral") and opens is not both
