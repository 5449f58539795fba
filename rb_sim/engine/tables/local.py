"""The kernels of `systems` on a body and its parent alone: what a per-kind law computes.

Every function takes first a thing (nested tuples of numbers), the time, and its fields, and gives
fields.  Index 0 is the body, 1 its parent.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from rb_sim.catalogue.constraints.rows import anchor
from rb_sim.catalogue.types import Placed, potential
from rb_sim.engine.systems.free_spin import settle_spins
from rb_sim.engine.systems.many_bodies import (
    BODY_WIDTH,
    INERTIA,
    LOAD,
    MASS,
    PUSH,
    WIDTH,
    apply_one,
    potential_one,
    power_one,
    state_of,
)
from rb_sim.engine.systems.multibody import put_momenta, put_rates
from rb_sim.engine.systems.multipliers import free_accelerations, move_by_push
from rb_sim.maths.vectors import add, cross, gyroscopic, rotate, scale, sub

NO_TORQUE = (0.0, 0.0, 0.0)


def constants_of(system: Any, i: int) -> tuple[float, ...]:
    """Mass, inertia and its inverse."""
    return tuple(system.bodies[i, :PUSH].tolist())


def alone(*bodies: Any) -> SimpleNamespace:
    """A system of these bodies, by their constants; () where they do not matter."""
    table = np.zeros((len(bodies), BODY_WIDTH), dtype=object)
    for i, constants in enumerate(bodies):
        table[i, : len(constants)] = constants
    return SimpleNamespace(bodies=table)


def with_load(thing: Any, t: Any, y: Any, *rest: Any) -> list[Any]:
    """Loads with the wrench of an effect; rest: parent's y, then the loads."""
    body, row = thing
    loads = rest[-1:] if len(rest) == 1 else rest[1:]
    system = alone(body, *((),) * (len(loads) - 1))
    for i, load in enumerate(loads):
        system.bodies[i, LOAD : LOAD + 6] = load
    states = y if len(loads) == 1 else (*y, *rest[0])
    apply_one(Placed(row, 0, -1 if len(loads) == 1 else 1), t, system, states)
    return [system.bodies[i, LOAD : LOAD + 6].tolist() for i in range(len(loads))]


def freely(body: Any, t: Any, y: Any, load: Any) -> list[Any]:
    """Accelerations by the load alone."""
    system = alone(body)
    system.bodies[0, LOAD : LOAD + 6] = load
    free_accelerations(system, y)
    return [system.bodies[0, PUSH : PUSH + 6].tolist()]


def of_hub(body: Any, t: Any, y: Any, load: Any) -> list[Any]:
    """-M and, as the right side, -f of a body whose accelerations are unknowns."""
    inertia = body[INERTIA : INERTIA + 6]
    turn = gyroscopic(inertia, state_of(y, 0).w_WB_B)
    force = (*load[:3], *sub(load[3:], turn))
    return [minus_mass(body), [*(-f for f in force), *([0.0] * 6)]]


def still_hub(body: Any, t: Any) -> list[Any]:
    """As of_hub without loads."""
    return [minus_mass(body), [0.0] * 12]


def minus_mass(body: Any) -> list[Any]:
    """-M, packed by lower rows."""
    xx, yy, zz, xy, xz, yz = body[INERTIA : INERTIA + 6]
    m, o = body[MASS], 0.0
    rows = [m], [o, m], [o, o, m], [o, o, o, xx], [o, o, o, xy, yy], [o, o, o, xz, yz, zz]
    return [-x if x is not o else o for row in rows for x in row]


def slopes(t: Any, y: Any, push: Any) -> list[Any]:
    """dy/dt of a body."""
    system = alone(())
    system.bodies[0, PUSH : PUSH + 6] = push
    dy: list[Any] = [0.0] * WIDTH
    put_rates(system, y, dy)
    return [dy]


def moved(t: Any, y: Any, push: Any) -> list[Any]:
    """A body shifted and turned by push."""
    system, at = alone(()), list(y)
    system.bodies[0, PUSH : PUSH + 6] = push
    move_by_push(system, at)
    return [at]


def hastened(t: Any, y: Any, push: Any) -> list[Any]:
    """A body whose velocities change by push."""
    return [[*y[:7], *(u + d for u, d in zip(y[7:], push, strict=True))]]


def unit(t: Any, y: Any) -> list[Any]:
    """A body with a unit quaternion."""
    return moved(t, y, [0.0] * 6)


def on_own_polhode(spin: Any, t: Any, y: Any) -> list[Any]:
    """A body whose spin is put back."""
    at = list(y)
    settle_spins(SimpleNamespace(spins=(spin,)), at)  # type: ignore[arg-type]
    return [at]


def momenta(body: Any, t: Any, y: Any, kinetic: Any, total: Any) -> list[Any]:
    """Kinetic energy and momenta with those of a body."""
    own: list[Any] = [0.0] * 6
    energy = put_momenta(alone(body), y, own, 0)
    return [[kinetic[0] + energy], [a + b for a, b in zip(total, own, strict=True)]]


def energy(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """Potential energy, or power, with that of an effect; last field: that so far."""
    body, row = thing
    *states, so_far = fields
    y = [x for state in states for x in state]
    system = alone(body, *((),) * (len(states) - 1))
    of = potential_one if type(row) in potential.kernels else power_one
    return [[so_far[0] + of(Placed(row, 0, 1 if len(states) > 1 else -1), t, system, y)]]


def power(t: Any, found: Any, rates: Any, so_far: Any) -> list[Any]:
    """Power of the multipliers on lines that prescribe a velocity, added."""
    return [[so_far[0] + sum(x * b for x, b in zip(found, rates, strict=True))]]


def reaction(thing: Any, t: Any, *fields: Any) -> list[Any]:
    """Force, torque about the anchor, anchor; world axes.

    thing: the row that tells the anchor, whether it has a parent. fields: states, then of every
    part its lines and its multipliers.
    """
    row, parent = thing
    count = 2 if parent else 1
    y = [x for state in fields[:count] for x in state]
    B, A = state_of(y, 0), state_of(y, 1 if parent else -1)
    force, torque_B = NO_TORQUE, NO_TORQUE
    for lines, found in zip(fields[count::2], fields[count + 1 :: 2], strict=True):
        for k, x in enumerate(found):
            force = add(force, scale(x, lines[6 * k : 6 * k + 3]))
            torque_B = add(torque_B, scale(x, lines[6 * k + 3 : 6 * k + 6]))
    point = anchor(row, B, A)
    torque = add(rotate(B.q_WB, torque_B), cross(sub(B.p_WC, point), force))
    return [[*force, *torque, *point]]


def kept(t: Any, y: Any) -> list[Any]:
    """y as it is."""
    return [y]
