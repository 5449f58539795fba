"""Decompositions of the contacts' matrices that succeed, or end the run in one line.

LAPACK answers entries that are not finite, and hardly ever finite ones, with a LinAlgError; neither
may reach whoever runs a scene.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from rb_sim.engine.samples import Array
from rb_sim.errors import SimulationError
from rb_sim.maths.rank import LEAST_SINGULAR


def singular_values(A: Array, of: str) -> tuple[Array, Array, Array]:
    """u, s, v^T of A = u diag(s) v^T.

    of: what A belongs to, for the SimulationError that is raised where there is none.
    """
    require_finite(of, A)
    with told(lambda: of):
        u, s, vt = np.linalg.svd(A)
    return u, s, vt


def eigenvalues(A: Array, of: str) -> tuple[Array, Array]:
    """Eigenvalues, ascending, and eigenvectors of the symmetric A; errors as `singular_values`."""
    require_finite(of, A)
    with told(lambda: of):
        values, vectors = np.linalg.eigh(A)
    return values, vectors


def pseudo_inverse(A: Array, of: str) -> Array:
    """A^+ by the rank rule (see `rb_sim.maths.rank`); errors as `singular_values`."""
    require_finite(of, A)
    with told(lambda: of):
        inverse = np.linalg.pinv(A, rcond=LEAST_SINGULAR)
    return np.asarray(inverse, dtype=float)


def require_finite(of: str, *arrays: Array) -> None:
    """Raise SimulationError unless all entries are finite."""
    for array in arrays:
        numbers = array.reshape(-1)
        # the sum of squares is finite for all but huge entries, and is had in one call
        if not math.isfinite(np.dot(numbers, numbers)) and not np.isfinite(numbers).all():
            raise not_finite(of)


def not_finite(of: str) -> SimulationError:
    """The error of numbers that are none."""
    return SimulationError(
        f"{of} have no solution: the state or the loads are no longer finite, or overflow "
        "in them (try a smaller step or tolerance)"
    )


@contextmanager
def told(of: Callable[[], str]) -> Iterator[None]:
    """Raises what linear algebra could not do inside as SimulationError."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise SimulationError(f"{of()} have no solution: {error}") from error
