# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motion of bodies in contact under time stepping: a grid of steps, and samples.

As in `integrate.loop`, the grid does not depend on the samples: a sample between two grid points is
a separate step from the point before it, whose effect on the memory of contacts is undone.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np

from rb_sim.catalogue.constraints.rows import RATE, ROW_WIDTH
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.catalogue.geometry.solids import Box
from rb_sim.compiler.graph.machine import evaluate_rows
from rb_sim.contact.grid_motion import OPEN_SHARES, GridMotion, LeftOpen
from rb_sim.contact.stepping import step_kernels
from rb_sim.contact.stepping.scene_tables import (
    Neighbours,
    PointLaws,
    Tables,
    addresses,
    resized,
    tables_of,
)
from rb_sim.contact.stepping.step_workspace import (
    ACTIVE,
    ALL_SWEEPS,
    ASTRAY,
    ASTRAY_AT,
    ASTRAY_OF,
    FRESH,
    GAVE,
    LENGTH,
    MADE,
    OPEN,
    OPEN_AT,
    OPEN_OF,
    ROUGH_SLIPS,
    SEVERAL,
    STRUCK,
    TURNED,
    UNSOLVED,
    WORST,
    memory_of,
    workspace_for,
)
from rb_sim.contact.tunnelling import run_looking
from rb_sim.integrate.layout import NOT_FINITE, ULPS
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.contact.contact_bodies import AMONG_POSITIONS, AMONG_ROWS, DEPENDENT
from rb_sim.mechanics.contact.contact_laws import ContactLaws
from rb_sim.mechanics.inputs import kept_inputs, with_kept
from rb_sim.mechanics.laws import CompiledLaws, reference
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.elimination import Dependent
from rb_sim.mechanics.systems.many_bodies import (
    MULTIPLIERS,
    ROW_TABLE_COLUMNS,
    MultiBody,
    anchor_all,
    energetics,
    state_of,
)
from rb_sim.mechanics.systems.multibody import residual_of, write_rows
from rb_sim.motion.motion import Motion
from rb_sim.numerics.vectors import add, cross, rotate, sub


class Joints:
    """The joints of a scene under time stepping: laws of their rows and of the projection.

    system: the joints alone as MultiBody, with tables of its own.
    """

    def __init__(self, system: Any) -> None:
        count = int(system.first_row[len(system.constraints)])
        self.system = joint_system(system, count)
        flags = system.row_table[:count, DEPENDENT]
        left_out = (
            frozenset(np.flatnonzero(flags & among).tolist())
            for among in (AMONG_ROWS, AMONG_POSITIONS)
        )
        self.laws = MultiBodyLaws(self.system, 0, bool(flags.any()), (), Dependent(*left_out))
        self._inputs = np.array([*self.laws.inputs.values(self.system, 0.0), 0.0])

    @cached_property
    def _written(self) -> CompiledLaws:
        """The law of the rows."""

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            write_rows(system, t, y)
            return list(system.rows.ravel())

        return self.laws.traced(kernel)

    def rows(self, t: float, y: Array) -> Array:
        """The rows at (t, y), shape (n, ROW_WIDTH)."""
        n = self.system.row_table.shape[0]
        return self.value(self._written, t, y, n * ROW_WIDTH).reshape(n, ROW_WIDTH)

    @cached_property
    def _hastened(self) -> CompiledLaws:
        """The law of the projection of velocities: y, then the impulse of each row for it."""

        def kernel(system: MultiBody, t: Any, y: list[Any]) -> list[Any]:
            return [*self.laws.hastened(system, t, y), *system.vectors[MULTIPLIERS]]

        return self.laws.traced(kernel)

    def into(self, tables: Tables) -> Tables:
        """The tables with the laws of the joints."""
        laws = self.laws
        found = self._written, laws.project, laws.gap, laws.position, self._hastened
        return tables._replace(
            joint_laws=addresses([reference(law) for law in found]), joint_inputs=self._inputs
        )

    def value(self, law: Any, t: float, y: Array, count: int) -> Array:
        """The results of a law at (t, y), `count` numbers."""
        out = np.zeros((1, count))
        state = np.ascontiguousarray(y[None, : self.laws.n])
        evaluate_rows(law, np.array([t]), state, self._inputs, out)
        return out[0]


def joint_system(system: Any, rows: int) -> MultiBody:
    """The system of the joints alone, with a workspace of its own."""
    joints = len(system.constraints)
    return MultiBody(
        bodies=system.bodies.copy(),
        row_table=system.row_table[:rows, :ROW_TABLE_COLUMNS].copy(),
        rows=np.zeros((rows, system.rows.shape[1])),
        vectors=np.zeros((2, rows)),
        first_row=system.first_row[: joints + 1].copy(),
        members=system.members[:, : 1 + joints].copy(),
        anchors=np.zeros((joints, 3)),
        length=system.length,
        speed=system.speed,
        effects=(),
        constraints=system.constraints,
    )


def other_effects(system: Any) -> tuple[Any, ...]:
    """The effects other than gravity, which the kernels compute themselves."""
    return tuple(e for e in system.effects if not isinstance(e.row, GravityRow))


SUNK_IN_STEPS = 1e-3
"""Depth, over the thickness of what meets, by which a side may lie deeper than its points."""
MOST_AT_ONCE = 4096
"""Steps in one call of a kernel, so that signals are answered."""


class SteppedContacts(GridMotion):
    """Bodies in contact under time stepping, without events."""

    def __init__(self, compiled: Compiled, method: Any) -> None:
        laws = PointLaws()
        tables = tables_of(compiled, laws)
        system = compiled.system
        self._others = other_effects(system)
        alone = system._replace(effects=self._others)
        self._loads = ContactLaws(alone)
        if self._others:
            inputs = np.array([*self._loads.inputs.values(alone, 0.0), 0.0])
            found = [reference(self._loads.loads_and_inputs), *tables.addresses[1:]]
            kept = len(inputs) - 1 if kept_inputs(alone) else 0
            loads = np.zeros(6 * len(system.bodies) + kept)
            tables = tables._replace(addresses=addresses(found), inputs=inputs, loads=loads)
        self._kept_inputs = np.array(kept_inputs(alone), dtype=int)
        self._joints = Joints(system) if system.constraints else None
        if self._joints is not None:
            tables = self._joints.into(tables)
        self._fixed = self._tables = tables
        between = compiled.between
        near = between is not None
        self._near = Neighbours(compiled, between, tables, laws) if near else None
        self._sides = tuple(
            sides
            for sides in compiled.sides
            if not (isinstance(sides.own, Box) and isinstance(sides.support, Box))
        )  # two boxes touch with their edges as well
        super().__init__(compiled, method)

    @property
    def unsolved_steps(self) -> int:
        """Number of steps in which the solver reached its limit before it converged."""
        return int(self._workspace.notes[UNSOLVED])

    @property
    def circling_steps(self) -> int:
        """Number of steps in which the only point of a closed contact ran around its body."""
        return int(self._workspace.notes[TURNED])

    @property
    def restruck_energy(self) -> float:
        """Energy dissipated in impacts of rigid contacts that were closed already [J]."""
        return float(self._workspace.notes[STRUCK])

    @property
    def made_energy(self) -> float:
        """Energy gained in rigid contacts, which by their laws gain none [J]."""
        return float(self._workspace.notes[MADE])

    @property
    def astray(self) -> tuple[float, float, int]:
        """Largest velocity given by an impulse along a normal that rotated within the step,
        relative to the scene's speed; its time [s], and index of the contact."""
        self._name_points()
        speed, t, c = self._workspace.notes[[ASTRAY, ASTRAY_AT, ASTRAY_OF]].tolist()
        return speed / float(self._tables.scales[1]), t, int(c) if c >= 0.0 else -1 - int(c)

    def _name_points(self) -> None:
        """Replace indices of points of neighbours in the notes, which change, by -1 - contact."""
        notes = self._workspace.notes
        for figure, of in ((ASTRAY, ASTRAY_OF), (OPEN, OPEN_OF)):
            c = int(notes[of])
            if self._near is not None and notes[figure] > 0.0 and c >= len(self._fixed.owners):
                notes[of] = -1 - int(self._tables.shares[c, 2])

    @property
    def left_open(self) -> LeftOpen:
        """The first non-uniqueness of contact forces that changes the motion."""
        self._name_points()
        figure, t, c = self._workspace.notes[[OPEN, OPEN_AT, OPEN_OF]].tolist()
        if figure == 0.0:
            return LeftOpen()
        name = self.layout.contacts[int(c) if c >= 0.0 else -1 - int(c)]
        return LeftOpen(figure, t, name, OPEN_SHARES)

    @property
    def swept_contacts(self) -> float:
        """Sweeps of the solver so far times the number of active contacts now."""
        return float(self._workspace.notes[ALL_SWEEPS] * self._workspace.notes[ACTIVE])

    @property
    def paradox_steps(self) -> int:
        """Number of steps in which a slipping contact has Painleve's paradox."""
        return int(self._workspace.notes[SEVERAL])

    @property
    def slipping_steps(self) -> int:
        """Number of steps in which a perfectly rough contact slipped."""
        return int(self._workspace.notes[ROUGH_SLIPS])

    @property
    def solver_residual(self) -> float:
        """Largest residual of a step's contact problem relative to its largest impulse: change of
        an impulse in the last sweep, or natural map after Newton's method; 0 for a moving heap
        whose residual, `solver_give`, is within its tolerance."""
        return float(self._workspace.notes[WORST])

    @property
    def solver_give(self) -> float:
        """Largest residual of a contact law in a moving heap: natural map relative to the largest
        impulse of its step."""
        return float(self._workspace.notes[GAVE])

    def reset(self, y: Any = None, time: float = 0.0) -> None:
        """As Motion.reset, with new workspace and memory of the contacts."""
        super().reset(y, time)
        self._take_inputs(fresh=True)
        if self._near is not None:
            self._look(np.asarray(self._grid.y1))
        points = len(self._tables.owners)
        bodies = len(self._tables.bodies)
        self._workspace = workspace_for(bodies, points, len(self._tables.joints))
        self._memory, self._memory_before = memory_of(points), memory_of(points)

    def _look(self, y: Array) -> None:
        """Update the tables with the neighbouring pairs at y."""
        assert self._near is not None
        self._tables = self._near.look(y, self.method.step)

    def _look_around(self, y: Array) -> None:
        """Search for neighbours if the present list is not valid for the next step from y."""
        near = self._near
        if near is None or not np.isfinite(y).all():
            return
        if not step_kernels.strayed(self._tables, y, self.method.step):
            return
        self._name_points()
        before = near.first
        self._look(y)
        points = len(self._tables.owners)
        self._memory = near.moved(before, self._memory, points)
        self._memory_before = near.moved(before, self._memory_before, points)
        sizes = len(self._tables.bodies), points, len(self._tables.joints)
        self._workspace = resized(self._workspace, *sizes)

    def reset_beside(self, run: Motion, y: Any, time: float) -> None:
        """As Motion, with the memory of the contacts: without it, closed contacts would have
        impacts and lose energy."""
        super().reset_beside(run, y, time)
        assert isinstance(run, SteppedContacts)
        if self._near is not None and run._near is not None:
            self._memory = self._near.moved(run._near.first, run._memory, len(self._memory))
        else:
            self._memory[:] = run._memory
        self._workspace.joint_x[:] = run._workspace.joint_x
        for note in (LENGTH, FRESH):
            self._workspace.notes[note] = run._workspace.notes[note]

    def _restart_grid(self) -> None:
        super()._restart_grid()
        self._take_inputs()

    def _take_inputs(self, *, fresh: bool = False) -> None:
        """Update the inputs of the laws; fresh: reset those that are carried from step to step."""
        self._others = other_effects(self.system)
        if self._others:
            system, kept = self.system._replace(effects=self._others), self.kept
            self._fixed.inputs[:-1] = self._loads.inputs.values(system, self.time)
            if not fresh:
                self.kept = kept

    @property
    def kept(self) -> Array:
        """As Motion.kept: inputs of the laws that are carried from step to step."""
        return self._fixed.inputs[self._kept_inputs]

    @kept.setter
    def kept(self, values: Array) -> None:
        self._fixed.inputs[self._kept_inputs] = values

    def run_to(self, times: Any, out: Array | None = None) -> int:
        """As Motion; also raises SimulationError if a side sinks into a support."""
        return run_looking(self, super().run_to, self._sides, times, out, SUNK_IN_STEPS)

    def warm(self) -> None:
        """Compile everything that `run_to` calls, by a step that is undone."""
        self.sample()
        kept = self._kept()
        self._one_step(self._memory.copy(), self._grid.t1, self._grid.y1.copy(), self.method.step)
        self._restore(*kept)

    # the grid

    def _record(self, times: Array, stop: float, out: Array | None) -> None:
        """Take steps to each of the times, and sample there."""
        for i, t in enumerate(times):
            while self._grid.t1 < t - ULPS * abs(t):
                self._advance(float(t), stop)
            self._stand_at(float(t), None if out is None else out[i])
            self.time = float(t)

    def _advance(self, t: float, stop: float) -> None:
        """Take grid steps to t or beyond; the last one ends at `stop` if it would cross it."""
        grid, step = self._grid, self.method.step
        y, before = grid.y1, np.array(grid.y1)
        self._look_around(y)
        first, last = grid.steps, stop * (1 - ULPS)
        count = int(min(MOST_AT_ONCE, max(1.0, (min(t, stop) - grid.t1) / step - 1e-6)))
        while count > 0 and grid.origin + (first + count) * step > last:
            count -= 1
        if count > 0:
            origin, h, number, end = grid.origin, step, first, math.inf
        else:  # the last step before the stop is a shorter one
            origin, h, number, end, count = grid.t1, stop - grid.t1, 0, stop, 1
        done = step_kernels.steps(
            self._tables, self._memory, self._workspace, origin, number, count, h, y, before,
            self._memory_before,
        )  # fmt: skip
        if np.isfinite(y).all():
            count = done  # or fewer, if a new search for neighbours is needed
        start = origin + (number + done - 1) * h
        if math.isinf(end):
            end = origin + (number + done) * h
        self._grid = grid._replace(steps=first + done, t0=start, y0=before, t1=end, y1=y)
        if done < count:
            raise self._failure(NOT_FINITE)

    def _stand_at(self, t: float, out: Array | None) -> None:
        """The state at t, between t0 and t1, and its sample."""
        grid, slack = self._grid, ULPS * abs(t)
        fresh = self._workspace.notes[LENGTH] == 0.0
        if t >= grid.t1 - slack and not fresh:
            y, h = grid.y1.copy(), self._workspace.notes[LENGTH]
            if out is not None:
                self._sample(self._memory, t, y, h, out)
        elif t <= grid.t0 + slack or fresh:
            y = (grid.y1 if fresh else grid.y0).copy()
            if out is not None:
                self._tried(t, y, out)
        else:
            y = self._between(t, out)
        self._grid = self._grid._replace(y=y)

    def _between(self, t: float, out: Array | None) -> Array:
        """The state at t and its sample, by a step from t0 that is undone."""
        grid, kept = self._grid, self._kept()
        y, memory = np.array(grid.y0), self._memory_before.copy()
        self._one_step(memory, grid.t0, y, t - grid.t0)
        if out is not None:
            self._sample(memory, t, y, t - grid.t0, out)
        self._restore(*kept)
        return y

    def _tried(self, t: float, y: Array, out: Array) -> None:
        """A sample before the first step, with the forces of a step that is undone."""
        kept = self._kept()
        moved, memory, h = y.copy(), self._memory_before.copy(), self.method.step
        self._one_step(memory, t, moved, h)
        self._sample(memory, t, y, h, out)
        self._restore(*kept)

    def _one_step(self, memory: Array, t: float, y: Array, h: float) -> None:
        """One step of length h from (t, y); y and memory in place."""
        before = np.empty_like(memory)
        step_kernels.steps(
            self._tables, memory, self._workspace, t, 0, 1, h, y, np.empty_like(y), before
        )

    def _kept(self) -> tuple[list[Array], Array]:
        return [a.copy() for a in self._workspace], self._memory.copy()

    def _restore(self, workspace: list[Array], memory: Array) -> None:
        for a, b in zip(self._workspace, workspace, strict=True):
            a[...] = b
        self._memory[...] = memory

    def _carrying(self) -> Any:
        """The system with the bodies of the tables, for effects to act on."""
        return self.system._replace(bodies=self._tables.bodies)

    # samples

    def _sample(self, memory: Array, t: float, y: Array, h: float, out: Array) -> None:
        """Write the row of a sample at (t, y), with the impulses in `memory` over h."""
        members, joints = self.system.members, len(self.system.constraints)
        step_kernels.report(self._tables, memory, self._workspace, members, joints, y, h, out)
        at = 13 * len(self.layout.bodies) + 9 * len(self.layout.reactions)
        if self._others:
            system = self._carrying()
            if len(self._kept_inputs):
                system = with_kept(system, self.kept.tolist())
            potential, power = energetics(other_effects(system), t, system, y)
            out[at + 1] += potential
            out[at + 2] += power
        if self._joints is not None:
            self._sample_joints(t, y, h, out, at)

    def _sample_joints(self, t: float, y: Array, h: float, out: Array, at: int) -> None:
        """Write reactions of joints, power of driven ones, and the constraint violation."""
        assert self._joints is not None
        system = self._joints.system
        system.rows[...] = self._joints.rows(t, y)
        anchor_all(system.constraints, system, y)
        workspace = self._workspace
        x = system.vectors[MULTIPLIERS] = (workspace.joint_x + workspace.joint_back) / h
        first, row = system.first_row, 13 * len(self.layout.bodies)
        for members in self.system.members:
            main = int(members[0])
            if 0 <= main < len(system.constraints):
                b = int(system.row_table[first[main], 0])
                B, anchor = state_of(y, b), tuple(system.anchors[main])
                force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
                for part in np.flatnonzero(members[1 : 1 + len(system.constraints)]):
                    for k in range(first[part], first[part + 1]):
                        force = add(force, tuple(x[k] * system.rows[k, 0:3]))
                        torque = add(torque, rotate(B.q_WB, tuple(x[k] * system.rows[k, 3:6])))
                torque = add(torque, cross(sub(B.p_WC, anchor), force))
                out[row : row + 9] = [*force, *torque, *anchor]
            row += 9
        out[at + 2] += float(x @ system.rows[:, RATE])
        out[at + 9] = max(out[at + 9], residual_of(system, y))
