"""Closed forms of motions: a scene that matches one is measured against it."""

from __future__ import annotations

from rb_sim.accuracy.closed_forms.exact import Exact, falling_body
from rb_sim.accuracy.closed_forms.impacts_and_sliding import (
    bouncing_ball,
    sliding_block,
    slipping_ball,
)
from rb_sim.accuracy.closed_forms.rolling import (
    off_a_sphere,
    rolling_in_cylinder,
    rolling_sphere,
    turntable,
)
from rb_sim.accuracy.closed_forms.rotors import free_rotor, pendulum, steady_top, symmetric_rotor
from rb_sim.scene.compiled import Compiled

FORMS = (
    symmetric_rotor,
    free_rotor,
    pendulum,
    rolling_sphere,
    steady_top,
    falling_body,
    bouncing_ball,
    slipping_ball,
    turntable,
    rolling_in_cylinder,
    off_a_sphere,
    sliding_block,
)
"""Of a compiled scene: its exact motion, or None; the first that knows one is taken. The table that
`rb_sim accuracy` measures against and that the tests compare runs with; of reactions at rest:
`STATICS_FORMS`."""


def closed_form(compiled: Compiled) -> Exact | None:
    """The exact motion of a compiled scene, or None where none is known."""
    if compiled.breakpoints:
        return None
    found = (form(compiled) for form in FORMS)
    return next((exact for exact in found if exact is not None), None)
