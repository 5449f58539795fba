"""The constraint lines of N bodies in traced laws: in which order they are eliminated, which get a
multiplier, and what it is.

The kernels of `systems` write their tables as they do with numbers; the tables hold symbols.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from rb_sim.catalogue.constraints.rows import HOLONOMIC
from rb_sim.engine.guides import GuidedLaws
from rb_sim.engine.hubs import factors_of, plan_of
from rb_sim.engine.independent import INDEPENDENT, Dependent
from rb_sim.engine.inputs import Inputs
from rb_sim.engine.laws import Compiled
from rb_sim.engine.object_tables import constraint_matrix, with_object_tables
from rb_sim.engine.places import Place
from rb_sim.engine.systems.choice import chosen_lines
from rb_sim.engine.systems.elimination import lines_in_order
from rb_sim.engine.systems.many_bodies import MULTIPLIERS, WIDTH, MultiBody, fill_all
from rb_sim.engine.systems.multipliers import write_rows
from rb_sim.engine.tables.graph_of_lines import Plan
from rb_sim.graph.machine import compile_law
from rb_sim.graph.symbols import Graph


class SolvedLines(GuidedLaws):
    """How kernels are traced, and the multipliers of constraint lines found in them.

    varied: places of constants that are inputs. changing: lines of which the inputs tell whether
    they get a multiplier; those of them that are `dependent` have none at the start.
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
        self.inputs = Inputs(varied, [float(k not in dependent.lines) for k in self.changing])
        self.n = WIDTH * system.bodies.shape[0]
        self.lines = system.lines.shape[0]

    def traced(self, kernel: Callable[..., list[Any]], *, often: bool = True) -> Compiled:
        """The law kernel(system, t, y); y is a list and may be written."""
        return compile_law(self.outputs(kernel), often=often)

    def outputs(self, kernel: Callable[..., list[Any]]) -> list[Any]:
        """The kernel is run on symbols of a new graph; returns its outputs."""
        graph = Graph()
        system = with_object_tables(self.inputs.symbolic(self.system, graph))
        if self.changing:
            first = len(self.inputs.values(self.system, 0.0)) - len(self.changing)
            symbols = graph.vector("p", len(self.changing), first)
            system = system._replace(chosen=dict(zip(self.changing, symbols, strict=True)))
        return kernel(system, graph.input("t"), list(graph.vector("y", self.n)))

    @cached_property
    def holonomic(self) -> list[bool]:
        """For each line whether it is holonomic, which its kind alone decides.

        Rows are written on symbols: at any numbers some scene has a point or an axis there, and a
        division by zero.
        """
        graph = Graph()
        system = with_object_tables(self.system)
        y = list(graph.vector("y", self.n))
        fill_all(system.constraints, graph.input("t"), system, y, 0)
        return [value != 0.0 for value in system.rows[:, HOLONOMIC]]

    @cached_property
    def whole_order(self) -> list[int]:
        """All lines in the order of elimination."""
        first = self.system.first_row
        parts = [range(first[i], first[i + 1]) for i in range(len(first) - 1)]
        bodies = [{c.body, c.parent} - {-1} for c in self.system.constraints]
        return lines_in_order(parts, bodies)

    @cached_property
    def order(self) -> list[int]:
        """Lines that get a multiplier, or may get one, in the order of elimination."""
        left_out = self.dependent.lines - set(self.changing)
        return [k for k in self.whole_order if k not in left_out]

    @cached_property
    def position_order(self) -> list[int]:
        """Holonomic lines in the order of elimination, those left out that depend on others."""
        left_out = self.dependent.positions - set(self.changing)
        return [k for k in self.whole_order if self.holonomic[k] and k not in left_out]

    def multipliers(self, system: MultiBody, right: dict[int, Any], order: Sequence[int]) -> Any:
        """Multipliers of the lines in `order`, the others zero; the rank of those lines."""
        factors = factors_of(system, order, self.plan)
        self._put(system, factors.solve(self._chosen(system, right)))
        return factors.rank - self.inputs.chosen.count(0.0)

    def _chosen(self, system: MultiBody, right: dict[int, Any]) -> dict[int, Any]:
        """The right sides, zero for lines that are not chosen."""
        chosen = dict(system.chosen)
        return {k: value * chosen.get(k, 1.0) for k, value in right.items()}

    @cached_property
    def plan(self) -> Plan | None:
        """The order of elimination where there are hubs; lines that depend on others have none."""
        return None if self.redundant or self.dependent.lines else plan_of(self.system)

    def _put(self, system: MultiBody, found: dict[int, Any]) -> None:
        """Write the multipliers of all lines, zero where none was found."""
        for k in range(self.lines):
            system.vectors[MULTIPLIERS, k] = found.get(k, 0.0)

    @cached_property
    def choice(self) -> Compiled | None:
        """Which of the `changing` lines get a multiplier in a step from here, 1 or 0 each.

        Then their least pivot, scaled to a diagonal of ones, and the number of its line among them.
        """
        if not self.changing:
            return None

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            write_rows(system, t, y)
            matrix, lines = constraint_matrix(system, self.changing), self.changing
            entries = [matrix[i].get(j, 0.0) for i in lines for j in lines]
            rank = len(lines) - self.inputs.chosen.count(0.0)
            return list(chosen_lines(len(lines), rank, entries))

        return self.traced(kernel)
