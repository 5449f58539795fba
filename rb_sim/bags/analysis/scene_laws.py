# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Constraint errors, energies and loads of a scene at many instants of a recorded motion.

The constraint rows and effect laws are those of the simulation, traced once and evaluated on
arrays. If only poses were recorded, the velocities come from the filter that differentiates them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.catalogue.constraints.rows import COUNT, ERROR, HOLONOMIC, RATE
from rb_sim.catalogue.contact import Touching
from rb_sim.catalogue.effects.torsion import TorsionSpringRow, twist
from rb_sim.catalogue.geometry.pairs import carrier, touching
from rb_sim.catalogue.spec import BodyState, potential, wrench
from rb_sim.compiler.graph.symbols import ArrayLaw, External, Graph, call
from rb_sim.mechanics.inputs import with_kept
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.many_bodies import WIDTH, arm_of, fill_all, inertial_of, state_of
from rb_sim.mechanics.systems.multibody import put_momenta, row_velocity
from rb_sim.numerics.vectors import add, cross, dot, rotate, sub
from rb_sim.scene.compile import compile_motion
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene


class Line(NamedTuple):
    """One constraint equation."""

    constraint: str
    holonomic: bool
    """it has a position error in addition to the velocity error."""
    arm: float
    """factor that converts its error to a length: 1, or the scene's length [m] for an angle."""


class Found(NamedTuple):
    """Values at n instants."""

    gap: Array
    """position error g of each equation; 0 if it is not holonomic, shape (n, rows)."""
    slip: Array
    """velocity error G u - b of each equation, shape (n, rows)."""
    overlap: Array
    """penetration depth of each contact point [m], negative if apart, shape (n, points)."""
    potential: Array
    """of the conservative effects [J], shape (n,)."""
    power: Array
    """of the other effects [W], shape (n,)."""
    kinetic: Array
    """kinetic energy [J], shape (n,)."""
    momenta: Array
    """P and L about the world's origin, world axes, shape (n, 6)."""
    loads: Array
    """force and torque of the effects about the world's origin, world axes, shape (n, 6)."""


class SceneLaws:
    """Laws of a scene's constraints and effects on arrays; commands count as zero.

    lines, points: what the columns of `Found` refer to. length, speed: scales of the scene, as in
    the residual of a run. Laws that branch on the state are evaluated one instant at a time. Raises
    SceneError as compiling does.
    """

    def __init__(self, scene: Scene) -> None:
        place = InitialPlace(scene)
        self.bodies = tuple(scene.bodies)
        system: Any = compile_motion(scene, "maximal").system
        self.length, self.speed = float(system.length), float(system.speed)
        owners = [
            name
            for name, spec in scene.constraints.items()
            if not isinstance(spec, Touching)
            for part in spec.parts(place)  # type: ignore[attr-defined]
            for _ in range(COUNT[type(part.row)])
        ]
        graph = Graph()
        t, y = graph.input("t"), list(graph.vector("y", WIDTH * len(self.bodies)))
        rows = np.zeros(system.rows.shape, object)
        here = system._replace(rows=rows)
        fill_all(here.constraints, t, here, y)
        count = len(owners)
        self.lines = [
            Line(owners[k], rows[k, HOLONOMIC] != 0.0, arm_of(system, k)) for k in range(count)
        ]
        gaps = [rows[k, ERROR] if line.holonomic else 0.0 for k, line in enumerate(self.lines)]
        slips = [row_velocity(here, y, k) - rows[k, RATE] for k in range(count)]
        self.points, depths = _overlaps(scene, place, t, y)
        self._turns = Turns(system, t, y)
        own = graph.vector("y", self._turns.columns, len(y))
        effects = _effects(with_kept(system, own), t, y)
        momenta: list[Any] = [0.0] * 6
        kinetic = put_momenta(here, y, momenta, 0)
        ends = np.cumsum([count, count, len(depths), 1, 1, 1, 6])
        self._ends = ends.tolist()
        self._law = ArrayLaw(
            [*gaps, *slips, *depths, *effects[:2], kinetic, *momenta, *effects[2:]]
        )

    def at(self, t: Array, y: Array) -> Found:
        """Values at times t [s], (n,), and y: p_WC, q_WB, v_WC, w_WB_B of each body, (n, 13 N)."""
        whole = np.hstack([y, self._turns.at(t, y)])
        parts = np.split(self._law(t, whole), self._ends, axis=1)
        gap, slip, overlap, potential, power, kinetic, momenta, loads = parts
        return Found(
            gap, slip, overlap, potential[:, 0], power[:, 0], kinetic[:, 0], momenta, loads
        )


class Turns:
    """Counts whole turns of torsion springs along the samples, as their laws do in steps."""

    def __init__(self, system: Any, t: Any, y: list[Any]) -> None:
        springs = [e for e in system.effects if isinstance(e.row, TorsionSpringRow)]
        self.columns = 2 * len(springs)
        """number of columns: angle and whole turns of each spring."""
        self._law = ArrayLaw(
            [twist(e.row, state_of(y, e.body), state_of(y, e.parent))[0] for e in springs]
        )
        self._before = [(-np.inf, np.zeros(len(springs)))]
        """state at the ends of the pieces so far: time [s] and angles [rad]."""

    def at(self, t: Array, y: Array) -> Array:
        """The columns at each time, shape (n, columns); pieces come in order of time, or again."""
        if not self.columns or not len(t):
            return np.empty((len(t), self.columns))
        folded = self._law(t, y)
        before = next(angles for end, angles in reversed(self._before) if end <= t[0])
        angles = np.unwrap(np.vstack([before, folded]), axis=0)[1:]
        if t[-1] > self._before[-1][0]:
            self._before.append((float(t[-1]), angles[-1]))
        return np.stack([angles, angles - folded], axis=2).reshape(len(t), -1)


def _effects(system: Any, t: Any, y: list[Any]) -> list[Any]:
    """Potential energy, power of non-conservative effects, and total force and torque about the
    world's origin, world axes."""
    energy: Any = 0.0
    power: Any = 0.0
    force: Any = (0.0, 0.0, 0.0)
    torque: Any = (0.0, 0.0, 0.0)
    for placed in system.effects:
        row, inertial = placed.row, inertial_of(system, placed.body)
        B, A = state_of(y, placed.body), state_of(y, placed.parent)
        f, k_B = _wrench(row, t, inertial, B, A)
        k = rotate(B.q_WB, k_B)
        if type(row) in potential.kernels:
            energy = energy + potential(row, t, inertial, B, A)
        else:
            power = power + dot(f, B.v_WC) + dot(k_B, B.w_WB_B)
        if placed.parent < 0:
            force, torque = add(force, f), add(torque, add(k, cross(B.p_WC, f)))
        elif type(row) not in potential.kernels:  # between bodies: no outer wrench, but power
            moment = add(k, cross(sub(B.p_WC, A.p_WC), f))
            power = power - dot(f, A.v_WC) - dot(moment, rotate(A.q_WB, A.w_WB_B))
    return [energy, power, *force, *torque]


def _wrench(row: Any, t: Any, inertial: Any, B: BodyState, A: BodyState) -> Any:
    """Force, world axes, and torque about C, body axes, of one effect."""

    def plainly(t: Any, B: BodyState, A: BodyState) -> tuple[Any, ...]:
        force, torque = wrench(row, t, inertial, B, A)
        return (*force, *torque)

    found = _traced(plainly, 6, t, B, A)
    return found[:3], found[3:]


def _traced(plainly: Any, results: int, t: Any, B: BodyState, A: BodyState) -> tuple[Any, ...]:
    """Results of a function of the time and two states; it is called one instant at a time if it
    branches on them."""
    try:
        return plainly(t, B, A)
    except TypeError:
        numbers = [x for state in (B, A) for vector in state for x in vector]

        def on_numbers(t: float, *numbers: float) -> tuple[float, ...]:
            return plainly(t, _state(numbers[:13]), _state(numbers[13:]))

        return call(External(plainly.__qualname__, results, on_numbers, lambda: 0), t, *numbers)


def _state(n: Any) -> BodyState:
    return BodyState(n[:3], n[3:7], n[7:10], n[10:13])


def _overlaps(
    scene: Scene, place: InitialPlace, t: Any, y: list[Any]
) -> tuple[list[str], list[Any]]:
    """Names of the contact points and their penetration depths [m]."""
    index = {name: i for i, name in enumerate(scene.bodies)}
    names: list[str] = []
    depths: list[Any] = []
    for name, spec in scene.constraints.items():
        if not isinstance(spec, Touching):
            continue
        B = state_of(y, index[spec.body])
        A = state_of(y, -1 if spec.parent is None else index[spec.parent])
        found = [_overlap(part.row, t, B, A) for part in spec.parts(place)]
        depths += found
        names += [name if len(found) == 1 else f"{name}/{i + 1}" for i in range(len(found))]
    return names, depths


def _overlap(row: Any, t: Any, B: BodyState, A: BodyState) -> Any:
    def plainly(t: Any, B: BodyState, A: BodyState) -> tuple[Any, ...]:
        return (-touching(row.pair, B, carrier(row.carrier, t, A)[0]).gap,)

    return _traced(plainly, 1, t, B, A)[0]


# Constraint errors recomputed from poses.


@dataclass
class _Worst:
    """Largest value so far and its time [s]."""

    value: float = 0.0
    at: float | None = None

    def follow(self, t: Array, values: Array) -> None:
        k = int(np.nanargmax(values)) if np.isfinite(values).any() else -1
        if k >= 0 and (self.at is None or values[k] > self.value):
            self.value, self.at = float(values[k]), float(t[k])

    def as_dict(self) -> dict[str, Any]:
        return {"largest": self.value, "at": self.at}


class ConstraintFigures:
    """Tracks the errors of all constraints of `laws`."""

    def __init__(self, laws: SceneLaws) -> None:
        self._laws = laws
        rows: dict[str, list[int]] = {}
        for k, line in enumerate(laws.lines):
            rows.setdefault(line.constraint, []).append(k)
        holonomic = {n: [k for k in ks if laws.lines[k].holonomic] for n, ks in rows.items()}
        self._rows = rows, holonomic
        self._position = {name: _Worst() for name, ks in holonomic.items() if ks}
        self._velocity = {name: _Worst() for name in rows}
        self._overlap = {name: _Worst() for name in laws.points}
        self._relative = 0.0

    def add(self, t: Array, found: Found) -> None:
        """Append instants t (n,) [s] and the laws' values at them."""
        if not len(t):
            return
        rows, holonomic = self._rows
        for name, worst in self._position.items():
            worst.follow(t, np.abs(found.gap[:, holonomic[name]]).max(axis=1))
        for name, worst in self._velocity.items():
            worst.follow(t, np.abs(found.slip[:, rows[name]]).max(axis=1))
        for k, worst in enumerate(self._overlap.values()):
            worst.follow(t, found.overlap[:, k])
        arms = np.array([line.arm for line in self._laws.lines])
        gap = np.abs(found.gap * arms).max(initial=0.0) / self._laws.length
        slip = np.abs(found.slip * arms).max(initial=0.0) / self._laws.speed
        depth = abs(found.overlap.max(initial=0.0)) / self._laws.length  # of -0.0 too
        self._relative = float(np.nanmax([self._relative, gap, slip, depth]))

    def as_dict(self) -> dict[str, Any] | None:
        """Largest errors by constraint and their times; None if the scene has no constraints.

        position [m or rad] and velocity [m/s or rad/s] of joints; overlap [m] of contacts, negative
        if they never touched, and whether they did; relative: the largest of all relative to the
        scene's length or speed, with angles and spins multiplied by that length.
        """
        if not (self._velocity or self._overlap):
            return None
        return {
            "relative": self._relative,
            "position": {name: worst.as_dict() for name, worst in self._position.items()},
            "velocity": {name: worst.as_dict() for name, worst in self._velocity.items()},
            "overlap": {
                name: worst.as_dict()
                | {"touches": worst.value >= -WRITTEN_ROUNDING * self._laws.length}
                for name, worst in self._overlap.items()
            },
        }
