# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Convex hull of listed points: a polyhedron, a polygon, a segment or a point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.catalogue.geometry.solids import SPARE, direction, nearest, off_segment
from rb_sim.catalogue.spec import Vec3
from rb_sim.compiler.graph.symbols import External, call
from rb_sim.numerics.kernels import routine, table_at
from rb_sim.numerics.vectors import ZERO, dot, perpendicular, sub


class Hull(NamedTuple):
    """Convex hull: flat faces, with coplanar ones merged; a polygon has a face on either side."""

    faces: np.ndarray
    """outward normal n and n . x of the plane of each face, shape (f, 4)."""
    sides: np.ndarray
    """outward planes through a face's edges, normal to the face: n and n . x, shape (s, 4)."""
    first: np.ndarray
    """the sides of face i are first[i] to first[i + 1]; integers, shape (f + 1,)."""
    edges: np.ndarray
    """start, unit vector, length; shape (e, 7). A single point is an edge of length zero."""
    reach: float
    """distance of the farthest point from C [m]."""


def triple(table, i, at):
    """Three numbers of row i of a table from column `at` on."""
    return (table[i, at], table[i, at + 1], table[i, at + 2])


def height(planes, i, x):
    """Signed distance of x from the plane of face i, positive outside [m]."""
    return dot(triple(planes, i, 0), x) - planes[i, 3]


def highest_face(hull, x):
    """(height, index) of the face whose plane x is highest above; index -1 if there are no faces.

    No plane is farther from x than the hull, so only this face can contain the nearest point.
    """
    best, face = -1e300, -1
    for i in range(hull.faces.shape[0]):
        h = height(hull.faces, i, x)
        if h > best:
            best, face = h, i
    return best, face


def is_over(hull, face, x):
    """Whether the projection of x on the plane of the face lies in the face."""
    for i in range(hull.first[face], hull.first[face + 1]):
        if height(hull.sides, i, x) > 0.0:
            return False
    return True


class PackedHull(NamedTuple):
    """A hull as traced laws see it: one external function for all hulls reads its tables."""

    place: float
    """address of the hull's `packed` tables."""


def packed(hull: Hull) -> np.ndarray:
    """Numbers of faces, sides and edges, then the tables."""
    counts = [len(hull.faces), len(hull.sides), len(hull.edges)]
    tables = (hull.faces, hull.sides, hull.first, hull.edges)
    return np.concatenate([counts, *(np.ravel(table).astype(float) for table in tables)])


def hull_at(place):
    """The hull whose packed tables are at this address; its `reach` is 0."""
    counts = table_at(place, 3)
    f, s, e = int(counts[0]), int(counts[1]), int(counts[2])
    tables = table_at(place, 3 + 4 * f + 4 * s + f + 1 + 7 * e)
    sides, first = 3 + 4 * f, 3 + 4 * f + 4 * s
    edges = first + f + 1
    return Hull(
        tables[3:sides].reshape((f, 4)),
        tables[sides:first].reshape((s, 4)),
        tables[first:edges].astype(np.int64),
        tables[edges : edges + 7 * e].reshape((e, 7)),
        0.0,
    )


@routine
def nearest_of_packed_hull(arguments, results):
    """arguments: address of the tables, x, x_dot; results: distance, u, its rate."""
    x = (arguments[1], arguments[2], arguments[3])
    x_dot = (arguments[4], arguments[5], arguments[6])
    distance, u, u_dot = nearest_of_hull(hull_at(arguments[0]), x, x_dot)
    results[0] = distance
    for i in range(3):
        results[1 + i], results[4 + i] = u[i], u_dot[i]


def _nearest_plainly(place: float, *at: float) -> tuple[float, ...]:
    distance, u, u_dot = nearest_of_hull(hull_at(place), at[:3], at[3:])
    return (distance, *u, *u_dot)


NEAREST = External(
    "rb_sim_nearest_of_hull", 7, _nearest_plainly, lambda: nearest_of_packed_hull.address
)


@nearest.register(PackedHull)
def nearest_by_routine(hull, x, x_dot):
    """The same as for a Hull, by one external function for all traced laws."""
    found = call(NEAREST, hull.place, *x, *x_dot)
    return found[0], found[1:4], found[4:7]


@nearest.register(Hull)
def nearest_of_hull(hull, x, x_dot):
    """The face whose plane x is highest above, if x is inside or projects on it; else the nearest
    edge."""
    above, face = highest_face(hull, x)
    if face >= 0 and (above < 0.0 or is_over(hull, face, x)):
        return above, triple(hull.faces, face, 0), ZERO
    best, away, away_dot = 1e300, ZERO, ZERO
    for i in range(hull.edges.shape[0]):
        far = sub(x, triple(hull.edges, i, 0))
        a, a_dot = off_segment(far, x_dot, triple(hull.edges, i, 3), hull.edges[i, 6])
        square = dot(a, a)
        if square < best:
            best, away, away_dot = square, a, a_dot
    return direction(away, away_dot, SPARE)


def principal(points: np.ndarray) -> tuple[int, np.ndarray]:
    """(dimension of the span of the points, principal axes as rows, longest first)."""
    away = points - points.mean(axis=0)
    axes = np.linalg.svd(away)[2]
    extents = np.abs(away @ axes.T).max(axis=0)
    return int(np.sum(extents > COMPUTED_ROUNDING * extents.max())), axes


def polygon(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Indices of the corners of coplanar points, counterclockwise about the normal."""
    from scipy.spatial import ConvexHull  # imported when needed: slow, and few scenes use it

    flat = points @ np.stack(perpendicular(normal), axis=1)
    around = ConvexHull(flat).vertices
    away = np.linalg.norm(flat[around] - flat.mean(axis=0), axis=1)
    around = np.roll(around, -np.argmax(away))  # the farthest: a corner for any rounding
    corners: list[int] = []
    for i in [*around, around[0]]:
        while len(corners) > 1:
            before, last = flat[corners[-2]], flat[corners[-1]]
            if not is_straight(before, last, flat[i], away.max()):
                break
            corners.pop()
        corners.append(i)
    return np.array(corners[:-1])


def is_straight(a: np.ndarray, b: np.ndarray, c: np.ndarray, size: float) -> bool:
    """Whether b lies on the line from a to c up to rounding; size: of the polygon [m]."""
    (x, y), (u, v) = c - a, b - a
    return abs(x * v - y * u) <= COMPUTED_ROUNDING * size * float(np.hypot(x, y))


def faces_of(points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """(outward normal, indices of the corners) of each face of points that span 2 or 3
    dimensions."""
    from scipy.spatial import ConvexHull

    dimension, axes = principal(points)
    if dimension == 2:
        return [(n, polygon(points, n)) for n in (axes[2], -axes[2])]
    size = np.abs(points - points.mean(axis=0)).max()
    found = {}
    for *n, offset in ConvexHull(points).equations:
        on = np.flatnonzero(np.abs(points @ n + offset) <= COMPUTED_ROUNDING * size)
        if principal(points[on])[0] == 2:
            found.setdefault(tuple(on), np.array(n))
    return [(n, np.array(on)[polygon(points[list(on)], n)]) for on, n in found.items()]


def hull_of(points: Sequence[Vec3]) -> Hull:
    """The hull of points given from C, body axes [m]."""
    p = np.unique(np.array(points, dtype=float), axis=0)
    dimension, axes = principal(p)
    faces = faces_of(p) if dimension > 1 else []
    planes, sides, first, lines = [], [], [0], set()
    for n, corners in faces:
        planes.append([*n, np.mean(p[corners] @ n)])
        for a, b in zip(corners, np.roll(corners, -1), strict=True):
            side = np.cross(p[b] - p[a], n)
            side /= np.linalg.norm(side)
            sides.append([*side, side @ p[a]])
            lines.add((min(a, b), max(a, b)))
        first.append(len(sides))
    if not faces:
        along = p @ axes[0]
        lines.add((int(np.argmin(along)), int(np.argmax(along))))
    return Hull(
        np.array(planes, dtype=float).reshape(-1, 4),
        np.array(sides, dtype=float).reshape(-1, 4),
        np.array(first, dtype=np.int64),
        np.array([edge(p[a], p[b]) for a, b in sorted(lines)]),
        float(np.linalg.norm(p, axis=1).max()),
    )


def edge(a: np.ndarray, b: np.ndarray) -> list[float]:
    """Row of Hull.edges for the edge from a to b."""
    length = float(np.linalg.norm(b - a))
    along = (b - a) / length if length > 0.0 else SPARE
    return [float(value) for value in (*a, *along, length)]
