"""The laws of N bodies in maximal coordinates, traced with the whole elimination."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from rb_sim.catalogue.constraints.rows import BIAS, ERROR, RATE
from rb_sim.engine.guides import on_guides, ways
from rb_sim.engine.hubs import factors_of
from rb_sim.engine.laws import Compiled, domain_law
from rb_sim.engine.object_tables import (
    hasten,
    take_least_norm,
)
from rb_sim.engine.solved_lines import SolvedLines
from rb_sim.engine.systems.elimination import Factors
from rb_sim.engine.systems.free_spin import settle_spins
from rb_sim.engine.systems.many_bodies import WIDTH, MultiBody, apply_effects
from rb_sim.engine.systems.multibody import (
    power_of_reactions,
    put_balances,
    put_rates,
    put_reactions,
    worst_gap,
)
from rb_sim.engine.systems.multipliers import (
    add_multipliers,
    clear_loads,
    clear_push,
    free_accelerations,
    move_by_push,
    row_times_push,
    row_velocity,
    write_rows,
)
from rb_sim.graph.columns import compile_columns
from rb_sim.graph.series_code import SeriesLaws
from rb_sim.loops.compiled import Step


class MultiBodyLaws(SolvedLines):
    """The laws of N bodies; reactions are of least norm where `redundant`."""

    @property
    def velocities(self) -> list[float]:
        """1 for each coordinate that is a velocity, else 0."""
        return ([0.0] * 7 + [1.0] * 6) * (self.n // WIDTH)

    def whole(self, step: Step, estimated: bool = True) -> None:
        """No step is one law: the way back to the manifold iterates."""
        return None

    def accelerations(self, system: MultiBody, t: Any, y: list[Any]) -> Any:
        """Fill the multipliers and push = accelerations; returns the rank of G."""
        clear_loads(system)
        apply_effects(system.effects, t, system, y)
        free_accelerations(system, y)
        if not self.lines:
            return 0.0
        write_rows(system, t, y)
        rows = system.rows
        right = {k: -(rows[k, BIAS] + row_times_push(system, k)) for k in self.order}
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
    def rate(self) -> Compiled:
        """dy/dt."""
        return self.traced(self.slopes)

    @cached_property
    def jacobian(self) -> Compiled:
        """d(dy/dt)/dy by rows, n n numbers."""
        return compile_columns(self.outputs(self.slopes), self.n)

    @cached_property
    def series(self) -> SeriesLaws:
        """The Taylor series of y; of the whole graph, however many bodies there are."""
        return SeriesLaws(self.outputs(lambda *at: MultiBodyLaws.slopes(self, *at)))

    @cached_property
    def settle(self) -> Compiled:
        """Unit quaternions, and free spins on their polhodes."""

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            clear_push(system)
            move_by_push(system, y)
            settle_spins(system, y)
            return y

        return self.traced(kernel)

    @cached_property
    def gap(self) -> Compiled | None:
        """The largest position error [m]."""
        if not self.lines:
            return None

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            write_rows(system, t, y)
            return [worst_gap(system, self.holonomic)]

        return self.traced(kernel)

    @cached_property
    def position(self) -> Compiled | None:
        """y after one step of Newton's iteration on the position errors."""
        if not self.lines:
            return None

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            write_rows(system, t, y)
            errors = {k: -system.rows[k, ERROR] for k in self.position_order}
            self.multipliers(system, errors, self.position_order)
            clear_push(system)
            add_multipliers(system)
            move_by_push(system, y)
            return y

        return self.traced(kernel)

    @cached_property
    def velocity(self) -> Compiled | None:
        """y with the nearest admissible velocities in the metric of M."""
        return self.traced(self.hastened) if self.lines else None

    def hastened(self, system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
        """As `velocity`; the multipliers are the impulses that give the velocities [N s]."""
        write_rows(system, t, y)
        slips = {k: system.rows[k, RATE] - row_velocity(system, y, k) for k in self.order}
        self.multipliers(system, slips, self.order)
        clear_push(system)
        add_multipliers(system)
        hasten(system, y)
        return y

    @cached_property
    def back(self) -> Compiled | None:
        """y from near the manifold back on it, then the position error before.

        One step of Newton's iteration for the positions; the slips that are left go out with the
        same factors, which differ from those of the new position by the size of that step.
        """
        if not self.lines or not all(self.holonomic):
            return None

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            clear_push(system)
            move_by_push(system, y)
            settle_spins(system, y)
            write_rows(system, t, y)
            worst = worst_gap(system, self.holonomic)
            factors = factors_of(system, self.order, self.plan)
            self._push(system, factors, {k: -system.rows[k, ERROR] for k in self.order})
            move_by_push(system, y)
            before = system.rows.copy()
            write_rows(system, t, y)
            slips = {k: system.rows[k, RATE] - row_velocity(system, y, k) for k in self.order}
            system.rows[:] = before
            self._push(system, factors, slips)
            hasten(system, y)
            return [*y, worst]

        return self.traced(kernel)

    def _push(self, system: MultiBody, factors: Factors, right: dict[int, Any]) -> None:
        """push = M^-1 G^T lambda for the multipliers of these right sides."""
        self._put(system, factors.solve(self._chosen(system, right)))
        clear_push(system)
        add_multipliers(system)

    @cached_property
    def inside(self) -> Compiled | None:
        """One number, 0 once a body has left the end of its guide."""
        (output,) = self.outputs(lambda system, t, y: [on_guides(system, y)])
        return domain_law(output)

    @cached_property
    def along(self) -> Compiled | None:
        """The parameter of each spline and its rate."""
        return self.traced(lambda system, t, y: ways(system, y)) if self.splines else None

    @cached_property
    def sample(self) -> Compiled:
        """Everything that is reported at one instant."""

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            out: list[Any] = [0.0] * self.width
            out[: self.n] = y
            rank = self.accelerations(system, t, y)
            if self.redundant:
                take_least_norm(system, rank)
            at = self.n
            if self.lines:
                at = put_reactions(system, y, out, at)
            put_balances(system, t, y, out, at, power_of_reactions(system))
            return out

        return self.traced(kernel, often=False)
