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


def changed(
    matrix: np.ndarray, x: np.ndarray, rank: int, d_matrix: np.ndarray, d_x: np.ndarray
) -> np.ndarray:
    """The change of P x, P = A A+ the projector of `projected`, as A changes and keeps its rank.

    dP = (1 - P) dA A+ + A+ dA (1 - P)  (Golub & Pereyra 1973).
    """
    values, vectors = np.linalg.eigh(matrix)
    first = matrix.shape[0] - rank
    kept, values = vectors[:, first:], values[first:]
    shares = kept.T @ x
    outward = d_matrix @ (kept @ (shares / values))
    inward = d_matrix @ (x - kept @ shares)
    return outward + kept @ (kept.T @ (d_x - outward) + (kept.T @ inward) / values)


@routine
def changed_routine(arguments, results):
    """As `changed`; arguments: n, rank, A (n n), x (n), dA (n n), dx (n); results: n numbers."""
    n, rank = int(arguments[0]), int(arguments[1])
    x, room = part(arguments, 2 + n * n), np.empty(n * (n + 5 + WORK))
    d_matrix, d_x = part(arguments, 2 + n * n + n), part(arguments, 2 + 2 * n * n + n)
    vectors, values = pointer(room), part(pointer(room), n * n)
    solved, rest = part(pointer(room), n * (n + 1)), part(pointer(room), n * (n + 2))
    outward, inward = part(pointer(room), n * (n + 3)), part(pointer(room), n * (n + 4))
    for i in range(n * n):
        vectors[i] = arguments[2 + i]
    eigenvectors(n, vectors, values, part(pointer(room), n * (n + 5)))
    for i in range(n):
        solved[i], rest[i] = 0.0, x[i]
    for k in range(n - rank, n):
        share = 0.0
        for i in range(n):
            share += vectors[k * n + i] * x[i]
        for i in range(n):
            solved[i] += share / values[k] * vectors[k * n + i]
            rest[i] -= share * vectors[k * n + i]
    for i in range(n):
        outward[i], inward[i] = 0.0, 0.0
        for j in range(n):
            outward[i] += d_matrix[i * n + j] * solved[j]
            inward[i] += d_matrix[i * n + j] * rest[j]
        results[i] = outward[i]
    for k in range(n - rank, n):
        share, other = 0.0, 0.0
        for i in range(n):
            share += vectors[k * n + i] * (d_x[i] - outward[i])
            other += vectors[k * n + i] * inward[i]
        for i in range(n):
            results[i] += (share + other / values[k]) * vectors[k * n + i]


@cache
def changed_external(n: int) -> External:
    """The function for n multipliers: arguments n, rank, A by rows, x, dA by rows and dx."""

    def plain(*arguments: float) -> tuple[float, ...]:
        numbers = np.array(arguments[2:], dtype=float)
        if not np.isfinite(numbers).all():
            return (float("nan"),) * n
        matrix, x, d_matrix, d_x = np.split(numbers, np.cumsum([n * n, n, n * n]))
        square = matrix.reshape(n, n), x, int(arguments[1]), d_matrix.reshape(n, n), d_x
        return tuple(changed(*square).tolist())

    return External("rb_sim_least_norm_changed", n, plain, lambda: changed_routine.address)


def changes_of_least_norm(*arguments: Any) -> tuple[Any, ...]:
    """The changes of `least_norm`; its arguments, n and the rank first, then their changes."""
    given = len(arguments) // 2
    n, rank, *numbers = arguments[:given]
    return call(changed_external(int(n)), n, rank, *numbers, *arguments[given + 2 :])


@cache
def least_norm_external(n: int) -> External:
    """The function for n multipliers: arguments n, rank, A by rows and x."""

    def plain(*arguments: float) -> tuple[float, ...]:
        matrix = np.array(arguments[2 : 2 + n * n], dtype=float).reshape(n, n)
        x = np.array(arguments[2 + n * n :], dtype=float)
        if not (np.isfinite(matrix).all() and np.isfinite(x).all()):
            return (float("nan"),) * n
        return tuple(projected(matrix, x, int(arguments[1])).tolist())

    return External(
        "rb_sim_least_norm",
        n,
        plain,
        lambda: least_norm_routine.address,
        along=changes_of_least_norm,
    )


def least_norm(entries: list[Any], x: list[Any], rank: Any) -> tuple[Any, ...]:
    """x of least norm among those with the same A x; entries: A row by row, of this rank."""
    return call(least_norm_external(len(x)), float(len(x)), rank, *entries, *x)
