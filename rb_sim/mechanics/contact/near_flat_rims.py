"""Rims that are held at a point, nearly lie flat, and do not: how far a step may go with them.

The lean of a rim, as a vector across the plane's normal, goes by flat as a particle goes by the tip
of a cone: the low point runs round the rim within a time of tilt over rate, and the contact pushes
the harder the less flat is missed (Srinivasan and Ruina, "Rocking and rolling: A can that appears
to rock might actually roll", Phys. Rev. E 78, 2008).  No stage of a long step need fall in that
time, and the step would go straight through flat.  So steps end before, time and again, until what
is left is followed; a rim that misses flat by nothing slams, and its next point touches.
"""

from __future__ import annotations

from rb_sim.catalogue.geometry.corners_and_rims import FLAT, IN_FLIGHT, SLAMS
from rb_sim.mechanics.contact.contact_bodies import FREE
from rb_sim.mechanics.contact.contact_table import (
    AXIS,
    CLOSED,
    LEAN_BEFORE,
    LEAN_SIGN,
    LEAN_WIDTH,
    LOW,
    NEARS,
    NORMAL,
    RELATIVE_SPIN,
    RIM,
    SWING,
)
from rb_sim.mechanics.systems.many_bodies import vec
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.vectors import add, cross, dot, norm, scale, sub

NEARLY_FLAT = 1e-7
"""Tilt [rad] from which on a rim that is going straight to flat keeps its low point; before, it may
yet be turned aside."""
MISSED = 0.5 * FLAT
"""Tilt [rad] by which it may miss flat then: as its next point touches, it lies within FLAT."""
TURNED, LEANS = 0.5, 0.9
"""Cosine of the angle by which the lean of a rim may turn in a step, and sine of the tilt above
which it may turn as it likes."""
SHALLOW, PART = 1e-5, 0.02
"""Tilt [rad] below which rounding turns a lean by more than a tolerance, and the part of the time
of a swing that a step of order 8 follows to rounding."""
ROUND, ROUND_PART, NEARER = 0.3, 0.03, 0.5
"""Parts of the time of a swing that a step of fixed length may take; that one takes which is too
long; and that one takes of a rim that goes straight to flat as yet."""
ROUNDING = 4e-16
"""Error of a tilt [rad], of that of a rim in any axes."""
STRAIGHT = 0.99995
"""Cosine of the angle between where a rim leans and where it goes from which on it is straight."""


@inline
def is_held(touch, c):
    """True if a point of the rim that contact c is a point of is held."""
    for other in range(touch.shape[0]):
        if touch[other, RIM] == touch[c, RIM] and touch[other, CLOSED] == 1.0:
            return True
    return False


@inline
def note_lean(touch, c):
    """How a rim leans, and goes on; one that nothing holds has no point to keep."""
    for i in range(LEAN_WIDTH):
        touch[c, LEAN_BEFORE + i] = touch[c, LOW + i]
    touch[c, SWING], touch[c, NEARS] = FREE, 0.0
    if touch[c, RIM] < 0.0:
        return
    if not is_held(touch, c):
        touch[c, LEAN_BEFORE + 6] = IN_FLIGHT
        return
    side, size = 1.0 if touch[c, LEAN_SIGN] > 0.0 else -1.0, abs(touch[c, LEAN_SIGN])
    if size == IN_FLIGHT or size == SLAMS:
        touch[c, LEAN_BEFORE + 6] = side
    lean, rate = vec(touch, c, AXIS), lean_rate(touch, c)
    tilt, speed = norm(lean), norm(rate)
    if not FLAT < tilt < speed * FREE:
        return
    touch[c, SWING], touch[c, NEARS] = tilt / speed, -dot(lean, rate) / (tilt * speed)
    missed = norm(cross(lean, rate)) / speed
    if touch[c, NEARS] > 0.0 and missed < MISSED and tilt < NEARLY_FLAT:
        touch[c, LEAN_BEFORE + 6] = side * SLAMS


@inline
def lean_rate(touch, c):
    """Rate [rad/s] of the axis of a rim across the normal, as its support sees it."""
    lean, n = vec(touch, c, AXIS), vec(touch, c, NORMAL)
    upright = max(0.0, 1.0 - dot(lean, lean)) ** 0.5
    rate = cross(vec(touch, c, RELATIVE_SPIN), add(lean, scale(upright, n)))
    return sub(rate, scale(dot(rate, n), n))


@inline
def lean_has_turned(touch, c):
    """True if the low point of the rim has gone too far round it in the step."""
    lean, before = vec(touch, c, AXIS), vec(touch, c, LEAN_BEFORE + 3)
    least, most = min(norm(lean), norm(before)), max(norm(lean), norm(before))
    if least <= FLAT or least > LEANS or abs(touch[c, LEAN_BEFORE + 6]) == SLAMS:
        return False
    return dot(lean, before) < TURNED * least * most


@inline
def end_for_rims(system, t0, t1):
    """Where the step from t0 to t1 has to end, at the latest, for rims that are held; the tables
    are those of t1."""
    touch, end = system.touch, t1
    for c in range(touch.shape[0]):
        if touch[c, RIM] >= 0.0 and touch[c, CLOSED] == 1.0 and lean_has_turned(touch, c):
            end = 0.5 * (t0 + t1)
    return end


@inline
def before_swing(method, system, t0, t1):
    """Where the step from t0 to t1 has to end, at the latest, if its length is fixed, for rims that
    are held and whose low point would go far round in it."""
    touch, end = system.touch, t1
    if method.setting[1] != 0.0:
        return end
    for c in range(touch.shape[0]):
        round_it = abs(touch[c, NEARS]) < STRAIGHT
        goes = touch[c, CLOSED] == 1.0 and (round_it or touch[c, NEARS] > 0.0)
        if goes and t1 - t0 > ROUND * touch[c, SWING]:
            end = min(end, t0 + (ROUND_PART if round_it else NEARER) * touch[c, SWING])
    return end


@inline
def step_of_swings(system):
    """A length of step that follows each rim that is held and hardly misses flat, however fast its
    low point goes round it; 0 without one.  All that shorter steps would follow is how rounding
    turns its lean."""
    touch, least = system.touch, FREE
    for c in range(touch.shape[0]):
        if touch[c, CLOSED] == 1.0 and norm(vec(touch, c, LEAN_BEFORE + 3)) < SHALLOW:
            least = min(least, touch[c, SWING])
    return PART * least if least < FREE else 0.0


@inline
def turned_by_rounding(touch, c):
    """Angle [rad] by which rounding turns the lean of the rim of contact c at the start of the
    step, while its low point goes round; 0 of others."""
    goes = touch[c, CLOSED] == 1.0 and touch[c, SWING] < FREE and abs(touch[c, NEARS]) < STRAIGHT
    return ROUNDING / norm(vec(touch, c, LEAN_BEFORE + 3)) if goes else 0.0
