"""Contacts that lift off at one instant: their pushes vanish together, and none may be told first.

Where one of several points opens, as of a box that its floor leaves, the others bear nothing any
more.  To open one alone lets the others open and it close in turns, by rounding, without end.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rb_sim.contact.events.chatter import at_one_instant
from rb_sim.contact.system.touch import BILATERAL, CLOSED, COMPLIANT, FORCE, LEVELS_BEFORE


def lifting(system: Any, begun: float, t: float) -> frozenset[int]:
    """Rigid contacts whose push has fallen in the step and is over at t, but for rounding of t.

    system: its forces are those at t in the modes before. begun: where the step began [s]; an event
    there has no step in which a push could have fallen.
    """
    if not t > begun:
        return frozenset()
    touch, unit = system.touch, system.mass * system.speed**2 / system.length
    rigid = (touch[:, CLOSED] == 1.0) & (touch[:, BILATERAL] == 0.0) & (touch[:, COMPLIANT] == 0.0)
    push = touch[:, FORCE] / unit
    fallen = touch[:, LEVELS_BEFORE] - push
    left = push * (t - begun) <= fallen * at_one_instant(t)
    return frozenset(np.flatnonzero(rigid & (fallen > 0.0) & left).tolist())


def bearing(system: Any, lifted: frozenset[int]) -> bool:
    """Whether a contact bears besides those that lift off."""
    return bool(set(np.flatnonzero(system.touch[:, CLOSED] == 1.0).tolist()) - lifted)
