"""The complex elimination of implicit steps, where there is nothing to divide by."""

from __future__ import annotations

import numpy as np

from tests.interpreted import interpreted


def solved(re: list[float], im: list[float]) -> list[float]:
    from rb_sim.integrate.methods import collocation

    a, b, order = np.array(re), np.array(im), np.zeros(2)
    x, z = np.array([1.0, 2.0]), np.array([0.5, -1.0])
    collocation.factor_complex(2, a, b, order)
    collocation.solve_complex(2, a, b, order, x, z)
    return [*x, *z]


def test_a_singular_matrix_gives_nan_and_no_traceback() -> None:
    assert np.isnan(interpreted(solved, [0.0] * 4, [0.0] * 4)).all()


def test_a_regular_one_is_solved() -> None:
    re, im = [1.0, 2.0, -1.0, 0.5], [0.3, 0.0, 1.0, -2.0]
    x = np.linalg.solve(
        np.reshape(re, (2, 2)) + 1j * np.reshape(im, (2, 2)), [1.0 + 0.5j, 2.0 - 1.0j]
    )
    found = interpreted(solved, re, im)
    assert np.allclose(found, [*x.real, *x.imag], rtol=1e-14)
