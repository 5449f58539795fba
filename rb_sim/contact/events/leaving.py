"""Where a point leaves the face of another body's solid and may not."""

from __future__ import annotations

from collections.abc import Sequence

from rb_sim.contact.scene.touching import ContactLaw
from rb_sim.contact.system.bodies import LIES_FLAT
from rb_sim.errors import SimulationError


def refuse_to_leave(
    laws: Sequence[ContactLaw], t: float, names: Sequence[str], code: tuple[int, int] | None
) -> None:
    """Raise SimulationError where a bilateral contact leads a point over the edge of the face that
    guides it; code: (contact, kind) of the event that led here."""
    if code is not None and code[1] == LIES_FLAT and laws[code[0]].bilateral:
        name = names[code[0]]
        raise SimulationError(
            f"contact {name} comes to the edge of the face that guides it at t = {t:.9g} s, beyond "
            f"which nothing does: give constraints.{name} a larger surface, or mode unilateral"
        )
