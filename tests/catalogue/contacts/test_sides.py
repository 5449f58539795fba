"""Which edges may sink into which support, of boxes and rods in scenes by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.catalogue.contacts.touching import edges_of_box, sides_of
from rb_sim.catalogue.geometry.carriers import Resting, Shaken
from rb_sim.catalogue.geometry.pairs import BallOnCylinder
from rb_sim.catalogue.geometry.solids import Box, Cylinder
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.place import InitialPlace
from tests.contact.scenes import body, scene, touch

SIZE = np.array([0.4, 0.6, 1.0])
CENTRE = [0.1, 0.2, 0.3]
BOX = {"type": "box", "size": SIZE.tolist(), "center_B": CENTRE}
ROD: dict[str, Any] = {"type": "rod", "length": 0.8, "axis_B": [0.0, 0.6, 0.8], "center_B": CENTRE}
DRUM = {"type": "cylinder", "radius": 0.5, "length": 0.6, "axis_B": [1, 0, 0]}
LOG = {"type": "cylinder", "axis": [1, 0, 0], "radius": 0.5, "side": "outside"}
OWN = {"surface": {"type": "shape"}, "parent": "a"}


def found(shape: Any, support: Any = None, **contact: Any) -> Any:
    """The sides of a body of that shape on the shape of `a`, or on the surface that is given."""
    bodies = {
        "a": body(support or DRUM, [0, 0, 0], inertia=[0.1, 0.2, 0.25]),
        "body": body(shape, [0, 0, 2], inertia=[0.1, 0.2, 0.25]),
    }
    mapping = scene(bodies, touch(**contact))
    loaded = scene_from_mapping(mapping)
    place, spec = InitialPlace(loaded), loaded.constraints["floor"]
    index = {name: i for i, name in enumerate(loaded.bodies)}
    return sides_of("floor", spec, spec.parts(place)[0], index, place)


def test_a_box_has_twelve_edges() -> None:
    """Four along each axis, each with another pair of signs across it."""
    edges = edges_of_box(Box((1.0, 2.0, 3.0), (0.5, 0.3, 0.2)))
    assert edges.shape == (12, 2, 3)
    away = np.abs(edges - np.array([1.0, 2.0, 3.0]))
    assert_allclose(away, np.broadcast_to([0.5, 0.3, 0.2], away.shape))
    along = np.abs(edges[:, 1] - edges[:, 0])
    assert sorted(along.round(12).tolist()) == sorted(
        [[1.0, 0.0, 0.0]] * 4 + [[0.0, 0.6, 0.0]] * 4 + [[0.0, 0.0, 0.4]] * 4
    )
    assert len({tuple(middle) for middle in edges.mean(axis=1).round(12).tolist()}) == 12


def test_the_edges_of_a_box_on_a_drum_and_whose_they_are() -> None:
    sides = found(BOX, **OWN)
    assert (sides.name, sides.body, sides.parent) == ("floor", 1, 0)
    assert isinstance(sides.support, Cylinder) and isinstance(sides.motion, Resting)
    assert_allclose(sides.own.half, 0.5 * SIZE)
    assert_allclose(sides.edges, edges_of_box(sides.own))
    assert_allclose(sides.edges.mean(axis=(0, 1)), CENTRE)


def test_a_rod_is_one_edge() -> None:
    sides = found(ROD, BOX, **OWN)
    assert sides.own is None and isinstance(sides.support, Box)
    ((start, end),) = sides.edges
    arm = 0.4 * np.array(ROD["axis_B"])
    assert_allclose([start, end], np.array(CENTRE) + [-arm, arm])


def test_a_cylinder_that_is_no_body() -> None:
    shaken = {"type": "shaken", "direction": [0, 0, 1], "amplitude": 0.01, "frequency": 2.0}
    sides = found(ROD, surface=LOG, motion=shaken)
    assert isinstance(sides.support, BallOnCylinder) and sides.parent == -1
    assert isinstance(sides.motion, Shaken)


@pytest.mark.parametrize(
    ("shape", "contact"),
    [
        (BOX, {"surface": LOG | {"side": "inside", "radius": 3.0}}),
        (BOX, {"surface": {"type": "plane"}}),
        (BOX, OWN | {"points": [[0, 0, 0.5], [0, 0, -0.5]]}),
        ({"type": "sphere", "radius": 0.2}, OWN),
    ],
    ids=["in a pipe", "on a plane", "points", "a ball"],
)
def test_what_has_no_sides(shape: Any, contact: Any) -> None:
    assert found(shape, **contact) is None
