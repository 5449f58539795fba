"""What a step of bodies in contact starts from: directions, gaps, event functions, leans."""

from __future__ import annotations

from rb_sim.contact.system.bodies import keep, least_slip
from rb_sim.contact.system.creep import note_creep, rubs
from rb_sim.contact.system.levels import roll_level, rolling, slip_level
from rb_sim.contact.system.swings import note_lean
from rb_sim.contact.system.terms import SLIDING
from rb_sim.contact.system.touch import (
    AHEAD,
    AT_ROLL,
    AT_SLIP,
    AT_SPIN,
    CLOSED,
    FASTEST,
    FASTEST_BEFORE,
    GAP,
    GAP_BEFORE,
    GAP_RATE,
    GAP_RATE_BEFORE,
    LEVEL_KINDS,
    LEVELS,
    LEVELS_BEFORE,
    NORMAL,
    NORMAL_BEFORE,
    ROLL,
    ROLL_AHEAD,
    ROLL_RATE,
    SLIP,
    SLIP_RATE,
    SLOPES_BEFORE,
    SPIN,
    SPIN_AHEAD,
    TURN,
)
from rb_sim.engine.systems.many_bodies import vec
from rb_sim.maths.jit import inline
from rb_sim.maths.vectors import dot, norm, scale


@inline
def look_ahead(system, rates):
    """Note what the next step starts from: directions of slip and turning, gaps, levels, leans.

    After `lowest_level` and, with the rates that it has found, `level_rates`.
    """
    touch = system.touch
    for c in range(touch.shape[0]):
        for i in range(LEVEL_KINDS):
            touch[c, LEVELS_BEFORE + i] = touch[c, LEVELS + i]
            touch[c, SLOPES_BEFORE + i] = rates[c, i]
        touch[c, GAP_RATE_BEFORE], touch[c, GAP_BEFORE] = touch[c, GAP_RATE], touch[c, GAP]
        touch[c, FASTEST_BEFORE] = touch[c, FASTEST]
        keep(touch, c, NORMAL_BEFORE, vec(touch, c, NORMAL))
        note_directions(system, c)
        note_creep(system, c)
        note_lean(touch, c)


@inline
def note_directions(system, c):
    """Directions of slip and turning, and the event functions along them."""
    touch, before, slopes = system.touch, LEVELS_BEFORE, SLOPES_BEFORE
    slip, roll = vec(touch, c, SLIP), rolling(touch, c)
    note_direction(touch, c, AHEAD, slip, least_slip(system, c))
    about = dot(vec(touch, c, TURN), vec(touch, c, NORMAL))
    still = system.still / system.length
    note_direction(touch, c, ROLL_AHEAD, roll, still)
    if rubs(touch, c):
        touch[c, before + AT_SLIP] = slip_level(system, c, slip)
        touch[c, slopes + AT_SLIP] = slip_level(system, c, vec(touch, c, SLIP_RATE))
    if touch[c, CLOSED] == 1.0 and touch[c, ROLL] == SLIDING:
        touch[c, before + AT_ROLL] = roll_level(system, c, roll)
        touch[c, slopes + AT_ROLL] = roll_level(system, c, vec(touch, c, ROLL_RATE))
    if abs(about) > still:
        ahead = 1.0 if about > 0.0 else -1.0
        if touch[c, CLOSED] == 1.0 and touch[c, SPIN] == SLIDING and ahead != touch[c, SPIN_AHEAD]:
            touch[c, before + AT_SPIN] = -touch[c, before + AT_SPIN]
            touch[c, slopes + AT_SPIN] = -touch[c, slopes + AT_SPIN]
        touch[c, SPIN_AHEAD] = ahead


@inline
def note_direction(touch, c, at, a, still):
    size = norm(a)
    if size > still:
        keep(touch, c, at, scale(1.0 / size, a))
