"""What a scene asks of a constraint whose points may be open: names, lines, springs."""

from __future__ import annotations

from typing import Any

import pytest

from rb_sim.catalogue.contacts.touching import Compliance, contact_lines
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.place import InitialPlace
from tests.contact.scenes import ball, body, scene, touch

ROD = body({"type": "rod", "length": 0.8}, [0, 0, 1])


@pytest.mark.parametrize(
    ("solid", "points", "reactions"),
    [
        (ball([0, 0, 1]), ("",), ("",)),
        (ROD, ("1", "2"), ("", "1", "2")),
    ],
)
def test_reactions_are_those_of_all_points_and_of_each(
    solid: dict[str, Any], points: tuple[str, ...], reactions: tuple[str, ...]
) -> None:
    loaded = scene_from_mapping(scene(solid, touch()))
    spec, place = loaded.constraints["floor"], InitialPlace(loaded)
    assert spec.contact_suffixes(place) == points
    assert spec.reaction_suffixes(place) == reactions


def test_a_point_has_three_lines_and_three_more_where_it_resists_turning() -> None:
    cases: Any = ({}, 3), ({"rolling_resistance": 0.1}, 6), ({"spinning_resistance": 1}, 6)
    for more, lines in cases:
        loaded = scene_from_mapping(scene(ball([0, 0, 1]), touch(mu=0.3, **more)))
        spec: Any = loaded.constraints["floor"]
        (part,) = spec.parts(InitialPlace(loaded))
        assert contact_lines(part.row) == lines


def test_the_spring_of_a_support_that_gives_way() -> None:
    assert Compliance(stiffness=3.0).spring == (3.0, 0.0)
    assert Compliance(stiffness=3.0, damping=2.0).spring == (3.0, 2.0)
