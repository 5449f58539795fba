"""The one rank rule: lines of constraints scaled to length 1, then one threshold."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.maths.semidefinite import RANK_TOLERANCE


class Ranked(NamedTuple):
    """A symmetric positive semidefinite matrix A = G M^-1 G^T, its rank decided."""

    rank: int
    null: np.ndarray
    """orthonormal basis of what A maps to zero: what vanishes of the lines; (n, n - rank)."""
    inverse: np.ndarray
    """A^+ b is the solution of least norm of A x = b, for a consistent b; (n, n)."""

    def least(self, b: np.ndarray) -> np.ndarray:
        """The x of least norm with A x = b."""
        return self.inverse @ b


def ranked(a: np.ndarray) -> Ranked:
    """Rank, null space and pseudo-inverse of a symmetric positive semidefinite matrix (n, n).

    Each line is scaled by the root of its diagonal element; of the scaled matrix eigenvalues up to
    RANK_TOLERANCE times n count as zero, so that neither units nor mass ratios decide.
    """
    n = len(a)
    if n == 0:
        return Ranked(0, np.zeros((0, 0)), np.zeros((0, 0)))
    diagonal = np.diag(a)
    scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 0.0)
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
