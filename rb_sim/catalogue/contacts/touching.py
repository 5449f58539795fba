# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What touches and may part: the equations of one point, and what a scene asks of its constraint.

A contact (`contact`) and a light string (`string`) are constraints of this kind: while they are
closed they push one way along a normal, and they open where that push would have to pull.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.contacts import friction
from rb_sim.catalogue.contacts.surfaces import SOLIDS
from rb_sim.catalogue.geometry.pairs import BallOnCylinder, BallOnSolid
from rb_sim.catalogue.geometry.solids import Box, Cylinder
from rb_sim.catalogue.spec import Name, NonNegative, Positive, Spec
from rb_sim.catalogue.types import Part, Place

# Bodies whose sides may sink into a support that they touch with corners or ends alone.


class Sides(NamedTuple):
    """Edges of one body that may cross a support without a corner in it, and the reverse."""

    name: str
    """of the constraint."""
    body: int
    parent: int
    """-1: the world."""
    edges: np.ndarray
    """ends in body coordinates from C, shape (k, 2, 3)."""
    support: NamedTuple
    """Box, Cylinder or BallOnCylinder, in the parent's coordinates from C."""
    motion: NamedTuple
    """of a support in the world."""
    own: NamedTuple | None
    """the body's box, which corners and rims of the support may enter; None of a rod."""


def edges_of_box(box: Box) -> np.ndarray:
    """Shape (12, 2, 3)."""
    signs = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0
    corners = np.array(box.centre) + signs * np.array(box.half)
    pairs = [
        (i, j) for i in range(8) for j in range(i) if np.sum(signs[i] != signs[j]) == 1
    ]  # neighbours differ in one sign
    return np.array([[corners[i], corners[j]] for i, j in pairs])


def support_of_pair(pair: Any) -> NamedTuple | None:
    """The support of a corner or an end where sides may sink in; None of others."""
    if isinstance(pair, BallOnSolid) and isinstance(pair.surface, Box | Cylinder):
        return pair.surface
    return pair if isinstance(pair, BallOnCylinder) and pair.side > 0.0 else None


def sides_of(name: str, spec: Any, part: Any, index: dict[str, int], place: Place) -> Any:
    """The Sides of a contact of a box or a rod, None of others; part: its first point."""
    support = support_of_pair(part.row.pair)
    if support is None or spec.points is not None:
        return None
    shape: Any = place.shape(spec.body)
    if shape.type not in ("box", "rod"):
        return None
    solid: Any = SOLIDS[shape.type](place.from_com(spec.body, shape.center_B), shape)
    own, end = None, solid.end if shape.type == "rod" else None
    if end is None:
        own, edges = solid, edges_of_box(solid)
    else:
        edges = np.array([[end, np.array(end) + solid.length * np.array(solid.axis)]])
    parent = -1 if spec.parent is None else index[spec.parent]
    return Sides(name, index[spec.body], parent, edges, support, part.row.carrier, own)


class Compliance(Spec):
    """Compliant support: N = stiffness depth + damping (rate of depth), never negative."""

    stiffness: Positive
    """stiffness [N/m]."""
    damping: NonNegative = 0.0
    """damping [N s/m]."""

    @property
    def spring(self) -> tuple[float, float]:
        """(stiffness [N/m], damping [N s/m])."""
        return float(self.stiffness), float(self.damping)


class ContactRow(NamedTuple):
    """One point of contact: the types of its fields choose its equations."""

    pair: tuple
    friction: tuple
    resistance: tuple
    carrier: tuple
    spring: tuple
    """(stiffness, damping) of a compliant support, or () for a rigid one."""


def contact_rows(row: ContactRow) -> int:
    """Rows of one point of contact: normal and two tangents; three more if it resists turning."""
    return 3 if isinstance(row.resistance, friction.NoResistance) else 6


class ContactLaw(NamedTuple):
    """What impacts and changes of mode need to know; kernels do not see it."""

    restitution: float
    bilateral: bool
    compliant: bool
    static: float
    """coefficient that bounds the traction at rest; inf where it never slips, 0 for none."""
    kinetic: float
    """traction over N as a slip begins, of a law that can stick; inf where it never slips."""
    rolling_arm: float
    spinning_arm: float
    spring: tuple[float, float] = (0.0, 0.0)
    """stiffness [N/m] and damping [N s/m] of a compliant support."""
    closes: str = "closes"
    """what the event is called when it begins to push."""
    opens: str = "opens"
    """what it is called when it ceases to."""
    drags: bool = False
    """whether its traction does not vanish as the push does."""


class Touching(Spec):
    """A constraint whose points may be open or closed."""

    body: Name
    parent: Name | None = None

    @abstractmethod
    def law(self) -> ContactLaw:
        """What impacts and changes of mode need to know of each of its points."""

    @abstractmethod
    def parts(self, place: Place) -> list[Part]:
        """One ContactRow for each point."""

    def contact_suffixes(self, place: Place) -> tuple[str, ...]:
        """ "1", "2" ... of its points, or "" where it has one."""
        n = len(self.parts(place))
        return ("",) if n == 1 else tuple(str(i + 1) for i in range(n))

    def reaction_suffixes(self, place: Place) -> tuple[str, ...]:
        """The total, and the reaction at each point where there are several."""
        points = self.contact_suffixes(place)
        return points if len(points) == 1 else ("", *points)
