"""Laws of friction that have no motion at all in some states: which, and the line that says so.

Perfectly rough contacts that push may not slip.

No force of theirs is bounded, so that a slip ends in an impact at once.  A support that gives way
knows no impacts, and a contact that would have to pull to keep from slipping has no motion at all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from rb_sim.contact.events.flight import HELD_DOWN
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.scene.touching import ContactLaw
from rb_sim.contact.system.bodies import ContactBodies
from rb_sim.contact.system.terms import SLIDING
from rb_sim.contact.system.touch import CLOSED, SLIDE, SLOPES_BEFORE
from rb_sim.errors import SimulationError


def slipping_rough(at: Instant) -> list[int]:
    """Perfectly rough contacts that are closed and slip, in the modes of the table."""
    touch, rough = at.system.touch, [c for c, law in enumerate(at.laws) if law.static == math.inf]
    return [c for c in rough if touch[c, CLOSED] == 1.0 and touch[c, SLIDE] == SLIDING]


def refuse_rough(at: Instant, c: int, names: Sequence[str]) -> None:
    """Raise SimulationError: nothing keeps the perfectly rough contact c from slipping."""
    if at.laws[c].compliant:
        raise SimulationError(
            f"perfectly rough contact {names[c]} slips as it touches at t = {at.t:.9g} s, and its "
            "support gives way: no force ends a slip at once; give it coulomb friction"
        )
    raise SimulationError(
        f"perfectly rough contact {names[c]} would have to pull at t = {at.t:.9g} s, "
        "or else slip; give it coulomb friction or make it bilateral"
    )


def refuse_drag(t: float, name: str) -> None:
    """Raise SimulationError: a viscous contact's drag, which does not wait for a push, lifts its
    body off, and without it the body falls back."""
    raise SimulationError(
        f"viscous contact {name} neither stays nor leaves at t = {t:.9g} s: its drag alone, which "
        "does not wait for a push, lifts the body off; set friction.per_normal or give it "
        "regularised friction"
    )


def refuse_to_be_dragged_off(
    system: ContactBodies, law: ContactLaw, t: float, c: int, names: Sequence[str]
) -> None:
    """Raise SimulationError where a contact with a damper, which its drag has just lifted off,
    would push again at once: at the start of the step, apart, its event function falls."""
    touch, unit = system.touch, system.length / system.speed
    apart = law.compliant and touch[c, CLOSED] == 0.0
    if apart and law.drags and touch[c, SLOPES_BEFORE] * unit < -HELD_DOWN:
        refuse_drag(t, names[c])
