"""Closed forms of the motion: one file each; a scene that matches one is measured against it."""

from __future__ import annotations

from rb_sim.accuracy.closed_forms.contact import CONTACT_FORMS
from rb_sim.accuracy.closed_forms.exact import Exact
from rb_sim.accuracy.closed_forms.free_rotor import free_rotor
from rb_sim.accuracy.closed_forms.parabola import falling_body
from rb_sim.accuracy.closed_forms.pendulum import pendulum
from rb_sim.accuracy.closed_forms.rolling_sphere import rolling_sphere
from rb_sim.accuracy.closed_forms.steady_top import steady_top
from rb_sim.accuracy.closed_forms.symmetric_rotor import symmetric_rotor
from rb_sim.scene.compiled import Compiled

FORMS = (symmetric_rotor, free_rotor, pendulum, rolling_sphere, steady_top, falling_body)


def closed_form(compiled: Compiled) -> Exact | None:
    """The exact motion of a compiled scene, or None where none is known."""
    if compiled.breakpoints:
        return None
    if compiled.contact_laws:
        exacts = (form(compiled) for form in CONTACT_FORMS)
        return next((exact for exact in exacts if exact is not None), None)
    if not compiled.reduced:
        return None
    for form in FORMS:
        exact = form(compiled.system, compiled.y)
        if exact is not None:
            return exact
    return None
