"""Points held between bodies, with lines along the world's axes or along the parent's.

On the manifold of the constraints both ask for the same.  Off it, in the stages of a step, lines
along the world's axes ask for other accelerations than lines that turn with the parent, and a body
that has one of each close to each other is tilted by their difference over their distance.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

from rb_sim.catalogue.constraints.rows import (
    DistanceRow,
    PlaneRow,
    PointRow,
    SeatRow,
    SlotRow,
)
from rb_sim.catalogue.types import Placed

CLOSE = 0.1
"""Of its arms: a point held between two bodies that is closer to what else holds a point of the
same two has its lines along the parent's axes, a fifth more operations. The square of their
distance is in an error of the motion, at a tenth a twentieth of what rk4 errs by."""

TURNING = (SlotRow, PlaneRow, DistanceRow)
"""Rows that hold a point of a body as seen from its parent."""


def along_parents(system: Any) -> Any:
    """The same system, all points held between two bodies with lines along the parent's axes.

    For scenes with lines that depend on each other.  Those that are left out are chosen at the
    start; along the world's axes the choice is a bad one as soon as a loop of bodies has turned as
    a whole: the line along x cannot be left out once the direction that is held twice is normal to
    x.  Seen from the bodies that direction stays where it is.
    """
    return system._replace(constraints=tuple(_seated(c) for c in system.constraints))


def along_parents_if_close(constraints: Sequence[Placed]) -> tuple[Placed, ...]:
    """The constraints, points with lines along the parent's axes where other rows on the same two
    bodies are CLOSE."""
    of_pair: dict[tuple[int, int], list[Any]] = defaultdict(list)
    for c in constraints:
        of_pair[c.body, c.parent].append(c.row)
    close = {pair for pair, rows in of_pair.items() if pair[1] >= 0 and _close(rows)}
    return tuple(_seated(c) if (c.body, c.parent) in close else c for c in constraints)


def _close(rows: Sequence[Any]) -> bool:
    """Whether one of the points is close to what turns with the parent."""
    points = [row for row in rows if isinstance(row, PointRow)]
    others = [row.r_B for row in rows if isinstance(row, TURNING)]
    return any(
        math.dist(point.r_B, r_B) < CLOSE * max(math.hypot(*point.r_B), math.hypot(*point.r_A))
        for point in points
        for r_B in others
    )


def _seated(c: Placed) -> Placed:
    """A point between two bodies with lines along the parent's axes; all else as it is."""
    return c._replace(row=SeatRow(*c.row)) if isinstance(c.row, PointRow) and c.parent >= 0 else c
