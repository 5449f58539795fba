# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How long arrows are drawn in a recording, and where they start."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.base.rounding import NEGLIGIBLE, WRITTEN_ROUNDING
from rb_sim.io.extent import reach_of
from rb_sim.io.sink import Thinned
from rb_sim.numerics.rotations import conjugate, rotate

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

QUIET = np.errstate(all="ignore")
"""A run that blows up has samples without bounds, of which numpy would tell in words of its own."""


TOUCHING = 0.01
"""Of the size of a body, within which a point on its surface counts as inside."""


class Scales(NamedTuple):
    """How long the arrows are, in metres of the view, and how far the scene reaches [m]."""

    length: float
    per_newton: float
    per_speed: float
    center: Array
    """of the scene, from the local origin [m]."""
    size: float
    origin: Array
    """local origin in world axes [m], from which all places of the 3D view are counted."""


@QUIET
def scales_of(scene: Scene, layout: SampleLayout, first: SampleBlock) -> Scales:
    """Arrows, at the median, about half as long as the bodies, or an eighth of the way, if more."""
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
"""Distance of a scene from the world's origin, in its own sizes, from which on single precision, in
which the viewer counts, shows it by leaps: there places are counted from a local origin."""


def local_origin(center: Array, size: float) -> Array:
    """The origin of the 3D view [m]: zero, or whole metres near the scene if that is FAR away."""
    if not np.isfinite(center).all() or np.linalg.norm(center) <= FAR * size:
        return np.zeros(3)
    return np.round(center)


@QUIET
def framed(low: Array, high: Array) -> tuple[Array, float]:
    """Middle and size [m] of what the camera is to show of the box between two corners.

    A view is wider than high: what is high needs more room about it.
    """
    size = max(float(np.linalg.norm(high - low)), 1.4 * float(high[2] - low[2]))
    return 0.5 * (low + high), size or 1.0


KEPT = 4096
"""Lengths of vectors at least from which the scale of the arrows of a whole run is found."""


class Lengths:
    """The typical length of vectors of a run of any length: those of some samples are kept."""

    def __init__(self) -> None:
        self._longest = Thinned(1, 2 * KEPT)

    def add(self, vectors: Array) -> None:
        """Those of the next samples, shape (n, k, 3); of a sample the longest counts."""
        longest = np.linalg.norm(vectors, axis=-1).max(axis=1, initial=0.0)
        self._longest.add(longest[:, None])

    def per_metre(self, length: float) -> float:
        """Metres of arrow for a unit of the vector, so that at the median it has this length."""
        return 1.0 / nice(middle(self._longest.rows) / length)


class Extent:
    """The box in which the bodies and the anchors of reactions have been."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        """The boxes of all bodies count."""
        self._margin = max((reach_of(scene.bodies[n]) for n in layout.bodies), default=0.0)
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    @QUIET
    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        points = np.concatenate([block.position, block.anchor], axis=1).reshape(-1, 3)
        points = points[np.isfinite(points).all(axis=1)]
        self._low = np.minimum(self._low, points.min(axis=0, initial=np.inf))
        self._high = np.maximum(self._high, points.max(axis=0, initial=-np.inf))

    def center_and_size(self) -> tuple[Array, float]:
        """What the camera is to show, with the reach of the largest body about it [m]."""
        if not np.isfinite(self._low).all():
            return np.zeros(3), 1.0
        return framed(self._low - self._margin, self._high + self._margin)


class Resolved:
    """Takes round-off out of plots, whose axes would zoom into it; what moves stays as it is.

    length: of the scene, by which a torque is compared with forces [m].
    """

    def __init__(self, length: float) -> None:
        self._length = length
        self._largest = {"length": length, "attitude": 1.0, "angle": 180.0, "residual": 1.0}
        self._held: dict[str, Array] = {}

    def least(self, kind: str) -> float:
        """What is below is round-off. Kinds that belong together lend each other their size."""
        largest = self._largest.get(kind, 0.0)
        other, per = {
            "torque": ("force", self._length),
            "speed": ("spin", self._length),
            "spin": ("speed", 1.0 / self._length),
        }.get(kind, (kind, 1.0))
        return WRITTEN_ROUNDING * max(largest, self._largest.get(other, 0.0) * per)

    @QUIET
    def __call__(self, kind: str, name: str, values: Array) -> Array:
        """Values of one kind, shape (n, m), that go on those of this name."""
        finite = np.abs(values[np.isfinite(values)])
        self._largest[kind] = max(self._largest.get(kind, 0.0), float(finite.max(initial=0.0)))
        least = self.least(kind)
        flat = np.ptp(values, axis=0) <= least  # not what is not finite
        constant = values[0]
        constant = np.where(np.abs(constant) <= least, 0.0, constant)
        before = self._held.get(name, constant)
        constant = np.where(np.abs(constant - before) <= least, before, constant)
        self._held[name] = constant
        return np.where(flat, constant, values)


@QUIET
def typical(vectors: Array) -> float:
    """Median length of those among vectors of shape (..., 3) that are not zero; 0 if all are.

    A peak is no measure: after an impact every other arrow would be too short to see. Nor are
    lengths of round-off, so only those above NEGLIGIBLE of the greatest count.
    """
    return middle(np.linalg.norm(vectors.reshape(-1, 3), axis=1))


def middle(lengths: Array) -> float:
    """The same of lengths."""
    lengths = lengths[np.isfinite(lengths)]
    greatest = float(lengths.max(initial=0.0))
    if greatest == 0.0:
        return 0.0
    return float(np.median(lengths[lengths > NEGLIGIBLE * greatest]))


@QUIET
def clear_of(half: Array, center: Array, q: Array, point: Array, arrow: Array) -> Array:
    """Where arrows start so that they do not lie inside of the body: on their own line, where it
    leaves the box around the shape; at `point` where that is not inside of the box, shape (n, 3).

    half: of the box, body axes (3,); center: its centre, world (n, 3); q: body to world (n, 4).
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
    """Directions, shape (n, 3); zero for zero."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)


def drawn_reactions(layout: SampleLayout) -> list[int]:
    """Reactions to draw: bearings, but not the total that they add up to."""
    names = layout.reactions
    parts = {name.rpartition("/")[0] for name in names}
    return [k for k, name in enumerate(names) if name not in parts]


def nice(value: float) -> float:
    """The greatest 1, 2 or 5 times a power of ten that is not over 1.3 value; 1 for nothing."""
    if not np.isfinite(value) or value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(1.3 * value))
    return float(max(m * power for m in (1, 2, 5) if m * power <= 1.3 * value))
