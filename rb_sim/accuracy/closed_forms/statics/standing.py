"""A statics scene as its closed forms read it: supports in the world, loads about the centres."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.statics.element import Element
from rb_sim.statics.equilibrium import loads_about
from rb_sim.statics.model import StaticsScene, placed
from rb_sim.statics.supports import place_support

Array = NDArray[np.float64]

CLOSE = 1e-12
"""Relative to what is compared: below it two numbers of a scene are taken to be one."""


class ExactReactions(NamedTuple):
    """The exact answer of one scene."""

    name: str
    """what it is, and the source."""
    forces: dict[str, Array]
    """by the support on its body, world [N], (3,); those of least norm if there are many."""
    ranges: Mapping[str, tuple[float, float]] = {}
    """smallest and largest normal force [N], where the reactions are not unique."""


class Standing(NamedTuple):
    """Bodies at rest, n of them."""

    bodies: tuple[str, ...]
    elements: tuple[Element, ...]
    centres: Array
    """of mass, world [m], (n, 3)."""
    loads: Array
    """force [N] and torque about the centre of mass [N m], world, (n, 6)."""


def standing_of(scene: StaticsScene) -> Standing:
    """Place the supports and sum up the loads."""
    centres = np.array([placed(body, body.center_of_mass) for body in scene.bodies.values()])
    elements = tuple(place_support(scene, name) for name in scene.supports)
    return Standing(tuple(scene.bodies), elements, centres, loads_about(scene, centres))


class Weight(NamedTuple):
    """A single body that nothing but a force through its centre of mass loads."""

    size: float
    """[N]."""
    up: Array
    """against it, (3,)."""
    centre: Array
    """[m], (3,)."""


def weight_of(standing: Standing) -> Weight | None:
    """The load of a scene of one body, if it is a mere weight."""
    if len(standing.bodies) != 1:
        return None
    force, torque = standing.loads[0, :3], standing.loads[0, 3:]
    size = float(np.linalg.norm(force))
    if size == 0.0 or torque.any():
        return None
    return Weight(size, -force / size, standing.centres[0])


def of_kind(standing: Standing, kind: str, smooth: bool = False) -> list[Element]:
    """The supports of a kind; smooth: with one unknown only."""
    return [e for e in standing.elements if e.kind == kind and not (smooth and e.size > 1)]


def line(element: Element) -> Array:
    """Unit normal of a contact, or direction of a string away from its body; (3,)."""
    assert element.direction is not None  # contacts, strings and rods have one
    return element.direction


def same(a: Any, b: Any, scale: float = 1.0) -> bool:
    """Whether two vectors or numbers are one, but for rounding at `scale`."""
    return float(np.abs(np.subtract(a, b)).max()) <= CLOSE * scale


def pointing(elements: Iterable[Element], direction: Array) -> Element | None:
    """The first support along a unit vector."""
    return next((e for e in elements if same(line(e), direction)), None)
