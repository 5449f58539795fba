"""Tables of bodies and lines that may hold symbols, and what is done with them."""

from __future__ import annotations

from typing import Any

from rb_sim.engine.systems.elimination import Matrix
from rb_sim.engine.systems.many_bodies import BODY, PARENT, PUSH, WIDTH, MultiBody
from rb_sim.engine.systems.multipliers import coupling, inverse_mass_times


def hasten(system: MultiBody, y: list[Any]) -> None:
    """Add push to the velocities."""
    for i in range(len(y) // WIDTH):
        for j in range(6):
            k = WIDTH * i + 7 + j
            y[k] = y[k] + system.bodies[i, PUSH + j]


def with_object_tables(system: MultiBody) -> MultiBody:
    """The system with tables of its own that may hold symbols."""
    names = ("bodies", "rows", "vectors", "anchors")
    return system._replace(**{name: getattr(system, name).astype(object) for name in names})


def constraint_matrix(system: MultiBody, lines: Any) -> Matrix:
    """A = G M^-1 G^T of these lines; entries only where two share a body."""
    matrix: Matrix = {i: {} for i in lines}
    on: dict[int, list[tuple[int, int]]] = {}
    for i in lines:
        for body, column in ((system.lines[i, BODY], 0), (system.lines[i, PARENT], 6)):
            if body >= 0:
                on.setdefault(int(body), []).append((i, column))
    for body, members in on.items():
        for at, (i, column) in enumerate(members):
            force, turn = inverse_mass_times(system, body, i, column)
            for j, other in members[: at + 1]:
                share = coupling(system.rows, j, other, force, turn)
                matrix[i][j] = matrix[j][i] = matrix[i].get(j, 0.0) + share
    return matrix
