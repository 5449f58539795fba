# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The rank rule: rows scaled to length 1, then one threshold.

Whether rows depend on each other is decided here: by eigenvalues or singular values, and in
compiled code by the pivots of `linear_solves`, which use the threshold defined here. Loads and
lengths are scaled first, so that neither units nor mass ratios decide.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

RANK_TOLERANCE = 1e-11
"""Pivot or eigenvalue of a symmetric matrix, relative to its diagonal elements, at or below which a
row depends on others (eigenvalues: times their number)."""
LEAST_SINGULAR = 1e-12
"""Singular value, relative to the largest, at or below which it is rounding and its direction
belongs to the null space; singular values are square roots of eigenvalues, and known more
accurately."""
JUDGED_BY_CONTACT = 1e-10
"""As LEAST_SINGULAR, for rows of contacts, whose positions are known with this accuracy only:
points that touch are within this distance (see TOUCHING)."""


class Ranked(NamedTuple):
    """Rank, null space and pseudo-inverse of a symmetric positive semidefinite A = G M^-1 G^T."""

    rank: int
    null: np.ndarray
    """orthonormal basis of the null space of A, (n, n - rank)."""
    inverse: np.ndarray
    """pseudo-inverse: A^+ b is the minimum-norm solution of A x = b for a consistent b; (n, n)."""

    def least(self, b: np.ndarray) -> np.ndarray:
        """The minimum-norm x with A x = b."""
        return self.inverse @ b


def ranked(a: np.ndarray) -> Ranked:
    """Rank, null space and pseudo-inverse of a symmetric positive semidefinite matrix (n, n).

    Each row is scaled by the root of its diagonal element; eigenvalues of the scaled matrix up to
    RANK_TOLERANCE times n count as zero, so that neither units nor mass ratios decide.
    """
    n = len(a)
    if n == 0:
        return Ranked(0, np.zeros((0, 0)), np.zeros((0, 0)))
    scale = _scale(a)
    values, vectors = np.linalg.eigh(a * np.outer(scale, scale))
    kept = values > RANK_TOLERANCE * n
    rank = int(kept.sum())
    some = vectors[:, kept] * scale[:, None]
    inverse = (some / values[kept]) @ some.T
    if rank == n:
        return Ranked(rank, np.zeros((n, 0)), inverse)
    null = np.linalg.qr(np.where(scale > 0.0, scale, 1.0)[:, None] * vectors[:, ~kept])[0]
    outside = np.eye(n) - null @ null.T
    return Ranked(rank, null, outside @ inverse @ outside)


def rank_of(a: np.ndarray) -> int:
    """The rank as from `ranked`, five times as fast."""
    scale = _scale(a)
    values = np.linalg.eigvalsh(a * np.outer(scale, scale))
    return int((values > RANK_TOLERANCE * len(a)).sum())


def _scale(a: np.ndarray) -> np.ndarray:
    """One over the square root of each diagonal element; 0 for an element of 0."""
    diagonal = np.diag(a)
    return np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 0.0)


class Split(NamedTuple):
    """Singular value decomposition A = U diag(s) V^T of a matrix, with its rank."""

    rank: int
    singular: np.ndarray
    """nonzero singular values, the largest first, (rank,)."""
    left: np.ndarray
    """the whole U, (m, m); its columns from `rank` on are combinations of rows that vanish."""
    right: np.ndarray
    """the whole V^T, (n, n); its rows from `rank` on span the null space."""

    @property
    def null(self) -> np.ndarray:
        """Orthonormal basis of the null space, (n, n - rank)."""
        return self.right[self.rank :].T

    def least(self, b: np.ndarray) -> np.ndarray:
        """The minimum-norm x among those with the least |A x - b|."""
        on_left = self.left[:, : self.rank].T @ b
        return self.right[: self.rank].T @ (on_left / self.singular)


def split(u: np.ndarray, s: np.ndarray, vt: np.ndarray, least: float = LEAST_SINGULAR) -> Split:
    """The decomposition with its rank; least: relative threshold, larger for less accurate
    values."""
    rank = int(np.sum(s > least * s.max(initial=0.0)))
    return Split(rank, s[:rank], u, vt)


def scaled_rows(rows: np.ndarray) -> np.ndarray:
    """The rows (m, n) normalised; rows that vanish stay zero."""
    sizes = np.linalg.norm(rows, axis=1)
    return rows / np.where(sizes > 0.0, sizes, 1.0)[:, None]


def null_space(rows: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the null space of the rows (m, n), (n, dimension)."""
    scaled = scaled_rows(rows)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    return vectors[:, values <= RANK_TOLERANCE * max(len(values), len(rows))]


def solved(rows: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The minimum-norm x among those with the least |rows x - right|."""
    return np.linalg.lstsq(rows, right, rcond=RANK_TOLERANCE)[0]
