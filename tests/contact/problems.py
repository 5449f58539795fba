# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""One collection of friction problems, as graphs of bodies, that every solver is tested on."""

from __future__ import annotations

import numpy as np

from rb_sim.contact.gauss_seidel import fill_block
from rb_sim.contact.problem import (
    BLOCK,
    BOUND,
    CONTACT_ROWS,
    LIGHT_A,
    LIGHT_B,
    RULES,
    TURN_A,
    TURN_B,
    WIDTH,
    Graph,
)


def graph_of(ends, points, normals, mu, masses, targets) -> Graph:
    """Bodies are balls of inertia 2/5 m about the origin of their own; axes are the world's.

    ends: (n, 2); points: (n, 2, 3) arms from the body and the parent; normals (n, 3).
    """
    n = len(ends)
    rows = np.zeros((CONTACT_ROWS * n, WIDTH))
    for i in range(n):
        d = np.array(normals[i]) / np.linalg.norm(normals[i])
        t1 = np.cross(d, [0.3, 0.5, 0.8])
        t1 /= np.linalg.norm(t1)
        for p, axis in enumerate((d, t1, np.cross(d, t1))):
            k = CONTACT_ROWS * i + p
            b, a = ends[i]
            arms = points[i]
            rows[k, 0:3], rows[k, 3:6] = axis, np.cross(arms[0], axis)
            rows[k, LIGHT_B] = 1.0 / masses[b]
            rows[k, TURN_B : TURN_B + 3] = rows[k, 3:6] / (0.4 * masses[b])
            if a >= 0:
                rows[k, 6:9], rows[k, 9:12] = -axis, -np.cross(arms[1], axis)
                rows[k, LIGHT_A] = 1.0 / masses[a]
                rows[k, TURN_A : TURN_A + 3] = rows[k, 9:12] / (0.4 * masses[a])
    rules = np.zeros((n, RULES))
    rules[:, BOUND] = mu
    goal = np.zeros(CONTACT_ROWS * n)
    goal[0::CONTACT_ROWS] = targets
    none = np.zeros((0, WIDTH))
    graph = Graph(
        np.array(ends, np.int64), rows, goal, rules, np.zeros((n, BLOCK)),
        np.zeros((0, 3), np.int64), none, np.zeros(0), np.zeros((0, 0)), np.zeros((2, 0)),
    )  # fmt: skip
    for c in range(n):
        fill_block(graph, c)
    return graph


def random_heap(seed: int, contacts: int = 12, bodies: int = 5, mu: float = 0.5):
    """(graph, velocities without reactions): bodies that approach each other and a floor."""
    rng = np.random.default_rng(seed)
    ends, points, normals = [], [], []
    for _ in range(contacts):
        b, a = rng.choice(bodies, 2, replace=False)
        a = -1 if rng.random() < 0.4 else a
        ends.append((b, a))
        normals.append(rng.normal(size=3) + np.array([0.0, 0.0, 2.0]))
        points.append(rng.normal(size=(2, 3)))
    masses = rng.uniform(0.5, 2.0, bodies)
    targets = rng.uniform(0.0, 0.05, contacts) * (rng.random(contacts) < 0.3)
    graph = graph_of(ends, points, normals, mu, masses, targets)
    u = rng.normal(size=(bodies, 6)) - np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0])
    return graph, u


def box_on_corners(corners: int = 4, mu: float = 0.5, slip: float = 0.0):
    """A body on more points than hold it, pulled down and along."""
    angles = 2.0 * np.pi * np.arange(corners) / corners
    arms = np.stack([np.cos(angles), np.sin(angles), -np.ones(corners)], axis=1)
    points = np.stack([arms, arms], axis=1)
    graph = graph_of(
        [(0, -1)] * corners, points, [[0.0, 0.0, 1.0]] * corners, mu, [1.0], np.zeros(corners)
    )
    return graph, np.array([[slip, 0.2 * slip, -1.0, 0.0, 0.0, 0.0]])


COLLECTION = {
    "one ball": lambda: box_on_corners(1),
    "box at rest": lambda: box_on_corners(4),
    "box that slides": lambda: box_on_corners(4, 0.3, 2.0),
    "table on eight legs": lambda: box_on_corners(8),
    "smooth heap": lambda: random_heap(1, mu=0.0),
    "heap": lambda: random_heap(2),
    "rough heap": lambda: random_heap(3, mu=1.0),
    "large heap": lambda: random_heap(4, contacts=30, bodies=12),
    "slippery heap": lambda: random_heap(5, contacts=20, bodies=8, mu=0.1),
}


def dense(graph: Graph, u: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, ...]:
    """(W, q, mu, r): the Delassus matrix, shape (3n, 3n), velocities without impulses, coefficients
    and impulses of a graph; u: velocities that x has been pushed into."""
    n, bodies = len(graph.ends), len(u)
    J, P = np.zeros((3 * n, 6 * bodies)), np.zeros((3 * n, 6 * bodies))
    at = [CONTACT_ROWS * i + p for i in range(n) for p in range(3)]
    for m, k in enumerate(at):
        b, a = graph.ends[k // CONTACT_ROWS]
        row = graph.rows[k]
        J[m, 6 * b : 6 * b + 6] = row[:6]
        P[m, 6 * b : 6 * b + 6] = [*row[LIGHT_B] * row[:3], *row[TURN_B : TURN_B + 3]]
        if a >= 0:
            J[m, 6 * a : 6 * a + 6] = row[6:12]
            P[m, 6 * a : 6 * a + 6] = [*row[LIGHT_A] * row[6:9], *row[TURN_A : TURN_A + 3]]
    W, r = J @ P.T, x[at]
    return W, J @ u.ravel() - graph.targets[at] - W @ r, graph.rules[:, BOUND], r


def onto_cone(point: np.ndarray, mu: float) -> np.ndarray:
    """The point of |(y, z)| <= mu x nearest to (x, y, z)."""
    x, size = point[0], np.hypot(*point[1:])
    if size <= mu * x:
        return point
    if mu * size <= -x:
        return np.zeros(3)
    near = (x + mu * size) / (1.0 + mu * mu)
    return np.array([near, *(mu * near / size * point[1:])])


def residual(W: np.ndarray, q: np.ndarray, mu: np.ndarray, r: np.ndarray) -> float:
    """How far r is from a solution of Signorini's and Coulomb's laws for u = W r + q, relative to
    the largest impulse or to what would stop the largest velocity: by the natural map
    r - P_K(r - (u + mu |u_T| n) / w) of each contact (De Saxce), w the largest of its own block."""
    error = []
    for u, own, part, c in zip(
        (W @ r + q).reshape(-1, 3), np.diag(W).reshape(-1, 3), r.reshape(-1, 3), mu, strict=True
    ):
        moved = u + [c * np.hypot(*u[1:]), 0.0, 0.0]
        error.append(part - onto_cone(part - moved / own.max(), c))
    scale = max(np.abs(r).max(), (np.abs(q) / np.diag(W)).max())
    return float(np.abs(error).max() / scale)
