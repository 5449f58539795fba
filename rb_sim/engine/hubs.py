"""The factors of A = G M^-1 G^T where many constraints act on one body.

All of these would be neighbours of each other.  The body, a hub, stays instead: what the
multipliers change its accelerations by are six more unknowns,

    [ A    G_h ] [lambda]   [right]
    [G_h^T -M_h] [ a_h  ] = [  0  ],   A = G M^-1 G^T over all other bodies.
"""

from __future__ import annotations

from collections.abc import Sequence

from rb_sim.engine.object_tables import constraint_matrix
from rb_sim.engine.systems.choice import switch_off
from rb_sim.engine.systems.elimination import Factors, Matrix
from rb_sim.engine.systems.many_bodies import BODY, INERTIA, MASS, PARENT, MultiBody, six
from rb_sim.engine.tables.graph_of_lines import Plan, constraint_nodes, hubs_of, planned


def plan_of(system: MultiBody) -> Plan | None:
    """The order in which the lines of a system go, and its hubs; None where it has none."""
    first = [int(k) for k in system.first_row]
    sizes = [after - before for before, after in zip(first, first[1:], strict=False)]
    pairs = [(c.body, c.parent) for c in system.constraints]
    nodes = constraint_nodes(pairs, sizes, range(len(sizes)))
    hubs = hubs_of(nodes)
    return planned(nodes, hubs) if hubs else None


def factors_of(system: MultiBody, lines: Sequence[int], plan: Plan | None) -> Factors:
    """The factors of these lines as written; what is solved with them gives their multipliers.

    Without a plan they go in turn; with one its hubs stay, and a_h is found as well.  Right sides
    of lines that are not chosen must be zero.
    """
    if plan is None:
        matrix = constraint_matrix(system, lines)
        if system.chosen:
            switch_off(matrix, system.chosen)
        return Factors(matrix, lines)
    matrix = constraint_matrix(system, lines, besides=plan.hubs)
    # nothing can move lines on hubs alone before the hubs are there; with these, it is this much
    alone = [k for k in lines if k not in matrix[k]]
    scales = {k: constraint_matrix(system, [k])[k][k] for k in alone}
    for k in alone:
        matrix[k][k] = 0.0
    first = int(system.first_row[-1])
    places = {body: first + 6 * i for i, body in enumerate(sorted(plan.hubs))}
    for body, at in places.items():
        _put_hub(system, matrix, body, at)
    order = [k for k in _unknowns(system, plan, places) if k in matrix]
    sure = frozenset(range(first, first + 6 * len(places)))
    return Factors(matrix, order, sure=sure, scales=scales)


def _unknowns(system: MultiBody, plan: Plan, places: dict[int, int]) -> list[int]:
    """All lines, and accelerations of hubs, in the order in which they go."""
    first, order = system.first_row, []
    for node in plan.nodes:
        if node.parts:
            order += [k for part in node.parts for k in range(first[part], first[part + 1])]
        else:
            order += range(places[node.body], places[node.body] + 6)
    return order


def _put_hub(system: MultiBody, matrix: Matrix, body: int, at: int) -> None:
    """The rows of a hub, whose unknowns lie from `at` on: less its mass, and the lines on it."""
    xx, yy, zz, xy, xz, yz = six(system.bodies, body, INERTIA)
    inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    lines = list(matrix)
    for j in range(3):
        matrix[at + j] = {at + j: -system.bodies[body, MASS]}
        matrix[at + 3 + j] = {at + 3 + i: -inertia[j][i] for i in range(3)}
    for k in lines:
        for end, column in ((BODY, 0), (PARENT, 6)):
            if k < system.lines.shape[0] and system.lines[k, end] == body:
                for j in range(6):
                    value = matrix[k].get(at + j, 0.0) + system.rows[k, column + j]
                    matrix[k][at + j] = matrix[at + j][k] = value
