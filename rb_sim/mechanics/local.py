# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Kernels of `systems` for one body and its parent: the functions of per-kind laws.

The arguments of each function are a thing (nested tuples of numbers), the time and fields; it
returns fields. Index 0 is the body, 1 its parent.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from rb_sim.catalogue.constraints.rows import BIAS, COUNT, ERROR, HOLONOMIC, RATE, ROW_WIDTH, anchor
from rb_sim.catalogue.spec import Placed, potential
from rb_sim.compiler.graph.symbols import maximum
from rb_sim.mechanics.systems.free import project_spins
from rb_sim.mechanics.systems.many_bodies import (
    BODY_WIDTH,
    INERTIA,
    LOAD,
    MASS,
    RESPONSE,
    WIDTH,
    apply_one,
    arms,
    fill_all,
    potential_one,
    power_one,
    state_of,
)
from rb_sim.mechanics.systems.multibody import (
    coupling,
    free_accelerations,
    inverse_mass_times,
    move_by_response,
    put_momenta,
    put_rates,
)
from rb_sim.numerics.vectors import add, cross, gyroscopic, rotate, scale, sub

NO_TORQUE = (0.0, 0.0, 0.0)


def alone(*bodies: Any) -> SimpleNamespace:
    """A system of these bodies, by their constants; () for a body whose constants are not used."""
    table = np.zeros((len(bodies), BODY_WIDTH), dtype=object)
    for i, constants in enumerate(bodies):
        table[i, : len(constants)] = constants
    return SimpleNamespace(bodies=table)


def with_load(thing: Any, t: Any, y: Any, *rest: Any) -> list[Any]:
    """Loads with the wrench of an effect added; rest: the parent's y if there is one, then the
    loads."""
    body, row = thing
    loads = rest[-1:] if len(rest) == 1 else rest[1:]
    system = alone(body, *((),) * (len(loads) - 1))
    for i, load in enumerate(loads):
        system.bodies[i, LOAD : LOAD + 6] = load
    states = y if len(loads) == 1 else (*y, *rest[0])
    apply_one(Placed(row, 0, -1 if len(loads) == 1 else 1), t, system, states)
    return [system.bodies[i, LOAD : LOAD + 6].tolist() for i in range(len(loads))]


def freely(body: Any, t: Any, y: Any, load: Any) -> list[Any]:
    """Accelerations under the load alone."""
    system = alone(body)
    system.bodies[0, LOAD : LOAD + 6] = load
    free_accelerations(system, y)
    return [system.bodies[0, RESPONSE : RESPONSE + 6].tolist()]


def of_hub(body: Any, t: Any, y: Any, load: Any) -> list[Any]:
    """-M and right side -f of a body whose accelerations are unknowns."""
    inertia = body[INERTIA : INERTIA + 6]
    turn = gyroscopic(inertia, state_of(y, 0).w_WB_B)
    force = (*load[:3], *sub(load[3:], turn))
    return [minus_mass(body), [*(-f for f in force), *([0.0] * 6)]]


def unloaded_hub(body: Any, t: Any) -> list[Any]:
    """As of_hub, without loads."""
    return [minus_mass(body), [0.0] * 12]


def minus_mass(body: Any) -> list[Any]:
    """-M, packed by lower rows."""
    xx, yy, zz, xy, xz, yz = body[INERTIA : INERTIA + 6]
    m, o = body[MASS], 0.0
    rows = [m], [o, m], [o, o, m], [o, o, o, xx], [o, o, o, xy, yy], [o, o, o, xz, yz, zz]
    return [-x if x is not o else o for row in rows for x in row]


def slopes(t: Any, y: Any, response: Any) -> list[Any]:
    """dy/dt of a body."""
    system = alone(())
    system.bodies[0, RESPONSE : RESPONSE + 6] = response
    dy: list[Any] = [0.0] * WIDTH
    put_rates(system, y, dy)
    return [dy]


def moved(t: Any, y: Any, response: Any) -> list[Any]:
    """Coordinates of a body displaced by response."""
    system, at = alone(()), list(y)
    system.bodies[0, RESPONSE : RESPONSE + 6] = response
    move_by_response(system, at)
    return [at]


def hastened(t: Any, y: Any, response: Any) -> list[Any]:
    """Coordinates of a body whose velocities change by response."""
    return [[*y[:7], *(u + d for u, d in zip(y[7:], response, strict=True))]]


def unit(t: Any, y: Any) -> list[Any]:
    """Coordinates of a body with the quaternion normalised."""
    return moved(t, y, [0.0] * 6)


def on_own_polhode(spin: Any, t: Any, y: Any) -> list[Any]:
    """Coordinates of a body with the spin projected onto its polhode."""
    at = list(y)
    project_spins(SimpleNamespace(spins=(spin,)), at)  # type: ignore[arg-type]
    return [at]


def momenta(body: Any, t: Any, y: Any, kinetic: Any, total: Any) -> list[Any]:
    """Kinetic energy and momenta, with those of a body added."""
    own: list[Any] = [0.0] * 6
    energy = put_momenta(alone(body), y, own, 0)
    return [[kinetic[0] + energy], [a + b for a, b in zip(total, own, strict=True)]]


def energy(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """Potential energy, or power, with that of an effect added; last field: the sum so far."""
    body, row = thing
    *states, so_far = fields
    y = [x for state in states for x in state]
    system = alone(body, *((),) * (len(states) - 1))
    of = potential_one if type(row) in potential.kernels else power_one
    return [[so_far[0] + of(Placed(row, 0, 1 if len(states) > 1 else -1), t, system, y)]]


def power(t: Any, found: Any, rates: Any, so_far: Any) -> list[Any]:
    """Power of the multipliers on rows that prescribe a velocity, with the sum so far."""
    return [[so_far[0] + sum(x * b for x, b in zip(found, rates, strict=True))]]


def reaction(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """Force, torque about the anchor and anchor of a reaction; world axes.

    thing: (row that defines the anchor, whether it has a parent). fields: states, then the rows and
    multipliers of each part.
    """
    row, parent = thing
    count = 2 if parent else 1
    y = [x for state in fields[:count] for x in state]
    B, A = state_of(y, 0), state_of(y, 1 if parent else -1)
    force, torque_B = NO_TORQUE, NO_TORQUE
    for rows, found in zip(fields[count::2], fields[count + 1 :: 2], strict=True):
        for k, x in enumerate(found):
            force = add(force, scale(x, rows[6 * k : 6 * k + 3]))
            torque_B = add(torque_B, scale(x, rows[6 * k + 3 : 6 * k + 6]))
    point = anchor(row, B, A)
    torque = add(rotate(B.q_WB, torque_B), cross(sub(B.p_WC, point), force))
    return [[*force, *torque, *point]]


def kept(t: Any, y: Any) -> list[Any]:
    """y unchanged."""
    return [y]


# The constraint rows between a body and its parent, as the elimination over tables uses them.
#
# Functions take a thing, the time and fields, as above.


BARRED = 1e300
"""Added to the comparison value of a pivot whose row gets no multiplier."""


class Rows:
    """The constraint rows of a node, evaluated."""

    def __init__(self, thing: Any, t: Any, states: Any) -> None:
        body, parent, rows, self.hubs, self.barred = thing
        self.sides = 1 if parent is None else 2
        self.system = alone(body, *(() if parent is None else (parent,)))
        counts = [COUNT[type(row)] for row in rows]
        self.first = [sum(counts[:k]) for k in range(len(counts) + 1)]
        self.n = self.first[-1]
        self.system.rows = np.zeros((self.n, ROW_WIDTH), dtype=object)
        self.system.first_row = self.first
        placed = tuple(Placed(row, 0, -1 if parent is None else 1) for row in rows)
        y = [x for state in states for x in state]
        fill_all(placed, t, self.system, y)
        self.states = [state_of(y, side) for side in range(self.sides)]
        self.rows = rows

    def column(self, name: int) -> list[Any]:
        """One column of the rows, by its index in the table."""
        return list(self.system.rows[:, name])

    def gradient(self, side: int) -> list[Any]:
        """G on one body by rows, 6 n numbers."""
        return self.system.rows[:, 6 * side : 6 * side + 6].ravel().tolist()

    def responses(self, side: int) -> list[Any]:
        """M^-1 G^T by rows, 6 n numbers."""
        made = []
        for k in range(self.n):
            force, turn = inverse_mass_times(self.system, side, k, 6 * side)
            made += [*force, *turn]
        return made

    def matrix(self) -> list[Any]:
        """G M^-1 G^T over the bodies that are not hubs, packed."""
        return self._over([side for side in range(self.sides) if not self.hubs[side]])

    def _over(self, sides: list[int]) -> list[Any]:
        made: list[Any] = [0.0] * (self.n * (self.n + 1) // 2)
        for side in sides:
            place = 0
            for i in range(self.n):
                force, turn = inverse_mass_times(self.system, side, i, 6 * side)
                for j in range(i + 1):
                    share = coupling(self.system.rows, j, 6 * side, force, turn)
                    made[place] = made[place] + share
                    place += 1
        return made

    def diagonal(self) -> list[Any]:
        """Diagonal elements to which pivots are compared; rows on hubs alone count as if these were
        free."""
        own = [side for side in range(self.sides) if not self.hubs[side]]
        packed = self._over(own or list(range(self.sides)))
        found = [packed[i * (i + 3) // 2] for i in range(self.n)]
        return [a + b for a, b in zip(found, self.barred, strict=True)] if self.barred else found

    def on(self, velocities: Any) -> list[Any]:
        """G v for the velocities v = (linear, angular) of each side; None is at rest."""
        return [
            sum(
                coupling(self.system.rows, k, 6 * side, v[:3], v[3:])
                for side, v in enumerate(velocities)
                if v is not None
            )
            for k in range(self.n)
        ]

    def blocks(self, right: list[Any]) -> list[Any]:
        """Blocks of the elimination: D, right side with the diagonal, G and M^-1 G^T of each
        side."""
        made = [self.matrix(), [*right, *self.diagonal()]]
        for side in range(self.sides):
            made.append(self.gradient(side))
        for side in range(self.sides):
            if not self.hubs[side]:
                made.append(self.responses(side))
        return made

    def speeds(self) -> list[Any]:
        """(v_C, w) of each side."""
        return [(*state.v_WC, *state.w_WB_B) for state in self.states]


def _sides(thing: Any) -> int:
    return 1 if thing[1] is None else 2


def accelerated(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """Blocks of G du/dt = -bias; fields: states, then accelerations of the bodies that are not
    hubs."""
    count = _sides(thing)
    rows = Rows(thing, t, fields[:count])
    free = iter(fields[count:])
    accelerations = [None if thing[3][side] else next(free) for side in range(count)]
    right = [-(b + s) for b, s in zip(rows.column(BIAS), rows.on(accelerations), strict=True)]
    return rows.blocks(right)


def sampled(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """As `accelerated`, with the rates and the worst violation; last fields: that so far, the
    scales."""
    *given, balance, scales = fields
    made = accelerated(thing, t, *given)
    rows = Rows(thing, t, given[: _sides(thing)])
    arm = arms(rows.rows, scales[0])
    slips = zip(rows.on(rows.speeds()), rows.column(RATE), arm, strict=True)
    worst = balance[0]
    for error, holonomic, at in zip(rows.column(ERROR), rows.column(HOLONOMIC), arm, strict=True):
        worst = maximum(worst, abs(error) * holonomic * at / scales[0])
    for moved, rate, at in slips:
        worst = maximum(worst, abs(moved - rate) * at / scales[1])
    return [*made, rows.column(RATE), [worst]]


def displaced(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """Blocks of G dq = -g and the worst error; last fields: that so far, the arm of angles [m]."""
    *states, (worst,), (length,) = fields
    rows = Rows(thing, t, states)
    errors = rows.column(ERROR)
    for error, arm in zip(errors, arms(rows.rows, length), strict=True):
        worst = maximum(worst, abs(error) * arm)
    return [*rows.blocks([-error for error in errors]), [worst]]


def slipping(thing: Any, t: Any, *states: Any) -> list[Any]:
    """Blocks of G du = b - G u."""
    rows = Rows(thing, t, states)
    return rows.blocks(slips_of(rows))


def slips_of(rows: Rows) -> list[Any]:
    """b - G u."""
    moved = rows.on(rows.speeds())
    return [rate - s for rate, s in zip(rows.column(RATE), moved, strict=True)]


def slips(thing: Any, t: Any, *states: Any) -> list[Any]:
    """b - G u of the rows, as a field."""
    return [slips_of(Rows(thing, t, states))]


def worst_gap(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """The worst position error; last fields: that so far, the arm of angles [m]."""
    *states, (worst,), (length,) = fields
    rows = Rows(thing, t, states)
    errors = zip(rows.column(ERROR), rows.column(HOLONOMIC), arms(rows.rows, length), strict=True)
    for error, holonomic, arm in errors:
        if holonomic != 0.0:
            worst = maximum(worst, abs(error) * arm)
    return [[worst]]
