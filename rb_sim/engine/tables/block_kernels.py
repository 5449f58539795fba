"""Kernels on the blocks of lines, by their sizes alone."""

from __future__ import annotations

from typing import Any


def pushed(n: int) -> Any:
    """push + M^-1 G^T lambda, for n lines."""

    def kernel(t: Any, push: Any, responses: Any, found: Any) -> list[Any]:
        return [
            [push[j] + sum(responses[6 * k + j] * found[k] for k in range(n)) for j in range(6)]
        ]

    return kernel


def coupled(n: int, m: int, more: bool) -> Any:
    """G_i M^-1 G_j^T over one body, added to what is there if `more`."""

    def kernel(t: Any, gradient: Any, responses: Any, *there: Any) -> list[Any]:
        made = []
        for i in range(n):
            for j in range(m):
                s = sum(gradient[6 * i + c] * responses[6 * j + c] for c in range(6))
                made.append(there[0][i * m + j] + s if more else s)
        return [made]

    return kernel


def transposed(n: int) -> Any:
    """G^T of n lines, 6 by n."""

    def kernel(t: Any, gradient: Any) -> list[Any]:
        return [[gradient[6 * k + j] for j in range(6) for k in range(n)]]

    return kernel


def unpacked(n: int) -> Any:
    """The rows of a symmetric matrix."""

    def kernel(t: Any, matrix: Any) -> list[Any]:
        place = {(i, j): i * (i + 1) // 2 + j for i in range(n) for j in range(i + 1)}
        return [[matrix[place[max(i, j), min(i, j)]] for j in range(n)] for i in range(n)]

    return kernel


def both_ways(n: int, m: int) -> Any:
    """The rows of a matrix (n, m), then those of its transpose."""

    def kernel(t: Any, matrix: Any) -> list[Any]:
        rows = [matrix[i * m : (i + 1) * m] for i in range(n)]
        return [*rows, *zip(*rows, strict=True)]

    return kernel
