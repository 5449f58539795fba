"""The initial state on the constraints: checked, projected where the scene asks, or refused."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np

from rb_sim.engine.manifold import relative, start_on_manifold
from rb_sim.engine.systems.many_bodies import MultiBody
from rb_sim.errors import SceneError
from rb_sim.scene.dependent import dead_centre, hidden_by_masses
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.reduced import misfit
from rb_sim.scene.schema import Scene

MISFIT = 1e-6
"""Relative violation of a constraint up to which an initial state is taken as rounded."""

ON_MANIFOLD = 1e-9
"""Relative violation above which constraints that were to be satisfied contradict each other."""


def check_reduced(scene: Scene, place: InitialPlace, reduced: Any) -> None:
    """Refuse an initial state that the reduced coordinates cannot represent."""
    if scene.simulation.project_initial:
        return
    name = next(iter(scene.bodies))
    size, what = misfit(place.state(name), reduced.state, reduced.length)
    if size > MISFIT:
        joint = next(k for k, s in scene.constraints.items() if s.type != "free")
        refuse_initial(scene, joint, f"the initial {what} of {name}", size)


def refuse_initial(scene: Scene, constraint: str, what: str, size: float) -> None:
    raise SceneError(
        f"{what} violates it by {size:.2g} (relative to the scene's size; at most {MISFIT:g} is "
        "allowed); correct it or set simulation.project_initial: true",
        key=f"constraints.{constraint}",
        file=scene.file,
    )


def check_maximal(
    scene: Scene,
    system: Any,
    y: np.ndarray,
    owners: list[str],
    t: float,
    scales: tuple[float, float],
) -> tuple[int, int]:
    """Refuse or project an initial state off the manifold, in place; (rank, lines).

    scales: length [m] and speed [m/s] of which a misfit is a share, see `start_scales`.
    """
    try:
        with np.errstate(all="ignore"):  # what does not stay finite is refused below
            before, after, rank = start_on_manifold(system, t, y)
    except ZeroDivisionError:
        refuse_lines(scene, "have no direction there: points that must be apart coincide")
    lines = before.shape[1]
    misfits = zip(("position", "velocity"), relative(system, before, *scales), strict=True)
    for what, error in misfits if lines and not scene.simulation.project_initial else ():
        if error.max() > MISFIT:
            owner = owners[part_of(system, int(error.argmax()))]
            refuse_initial(scene, owner, f"the initial {what}", float(error.max()))
    if not (relative(system, after, system.length, system.speed) <= ON_MANIFOLD).all():  # nor NaN
        raise SceneError(
            "they contradict each other: no state near the initial one satisfies all of them",
            key="constraints",
            file=scene.file,
        )
    try:
        with np.errstate(all="ignore"):
            hidden = hidden_by_masses(system, t, y) if isinstance(system, MultiBody) else ()
            singular = dead_centre(system, t, y) if rank < lines else np.zeros(0, int)
    except np.linalg.LinAlgError:
        refuse_lines(scene, "overflow there: lengths or masses are too large, or too small")
    if len(hidden):
        found = dict.fromkeys(owners[part_of(system, int(k))] for k in hidden)
        refuse_masses(scene, ", ".join(found))
    if len(singular):
        found = dict.fromkeys(owners[part_of(system, int(k))] for k in singular)
        raise SceneError(
            f"the lines of {', '.join(found)} depend on each other in the initial position only (a "
            "dead centre, or bearings too close to tell apart), where accelerations and reactions "
            "are not determined; start beside it, set bearings further apart, or leave one of them "
            "out",
            key="constraints",
            file=scene.file,
        )
    return int(rank), lines


def refuse_lines(scene: Scene, why: str) -> NoReturn:
    raise SceneError(
        f"their lines in the initial position {why}", key="constraints", file=scene.file
    )


def refuse_masses(scene: Scene, constraints: str) -> None:
    masses = [body.mass for body in scene.bodies.values()]
    raise SceneError(
        f"masses of {min(masses):.3g} kg and {max(masses):.3g} kg hang on each other by "
        f"{constraints}: doubles cannot tell its lines from dependent ones; give the light body "
        "more mass (a ratio up to some 1e10 runs), or leave it out",
        key="constraints",
        file=scene.file,
    )


def part_of(system: Any, line: int) -> int:
    """The part of a constraint that owns a line."""
    return int(np.searchsorted(system.first_row, line, side="right")) - 1
