"""The choice of modes as a run sees it: errors instead of a status, and shares of what rests."""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events import tasks
from rb_sim.contact.events.decompositions import not_finite
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.modes import JAMMED_ONES, TOO_LARGE
from rb_sim.contact.events.shares import share_load
from rb_sim.contact.system.bodies import JAMMED
from rb_sim.errors import SimulationError

OF = "the laws of contact"


class JammedError(SimulationError):
    """No force keeps a slipping contact from penetrating (Painleve's paradox)."""

    def __init__(self, t: float) -> None:
        super().__init__(f"no contact force satisfies Coulomb's law at t = {t:.9g} s")
        self.t = t


def choose_modes(
    at: Instant, code: tuple[int, int] | None = None, opened: frozenset[int] = frozenset()
) -> tuple[int, ...]:
    """Decide which contacts are closed, slip, stick, roll, and project y onto that.

    code: (contact, kind) of the event that led here: what it ends does not go on; opened: contacts
    that do not close either. Returns slipping contacts that have opened though they may as well
    stay (their effective pivot is negative: Painleve).
    """
    at.room.opened[list(opened)] = 1
    contact, kind = code or (-1, -1)
    status = at.call(tasks.CHOOSE, at.t, at.y, (contact, kind, 0))
    at.room.opened[:] = 0  # what follows in the loop may close them again
    if status == TOO_LARGE:
        raise not_finite(OF)
    if status == JAMMED_ONES:
        raise JammedError(at.t)
    if at.call.undecided:
        share_load(at)
    parted = np.flatnonzero(at.room.parted).tolist()
    return tuple(c for c in parted if at.effective_pivot(c) < JAMMED)
