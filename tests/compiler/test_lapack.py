"""LAPACK called from machine code gives the vectors of numpy, whatever their signs."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.compiler.calls import WORK, eigenvectors, singular_vectors, work_of_singular_vectors
from rb_sim.compiler.program import Entry


def symmetric(n, a, values, work):
    eigenvectors(n, a, values, work)


def any_matrix(n, a, right, values, left, work):
    singular_vectors(n, a, right, values, left, work)


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_eigenvectors(n):
    rng = np.random.default_rng(n)
    matrix = rng.normal(size=(n, n))
    matrix = matrix + matrix.T
    a, values = matrix.reshape(-1).copy(), np.zeros(n)
    Entry(symmetric)(n, a, values, np.zeros(WORK * n))
    vectors = a.reshape(n, n)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), atol=1e-13 * n)
    np.testing.assert_allclose(vectors @ matrix @ vectors.T, np.diag(values), atol=1e-13 * n)
    plain, found = matrix.reshape(-1).copy(), np.zeros(n)
    symmetric(n, plain, found, None)
    np.testing.assert_allclose(found, values, atol=1e-13 * n)
    np.testing.assert_allclose(abs(plain), abs(a), atol=1e-10)


@pytest.mark.parametrize("n", [1, 3, 8])
def test_singular_vectors(n):
    rng = np.random.default_rng(n)
    matrix = rng.normal(size=(n, n))
    right, values, left = np.zeros(n * n), np.zeros(n), np.zeros(n * n)
    work = np.zeros(work_of_singular_vectors(n))
    Entry(any_matrix)(n, matrix.reshape(-1).copy(), right, values, left, work)
    v, u = right.reshape(n, n), left.reshape(n, n)
    np.testing.assert_allclose(u.T @ np.diag(values) @ v, matrix, atol=1e-13 * n)
    np.testing.assert_allclose(values, np.linalg.svd(matrix)[1], atol=1e-13 * n)
    r, s, w = np.zeros(n * n), np.zeros(n), np.zeros(n * n)
    any_matrix(n, matrix.reshape(-1).copy(), r, s, w, None)
    np.testing.assert_allclose(
        w.reshape(n, n).T @ np.diag(s) @ r.reshape(n, n), matrix, atol=1e-13 * n
    )
