"""The initial state against the laws of contact: checked, moved apart where the scene asks for a
projection, or refused."""

from __future__ import annotations

import numpy as np

from rb_sim.contact.geometry.rims_on_cylinders import ABSENT
from rb_sim.contact.scene.touching import ContactLaw
from rb_sim.contact.system.bodies import ContactBodies
from rb_sim.contact.system.lines import write_contact
from rb_sim.contact.system.manifold import bring_positions, bring_to_manifold
from rb_sim.contact.system.touch import CLOSED, GAP, SENSE, SLIP
from rb_sim.engine.systems.multipliers import write_rows
from rb_sim.errors import SceneError
from rb_sim.maths.jit import python_of
from rb_sim.scene.initial import MISFIT, refuse_initial
from rb_sim.scene.schema import Scene

TOUCHES = 1e-12
"""Overlap, relative to the scene's length, that is rounding once bodies have been moved apart."""


def check_contacts(
    scene: Scene,
    system: ContactBodies,
    y: np.ndarray,
    names: list[str],
    laws: list[ContactLaw],
    t: float,
) -> None:
    """Refuse a start in which bodies overlap or a perfectly rough contact slips; with
    `project_initial` move the bodies apart, in place."""
    try:
        write_rows(system, t, y)
    except ZeroDivisionError:
        refuse_middle(scene, system, y, names, t)
        raise
    if scene.simulation.project_initial:
        if not move_apart(system, y, laws, t):
            raise SceneError(
                "contacts contradict each other or the constraints: no state near the initial one "
                f"is without overlap ({deepest_name(system, names, laws)})",
                key="constraints",
                file=scene.file,
            )
        return
    for c, name in enumerate(names):
        gap = system.touch[c, GAP] / system.length
        if not laws[c].compliant and (gap < -MISFIT or (laws[c].bilateral and gap > MISFIT)):
            refuse_initial(scene, name, "the initial position", abs(float(gap)))
        slip = float(np.linalg.norm(system.touch[c, SLIP : SLIP + 3])) / system.speed
        if laws[c].static == np.inf and abs(gap) <= MISFIT < slip:
            refuse_initial(scene, name, "the initial velocity (it is perfectly rough)", slip)


def refuse_middle(
    scene: Scene, system: ContactBodies, y: np.ndarray, names: list[str], t: float
) -> None:
    """Raise SceneError where a body that is not round is in the very middle of a hollow support:
    no direction tells where its nearest point has to be sought."""
    for c, placed in enumerate(one for group in system.contacts for one in group):
        try:
            write_contact(placed, t, system, y, c)
        except ZeroDivisionError:
            name = names[c].split("/")[0]
            body = scene.constraints[name].body
            raise SceneError(
                f"the center of mass of {body} is in the very middle of the round surface, where "
                f"no point is the nearest; move bodies.{body}.position by a little",
                key=f"constraints.{name}",
                file=scene.file,
            ) from None


def move_apart(system: ContactBodies, y: np.ndarray, laws: list[ContactLaw], t: float) -> bool:
    """Move bodies that overlap, by the least mass-weighted way and with the joints holding, until
    they touch; y changes in place.  False if there is no such way.

    The deepest contact is held at its gap of zero, then the one that is deepest after that as
    well, until none is left; what the contacts' velocities are is not touched.
    """
    held: list[int] = []
    for _ in range(len(laws) + 1):
        gaps = overlaps(system, laws)
        c = int(gaps.argmin()) if len(gaps) else 0
        if not len(gaps) or gaps[c] >= -TOUCHES * system.length:
            break
        if c in held:
            return bool(gaps[c] >= -MISFIT * system.length)
        held.append(c)
        system.touch[held, CLOSED] = 1.0
        python_of(bring_positions)(system, t, y)
        system.touch[held, CLOSED] = 0.0
        write_rows(system, t, y)
    if held:  # velocities that the joints do not allow where the bodies are now
        python_of(bring_to_manifold)(system, t, y)
        write_rows(system, t, y)
    return bool(np.isfinite(y).all())


def overlaps(system: ContactBodies, laws: list[ContactLaw]) -> np.ndarray:
    """The gap of each rigid contact that can touch [m], 0 of others, (contacts,)."""
    compliant = np.array([law.compliant for law in laws], dtype=bool)
    counts = ~compliant & (system.touch[:, SENSE] != ABSENT)
    return np.where(counts, system.touch[:, GAP], 0.0)


def deepest_name(system: ContactBodies, names: list[str], laws: list[ContactLaw]) -> str:
    return names[int(overlaps(system, laws).argmin())]
