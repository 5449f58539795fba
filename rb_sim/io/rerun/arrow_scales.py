# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Lengths and start points of the arrows in a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.base.rounding import NEGLIGIBLE, WRITTEN_ROUNDING, related
from rb_sim.io.sink import Thinned
from rb_sim.numerics.rotations import conjugate, rotate
from rb_sim.scene.extent import reach_of

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

QUIET = np.errstate(all="ignore")
"""Suppresses numpy's warnings: a diverging run has samples that overflow."""


TOUCHING = 0.01
"""Tolerance, relative to the body's size, within which a point on its surface counts as inside."""


class Scales(NamedTuple):
    """Scales of the arrows (metres in the view per unit), and the extent of the scene [m]."""

    length: float
    per_newton: float
    per_speed: float
    center: Array
    """of the scene, relative to the local origin [m]."""
    size: float
    origin: Array
    """local origin, world axes [m]: positions in the 3D view are relative to it."""


@QUIET
def scales_of(scene: Scene, layout: SampleLayout, first: SampleBlock) -> Scales:
    """Scales such that the median arrow is about half as long as the bodies, or an eighth of the
    scene's extent if that is longer."""
    points = np.concatenate([first.position, first.anchor], axis=1).reshape(-1, 3)
    margin = max((reach_of(scene.bodies[name]) for name in layout.bodies), default=0.0)
    center, size = framed(points.min(axis=0) - margin, points.max(axis=0) + margin)
    length = max(margin, size / 8.0)
    origin = local_origin(center, size)
    force = np.concatenate([first.reaction_force, first.command[..., :3]], axis=1)
    return Scales(
        length=length,
        per_newton=1.0 / nice(typical(force) / length),
        per_speed=1.0 / nice(typical(first.linear_velocity) / length),
        center=center - origin,
        size=size,
        origin=origin,
    )


FAR = 1e3
"""Distance of a scene from the world's origin, relative to its size, above which positions are
relative to a local origin: the viewer's single precision would make motion jerky."""


def local_origin(center: Array, size: float) -> Array:
    """Origin of the 3D view [m]: zero, or rounded metres near the scene if it is FAR away."""
    if not np.isfinite(center).all() or np.linalg.norm(center) <= FAR * size:
        return np.zeros(3)
    return np.round(center)


@QUIET
def framed(low: Array, high: Array) -> tuple[Array, float]:
    """Centre and size [m] of the view of a box given by two corners.

    A view is wider than high, so that height counts more.
    """
    size = max(float(np.linalg.norm(high - low)), 1.4 * float(high[2] - low[2]))
    return 0.5 * (low + high), size if 0.0 < size < np.inf else 1.0


KEPT = 4096
"""Minimum number of vector lengths from which the arrow scale of a run is found."""


class Lengths:
    """Median length of the vectors of a run of any duration, from a subset of the samples."""

    def __init__(self) -> None:
        self._longest = Thinned(1, 2 * KEPT)

    def add(self, vectors: Array) -> None:
        """Append vectors of samples, shape (n, k, 3); the longest of each sample counts."""
        longest = np.linalg.norm(vectors, axis=-1).max(axis=1, initial=0.0)
        self._longest.add(longest[:, None])

    def per_metre(self, length: float) -> float:
        """Metres of arrow per unit of the vector; the median arrow has length `length` [m]."""
        return 1.0 / nice(middle(self._longest.rows) / length)


class Extent:
    """Bounding box of the bodies' centres and the anchors of reactions over a run.

    lowest: least height of a body's centre [m].
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        """The margin is the reach of the largest body."""
        self._margin = max((reach_of(scene.bodies[n]) for n in layout.bodies), default=0.0)
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self.lowest = np.inf

    @QUIET
    def add(self, block: SampleBlock) -> None:
        """Append samples."""
        points = np.concatenate([block.position, block.anchor], axis=1).reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1)]
        self._low = np.minimum(self._low, points.min(axis=0, initial=np.inf))
        self._high = np.maximum(self._high, points.max(axis=0, initial=-np.inf))
        heights = block.position[..., 2]
        self.lowest = min(self.lowest, heights[np.isfinite(heights)].min(initial=np.inf))

    def center_and_size(self) -> tuple[Array, float]:
        """Centre and size [m] of the view, including the reach of the largest body."""
        if not np.isfinite(self._low).all():
            return np.zeros(3), 1.0
        return framed(self._low - self._margin, self._high + self._margin)


class Resolved:
    """Removes rounding from plots, whose axes would otherwise scale to it.

    length: size of the scene, for comparison of torques with forces [m].
    """

    def __init__(self, length: float) -> None:
        self._length = length
        self._largest = {"length": length, "attitude": 1.0, "angle": 180.0, "residual": 1.0}
        self._held: dict[str, Array] = {}

    def least(self, kind: str) -> float:
        """Rounding level of a kind of quantity."""
        return WRITTEN_ROUNDING * related(self._largest, self._length).get(kind, 0.0)

    @QUIET
    def __call__(self, kind: str, name: str, values: Array) -> Array:
        """Values of one kind, shape (n, m), with constants in place of rounding, continued from the
        last call for this name."""
        finite = np.abs(values[np.isfinite(values)])
        self._largest[kind] = max(self._largest.get(kind, 0.0), float(finite.max(initial=0.0)))
        least = self.least(kind)
        flat = np.ptp(values, axis=0) <= least  # False for values that are not finite
        constant = values[0]
        constant = np.where(np.abs(constant) <= least, 0.0, constant)
        before = self._held.get(name, constant)
        constant = np.where(np.abs(constant - before) <= least, before, constant)
        self._held[name] = constant
        return np.where(flat, constant, values)


@QUIET
def typical(vectors: Array) -> float:
    """Median length of the non-zero vectors, shape (..., 3); 0 if all are zero.

    The maximum would be dominated by impacts. Lengths below NEGLIGIBLE of the largest are rounding
    and do not count.
    """
    return middle(np.linalg.norm(vectors.reshape(-1, 3), axis=1))


def middle(lengths: Array) -> float:
    """Median of non-zero lengths, as in `typical`."""
    lengths = lengths[np.isfinite(lengths)]
    greatest = float(lengths.max(initial=0.0))
    if greatest == 0.0:
        return 0.0
    return float(np.median(lengths[lengths > NEGLIGIBLE * greatest]))


@QUIET
def clear_of(half: Array, center: Array, q: Array, point: Array, arrow: Array) -> Array:
    """Start points (n, 3) of arrows outside of a body: `point` moved along the arrow to the box
    around the shape, or `point` itself if it is outside.

    half: half edges of the box, body axes (3,); center: its centre, world (n, 3); q: body to world
    (n, 4).
    """
    direction = unit(arrow)
    p, d = rotate(conjugate(q), point - center), rotate(conjugate(q), direction)
    ways = np.where(np.abs(d) > 1e-12, (np.copysign(half, d) - p) / d, np.inf)
    way = np.min(ways, axis=1, keepdims=True)
    inside = (np.abs(p) <= half * (1.0 + TOUCHING) + TOUCHING * half.max()).all(axis=1)
    counts = inside[:, None] & np.isfinite(way)
    return point + np.where(counts, np.maximum(way, 0.0), 0.0) * direction


@QUIET
def unit(vectors: Array) -> Array:
    """Unit vectors, shape (n, 3); zero for zero vectors."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)


def drawn_reactions(layout: SampleLayout) -> list[int]:
    """Indices of the reactions to draw: single bearings, not their totals."""
    names = layout.reactions
    parts = {name.rpartition("/")[0] for name in names}
    return [k for k, name in enumerate(names) if name not in parts]


def nice(value: float) -> float:
    """Largest 1, 2 or 5 times a power of ten not above 1.3 value; 1 if value is not positive."""
    if not np.isfinite(value) or value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(1.3 * value))
    return float(max(m * power for m in (1, 2, 5) if m * power <= 1.3 * value))
