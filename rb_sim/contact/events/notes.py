"""What happens to the contacts, noted where it happens: rows of the room, which `journal` reads."""

from __future__ import annotations

from rb_sim.contact.system.bodies import line_of
from rb_sim.contact.system.terms import SLIDING, STUCK
from rb_sim.contact.system.touch import (
    AHEAD,
    CLOSED,
    ROLL,
    ROLLING_ARM,
    SLIDE,
    SPIN,
    SPINNING_ARM,
    STATIC,
)
from rb_sim.engine.systems.many_bodies import BODY
from rb_sim.maths.jit import inline

KINDS = (
    "impact", "rests", "closes", "opens", "slips", "sticks", "rolls", "stops rolling", "spins",
    "stops spinning", "reverses", "jams", "leaps", "ambiguous",
)  # fmt: skip
"""Of events, by the number in a note; what closes and opens is called as its law has it."""
(
    IMPACT, RESTS, CLOSES, OPENS, SLIPS, STICKS, ROLLS, STOPS_ROLLING, SPINS, STOPS_SPINNING,
    REVERSES, JAMS, LEAPS, AMBIGUOUS,
) = range(14)  # fmt: skip
NONE = 1e-9
"""Part of the largest impulse that is none."""
OF_ROUND, CHANGES = 3, 5
"""Most notes of one contact in a round of impacts, and of its changes at one instant."""


@inline
def room_left(room):
    """For how many notes there is room."""
    return room.notes.shape[0] - room.written[0]


@inline
def note(room, t, c, kind, impulse):
    """Note one event of contact c; impulse: BY it ON its body, world axes [N s]."""
    k = room.written[0]
    room.notes[k, 0], room.notes[k, 1], room.notes[k, 2] = t, c, kind
    for j in range(3):
        room.notes[k, 3 + j] = impulse[j]
    room.written[0] = k + 1


@inline
def note_impulses(system, room, t, kind):
    """One event for each contact that takes part in the impulses of the room."""
    x, J, most = room.impulses, room.J, 0.0
    for k in range(x.shape[0]):
        most = max(most, abs(x[k]))
    for c in range(system.touch.shape[0]):
        k = line_of(system, c)
        if max(abs(x[k]), abs(x[k + 1]), abs(x[k + 2])) > NONE * most:
            b = 6 * system.lines[k, BODY]
            note(
                room, t, c, kind,
                (
                    J[k, b] * x[k] + J[k + 1, b] * x[k + 1] + J[k + 2, b] * x[k + 2],
                    J[k, b + 1] * x[k] + J[k + 1, b + 1] * x[k + 1] + J[k + 2, b + 1] * x[k + 2],
                    J[k, b + 2] * x[k] + J[k + 1, b + 2] * x[k + 1] + J[k + 2, b + 2] * x[k + 2],
                ),
            )  # fmt: skip


@inline
def take_before(system, room):
    """Keep the modes that the contacts have before an event."""
    for c in range(room.before.shape[0]):
        for j in range(room.before.shape[1]):
            room.before[c, j] = system.touch[c, j]


@inline
def note_way(system, room, t, c, way, kinds):
    """Note a change of one kind of friction; way: columns of its mode and its bound, kinds: those
    of its beginning and its end."""
    mode, bound = way
    was, now = room.before[c, mode], system.touch[c, mode]
    if system.touch[c, bound] > 0.0 and was != now:
        note(room, t, c, kinds[1] if now == STUCK else kinds[0], (0.0, 0.0, 0.0))


@inline
def note_changes(system, room, t):
    """Note what opened, closed, slipped and stuck."""
    touch, before = system.touch, room.before
    for c in range(touch.shape[0]):
        if before[c, CLOSED] != touch[c, CLOSED]:
            note(room, t, c, CLOSES if touch[c, CLOSED] != 0.0 else OPENS, (0.0, 0.0, 0.0))
        if touch[c, CLOSED] == 0.0:
            continue
        note_way(system, room, t, c, (SLIDE, STATIC), (SLIPS, STICKS))
        note_way(system, room, t, c, (ROLL, ROLLING_ARM), (ROLLS, STOPS_ROLLING))
        note_way(system, room, t, c, (SPIN, SPINNING_ARM), (SPINS, STOPS_SPINNING))
        along = 0.0
        for j in range(3):
            along += before[c, AHEAD + j] * touch[c, AHEAD + j]
        slides = before[c, SLIDE] == SLIDING and touch[c, SLIDE] == SLIDING
        if touch[c, STATIC] > 0.0 and slides and along < 0.0:
            note(room, t, c, REVERSES, (0.0, 0.0, 0.0))
