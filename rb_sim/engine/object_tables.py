"""Tables of bodies and lines that may hold symbols, and what is done with them."""

from __future__ import annotations

from typing import Any

from rb_sim.engine.systems.elimination import Matrix
from rb_sim.engine.systems.many_bodies import BODY, MULTIPLIERS, PARENT, PUSH, WIDTH, MultiBody
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


def constraint_matrix(
    system: MultiBody, lines: Any, besides: frozenset[int] = frozenset()
) -> Matrix:
    """A = G M^-1 G^T of these lines; entries only where two share a body.

    besides: bodies that are left out, as if nothing could move them.
    """
    matrix: Matrix = {i: {} for i in lines}
    on: dict[int, list[tuple[int, int]]] = {}
    for i in lines:
        for body, column in ((system.lines[i, BODY], 0), (system.lines[i, PARENT], 6)):
            if body >= 0 and body not in besides:
                on.setdefault(int(body), []).append((i, column))
    for body, members in on.items():
        for at, (i, column) in enumerate(members):
            force, turn = inverse_mass_times(system, body, i, column)
            for j, other in members[: at + 1]:
                share = coupling(system.rows, j, other, force, turn)
                matrix[i][j] = matrix[j][i] = matrix[i].get(j, 0.0) + share
    return matrix


def take_least_norm(system: MultiBody, rank: Any) -> None:
    """Replace the multipliers by those of least norm with the same G^T lambda."""
    from rb_sim.engine.systems.least_norm import least_norm

    lines = range(system.lines.shape[0])
    matrix = constraint_matrix(system, lines)
    entries = [matrix[i].get(j, 0.0) for i in lines for j in lines]
    system.vectors[MULTIPLIERS] = least_norm(entries, list(system.vectors[MULTIPLIERS]), rank)
