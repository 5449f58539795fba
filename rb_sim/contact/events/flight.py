"""Flights that an instant begins: how long they may be, and drags that neither hold nor let go."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rb_sim.contact.events.dense import ACCELERATE
from rb_sim.contact.events.instant import STILL, TOUCHING, Instant
from rb_sim.contact.events.rough import refuse_drag
from rb_sim.contact.system.touch import CLOSED, GAP, GAP_RATE, SLOPES_BEFORE
from rb_sim.engine.systems.many_bodies import PUSH

HELD_DOWN = 1e-6
"""Acceleration towards the support, in natural units, with which a contact that has just been left
would be pressed again at once."""
LANDED = 2.4
"""Times to the top of a flight after which it is over, also where its fall changes a little."""
LOW = 1e-10
"""Height of a flight, relative to the scene's length, which rounding of the gap may hide."""


def longest_step(at: Instant, names: Sequence[str], fixed: bool) -> float:
    """Time within which the flights that begin here have to be looked at [s], inf where there are
    none; raises SimulationError where a drag lifts off what falls back at once.

    A flight is to end within it.  One that is so low that rounding may hide it has to be cut at
    its top, as any where steps are fixed.
    """
    system, touch, length = at.system, at.system.touch, math.inf
    near, natural = TOUCHING * system.length, system.speed**2 / system.length
    at.call(ACCELERATE, at.t, at.y)
    u = system.bodies[:, PUSH : PUSH + 6].reshape(-1)
    columns = zip(touch[:, CLOSED].tolist(), touch[:, GAP].tolist(), strict=True)
    for c in [c for c, (closed, gap) in enumerate(columns) if closed == 0.0 and abs(gap) <= near]:
        k = at.first[c]
        fall = -float(at.lines.J[k] @ u + at.lines.bias[k])
        rise = float(touch[c, GAP_RATE])
        if fall > 0.0 and rise > STILL * system.speed:
            hidden = fixed or 0.5 * rise * rise < LOW * fall * system.length
            length = min(length, (1.0 if hidden else LANDED) * rise / fall)
        elif at.laws[c].drags and fall > HELD_DOWN * natural:
            refuse_drag(at.t, names[c])
    return length


def refuse_to_be_dragged_off(at: Instant, c: int, names: Sequence[str]) -> None:
    """Raise SimulationError where a contact with a damper, which its drag has just lifted off,
    would push again at once: at the start of the step, apart, its event function falls."""
    touch, unit = at.system.touch, at.system.length / at.system.speed
    apart = at.laws[c].compliant and touch[c, CLOSED] == 0.0
    if apart and at.laws[c].drags and touch[c, SLOPES_BEFORE] * unit < -HELD_DOWN:
        refuse_drag(at.t, names[c])
