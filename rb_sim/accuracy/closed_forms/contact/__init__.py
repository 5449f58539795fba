"""Closed forms of motions in contact: one file each, as those without."""

from __future__ import annotations

from rb_sim.accuracy.closed_forms.contact.bouncing_ball import bouncing_ball
from rb_sim.accuracy.closed_forms.contact.off_a_sphere import off_a_sphere
from rb_sim.accuracy.closed_forms.contact.rolling_in_cylinder import rolling_in_cylinder
from rb_sim.accuracy.closed_forms.contact.sliding_block import sliding_block
from rb_sim.accuracy.closed_forms.contact.slipping_ball import slipping_ball
from rb_sim.accuracy.closed_forms.contact.turntable import turntable

CONTACT_FORMS = (
    bouncing_ball,
    slipping_ball,
    turntable,
    rolling_in_cylinder,
    off_a_sphere,
    sliding_block,
)
