"""The spin of a body without torque among others: put back on the polhode on which it started.

In maximal coordinates, too, a body that nothing turns keeps its energy and angular momentum as
exactly as alone (see free_rotor, which tells why that matters near the middle axis).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rb_sim.catalogue.types import CENTRAL, CHANGING, Changing, Inertial, Quaternion, Vec3
from rb_sim.engine.system import STARTS
from rb_sim.engine.systems.free_rotor import on_polhode, polhode_inputs, start_rotor, with_polhode
from rb_sim.engine.systems.many_bodies import WIDTH, MultiBody
from rb_sim.maths.vectors import ZERO, conjugate, rotate, sub


class FreeSpin(NamedTuple):
    """The polhode of one of many bodies; fields as those of FreeRotor."""

    body: int
    """its index."""
    q_BP: Quaternion
    moments: Vec3
    weights: Vec3 = ZERO
    contrast: Vec3 = ZERO
    polhode: tuple[float, float] = (0.0, 0.0)


CHANGING[FreeSpin] = Changing(8, polhode_inputs, with_polhode)


def untouched(system: MultiBody) -> list[int]:
    """The bodies that no joint holds and no torque turns."""
    held = {i for c in system.constraints for i in (c.body, c.parent)}
    for effect in system.effects:
        if type(effect.row) not in CENTRAL or effect.parent >= 0:
            held |= {effect.body, effect.parent}
    return [i for i in range(system.bodies.shape[0]) if i not in held]


def with_spins(system: MultiBody, bodies: list[Inertial], principal: Any, y: Any) -> MultiBody:
    """The system that keeps the spins of its untouched bodies on the polhodes through those in y.

    principal: gives the principal moments of an inertia and the quaternion from their axes.
    """
    spins = []
    for i in untouched(system):
        moments, q_BP = principal(bodies[i].inertia)
        spins.append(FreeSpin(i, q_BP, moments))
    return start_spins(system._replace(spins=tuple(spins)), y)


def start_spins(system: MultiBody, y: Any) -> MultiBody:
    """The system for a motion that starts at y."""
    started = []
    for spin in system.spins:
        own = [float(x) for x in y[WIDTH * spin.body : WIDTH * (spin.body + 1)]]
        own[10:13] = rotate(conjugate(spin.q_BP), tuple(own[10:13]))
        started.append(start_rotor(spin, tuple(own)))  # type: ignore[arg-type]
    return system._replace(spins=tuple(started))


STARTS[MultiBody] = start_spins


def settle_spins(system: MultiBody, y: list[Any]) -> None:
    """The spins put back, in place; the change is turned into body axes, not the spin itself."""
    for spin in system.spins:
        first = WIDTH * spin.body + 10
        w_P = rotate(conjugate(spin.q_BP), tuple(y[first : first + 3]))
        change = rotate(spin.q_BP, sub(on_polhode(spin, w_P), w_P))
        for j in range(3):
            y[first + j] = y[first + j] + change[j]
