"""How a motion goes on, by another one beside it that starts from where it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rb_sim.contact.motion import motion_of
from rb_sim.errors import SimulationError

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array
    from rb_sim.motion import Motion

MOST_LOOKS = 100
"""Times that the motion beside is asked whether to go on, every some thousand steps, before it is
given up."""


def rows_ahead(run: Motion, times: Array) -> Array | None:
    """Rows of samples at the times, as `run` would have them, which stays as it is.

    None where the motion does not come so far, and with contacts, whose modes the motion beside
    would have to choose anew.
    """
    if run.layout.contacts:
        return None
    beside, looks = motion_of(run.compiled, run.method), 0

    def look() -> None:
        nonlocal looks
        looks += 1
        if looks > MOST_LOOKS:
            raise SimulationError("what lies ahead takes too long")

    beside.watch = look
    out = np.zeros((len(times), beside.width))
    try:
        beside.reset_beside(run, run.coordinates, run.time)
        if run.layout.commanded:
            beside.change_law(run.system)
        beside.run_to(times, out)
    except SimulationError:
        return None
    return out
