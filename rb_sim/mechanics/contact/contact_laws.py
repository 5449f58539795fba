# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Traced laws of bodies in contact: one for each kind of contact, and those of the scene.

The constants of a contact are inputs of its law, so contacts of one kind share machine code in all
scenes. Loads of the effects, rows of the joints, anchors and energies are traced for each scene.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from rb_sim.catalogue.friction import BOUNDED, traction
from rb_sim.catalogue.geometry.corners_and_rims import Lean
from rb_sim.catalogue.geometry.hull import Hull, PackedHull, packed
from rb_sim.catalogue.geometry.pairs import carrier, touching
from rb_sim.catalogue.spec import WORLD, BodyState
from rb_sim.compiler.graph.machine import Law, compile_law
from rb_sim.compiler.graph.symbols import Graph, explored, leaves
from rb_sim.integrate.layout import held
from rb_sim.mechanics.contact.accelerations import accelerations_in, unconstrained_here
from rb_sim.mechanics.contact.constraint_tables import (
    ARGUMENTS,
    CLOSED_LAW,
    CONTACT_BODY,
    CONTACT_COLUMNS,
    CONTACT_PARENT,
    FIRST_OF_TRACTION,
    FIRST_PARAMETER,
    KEPT,
    LAYOUT,
    OPEN_LAW,
    TRACTION_LAW,
    WORKSPACE,
)
from rb_sim.mechanics.contact.contact_bodies import ContactBodies
from rb_sim.mechanics.contact.contact_kinematics import Kept, forces, geometry, velocity_at
from rb_sim.mechanics.contact.motion_kernels import bring_to_manifold, contact_rate
from rb_sim.mechanics.inputs import Inputs, numbers, skeleton, with_numbers
from rb_sim.mechanics.systems.many_bodies import (
    BODY_WIDTH,
    LOAD,
    WIDTH,
    anchor_all,
    apply_effects,
    energetics,
    fill_all,
    state_of,
)
from rb_sim.numerics.kernels import by_address, place_of
from rb_sim.numerics.vectors import ZERO, rotate, sub

# Functions that loops call by address, compiled once for all scenes.


@by_address
def free(t, y, p, out):
    """Write the rows, and the accelerations by loads and direct contact forces, into the tables."""
    unconstrained_here(held(p), t, y)


@by_address
def accelerate(t, y, p, out):
    """Write multipliers and accelerations into the tables, with open contacts if out[0] is not 0;
    rank and number of active rows into out."""
    rank, holding = accelerations_in(held(p), t, y, out[0] != 0.0)
    out[0], out[1] = float(rank), float(holding)


@by_address
def bring_back(t, y, p, out):
    """Project y onto the manifold, in place."""
    bring_to_manifold(held(p), t, y)


@by_address
def rate_of_change(t, y, p, out):
    """Write dy/dt into out."""
    contact_rate(held(p), t, y, out)


_KINDS: dict[Any, Any] = {}
"""Traced laws by kind."""


def law_of_kind(found: Callable[..., Any], of: Any, width: int, *kind: Any) -> Any:
    """The traced law of a kind of objects such as `of`: void law(t, y, constants, outputs).

    found: function of (t, y, object, *kind) to be traced; width: length of y; kind: other
    arguments that distinguish laws.
    """
    key = found, skeleton(of), kind
    if key not in _KINDS:
        graph = Graph()
        places = [place for place, _ in numbers(of)]
        constants = dict(zip(places, graph.vector("p", len(places)), strict=True))
        symbolic = with_numbers(of, constants) if places else of
        t, y = graph.input("t"), graph.vector("y", width)
        _KINDS[key] = compile_law(list(leaves(explored(found, t, y, symbolic, *kind))))
    return _KINDS[key]


def laws_of_kind(row: Any, in_world: bool) -> tuple[Law, Law]:
    """(law while open, law while closed) of contacts of the kind of this row: void law(t,
    arguments, constants, outputs), see constraint_tables. in_world: the support is the world."""
    opened, closed = (law_of_kind(of_contact, row, ARGUMENTS, in_world, c) for c in (False, True))
    return opened, closed


def of_contact(t: Any, y: tuple[Any, ...], row: Any, in_world: bool, closed: bool) -> Any:
    """The results of the law of a contact."""
    k = y[KEPT:]
    lean = Lean(k[0:3], k[3:6], k[6])
    found, moving = geometry(row, t, *states_from(y, in_world), lean)
    if not closed:
        return found
    kept = Kept(lean, k[7], k[8], k[9], k[10], k[11:14], k[14:17], k[17], k[18], k[19])
    return found, forces(row, found, moving, kept)


def spot_law(pair: Any, moves: Any, in_world: bool) -> Any:
    """The law of a pair's contact point: void law(t, states of body and parent, constants, spot).
    moves: motion of the support."""
    return law_of_kind(of_spot, (pair, moves), 2 * WIDTH, in_world)


def of_spot(t: Any, y: tuple[Any, ...], of: tuple[Any, Any], in_world: bool) -> Any:
    """Gap, normal, P; velocity at P and spin of the support, 0 unless it is driven."""
    B, A = states_from(y, in_world)
    A, _, _, driven = carrier(of[1], t, A)
    at, moved, spin = touching(of[0], B, A), ZERO, ZERO
    if driven == 1.0:
        moved, spin = velocity_at(A, sub(at.point, A.p_WC)), rotate(A.q_WB, A.w_WB_B)
    return at.gap, at.normal, at.point, moved, spin


def traction_law(friction_law: Any) -> Any:
    """The law of traction of this kind of friction: void law(t, slip, constants, outputs).

    slip: along x, 3 numbers [m/s]; outputs: traction over N, and traction independent of N [N], 3
    numbers each.
    """
    return law_of_kind(of_traction, friction_law, 3)


def of_traction(t: Any, slip: tuple[Any, ...], friction_law: Any) -> Any:
    """Traction over N, and independent of N, at a slip along x."""
    return traction(friction_law, slip, (1.0, 0.0, 0.0), 0.0, False)


def states_from(y: tuple[Any, ...], in_world: bool) -> tuple[BodyState, BodyState]:
    """The states of body and parent (or the world) from their coordinates."""
    body, parent = (
        BodyState(k[0:3], k[3:7], k[7:10], k[10:13]) for k in (y[:WIDTH], y[WIDTH : 2 * WIDTH])
    )
    return body, WORLD if in_world else parent


def with_packed_hulls(row: Any, kept: list[np.ndarray]) -> Any:
    """The row with a packed hull in place of a hull; its table is appended to `kept`."""
    surface = getattr(row.pair, "surface", None)
    if not isinstance(surface, Hull):
        return row
    kept.append(packed(surface))
    return row._replace(pair=row.pair._replace(surface=PackedHull(place_of(kept[-1]))))


def loads_of(system: Any, t: Any, y: list[Any]) -> list[Any]:
    """Forces (world) and torques (body) of the effects on each body."""
    system.bodies[:, LOAD:BODY_WIDTH] = 0.0
    apply_effects(system.effects, t, system, y)
    return list(system.bodies[:, LOAD:BODY_WIDTH].ravel())


class ContactLaws:
    """The traced laws of a system of bodies in contact, and the system packed for loops."""

    def __init__(self, system: ContactBodies) -> None:
        self.inputs = Inputs()
        self._system = system
        self._kept: list[np.ndarray] = []

    def _law(self, kernel: Callable[[Any, Any, list[Any]], list[Any]]) -> Law:
        graph = Graph()
        system = self.inputs.symbolic(self._system, graph)
        names = ("bodies", "rows", "anchors")
        tables = {name: getattr(system, name).astype(object) for name in names}
        y = list(graph.vector("y", WIDTH * len(system.bodies)))
        return compile_law(kernel(system._replace(**tables), graph.input("t"), y))  # type: ignore[return-value]

    @cached_property
    def loads(self) -> Law:
        """Forces (world) and torques (body) of the effects on each body, 6 N numbers."""
        return self._law(loads_of)

    @cached_property
    def loads_and_inputs(self) -> Law:
        """As `loads`, followed by the inputs of the next step that laws carry."""

        def kernel(system: Any, t: Any, y: list[Any]) -> list[Any]:
            return [*loads_of(system, t, y), *self._next(y)]

        return self._law(kernel) if self.inputs.kept(self._system) else self.loads

    @cached_property
    def joint_rows(self) -> Law | None:
        """The rows of the joints as the table of rows has them."""
        count = int(self._system.first_row[len(self._system.constraints)])
        if not count:
            return None

        def kernel(system: Any, t: Any, y: list[Any]) -> list[Any]:
            fill_all(system.constraints, t, system, y)
            return list(system.rows[:count].ravel())

        return self._law(kernel)

    @cached_property
    def anchors(self) -> Law | None:
        """The anchors of the joints, 3 numbers each."""
        count = len(self._system.constraints)
        if not count:
            return None

        def kernel(system: Any, t: Any, y: list[Any]) -> list[Any]:
            anchor_all(system.constraints, system, y)
            return list(system.anchors[:count].ravel())

        return self._law(kernel)

    @cached_property
    def energy(self) -> Law:
        """Potential energy, and power of the effects that have none."""

        def kernel(system: Any, t: Any, y: list[Any]) -> list[Any]:
            return list(energetics(system.effects, t, system, y))

        return self._law(kernel)

    @cached_property
    def carry(self) -> Law | None:
        """The inputs of the step after one, where laws keep something from step to step."""
        if not self.inputs.kept(self._system):
            return None
        return self._law(lambda system, t, y: self._next(y))

    def _next(self, y: list[Any]) -> list[Any]:
        return self.inputs.next(self._system, y[0].graph, lambda body: state_of(y, body))

    @cached_property
    def contacts(self) -> tuple[np.ndarray, np.ndarray]:
        """(table of the contacts, their constants); see layout."""
        placed = [contact for group in self._system.contacts for contact in group]
        table = np.zeros((len(placed), CONTACT_COLUMNS), np.int64)
        constants: list[float] = []
        for c, contact in enumerate(placed):
            row = with_packed_hulls(contact.row, self._kept)
            opened, closed = laws_of_kind(row, contact.parent < 0)
            friction_law = contact.row.friction
            table[c, [OPEN_LAW, CLOSED_LAW]] = opened.address, closed.address
            table[c, [CONTACT_BODY, CONTACT_PARENT]] = contact.body, contact.parent
            table[c, FIRST_PARAMETER] = len(constants)
            constants += [value for _, value in numbers(row)]
            if not isinstance(friction_law, BOUNDED):
                table[c, TRACTION_LAW] = traction_law(friction_law).address
                table[c, FIRST_OF_TRACTION] = len(constants)
                constants += [value for _, value in numbers(friction_law)]
        return table, np.array(constants)

    def packed(self, system: ContactBodies, inputs: np.ndarray) -> tuple[np.ndarray, Any]:
        """(the system for loops, what must live as long); inputs: of the laws, in place."""

        table, constants = self.contacts
        workspace = np.zeros(WORKSPACE + max(6 * len(system.bodies), len(inputs)))
        laws = (self.loads, self.joint_rows, self.anchors, self.energy, self.carry)
        names = ("loads_law", "joint_rows_law", "anchors_law", "energy_law", "carry_law")
        values: dict[str, Any] = {
            **{name: getattr(system, name, None) for name in LAYOUT.fields},
            "joints": len(system.constraints),
            "contacts": table,
            "parameters": constants,
            "inputs": inputs,
            "workspace": workspace,
            **{name: law.address if law else 0 for name, law in zip(names, laws, strict=True)},
            "free_by_address": free.address,
            "accelerate_by_address": accelerate.address,
            "project_by_address": bring_back.address,
        }
        return LAYOUT.pack(values), (values, laws)
