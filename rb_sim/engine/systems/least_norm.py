"""Least-norm multipliers where constraints depend on each other, as one function for all scenes.

The only part of a law that pivots by value: it is compiled once and called by address.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from rb_sim.compiler.lapack import WORK, eigenvectors
from rb_sim.graph.functions import call
from rb_sim.graph.symbols import External
from rb_sim.loops.compiled import part, pointer, routine


def projected(matrix: np.ndarray, x: np.ndarray, rank: int) -> np.ndarray:
    """The part of x in the span of the eigenvectors of the `rank` largest eigenvalues."""
    _, vectors = np.linalg.eigh(matrix)
    kept = vectors[:, matrix.shape[0] - rank :]
    return kept @ (kept.T @ x)


@routine
def least_norm_routine(arguments, results):
    """arguments: n, rank, the matrix (n n), x (n); results: n numbers."""
    n, rank = int(arguments[0]), int(arguments[1])
    x, room = part(arguments, 2 + n * n), np.empty(n * (n + 1 + WORK))
    vectors, values = pointer(room), part(pointer(room), n * n)
    for i in range(n * n):
        vectors[i] = arguments[2 + i]
    eigenvectors(n, vectors, values, part(pointer(room), n * (n + 1)))
    for i in range(n):
        results[i] = 0.0
    for k in range(n - rank, n):
        share = 0.0
        for i in range(n):
            share += vectors[k * n + i] * x[i]
        for i in range(n):
            results[i] += share * vectors[k * n + i]


@cache
def least_norm_external(n: int) -> External:
    """The function for n multipliers: arguments n, rank, A by rows and x."""

    def plain(*arguments: float) -> tuple[float, ...]:
        matrix = np.array(arguments[2 : 2 + n * n], dtype=float).reshape(n, n)
        x = np.array(arguments[2 + n * n :], dtype=float)
        if not (np.isfinite(matrix).all() and np.isfinite(x).all()):
            return (float("nan"),) * n
        return tuple(projected(matrix, x, int(arguments[1])).tolist())

    return External("rb_sim_least_norm", n, plain, lambda: least_norm_routine.address)


def least_norm(entries: list[Any], x: list[Any], rank: Any) -> tuple[Any, ...]:
    """x of least norm among those with the same A x; entries: A row by row, of this rank."""
    return call(least_norm_external(len(x)), float(len(x)), rank, *entries, *x)
