"""Wrenches on bodies over the samples of a run, and one of them about another point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.engine.samples import Array
from rb_sim.errors import RbSimError

if TYPE_CHECKING:
    from rb_sim.trajectory import Trajectory


class Reaction(NamedTuple):
    """A wrench ON a body, world axes: BY a constraint, or by an effect."""

    force: Array
    """[N], shape (n, 3)."""
    torque: Array
    """about the anchor [N m], shape (n, 3)."""
    anchor: Array
    """anchor or contact point; of an effect the centre of mass; world [m], shape (n, 3)."""


class Resultant(NamedTuple):
    """A wrench reduced to a point, world axes."""

    force: Array
    """[N], shape (n, 3)."""
    torque: Array
    """about `point` [N m], shape (n, 3)."""
    point: Array
    """world [m], shape (n, 3)."""


def resultant(
    trajectory: Trajectory, name: str, about: str | Sequence[float] | Array | None
) -> Resultant:
    """As Trajectory.resultant."""
    acting = trajectory.reaction.get(name)
    if acting is None:
        effects = trajectory.effect if trajectory.scene is not None else {}
        if name not in effects:
            known = ", ".join((*trajectory.layout.reactions, *effects)) or "none"
            raise RbSimError(f"resultant: got {name!r}; constraints and effects: {known}")
        acting = effects[name]
    point = _point(trajectory, about, acting.anchor)
    torque = acting.torque + np.cross(acting.anchor - point, acting.force)
    return Resultant(acting.force, torque, point)


def _point(trajectory: Trajectory, about: Any, anchor: Array) -> Array:
    if about is None:
        return anchor
    if isinstance(about, str):
        if about not in trajectory.layout.bodies:
            bodies = ", ".join(trajectory.layout.bodies)
            raise RbSimError(f"about: got {about!r}; bodies: {bodies}")
        return trajectory.position[about]
    try:
        points = np.broadcast_to(np.asarray(about, dtype=float), (len(trajectory), 3))
        if np.isfinite(points).all():
            return points
    except (TypeError, ValueError):
        pass
    allowed = "a body, 3 finite numbers, or 3 for each sample"
    raise RbSimError(f"about: got {about!r}; must be {allowed}")
