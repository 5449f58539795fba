"""Room for what is done between the calls of the loop, as compiled functions see it: the lines as
dense matrices, one problem between lines and laws, and what is told to whoever runs a scene.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.contact.system.bodies import ContactBodies
from rb_sim.contact.system.touch import AHEAD
from rb_sim.loops.tables import INTEGER, REAL, Layout
from rb_sim.maths.complementarity import BOUND_WIDTH

MODES_WIDTH = AHEAD + 3
"""Columns of the table of contacts that hold the modes, and the directions of slip."""
NOTE_WIDTH = 6
"""Of a note: time [s], contact, kind (see KINDS of `notes`), impulse [N s]."""
WAYS = 3
"""In which a contact may move: slip, roll, spin."""


class Room(NamedTuple):
    """Tables of n lines, 6 N velocities, C contacts; integers of a contact are 0 or 1."""

    J: np.ndarray
    """lines of constraints and contacts, those of the candidates as if they held, (n, 6 N)."""
    W: np.ndarray
    """pushes: J, but for the normals of slipping contacts, (n, 6 N)."""
    line_bias: np.ndarray
    line_rate: np.ndarray
    """b of J u = b, (n,)."""
    free_accelerations: np.ndarray
    """from the loads alone, (6 N,)."""
    impulses: np.ndarray
    """of every line, (n,)."""
    used: np.ndarray
    """lines of the problem, (n + C,)."""
    place_of: np.ndarray
    """of each line among those, (n,)."""
    rules: np.ndarray
    """(n + C,)."""
    least: np.ndarray
    """(n + C,)."""
    bounds: np.ndarray
    """(3 C, BOUND_WIDTH)."""
    limits: np.ndarray
    """(3 C,)."""
    moves: np.ndarray
    """contact and way of each bound, (3 C, 2)."""
    taking_part: np.ndarray
    """contacts that touch rigidly, and those that a compliant support presses (2), (C,)."""
    plastic: np.ndarray
    """contacts that strike without rebound, (C,)."""
    together: np.ndarray
    """contacts that do not part in an impact, (C,)."""
    opened: np.ndarray
    """contacts that are not to close, (C,)."""
    parted: np.ndarray
    """contacts that opened while they slipped, (C,)."""
    moved: np.ndarray
    """contacts that have left their rest, in each way, (C, 3)."""
    bounces: np.ndarray
    """in a row, of each contact, and then of all that are too low to tell, (C + 1,)."""
    rests: np.ndarray
    """when the series of bounces of each contact will be over, see `bounces`, (C, 3)."""
    before: np.ndarray
    """modes before an event, (C, MODES_WIDTH)."""
    notes: np.ndarray
    """what has happened, (capacity, NOTE_WIDTH)."""
    written: np.ndarray
    """how many notes there are, (1,)."""


_INTEGERS = {
    "used": 1, "place_of": 1, "rules": 1, "bounds": 2, "moves": 2, "taking_part": 1, "plastic": 1,
    "together": 1, "opened": 1, "parted": 1, "moved": 2, "bounces": 1, "written": 1,
}  # fmt: skip
_REALS = {
    "J": 2, "W": 2, "line_bias": 1, "line_rate": 1, "free_accelerations": 1, "impulses": 1,
    "least": 1, "limits": 1, "rests": 2, "before": 2, "notes": 2,
}  # fmt: skip
ROOM_LAYOUT = Layout(
    {
        name: (INTEGER, _INTEGERS[name]) if name in _INTEGERS else (REAL, _REALS[name])
        for name in Room._fields
    }
)


def room_for(system: ContactBodies) -> Room:
    """Tables for the system, not filled yet."""
    n, freedoms, contacts = len(system.lines), 6 * len(system.bodies), len(system.touch)
    shapes = {
        "J": (n, freedoms), "W": (n, freedoms), "line_bias": (n,), "line_rate": (n,),
        "free_accelerations": (freedoms,), "impulses": (n,), "used": (n + contacts,),
        "place_of": (n,), "rules": (n + contacts,), "least": (n + contacts,),
        "bounds": (WAYS * contacts, BOUND_WIDTH), "limits": (WAYS * contacts,),
        "moves": (WAYS * contacts, 2), "taking_part": (contacts,), "plastic": (contacts,),
        "together": (contacts,), "opened": (contacts,), "parted": (contacts,),
        "moved": (contacts, WAYS), "bounces": (contacts + 1,), "rests": (contacts, 3),
        "before": (contacts, MODES_WIDTH), "notes": (64 + 8 * contacts, NOTE_WIDTH),
        "written": (1,),
    }  # fmt: skip
    return Room(
        **{
            name: np.zeros(shape, np.int64 if name in _INTEGERS else np.float64)
            for name, shape in shapes.items()
        }
    )
