"""Which motion a compiled scene has: smooth, cut at events, or stepped."""

from __future__ import annotations

from typing import Any

from rb_sim.contact.events.motion import ContactMotion
from rb_sim.contact.stepping.motion import SteppedContacts
from rb_sim.engine.methods.time_stepping import TimeStepping
from rb_sim.motion import Motion
from rb_sim.scene.compiled import Compiled
from rb_sim.traced_motion import motion_for


def motion_of(compiled: Compiled, method: Any) -> Motion:
    """The Motion of a compiled scene: with events only where there are contacts."""
    if not compiled.contact_laws:
        return motion_for(compiled, method)
    kind = SteppedContacts if isinstance(method, TimeStepping) else ContactMotion
    return kind(compiled, method)
