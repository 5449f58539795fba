"""What the laws of contact leave open of a motion: it matters where friction does not go one way.

How points that bear more than is needed share a load is not in the laws.  Where all rub one way, or
none, the motion is the same whatever the shares; where they slip in several directions, as the
corners of a face that spins, the friction and with it the motion depends on them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.contact.events.grazes import LAG, LAG_TIME, ROUNDED, ROUNDED_TIME, SPEED, TIME
from rb_sim.contact.system.terms import SLIDING
from rb_sim.contact.system.touch import CLOSED, SLIDE, STATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rb_sim.contact.events.instant import Instant
    from rb_sim.contact.events.room import Room
    from rb_sim.contact.events.shares import Reactions
    from rb_sim.engine.samples import Array
    from rb_sim.maths.cones import Cones

OPEN = 1e-8
"""Change of the accelerations, relative to the largest of one reaction, that is rounding."""
FAR = 1e6
"""Reactions, relative to the largest of the least ones, that shares are not followed beyond."""
HALVINGS = 30
"""Of the span within which the bounds of the shares are passed."""

OTHERS = "other motions obey the laws, too: this is that of the least shares, or what parts"
NO_SETTING = "no setting helps: what follows has an error of this size"
"""What to know where no setting would decide: of choices of the laws, and of rounding."""


class LeftOpen(NamedTuple):
    """The widest choice that the laws left in a run."""

    figure: float = 0.0
    """how far two motions that both obey them are apart, relative to the largest of its kind."""
    t: float = 0.0
    """[s]."""
    contact: str = ""
    what: str = ""
    """what differs by the figure."""
    by_setting: bool = False
    """whether it is the step or the tolerance that leaves it open."""
    advice: str = OTHERS
    """what to try, or to know, where it is not."""


IMPACT = "velocities after an impact that the laws of contact leave open, of the largest,"
SHARES = "accelerations that shares of a load leave open, of the largest,"
ORDER = "speed of two impacts whose order hangs on step or tolerance, of the scene's,"
GRAZE = "speed of an impact that step or tolerance may have missed, of the scene's,"
LAGGED = (
    "speed that friction should have taken of a slip too slow for the tolerance, of the body's,"
)
TURNED_BY_ROUNDING = "angle by which rounding turned the lean of a rim that all but lay flat,"
PARTED = "normal acceleration at a lift-off that may slip on as well, of its own,"


def reach(cones: Cones, y: Array, way: Array) -> float:
    """How far one may go along `way` from y within all bounds."""
    if cones.admits(y + FAR * way):
        return FAR
    inside, outside = 0.0, 1.0
    while cones.admits(y + outside * way):
        inside, outside = outside, 2.0 * outside
    for _ in range(HALVINGS):
        middle = 0.5 * (inside + outside)
        within = cones.admits(y + middle * way)
        inside, outside = (middle, outside) if within else (inside, middle)
    return inside


def open_in(at: Instant, reactions: Reactions, cones: Cones, y: Array) -> float:
    """By how much other shares than y change the accelerations within all bounds, relative to the
    largest that the loads or the reactions make; a turn counts by the scene's length."""
    room = at.room
    push = at.inverse_mass @ room.W[reactions.held].T
    weights = np.tile([1.0] * 3 + [at.system.length] * 3, len(room.free_accelerations) // 6)
    terms = weights * (np.abs(push) @ np.abs(reactions.least))
    size, ways = np.linalg.svd(weights[:, None] * (push @ reactions.self_stress))[1:]
    if not size[0] > OPEN * terms.max():
        return 0.0
    far = max(reach(cones, y, ways[0]), reach(cones, y, -ways[0]))
    if not far > 0.0:  # nothing is pushed, so that nothing can be shared otherwise
        return 0.0
    own = push @ reactions.least, room.free_accelerations / reactions.unit
    return float(far * size[0] / max(np.abs(weights * a).max() for a in own))


def note_shares(at: Instant, reactions: Reactions, cones: Cones, y: Array) -> None:
    """Keep in the room how much the shares y of the load leave open, if it is the most of a run."""
    touch = at.system.touch
    rubs = (touch[:, CLOSED] == 1.0) & (touch[:, SLIDE] == SLIDING) & (touch[:, STATIC] > 0.0)
    if rubs.any():
        figure = open_in(at, reactions, cones, y)
        if figure > at.room.undetermined[4]:
            at.room.undetermined[4:7] = figure, at.t, int(np.argmax(rubs))


def widest_of(room: Room, names: Sequence[str]) -> LeftOpen:
    """The widest choice that impacts and shares left."""
    told = []
    for first, what in ((1, IMPACT), (4, SHARES)):
        figure, t, contact = room.undetermined[first : first + 3].tolist()
        told.append(LeftOpen(figure, t, names[int(contact)], what))
    return max(told)


def widest_doubt(grazes: Array, names: Sequence[str], speed: float) -> LeftOpen:
    """The widest of what the table of `grazes` tells: the fastest impact that may have been missed,
    over the scene's speed [m/s], or 1, since past an edge a gap bends so much that no speed is
    told; what friction has missed of the slow slip that it followed least; and by how much rounding
    has turned the lean of a rim that hardly missed flat."""

    def most(figure: int, time: int) -> tuple[float, float, str]:
        c = int(np.argmax(grazes[:, figure]))
        return float(grazes[c, figure]), float(grazes[c, time]), names[c]

    fast, t, name = most(SPEED, TIME)
    missed = LeftOpen(min(1.0, fast / speed), t, name, GRAZE, by_setting=True)
    slow = LeftOpen(*most(LAG, LAG_TIME), LAGGED, by_setting=True)
    turned = LeftOpen(*most(ROUNDED, ROUNDED_TIME), TURNED_BY_ROUNDING, advice=NO_SETTING)
    return max(missed, slow, turned)
