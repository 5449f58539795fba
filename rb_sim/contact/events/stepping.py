"""Methods as the loop of bodies in contact takes them: implicit steps, longest steps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rb_sim.catalogue.effects.wrench import BodyHarmonicRow, WorldHarmonicRow
from rb_sim.catalogue.geometry.carriers import Shaken, Turntable, carrier
from rb_sim.catalogue.geometry.pairs import touching
from rb_sim.catalogue.types import WORLD
from rb_sim.contact.events.grid import Stepping
from rb_sim.integrate.layout import (
    held,
)
from rb_sim.integrate.methods.radau5 import radau5_of_slips
from rb_sim.mechanics.contact.contact_bodies import least_slip
from rb_sim.mechanics.contact.contact_laws import rate_of_change
from rb_sim.mechanics.contact.contact_table import SLIP
from rb_sim.mechanics.contact.creep import rubs
from rb_sim.mechanics.contact.motion_kernels import contact_rate
from rb_sim.mechanics.systems.many_bodies import WIDTH, state_of, vec
from rb_sim.motion.traced import settings_of
from rb_sim.numerics.kernels import by_address, inline
from rb_sim.numerics.vectors import norm
from rb_sim.scene.compiled import Compiled

# df/dy of bodies in contact, by differences, for implicit steps where friction is stiff.
#
# A slow slip s is turned by friction at a rate that changes with s over |s| itself: differences are
# small parts of the slowest slip.


OF_SLIP = 1e-4
"""Difference of velocities, over the slowest slip: what is left out is as much of the entry."""
OF_PLACES = 1e-3
"""Difference of places, in lengths of the scene, over the slowest slip, in its speeds: a support
that turns makes a slip of it."""
LEAST, MOST = 1e-12, 1e-8
"""Bounds of the difference of places, in lengths of the scene, and of quaternions: below rounding
counts, above the bend of the equations."""
FASTEST = 1e-3
"""Slip, in speeds of the scene, beyond which differences do not grow with it."""


@inline
def slowest_slip(system):
    """The least speed of a slip whose friction has a corner, over the scene's."""
    touch, least = system.touch, FASTEST * system.speed
    for c in range(touch.shape[0]):
        if rubs(touch, c):
            least = min(least, max(norm(vec(touch, c, SLIP)), least_slip(system, c)))
    return least / system.speed


@inline
def difference(system, k, slip):
    """Of the k-th coordinate of a body; slip: the slowest."""
    if k >= 7:
        speed = OF_SLIP * slip * system.speed
        return speed if k < 10 else speed / system.length
    place = max(LEAST, min(MOST, OF_PLACES * slip))
    return place * system.length if k < 3 else place


@by_address
def jacobian_by_differences(t, y, p, out):
    """df_i/dy_j into out[n i + j], n numbers of y; of the contacts' work, the last, nothing
    depends."""
    system = held(p)
    n = WIDTH * system.bodies.shape[0] + 1
    f, g, at = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        at[i] = y[i]
        out[n * i + n - 1] = 0.0
    contact_rate(system, t, at, f)
    slip = slowest_slip(system)
    for j in range(n - 1):
        step = difference(system, j % WIDTH, slip)
        at[j] = y[j] + step
        contact_rate(system, t, at, f)
        width = at[j]
        at[j] = y[j] - step
        contact_rate(system, t, at, g)
        width -= at[j]
        at[j] = y[j]
        for i in range(n):
            out[n * i + j] = (f[i] - g[i]) / width


# How long an adaptive step may be where a support or a force comes and goes with time alone.
#
# The equations of bodies in flight know nothing of a support that they do not touch, and those of
# bodies at rest nothing of a force that friction holds: a step may be as long as the flight or the
# rest, while the support or the force comes and goes many times.


SHARE_OF_PERIOD = 0.125
"""Of a period, within which a gap, or the distance of a force to its bound, has one minimum at
most."""
PHASES = (0.13, 0.31, 0.57, 0.83)
"""Of a turn, at which a turning surface must lie where it was, to count as at rest."""


def paced(compiled: Compiled, method: Any) -> Any:
    """The method with steps no longer than a share of the shortest period of the scene."""
    largest = getattr(method, "largest_step", None)
    if largest is None:
        return method
    return method._replace(largest_step=min(largest, SHARE_OF_PERIOD * shortest_period(compiled)))


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


# Methods as the loop of bodies in contact takes them, and the slips that they follow.


NOISE = 30.0
"""Slip in tolerances of an adaptive method whose direction is lost in its errors: explicit methods
turn it about where steps that keep the tolerance are too long for its stiffness."""
CREEP = 1e-9
"""Slip, relative to the scene's speed, below which contacts that give way creep in steps of an
adaptive method; above, implicit steps follow it."""


def slow_slips(system: Any, method: Any) -> dict[str, float]:
    """The slips [m/s] that are lost in errors, and that creep."""
    tolerance = getattr(method, "tolerance", 0.0)
    creep = CREEP * system.speed if tolerance > 0.0 else 0.0
    return {"still": max(system.still, NOISE * tolerance), "creep": creep}


def stepping_of(compiled: Compiled, method: Any, rubs: bool) -> Stepping:
    """rubs: whether slips may be slow and stiff."""
    step, setting = settings_of(paced(compiled, method))
    implicit: tuple[Any, Any] = 0, 0
    if rubs and getattr(method, "tolerance", 0.0) > 0.0:
        implicit = radau5_of_slips.reference, jacobian_by_differences.address
    setting = (*setting, float(step.implicit > 0))
    return Stepping(step.reference, rate_of_change.address, setting, *implicit)
