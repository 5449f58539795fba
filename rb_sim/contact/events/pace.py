"""How long an adaptive step may be where a support or a force comes and goes with time alone.

The equations of bodies in flight know nothing of a support that they do not touch, and those of
bodies at rest nothing of a force that friction holds: a step may be as long as the flight or the
rest, while the support or the force comes and goes many times.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rb_sim.catalogue.effects.wrench import BodyHarmonicRow, WorldHarmonicRow
from rb_sim.catalogue.types import WORLD
from rb_sim.contact.geometry.carriers import Shaken, Turntable, carrier
from rb_sim.contact.geometry.pairs import touching
from rb_sim.engine.systems.many_bodies import state_of
from rb_sim.scene.compiled import Compiled

SHARE = 0.125
"""Of a period, within which a gap, or the distance of a force to its bound, has one minimum at
most."""
PHASES = (0.13, 0.31, 0.57, 0.83)
"""Of a turn, at which a turning surface must lie where it was, to count as at rest."""


def paced(compiled: Compiled, method: Any) -> Any:
    """The method with steps no longer than a share of the shortest period of the scene."""
    largest = getattr(method, "largest_step", None)
    if largest is None:
        return method
    return method._replace(largest_step=min(largest, SHARE * shortest_period(compiled)))


def shortest_period(compiled: Compiled) -> float:
    """Of all harmonic forces, and supports whose surface moves as prescribed; inf if none [s]."""
    shortest = math.inf
    for effect in compiled.system.effects:
        if isinstance(effect.row, WorldHarmonicRow | BodyHarmonicRow):
            rate = abs(effect.row.angular_frequency)
            shortest = min(shortest, 2.0 * math.pi / rate if rate > 0.0 else math.inf)
    for group in compiled.system.contacts:
        for contact in group:
            motion = contact.row.carrier
            if isinstance(motion, Shaken):
                shortest = min(shortest, 2.0 * math.pi / motion.frequency)
            elif isinstance(motion, Turntable) and wobbles(compiled, contact):
                shortest = min(shortest, 2.0 * math.pi / float(np.linalg.norm(motion.spin)))
    return shortest


def wobbles(compiled: Compiled, contact: Any) -> bool:
    """True if the turning support's surface does not turn into itself."""
    motion = contact.row.carrier
    rate = float(np.linalg.norm(motion.spin))
    if rate == 0.0:
        return False
    B = state_of(compiled.y, contact.body)
    gaps = [
        touching(contact.row.pair, B, carrier(motion, 2.0 * math.pi * turn / rate, WORLD)[0]).gap
        for turn in (0.0, *PHASES)
    ]
    return max(gaps) - min(gaps) > 1e-9 * compiled.system.length
