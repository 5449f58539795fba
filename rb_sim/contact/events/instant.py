"""The contacts of a system at one instant: what impacts and the choice of modes look at."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property

import numpy as np

from rb_sim.base.errors import SimulationError
from rb_sim.catalogue.contacts.touching import ContactLaw
from rb_sim.contact.events import tasks
from rb_sim.contact.events.tasks import Tasks
from rb_sim.contact.problem.delassus import inverse_mass
from rb_sim.contact.problem.event_workspace import slip_speed, speed_that_is_none, touches
from rb_sim.mechanics.contact.contact_bodies import HELD
from rb_sim.mechanics.contact.contact_table import NORMAL, SLIP
from rb_sim.mechanics.samples import Array
from rb_sim.numerics.rank import LEAST_SINGULAR
from rb_sim.numerics.vectors import perpendicular

# Decompositions of the contacts' matrices that succeed, or end the run in one line.
#
# LAPACK answers entries that are not finite, and hardly ever finite ones, with a LinAlgError;
# neither may reach whoever runs a scene.


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
    """A^+ by the rank rule (see `rb_sim.numerics.rank`); errors as `singular_values`."""
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
        f"{of} have no solution: the state or the loads are not finite, or overflow; try a "
        "smaller step or tolerance"
    )


@contextmanager
def told(of: Callable[[], str]) -> Iterator[None]:
    """Raises what linear algebra could not do inside as SimulationError."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise SimulationError(f"{of()} have no solution: {error}") from error


class Instant:
    """The contacts of a system at (t, y); y and the table of contacts are changed in place.

    One instant after the other: they share the workspace of the tasks. Raises SimulationError
    if no modes or impulses satisfy the laws.
    """

    def __init__(
        self, laws: Sequence[ContactLaw], call: Tasks, t: float, y: Array, task: int = tasks.LINES
    ) -> None:
        """task: that writes the lines."""
        self.system, self.laws, self.t, self.y = call.system, laws, t, y
        self.call, self.workspace = call, call.workspace
        self.still = speed_that_is_none(self.system)
        """Speed that is none [m/s]."""
        self.first: list[int] = self.system.first_row[self.system.joints :].tolist()
        """First line of each contact; all before that of contact 0 are the joints'."""
        call(task, t, y)

    def refresh(self) -> None:
        """Write the lines again, after y or the modes have changed."""
        self.call(tasks.LINES, self.t, self.y)

    @cached_property
    def inverse_mass(self) -> Array:
        """M^-1, (6N, 6N)."""
        return inverse_mass(self.system)

    def touching(self) -> list[int]:
        """Rigid contacts whose surfaces touch."""
        return [c for c in range(len(self.laws)) if touches(self.system, c)]

    def slip_speed(self, c: int) -> float:
        """[m/s]."""
        return float(slip_speed(self.system, c))

    def apply(self, x: Array) -> None:
        """Add the impulses x to the velocities, and their work to that of the contacts."""
        self.workspace.impulses[:] = x
        self.call(tasks.APPLY, self.t, self.y)

    def taken_by_joints(self, rows: Array) -> Array:
        """Minus the impulses on the joints' lines per unit of impulse along each of `rows`, (joint
        lines, rows)."""
        held = self.workspace.J[: self.first[0]]
        if not len(held):
            return np.zeros((0, len(rows)))
        A = held @ self.inverse_mass @ held.T
        of = f"the joint impulses at t = {self.t:.9g} s"
        return pseudo_inverse(A, of) @ held @ self.inverse_mass @ rows.T

    def pivot_of(self, rows: Array, pushes: Array) -> Array:
        """Velocities along `rows` per unit of impulse along each of `pushes`, joints holding."""
        held = self.workspace.J[: self.first[0]]
        return rows @ self.inverse_mass @ (pushes.T - held.T @ self.taken_by_joints(pushes))

    def effective_pivot(self, c: int) -> float:
        """n . M^-1 (n + T/N) over n . M^-1 n, joints holding, for the slip that contact c has."""
        speed, law = self.slip_speed(c), self.laws[c]
        if speed <= self.still or not 0.0 < law.kinetic < np.inf:
            return 1.0
        k = self.first[c]
        J = self.workspace.J
        n = self.system.touch[c, NORMAL : NORMAL + 3]
        t1, t2 = frame(n)
        d = self.system.touch[c, SLIP : SLIP + 3] / speed
        push = J[k] - law.kinetic * (float(d @ t1) * J[k + 1] + float(d @ t2) * J[k + 2])
        alone = float(J[k] @ self.inverse_mass @ J[k])
        ideal, effective = self.pivot_of(J[[k]], np.array([J[k], push]))[0]
        return float(effective / ideal) if ideal > HELD * alone else 1.0


def frame(n: Array) -> tuple[Array, Array]:
    """The tangents that the kernels use."""
    t1, t2 = perpendicular(tuple(float(x) for x in n))
    return np.array(t1), np.array(t2)
