"""df/dy of bodies in contact, by differences, for implicit steps where friction is stiff.

A slow slip s is turned by friction at a rate that changes with s over |s| itself: differences are
small parts of the slowest slip.
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.system.bodies import least_slip
from rb_sim.contact.system.creep import rubs
from rb_sim.contact.system.rates import contact_rate
from rb_sim.contact.system.touch import SLIP
from rb_sim.engine.systems.many_bodies import WIDTH, vec
from rb_sim.loops.tables import held
from rb_sim.maths.jit import by_address, inline
from rb_sim.maths.vectors import norm

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
