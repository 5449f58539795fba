# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Traced laws of N bodies in maximal coordinates, with the whole elimination in each law."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from rb_sim.catalogue.constraints.rows import BIAS, ERROR, HOLONOMIC, RATE
from rb_sim.compiler.graph.derivative import compile_columns
from rb_sim.compiler.graph.machine import compile_law
from rb_sim.compiler.graph.symbols import Graph
from rb_sim.compiler.graph.taylor_code import SeriesLaws
from rb_sim.mechanics.blocks import Plan, constraint_nodes, hubs_of, planned
from rb_sim.mechanics.inputs import Inputs, Place
from rb_sim.mechanics.laws import CompiledLaws, domain_law
from rb_sim.mechanics.systems.elimination import (
    INDEPENDENT,
    Dependent,
    Factors,
    Matrix,
    chosen_rows,
    constraint_matrix,
    hasten,
    rows_in_loops,
    rows_in_order,
    switch_off,
    take_least_norm,
    with_object_tables,
)
from rb_sim.mechanics.systems.free import project_spins
from rb_sim.mechanics.systems.many_bodies import (
    BODY,
    INERTIA,
    MASS,
    MULTIPLIERS,
    PARENT,
    WIDTH,
    MultiBody,
    apply_effects,
    arm_of,
    fill_all,
    six,
    state_of,
)
from rb_sim.mechanics.systems.multibody import (
    add_multipliers,
    clear_loads,
    clear_response,
    free_accelerations,
    move_by_response,
    power_of_reactions,
    put_balances,
    put_rates,
    put_reactions,
    row_times_response,
    row_velocity,
    worst_gap,
    write_rows,
)
from rb_sim.mechanics.systems.translation import GuidedLaws, on_guides, ways
from rb_sim.numerics.kernels import Step

# Factors of A = G M^-1 G^T if many constraints act on one body.
#
# All of them would be neighbours of each other. Instead the body stays as a hub: the changes a_h of
# its accelerations by the multipliers are six more unknowns,
#
#     [ A    G_h ] [lambda]   [right]
#     [G_h^T -M_h] [ a_h  ] = [  0  ],   A = G M^-1 G^T over all other bodies.


def plan_of(system: MultiBody) -> Plan | None:
    """Elimination plan of the rows of a system with hubs; None without hubs."""
    first = [int(k) for k in system.first_row]
    sizes = [after - before for before, after in zip(first, first[1:], strict=False)]
    pairs = [(c.body, c.parent) for c in system.constraints]
    nodes = constraint_nodes(pairs, sizes, range(len(sizes)))
    hubs = hubs_of(nodes)
    return planned(nodes, hubs) if hubs else None


def factors_of(system: MultiBody, rows: Sequence[int], plan: Plan | None) -> Factors:
    """Factors of these rows as written; solving with them gives the multipliers.

    Without a plan the rows are eliminated in the given order; with one the hubs stay, and a_h is
    found as well. Right sides of rows that are not chosen must be zero.
    """
    if plan is None:
        matrix = constraint_matrix(system, rows)
        if system.chosen:
            switch_off(matrix, system.chosen)
        return Factors(matrix, rows)
    matrix = constraint_matrix(system, rows, besides=plan.hubs)
    # rows on hubs alone have no entry until the hubs are added; their scale is that of free hubs
    alone = [k for k in rows if k not in matrix[k]]
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
    """All rows, and accelerations of hubs, in the order of elimination."""
    first, order = system.first_row, []
    for node in plan.nodes:
        if node.parts:
            order += [k for part in node.parts for k in range(first[part], first[part + 1])]
        else:
            order += range(places[node.body], places[node.body] + 6)
    return order


def _put_hub(system: MultiBody, matrix: Matrix, body: int, at: int) -> None:
    """Add the six rows of a hub, with unknowns from `at` on: minus its mass, coupled to the rows on
    it."""
    xx, yy, zz, xy, xz, yz = six(system.bodies, body, INERTIA)
    inertia = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    rows = list(matrix)
    for j in range(3):
        matrix[at + j] = {at + j: -system.bodies[body, MASS]}
        matrix[at + 3 + j] = {at + 3 + i: -inertia[j][i] for i in range(3)}
    for k in rows:
        for end, column in ((BODY, 0), (PARENT, 6)):
            if k < system.row_table.shape[0] and system.row_table[k, end] == body:
                for j in range(6):
                    value = matrix[k].get(at + j, 0.0) + system.rows[k, column + j]
                    matrix[k][at + j] = matrix[at + j][k] = value


# The constraint rows of N bodies in traced laws: order of elimination, rows with a multiplier,
# multipliers.
#
# The kernels of `systems` write their tables as with numbers; here the tables hold symbols.


LEFT_NEAR_SINGULAR = 1e-10
"""Error of a constraint row, relative to the length of the scene, or of its rate, relative to
the speed, that is not corrected near a singular configuration: a tenth of the violation that is
reported."""


class SolvedRows(GuidedLaws):
    """Tracing of kernels, and the multipliers of the constraint rows in them.

    varied: places of constants that are inputs. changing: rows for which an input decides whether
    they get a multiplier; those of them in `dependent` have none at the start.
    """

    def __init__(
        self,
        system: MultiBody,
        width: int,
        redundant: bool,
        varied: Sequence[Place] = (),
        dependent: Dependent = INDEPENDENT,
        changing: Sequence[int] = (),
    ) -> None:
        self.system, self.width, self.redundant = system, width, redundant
        self.dependent, self.changing = dependent, tuple(changing)
        self.inputs = Inputs(varied, [float(k not in dependent.rows) for k in self.changing])
        self.n = WIDTH * system.bodies.shape[0]
        self.row_count = system.row_table.shape[0]

    def traced(self, kernel: Callable[..., list[Any]], *, often: bool = True) -> CompiledLaws:
        """The compiled law of kernel(system, t, y); y is a list that the kernel may overwrite."""
        return compile_law(self.outputs(kernel), often=often)

    def outputs(self, kernel: Callable[..., list[Any]]) -> list[Any]:
        """Outputs of the kernel on symbols of a new graph."""
        graph = Graph()
        system = with_object_tables(self.inputs.symbolic(self.system, graph))
        if self.changing:
            first = len(self.inputs.values(self.system, 0.0)) - len(self.changing)
            symbols = graph.vector("p", len(self.changing), first)
            system = system._replace(chosen=dict(zip(self.changing, symbols, strict=True)))
        return kernel(system, graph.input("t"), list(graph.vector("y", self.n)))

    @cached_property
    def holonomic(self) -> list[bool]:
        """Whether each row is holonomic, which depends on its kind only.

        Rows are evaluated on symbols: any numbers may be singular for some scene (division by
        zero).
        """
        graph = Graph()
        system = with_object_tables(self.system)
        y = list(graph.vector("y", self.n))
        fill_all(system.constraints, graph.input("t"), system, y)
        return [value != 0.0 for value in system.rows[:, HOLONOMIC]]

    @cached_property
    def whole_order(self) -> list[int]:
        """All rows in the order of elimination."""
        first = self.system.first_row
        parts = [range(first[i], first[i + 1]) for i in range(len(first) - 1)]
        bodies = [{c.body, c.parent} - {-1} for c in self.system.constraints]
        return rows_in_order(parts, bodies)

    @cached_property
    def order(self) -> list[int]:
        """Rows that get a multiplier, always or by choice, in the order of elimination."""
        left_out = self.dependent.rows - set(self.changing)
        return [k for k in self.whole_order if k not in left_out]

    @cached_property
    def independent(self) -> list[int]:
        """Rows that always get a multiplier, in the order of elimination."""
        return [k for k in self.order if k not in self.changing]

    @cached_property
    def pivots(self) -> CompiledLaws:
        """Pivots of the independent rows relative to their diagonal elements (see Factors)."""
        rows = self.independent

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            write_rows(system, t, y)
            shares = Factors(constraint_matrix(system, rows), rows).shares
            return [shares[k] for k in rows]

        return self.traced(kernel)

    @cached_property
    def position_order(self) -> list[int]:
        """Holonomic rows in the order of elimination, without those that depend on others."""
        left_out = self.dependent.positions - set(self.changing)
        return [k for k in self.whole_order if self.holonomic[k] and k not in left_out]

    def multipliers(
        self, system: MultiBody, right: dict[int, Any], order: Sequence[int], scale: float = 0.0
    ) -> Any:
        """Find the multipliers of the rows in `order`, all others zero; returns the rank of those
        rows.

        scale: as in `rounding`.
        """
        factors = factors_of(system, order, self.plan)
        self._put(system, factors.solve(self._chosen(system, right), self.rounding(scale)))
        return factors.rank - self.inputs.chosen.count(0.0)

    def rounding(self, scale: float) -> dict[int, float]:
        """For each row in a loop the error that is not corrected if its pivot is small (see
        Factors.solve).

        scale: the scene's length [m] or speed [m/s]; 0: every error is corrected.
        """
        rows = self.in_loops if scale else ()
        return {k: LEFT_NEAR_SINGULAR * scale / arm_of(self.system, k) for k in rows}

    @cached_property
    def in_loops(self) -> list[int]:
        """Rows that may become dependent on others: those in loops of three or more bodies."""
        return rows_in_loops(self.system)

    def _chosen(self, system: MultiBody, right: dict[int, Any]) -> dict[int, Any]:
        """The right sides, with zeros for rows that are not chosen."""
        chosen = dict(system.chosen)
        return {k: value * chosen.get(k, 1.0) for k, value in right.items()}

    @cached_property
    def plan(self) -> Plan | None:
        """Elimination plan of a system with hubs; None for other systems and with dependent
        rows."""
        return None if self.redundant or self.dependent.rows else plan_of(self.system)

    def _put(self, system: MultiBody, found: dict[int, Any]) -> None:
        """Write the multipliers of all rows, zero for rows without one."""
        for k in range(self.row_count):
            system.vectors[MULTIPLIERS, k] = found.get(k, 0.0)

    @cached_property
    def carried(self) -> int:
        """Number of inputs, before the length of the step, that `choice` returns."""
        if self.inputs.kept(self.system):
            return len(self.inputs.values(self.system, 0.0))
        return len(self.changing)

    @cached_property
    def choice(self) -> CompiledLaws | None:
        """Inputs of the next step: those carried over, then 1 or 0 for each of the `changing` rows.

        For the changing rows also their least pivot, scaled to a unit diagonal, and the index of
        its row.
        """
        if not self.carried:
            return None

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            found: list[Any] = []
            if self.carried > len(self.changing):
                found = self.inputs.next(self.system, y[0].graph, lambda body: state_of(y, body))
            if not self.changing:
                return found
            write_rows(system, t, y)
            matrix, rows = constraint_matrix(system, self.changing), self.changing
            entries = [matrix[i].get(j, 0.0) for i in rows for j in rows]
            rank = len(rows) - self.inputs.chosen.count(0.0)
            return [*found, *chosen_rows(len(rows), rank, entries)]

        return self.traced(kernel)


class MultiBodyLaws(SolvedRows):
    """The laws of N bodies; if `redundant`, reactions are of minimum norm."""

    @property
    def velocities(self) -> list[float]:
        """1 for each coordinate that is a velocity, else 0."""
        return ([0.0] * 7 + [1.0] * 6) * (self.n // WIDTH)

    def whole(self, step: Step, estimated: bool = True) -> None:
        """None: no step is one law, since the projection onto the manifold iterates."""
        return None

    def accelerations(self, system: MultiBody, t: Any, y: list[Any]) -> Any:
        """Fill the multipliers and response = accelerations; returns the rank of G."""
        clear_loads(system)
        apply_effects(system.effects, t, system, y)
        free_accelerations(system, y)
        if not self.row_count:
            return 0.0
        write_rows(system, t, y)
        rows = system.rows
        right = {k: -(rows[k, BIAS] + row_times_response(system, k)) for k in self.order}
        rank = self.multipliers(system, right, self.order)
        add_multipliers(system)
        return rank

    def slopes(self, system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
        """dy/dt; overwrites the tables of the system."""
        dy: list[Any] = [0.0] * self.n
        self.accelerations(system, t, y)
        put_rates(system, y, dy)
        return dy

    @cached_property
    def rate(self) -> CompiledLaws:
        """dy/dt."""
        return self.traced(self.slopes)

    @cached_property
    def jacobian(self) -> CompiledLaws:
        """d(dy/dt)/dy by rows, n n numbers."""
        return compile_columns(self.outputs(self.slopes), self.n)

    @cached_property
    def series(self) -> SeriesLaws:
        """The Taylor series of y, from the whole graph for any number of bodies."""
        return SeriesLaws(self.outputs(lambda *at: MultiBodyLaws.slopes(self, *at)))

    @cached_property
    def project(self) -> CompiledLaws:
        """y with unit quaternions and free spins on their polhodes."""

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            clear_response(system)
            move_by_response(system, y)
            project_spins(system, y)
            return y

        return self.traced(kernel)

    @cached_property
    def gap(self) -> CompiledLaws | None:
        """The largest position error [m]."""
        if not self.row_count:
            return None

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            write_rows(system, t, y)
            return [worst_gap(system, self.holonomic)]

        return self.traced(kernel)

    @cached_property
    def position(self) -> CompiledLaws | None:
        """y after one step of Newton's iteration on the position errors."""
        if not self.row_count:
            return None

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            write_rows(system, t, y)
            errors = {k: -system.rows[k, ERROR] for k in self.position_order}
            self.multipliers(system, errors, self.position_order, self.system.length)
            clear_response(system)
            add_multipliers(system)
            move_by_response(system, y)
            return y

        return self.traced(kernel)

    @cached_property
    def velocity(self) -> CompiledLaws | None:
        """y with the velocities projected onto the constraints in the metric of M."""
        return self.traced(self.hastened) if self.row_count else None

    def hastened(self, system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
        """As `velocity`, on the system's tables; the multipliers are the impulses of this
        projection [N s]."""
        write_rows(system, t, y)
        slips = {k: system.rows[k, RATE] - row_velocity(system, y, k) for k in self.order}
        self.multipliers(system, slips, self.order, self.system.speed)
        clear_response(system)
        add_multipliers(system)
        hasten(system, y)
        return y

    @cached_property
    def back(self) -> CompiledLaws | None:
        """y projected onto the manifold from nearby, then the position error before.

        One step of Newton's iteration for the positions; the remaining slips are removed with the
        same factors, which differ from those at the new position by the size of that step.
        """
        if not self.row_count or not all(self.holonomic):
            return None

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            clear_response(system)
            move_by_response(system, y)
            project_spins(system, y)
            write_rows(system, t, y)
            worst = worst_gap(system, self.holonomic)
            factors = factors_of(system, self.order, self.plan)
            errors = {k: -system.rows[k, ERROR] for k in self.order}
            self._respond(system, factors, errors, self.system.length)
            move_by_response(system, y)
            before = system.rows.copy()
            write_rows(system, t, y)
            slips = {k: system.rows[k, RATE] - row_velocity(system, y, k) for k in self.order}
            system.rows[:] = before
            self._respond(system, factors, slips, self.system.speed)
            hasten(system, y)
            return [*y, worst]

        return self.traced(kernel)

    def _respond(
        self, system: MultiBody, factors: Factors, right: dict[int, Any], scale: float
    ) -> None:
        """response = M^-1 G^T lambda, with lambda for these right sides. scale: as in
        `rounding`."""
        self._put(system, factors.solve(self._chosen(system, right), self.rounding(scale)))
        clear_response(system)
        add_multipliers(system)

    @cached_property
    def inside(self) -> CompiledLaws | None:
        """One number, 0 once a body has left its guide."""
        (output,) = self.outputs(lambda system, t, y: [on_guides(system, y)])
        return domain_law(output)

    @cached_property
    def along(self) -> CompiledLaws | None:
        """The parameter of each spline and its rate; None without splines."""
        return self.traced(lambda system, t, y: ways(system, y)) if self.splines else None

    @cached_property
    def sample(self) -> CompiledLaws:
        """The sample: all quantities reported at one instant."""

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            out: list[Any] = [0.0] * self.width
            out[: self.n] = y
            rank = self.accelerations(system, t, y)
            if self.redundant:
                take_least_norm(system, rank)
            at = self.n
            if self.row_count:
                at = put_reactions(system, y, out, at)
            put_balances(system, t, y, out, at, power_of_reactions(system))
            return out

        return self.traced(kernel, often=False)
