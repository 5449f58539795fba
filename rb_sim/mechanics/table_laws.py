# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Laws of many bodies over tables: those of MultiBodyLaws, traced once per kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from rb_sim.catalogue.spec import potential
from rb_sim.compiler.graph.symbols import Graph
from rb_sim.compiler.graph.table_program import Field, Program
from rb_sim.mechanics import local
from rb_sim.mechanics.blocks import clear, clear_out, constraint_nodes, hubs_of, planned
from rb_sim.mechanics.laws import CompiledLaws
from rb_sim.mechanics.local import BARRED
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.program_rows import (
    ConstraintRows,
    Instance,
    UntabledError,
    leaves_of,
    run,
    shape_of,
)
from rb_sim.mechanics.systems.many_bodies import WIDTH, MultiBody

BODIES = 12
"""Least number of bodies for which the laws are programs over tables (`python -m
benchmarks.sizes`)."""


class TableLaws(MultiBodyLaws):
    """The laws of MultiBodyLaws as programs over tables; no constants are inputs."""

    @cached_property
    def _symbolic(self) -> MultiBody:
        return self.inputs.symbolic(self.system, Graph())

    @cached_property
    def _bodies(self) -> list[tuple[float, ...]]:
        """(mass, inertia, inverse inertia) of each body."""
        return [
            tuple(row) for row in self.system.bodies[: self.n // WIDTH, : local.RESPONSE].tolist()
        ]

    def _new(
        self, parts: Sequence[int], left_out: frozenset[int]
    ) -> tuple[Program, ConstraintRows]:
        """A program, and the rows of these parts in it; rows in `left_out` get no multiplier."""
        program = Program()
        nodes = constraint_nodes(self._pairs, self._sizes, parts)
        hubs = frozenset() if self.redundant else hubs_of(nodes)
        first = self.system.first_row
        barred = [
            tuple(BARRED if row in left_out else 0.0 for row in range(first[k], first[k + 1]))
            for k in self._parts
        ]
        plan, rows = planned(nodes, hubs), self._symbolic.constraints
        return program, ConstraintRows(
            program, plan, rows, self._bodies, barred if left_out else ()
        )

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        return [(c.body, c.parent) for c in self.system.constraints]

    @cached_property
    def _sizes(self) -> list[int]:
        first = self.system.first_row
        return [int(first[k + 1] - first[k]) for k in range(len(first) - 1)]

    @cached_property
    def _parts(self) -> list[int]:
        return list(range(len(self._sizes)))

    @cached_property
    def _position_parts(self) -> list[int]:
        """Parts whose rows are holonomic; UntabledError for a part with rows of both kinds."""
        first = self.system.first_row
        found = []
        for k in self._parts:
            flags = set(self.holonomic[first[k] : first[k + 1]])
            if len(flags) != 1:
                raise UntabledError
            if flags == {True}:
                found.append(k)
        return found

    def _each_body(self, program: Program, kernel: Any, *fields: tuple[str, int, int, int]) -> None:
        """Run kernel(t, *fields) for every body; fields: (base, first place, stride, width).

        The last field is the output.
        """
        bodies = range(self.n // WIDTH)
        taken = [
            Field(base, width, [first + stride * i for i in bodies])
            for base, first, stride, width in fields[:-1]
        ]
        base, first, stride, _ = fields[-1]
        given = [(base, [first + stride * i for i in bodies])]
        program.run((kernel.__name__,), kernel, taken, given)

    def _free_accelerations(self, program: Program, rows: ConstraintRows) -> None:
        """Compute loads, and the accelerations under them alone, in rows.response."""
        bodies = range(len(self._bodies))
        load = program.workspace(6 * len(bodies))
        clear(program, 6, [load + 6 * i for i in bodies])
        effects = []
        for placed in self._symbolic.effects:
            pair = [i for i in (placed.body, placed.parent) if i >= 0]
            states = [("y", WIDTH * i, WIDTH) for i in pair]
            loads = [("frame", load + 6 * i, 6) for i in pair]
            outputs = tuple((base, at) for base, at, _ in loads)
            thing = self._bodies[placed.body], placed.row
            effects.append(Instance(thing, (*states, *loads), outputs))
        run(program, "load", local.with_load, effects)
        run(
            program,
            "freely",
            local.freely,
            [
                Instance(
                    self._bodies[i],
                    (("y", WIDTH * i, WIDTH), ("frame", load + 6 * i, 6)),
                    (("frame", rows.response + 6 * i),),
                )
                for i in bodies
            ],
        )
        rows.load = load

    def _accelerations(
        self, sampled: dict[str, Any] | None = None
    ) -> tuple[Program, ConstraintRows]:
        program, rows = self._new(self._parts, self.dependent.rows)
        self._free_accelerations(program, rows)
        rows.write("y", 0, "accelerated", sampled)
        least = sampled is not None and self.redundant
        dense = rows.dense() if least else 0
        rows.solve()
        if least:
            rows.least_norm(dense)
        rows.add_multipliers()
        return program, rows

    @cached_property
    def rate(self) -> CompiledLaws:
        """dy/dt."""
        program, rows = self._accelerations()
        self._each_body(
            program,
            local.slopes,
            ("y", 0, WIDTH, WIDTH),
            ("frame", rows.response, 6, 6),
            ("out", 0, WIDTH, WIDTH),
        )
        return program.compiled()

    def _project_into(self, program: Program, base: str, first: int) -> None:
        """Write y with unit quaternions and free spins on their polhodes into an array."""
        own = (base, first, WIDTH, WIDTH)
        self._each_body(program, local.unit, ("y", 0, WIDTH, WIDTH), own)
        spins = []
        for spin in self._symbolic.spins:
            place = (base, first + WIDTH * spin.body, WIDTH)
            spins.append(Instance(spin._replace(body=0), (place,), (place[:2],)))
        run(program, "polhode", local.on_own_polhode, spins)

    @cached_property
    def project(self) -> CompiledLaws:
        """y with unit quaternions and free spins on their polhodes."""
        program = Program()
        self._project_into(program, "out", 0)
        return program.compiled()

    @cached_property
    def gap(self) -> CompiledLaws | None:
        """The largest position error [m]."""
        if not self.row_count:
            return None
        program, rows = self._new(self._parts, self.dependent.rows)
        clear_out(program, 0)
        rows.gap("y", 0, ("out", 0, 1), float(self.system.length))
        return program.compiled()

    @cached_property
    def position(self) -> CompiledLaws | None:
        """y after one step of Newton's iteration on the position errors."""
        if not self.row_count:
            return None
        program, rows = self._new(self._position_parts, self.dependent.positions)
        worst = program.workspace(1)
        clear(program, 1, [worst])
        length = float(self.system.length)
        rows.write("y", 0, "displaced", {"worst": ("frame", worst, 1), "length": length})
        rows.solve()
        self._from_rest(program, rows)
        self._moved(program, local.moved, rows, "y", 0, "out")
        return program.compiled()

    @cached_property
    def velocity(self) -> CompiledLaws | None:
        """y with the velocities projected onto the constraints in the metric of M."""
        if not self.row_count:
            return None
        program, rows = self._new(self._parts, self.dependent.rows)
        rows.write("y", 0, "slipping")
        rows.solve()
        self._from_rest(program, rows)
        self._moved(program, local.hastened, rows, "y", 0, "out")
        return program.compiled()

    @cached_property
    def back(self) -> CompiledLaws | None:
        """y projected onto the manifold from nearby, then the position error before
        (MultiBodyLaws.back)."""
        if not self.row_count or not all(self.holonomic):
            return None
        program, rows = self._new(self._parts, self.dependent.rows)
        first, then = program.workspace(self.n), program.workspace(self.n)
        self._project_into(program, "frame", first)
        clear_out(program, self.n)
        length = float(self.system.length)
        rows.write("frame", first, "displaced", {"worst": ("out", self.n, 1), "length": length})
        rows.solve()
        self._from_rest(program, rows)
        self._moved(program, local.moved, rows, "frame", first, "frame", then)
        rows.right_again("frame", then)
        rows.solve_again()
        self._from_rest(program, rows)
        self._moved(program, local.hastened, rows, "frame", then, "out")
        return program.compiled()

    def _from_rest(self, program: Program, rows: ConstraintRows) -> None:
        """response = M^-1 G^T lambda."""
        clear(program, 6, [rows.response + 6 * i for i in range(len(self._bodies))])
        rows.add_multipliers()

    def _moved(
        self,
        program: Program,
        kernel: Callable[..., Any],
        rows: ConstraintRows,
        base: str,
        first: int,
        to: str,
        then: int = 0,
    ) -> None:
        """Run the kernel on y (base, first) and response; the result is at (to, then)."""
        response = ("frame", rows.response, 6, 6)
        fields = ((base, first, WIDTH, WIDTH), response, (to, then, WIDTH, WIDTH))
        self._each_body(program, kernel, *fields)

    @cached_property
    def sample(self) -> CompiledLaws:
        """The sample: all quantities reported at one instant."""
        at = self.width - 10
        program_rates: dict[str, Any] = {
            "worst": ("out", at + 9, 1),
            "scales": (float(self.system.length), float(self.system.speed)),
        }
        program, rows = self._accelerations(program_rates)
        own = ("y", 0, WIDTH, WIDTH)
        self._each_body(program, local.kept, own, ("out", 0, WIDTH, WIDTH))
        self._reactions(program, rows)
        self._balances(program, rows, at)
        return program.compiled()

    def _reactions(self, program: Program, rows: ConstraintRows) -> None:
        instances = []
        for o, (main, *counted) in enumerate(self.system.members.tolist()):
            placed = self._symbolic.constraints[main]
            pair = [i for i in (placed.body, placed.parent) if i >= 0]
            fields = [("y", WIDTH * i, WIDTH) for i in pair]
            for part, counts in enumerate(counted):
                if counts:
                    fields += rows.of_part(part)
            thing = placed.row, len(pair) == 2
            instances.append(Instance(thing, tuple(fields), (("out", self.n + 9 * o),)))
        run(program, "reaction", local.reaction, instances)

    def _balances(self, program: Program, rows: ConstraintRows, at: int) -> None:
        """Write energies, power and momenta."""
        bodies = []
        for i, constants in enumerate(self._bodies):
            totals = (("out", at, 1), ("out", at + 3, 6))
            fields = (("y", WIDTH * i, WIDTH), *totals)
            bodies.append(Instance(constants, fields, tuple((b, k) for b, k, _ in totals)))
        run(program, "momenta", local.momenta, bodies)
        effects = []
        for placed in self._symbolic.effects:
            pair = [i for i in (placed.body, placed.parent) if i >= 0]
            to = ("out", at + (1 if type(placed.row) in potential.kernels else 2))
            states = [("y", WIDTH * i, WIDTH) for i in pair]
            thing = self._bodies[placed.body], placed.row
            effects.append(Instance(thing, (*states, (*to, 1)), (to,)))
        run(program, "energy", local.energy, effects)
        rows.power(("out", at + 2))


def laws_over_tables(laws: MultiBodyLaws) -> MultiBodyLaws:
    """The laws of the same system over tables, if possible and worthwhile; else the laws
    unchanged."""
    system = laws.system
    if system.bodies.shape[0] < BODIES or laws.inputs.varied:
        return laws
    made = TableLaws(system, laws.width, laws.redundant, (), laws.dependent)
    try:
        for placed in (*made._symbolic.effects, *made._symbolic.constraints):
            shape_of(placed.row)
            leaves_of(placed.row)
        if made.row_count:
            _ = made._position_parts
    except UntabledError:
        return laws
    return made
