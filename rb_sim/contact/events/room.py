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
    rebounding: np.ndarray
    """contacts that part after an impact, (C,)."""
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
    undetermined: np.ndarray
    """how far apart two motions after an impact are that the laws leave open, relative to the
    largest velocity before it; the most of a run, its time and contact; the same three of what
    shares of a load leave open, (7,)."""
    far: np.ndarray
    """how far steps of fixed length may have taken each body from where it ought to be [m],
    (N,)."""
    notes: np.ndarray
    """what has happened, (capacity, NOTE_WIDTH)."""
    written: np.ndarray
    """how many notes there are, (1,)."""


_FIELDS: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "J": (REAL, ("lines", "velocities")),
    "W": (REAL, ("lines", "velocities")),
    "line_bias": (REAL, ("lines",)),
    "line_rate": (REAL, ("lines",)),
    "free_accelerations": (REAL, ("velocities",)),
    "impulses": (REAL, ("lines",)),
    "used": (INTEGER, ("places",)),
    "place_of": (INTEGER, ("lines",)),
    "rules": (INTEGER, ("places",)),
    "least": (REAL, ("places",)),
    "bounds": (INTEGER, ("bounds", BOUND_WIDTH)),
    "limits": (REAL, ("bounds",)),
    "moves": (INTEGER, ("bounds", 2)),
    "taking_part": (INTEGER, ("contacts",)),
    "plastic": (INTEGER, ("contacts",)),
    "together": (INTEGER, ("contacts",)),
    "rebounding": (INTEGER, ("contacts",)),
    "opened": (INTEGER, ("contacts",)),
    "parted": (INTEGER, ("contacts",)),
    "moved": (INTEGER, ("contacts", WAYS)),
    "bounces": (INTEGER, ("counts",)),
    "rests": (REAL, ("contacts", 3)),
    "before": (REAL, ("contacts", MODES_WIDTH)),
    "undetermined": (REAL, (7,)),
    "far": (REAL, ("bodies",)),
    "notes": (REAL, ("notes", NOTE_WIDTH)),
    "written": (INTEGER, (1,)),
}
"""Kind and lengths of each table."""
ROOM_LAYOUT = Layout({name: (kind, len(shape)) for name, (kind, shape) in _FIELDS.items()})


def room_for(system: ContactBodies) -> Room:
    """Tables for the system, not filled yet."""
    lines, contacts = len(system.lines), len(system.touch)
    lengths = {
        "lines": lines, "velocities": 6 * len(system.bodies), "contacts": contacts,
        "bodies": len(system.bodies), "places": lines + contacts, "bounds": WAYS * contacts,
        "counts": contacts + 1, "notes": 64 + 8 * contacts,
    }  # fmt: skip
    tables = {}
    for name, (kind, shape) in _FIELDS.items():
        sizes = [length if isinstance(length, int) else lengths[length] for length in shape]
        tables[name] = np.zeros(sizes, np.int64 if kind == INTEGER else np.float64)
    return Room(**tables)
