"""Slow slips that go on: friction turns them faster than explicit steps follow.

Near the end of a slip s the rate at which friction turns it, a / |s|, grows, but the slip is over
after some |s| / a as well.  A slip that stays slow, as of corners of what rocks on a support that
gives way, makes the equations stiff: there an adaptive explicit method hands its steps over to an
implicit one, Radau IIA of order 5, with its own error estimate and the same tolerance.
"""

from __future__ import annotations

from rb_sim.contact.events.stops import STOP_PART, own_rate, time_to_stop
from rb_sim.contact.system.bodies import FREE, SHARP, least_slip
from rb_sim.contact.system.creep import slides_on_what_gives
from rb_sim.contact.system.touch import (
    AT_SLIP,
    CREEPS,
    LEVELS_BEFORE,
    SLIDE,
    SLIP,
    STIFF,
)
from rb_sim.engine.systems.many_bodies import vec
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import norm

LASTS = 20.0
"""Times |s| / a after which a slip would end at its present rate: one that ends before costs an
explicit method few steps."""
LONG = 2.0
"""Times |s| / a that a step may take before it is an implicit one; an explicit method of order 8 is
stable up to 6, and a is taken for one to four times what it is."""
IMPLICIT_ORDER = 4.0
"""Of the error estimate of the implicit step."""
LEAST_IMPLICIT = 1e-12
"""Tolerance of these steps at the least: their stages are solved to a tenth of it (SLIPS_STALLED),
and below that the estimate is rounding, which shorter steps only add up."""


@inline
def note_stiffness(system, y):
    """The rates at which friction turns slips that go on, where a step starts: on what gives way; a
    slip on a rigid support that is as slow goes on as before (see slow_slips)."""
    touch = system.touch
    for c in range(touch.shape[0]):
        touch[c, STIFF] = 0.0
        if not slides_on_what_gives(touch, c):
            continue
        least = SHARP * least_slip(system, c) / system.speed
        level = SHARP * norm(vec(touch, c, SLIP)) / system.speed
        if touch[c, CREEPS] > 0.0:
            touch[c, STIFF] = own_rate(system, y, c, AT_SLIP) / max(level, least)
        elif least < touch[c, LEVELS_BEFORE + AT_SLIP] < FREE:
            rate = own_rate(system, y, c, AT_SLIP) / level
            lasts = rate * time_to_stop(touch, c, AT_SLIP, SLIDE) > LASTS
            touch[c, STIFF] = rate if lasts else 0.0


@inline
def shortened(system, tried):
    """(whether a step of this length is an implicit one, its length); it ends before slips do."""
    touch, rate, soon = system.touch, 0.0, FREE
    for c in range(touch.shape[0]):
        rate = max(rate, touch[c, STIFF])
        soon = min(soon, time_to_stop(touch, c, AT_SLIP, SLIDE))
    if rate * tried > LONG:
        tried = min(tried, STOP_PART * soon)
    return rate * tried > LONG, tried
