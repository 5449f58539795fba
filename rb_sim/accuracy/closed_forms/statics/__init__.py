"""Closed forms of bodies at rest: one file each; a statics scene that matches one is measured."""

from __future__ import annotations

from rb_sim.accuracy.closed_forms.statics.hinged_rods import hinged_rods
from rb_sim.accuracy.closed_forms.statics.ladder import ladder
from rb_sim.accuracy.closed_forms.statics.rod_on_two_planes import rod_on_two_planes
from rb_sim.accuracy.closed_forms.statics.rod_over_edge import rod_over_edge
from rb_sim.accuracy.closed_forms.statics.sphere_on_plane import sphere_on_plane
from rb_sim.accuracy.closed_forms.statics.standing import ExactReactions, standing_of
from rb_sim.accuracy.closed_forms.statics.table import table
from rb_sim.statics.model import StaticsScene

STATICS_FORMS = (sphere_on_plane, rod_over_edge, rod_on_two_planes, hinged_rods, ladder, table)


def exact_reactions(scene: StaticsScene) -> ExactReactions | None:
    """The exact reactions of a statics scene, or None where none are known."""
    standing = standing_of(scene)
    found = (form(standing) for form in STATICS_FORMS)
    return next((exact for exact in found if exact is not None), None)
