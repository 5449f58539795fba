"""Small dense matrices by their elements: what the elimination does with one block or two.

Symmetric ones are packed, by their lower rows.
"""

from __future__ import annotations

from typing import Any

from rb_sim.graph.functions import divide, rarely
from rb_sim.maths.rank import RANK_TOLERANCE


def packed(n: int) -> int:
    """Numbers of a symmetric matrix."""
    return n * (n + 1) // 2


def at(i: int, j: int) -> int:
    """Place of the element (i, j) in a symmetric matrix kept by its lower rows."""
    return packed(max(i, j)) + min(i, j)


def inverse_of(matrix: tuple[Any, ...], diagonal: tuple[Any, ...], hub: bool) -> tuple[list, Any]:
    """(D^+, rank): L^-T E^-1 L^-1 for D = L E L^T, without the lines whose pivots are lost."""
    n = len(diagonal)
    left = {(i, j): matrix[at(i, j)] for i in range(n) for j in range(i + 1)}
    inverse: list[Any] = []
    lower: dict[tuple[int, int], Any] = {}
    rank: Any = 0.0
    for k in range(n):
        pivot = left[k, k]
        one = divide(1.0, pivot)
        if not hub:
            lost = pivot <= RANK_TOLERANCE * diagonal[k]
            one = rarely(lost, 0.0, one)
            rank = rank + rarely(lost, 0.0, 1.0)
        inverse.append(one)
        for i in range(k + 1, n):
            lower[i, k] = left[i, k] * one
        for i in range(k + 1, n):
            for j in range(k + 1, i + 1):
                left[i, j] = left[i, j] - lower[i, k] * left[j, k]
    unit = {(i, i): 1.0 for i in range(n)}  # L^-1
    for j in range(n):
        for i in range(j + 1, n):
            unit[i, j] = -sum(lower[i, k] * unit[k, j] for k in range(j, i))
    result = [
        sum(unit[k, i] * inverse[k] * unit[k, j] for k in range(i, n))
        for i in range(n)
        for j in range(i + 1)
    ]
    return result, rank


def times(rows: int, columns: int, a: Any, x: Any) -> list[Any]:
    """A x for A by its rows."""
    return [sum(a[i * columns + k] * x[k] for k in range(columns)) for i in range(rows)]


def product(C: Any, P: Any, s: int, n: int) -> list[Any]:
    """C P for a symmetric P."""
    return [sum(C[i * n + k] * P[at(k, j)] for k in range(n)) for i in range(s) for j in range(n)]


def symmetric(P: Any, z: Any, n: int) -> list[Any]:
    """P z."""
    return [sum(P[at(i, k)] * z[k] for k in range(n)) for i in range(n)]


def reduced(D: Any, W: Any, C: Any, s: int, n: int) -> list[Any]:
    """D - W C^T, packed."""
    return [
        D[at(i, j)] - sum(W[i * n + k] * C[j * n + k] for k in range(n))
        for i in range(s)
        for j in range(i + 1)
    ]


def reduced_block(block: Any, W: Any, C: Any, s: int, r: int, n: int) -> list[Any]:
    """C_ij - W_i C_j^T."""
    return [
        block[i * r + j] - sum(W[i * n + k] * C[j * n + k] for k in range(n))
        for i in range(s)
        for j in range(r)
    ]
