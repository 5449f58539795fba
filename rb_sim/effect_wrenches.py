"""Wrenches of the effects at the samples of a trajectory: the catalogue's laws, evaluated there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.catalogue.types import WORLD, BodyState, wrench
from rb_sim.errors import RbSimError
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene
from rb_sim.sinks.frames import rotate

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array
    from rb_sim.trajectory import Trajectory
    from rb_sim.wrenches import Reaction


def effect_wrenches(trajectory: Trajectory) -> Mapping[str, Reaction]:
    """NAME, or NAME/BODY where an effect acts on several bodies: force and torque about C.

    World axes, ON the body; on the parent of an effect the opposite, about the parent's C.
    Raises RbSimError where the scene is not known.
    """
    found: dict[str, Reaction] = {}
    for name, by_body in wrenches_by_body(trajectory).items():
        for body, acting in by_body.items():
            found[name if len(by_body) == 1 else f"{name}/{body}"] = acting
    return found


def wrenches_by_body(trajectory: Trajectory) -> Mapping[str, Mapping[str, Reaction]]:
    """By effect, then by the body on which it acts; as `effect_wrenches`."""
    scene = trajectory.scene
    if not isinstance(scene, Scene):
        raise RbSimError("effects: the scene of these samples is not known")
    place = InitialPlace(scene)
    return {
        name: {
            body: _about_center(trajectory, body, force, torque)
            for body, (force, torque) in _of_effect(trajectory, place, spec).items()
        }
        for name, spec in scene.effects.items()
    }


def _about_center(trajectory: Trajectory, body: str, force: Array, torque: Array) -> Reaction:
    from rb_sim.wrenches import Reaction

    return Reaction(force, torque, trajectory.position[body])


def _of_effect(
    trajectory: Trajectory, place: InitialPlace, spec: Any
) -> dict[str, tuple[Array, Array]]:
    """(force, torque about C), world axes, shape (n, 3) each, by body."""
    if spec.type == "commanded_wrench":
        return {spec.body: _commanded(trajectory, place, spec.body)}
    totals: dict[str, tuple[Array, Array]] = {}
    for row, body, parent in spec.rows(place):
        force, torque = _of_row(trajectory, place, row, body, parent)
        _add(totals, body, force, torque)
        if parent is not None:
            lever = trajectory.position[body] - trajectory.position[parent]
            _add(totals, parent, -force, -torque - np.cross(lever, force))
    return totals


def _add(totals: dict[str, tuple[Array, Array]], body: str, force: Array, torque: Array) -> None:
    f, m = totals.get(body, (np.zeros_like(force), np.zeros_like(torque)))
    totals[body] = f + force, m + torque


def _of_row(
    trajectory: Trajectory, place: InitialPlace, row: Any, body: str, parent: str | None
) -> tuple[Array, Array]:
    """One row of the catalogue at every sample: its law takes one state at a time."""
    inertial = place.inertial(body)
    bodies = _states(trajectory, body)
    parents = [WORLD] * len(bodies) if parent is None else _states(trajectory, parent)
    pairs = [
        wrench(row, t, inertial, B, A)
        for t, B, A in zip(trajectory.t.tolist(), bodies, parents, strict=True)
    ]
    force = np.array([pair[0] for pair in pairs], dtype=float).reshape(-1, 3)
    torque_B = np.array([pair[1] for pair in pairs], dtype=float).reshape(-1, 3)
    return force, rotate(trajectory.orientation[body], torque_B)


def _states(trajectory: Trajectory, body: str) -> list[BodyState]:
    columns = (
        trajectory.position[body],
        trajectory.orientation[body],
        trajectory.linear_velocity[body],
        trajectory.angular_velocity[body],
    )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [BodyState(*map(tuple, row)) for row in rows]


def _commanded(trajectory: Trajectory, place: InitialPlace, body: str) -> tuple[Array, Array]:
    """As recorded, about the body origin, taken to C."""
    command = trajectory.command[body]
    force, torque = command[:, :3], command[:, 3:]
    r_OC_W = rotate(trajectory.orientation[body], np.array(place.inertial(body).r_OC))
    return force, torque - np.cross(r_OC_W, force)
