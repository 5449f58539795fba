"""Reactions that statics alone does not determine: redundant contacts, as redundant joints are.

Multipliers x that push without effect, W^T x = 0, may be added to any reactions; undetermined is a
reaction that such an x changes (a box on four corners, a table on four legs).
"""

from __future__ import annotations

import numpy as np

from rb_sim.contact.events.choice import choose_modes
from rb_sim.contact.events.decompositions import eigenvalues
from rb_sim.contact.events.delassus import inverse_mass
from rb_sim.contact.events.dense import spread
from rb_sim.contact.events.instant import Instant
from rb_sim.contact.events.tasks import WRITE, Tasks
from rb_sim.errors import SimulationError
from rb_sim.maths.rank import JUDGED_BY_CONTACT
from rb_sim.scene.compiled import Compiled

CHANGED = 1e-8
"""Change of a reaction's wrench, relative to the largest line, above which it is undetermined."""


MOST_CONTACTS = 24
"""Points above which their modes at the start are not sought for this: heaps are for time stepping,
and almost all of their reactions are undetermined."""


def undetermined_at_start(compiled: Compiled) -> tuple[str, ...]:
    """Names of such reactions, with the contacts in their modes at the start."""
    laws = compiled.contact_laws
    if not laws or len(laws) > MOST_CONTACTS:
        return compiled.indeterminate
    system = compiled.system._replace(touch=compiled.system.touch.copy())
    y, call = np.array(compiled.y), Tasks(system)
    try:
        choose_modes(Instant(laws, call, 0.0, y))
    except SimulationError:  # jams at once: nothing is known of its forces
        return compiled.indeterminate
    call(WRITE, 0.0, y)
    pushes = spread(system, system.pushes)
    holding = np.flatnonzero(np.abs(pushes).any(axis=1))
    if not len(holding):
        return compiled.indeterminate
    W = pushes[holding]
    values, vectors = eigenvalues(W @ inverse_mass(system) @ W.T, "the reactions at the start")
    free = vectors[:, values <= JUDGED_BY_CONTACT * values[-1]]
    part = np.searchsorted(system.first_row, holding, side="right") - 1
    names = []
    for o, name in enumerate(compiled.layout.reactions):
        own = system.members[o, 1 + part].astype(bool)
        wrench = W[own].T @ free[own]
        if np.abs(wrench).max(initial=0.0) > CHANGED * np.abs(W).max():
            names.append(name)
    return tuple(names)
