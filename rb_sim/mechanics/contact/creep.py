"""Contacts that give way and creep: slips so slow that their direction is lost in errors.

Corners of a body that rocks on a support that gives way slip by lean times rate of the lean, ever
more slowly as the rocking dies out, and friction turns such a slip at once to where it has to go.
There is no instant at which it ends.  Below CREEP friction is rounded, so that it has a direction
at any speed: T = -mu N s / (s^8 + creep^8)^(1/8).  From LEAVES times that speed on it is Coulomb's
again; the two differ by 1e-9 there.
"""

from __future__ import annotations

from rb_sim.mechanics.contact.contact_bodies import FREE, keep
from rb_sim.mechanics.contact.contact_kinematics import SLIDING
from rb_sim.mechanics.contact.contact_table import (
    AT_SLIP,
    CLOSED,
    COMPLIANT,
    CREEPS,
    EVENT_FUNCTIONS_BEFORE,
    EVENT_RATES_BEFORE,
    SLIDE,
    SLIP,
    SLIP_DIRECTION,
    STATIC,
)
from rb_sim.mechanics.systems.many_bodies import vec
from rb_sim.numerics.kernels import inline
from rb_sim.numerics.vectors import norm

LEAVES = 10.0
"""Times the speed of creeping from which on a slip that creeps is one of Coulomb's again."""
SOON, RESTS, SLOWER = 2.0, 0.9, 0.5
"""Parts of the speed of creeping below which contacts that creep may come to rest: as they begin to
creep, and now and then; where they have been faster again, where friction takes as much of its
bound; and part of the slip at a try that was too early, for the next one."""
BEGUN, NEVER = 1e-3, 1e-300
"""Part of the speed of creeping below which a slip has just begun, and the bound below which it may
then come to rest [m/s]."""


@inline
def rubs(touch, c):
    """True of a contact that slips against Coulomb's friction."""
    return touch[c, CLOSED] == 1.0 and touch[c, SLIDE] == SLIDING and touch[c, STATIC] > 0.0


@inline
def slides_on_what_gives(touch, c):
    """True of one that rubs and gives way."""
    return rubs(touch, c) and touch[c, COMPLIANT] == 1.0


@inline
def note_creep(system, c):
    """Whether contact c creeps in the next step; after its directions have been noted."""
    touch, creep = system.touch, system.creep
    slip = norm(vec(touch, c, SLIP))
    if not slides_on_what_gives(touch, c) or slip > LEAVES * creep or creep == 0.0:
        touch[c, CREEPS] = 0.0
        return
    if slip > creep:
        if touch[c, CREEPS] == 0.0:
            return
        touch[c, CREEPS] = RESTS * creep
    elif touch[c, CREEPS] == 0.0:
        touch[c, CREEPS] = SOON * creep if slip > BEGUN * creep else NEVER
    keep(touch, c, SLIP_DIRECTION, (0.0, 0.0, 0.0))
    touch[c, EVENT_FUNCTIONS_BEFORE + AT_SLIP], touch[c, EVENT_RATES_BEFORE + AT_SLIP] = FREE, 0.0


@inline
def fastest_creep(system):
    """(fastest slip of the contacts that creep, the least below which one may come to rest, the
    first of them; -1: none creeps)."""
    touch, most, bound, first = system.touch, 0.0, FREE, -1
    for c in range(touch.shape[0]):
        if touch[c, CREEPS] > 0.0 and slides_on_what_gives(touch, c):
            first = c if first < 0 else first
            most = max(most, norm(vec(touch, c, SLIP)))
            bound = min(bound, touch[c, CREEPS])
    return most, bound, first
