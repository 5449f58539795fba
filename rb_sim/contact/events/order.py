"""Impacts so close to each other that the length of the steps decides which is first.

Where two contacts of one body strike, the motion after them depends on their order by as much as
they strike.  What steps of fixed length have missed until then shifts the instant of each by

    sum of |v_h - v_h/2| of both bodies, times the time since the start, over the speed of approach.
"""

from __future__ import annotations

import math
from typing import Any

from rb_sim.contact.events.left_open import ORDER, LeftOpen
from rb_sim.contact.events.tasks import LINES, Tasks
from rb_sim.contact.events.touching import touches
from rb_sim.contact.system.bodies import line_of
from rb_sim.contact.system.levels import in_rigid_flight
from rb_sim.contact.system.touch import GAP, GAP_RATE
from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import BODY, PARENT


def bodies_of(system: Any, c: int) -> list[int]:
    """The bodies that contact c is between; the world is none."""
    k = line_of(system, c)
    return [int(b) for b in (system.lines[k, BODY], system.lines[k, PARENT]) if b >= 0]


def closing(system: Any, c: int) -> float:
    """Speed of approach of contact c [m/s]."""
    return max(0.0, -float(system.touch[c, GAP_RATE]))


def order_left_open(
    call: Tasks, at: tuple[float, Array], c: int, missed: Array, span: float
) -> LeftOpen:
    """What the order of impacts leaves open where contact c strikes: the speed of its approach over
    the scene's, or that of another contact of one of its bodies which may as well have come before
    it, if that is less; 0 where there is none.

    at: (t, y) of the impact, with whose modes the tables are. missed: by steps of the run until
        then, by body [m/s]; span: of the run [s].
    """
    system, figure = call.system, 0.0
    if not missed.any():
        return LeftOpen()
    call(LINES, *at)

    def shift(i: int) -> float:
        """By which steps may have moved the impact of contact i [s]."""
        far, speed = span * float(missed[bodies_of(system, i)].sum()), closing(system, i)
        return far / speed if speed > 0.0 else math.inf

    own = set(bodies_of(system, c))
    for i in range(system.touch.shape[0]):
        speed = closing(system, i)
        comes = i != c and speed > 0.0 and in_rigid_flight(system.touch, i)
        if not comes or touches(system, i) or own.isdisjoint(bodies_of(system, i)):
            continue
        if float(system.touch[i, GAP]) / speed < shift(c) + shift(i):
            figure = max(figure, min(closing(system, c), speed) / system.speed)
    return LeftOpen(figure, at[0], what=ORDER, by_steps=True)
