"""The equilibrium of every body as one linear system in the reactions (LL 38.1).

    matrix @ x + load = 0,    x admissible

Six rows per body: sum of forces (world axes) and sum of torques about the body's pole (world axes).
A support contributes columns: the wrench it puts on its body per unit of each of its unknowns, and
the opposite force at its other end on the parent. Unknowns are tensions and forces [N] and the
torques of hinges with an axis and of welds [N m].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rb_sim.statics.model import (
    Array,
    Element,
    Gravity,
    StaticsScene,
    Wrench,
    place_support,
    placed,
)


@dataclass(frozen=True)
class Equilibrium:
    """The linear system and where its rows and columns come from. n bodies, u unknowns."""

    bodies: tuple[str, ...]
    elements: tuple[Element, ...]
    columns: tuple[slice, ...]
    """columns of each element."""
    poles: Array
    """point about which a body's torques are summed, world [m], (n, 3)."""
    matrix: Array
    """(6 n, u): three force rows, then three torque rows, body after body."""
    load: Array
    """active wrench on each body, force [N] and torque about its pole [N m], (6 n,)."""
    active: Array
    """the same of the loads alone, without what elements exert whatever their unknowns, (n, 6)."""
    is_torque: Array
    """unknowns that are torques, bool (u,)."""
    lever: float
    """largest distance of a point of application from its body's pole [m]; 1 if all are zero."""
    reach: float
    """largest distance of a point of application from the world origin [m]."""
    centres: Array
    """of mass, world [m], (n, 3)."""
    apart: tuple[str, ...] = ()
    """contacts whose surfaces do not touch: they hold nothing."""

    def load_about_centres(self) -> Array:
        """The active loads with their torques about the centres of mass, (n, 6) [N, N m]."""
        total = self.active.copy()
        total[:, 3:] += np.cross(self.poles - self.centres, total[:, :3])
        return total


def assemble(scene: StaticsScene) -> Equilibrium:
    """Build the system of a scene."""
    bodies = tuple(scene.bodies)
    elements = tuple(place_support(scene, name) for name in scene.supports)
    points = points_of_application(scene, elements)
    centres = np.array([placed(body, body.center_of_mass) for body in scene.bodies.values()])
    poles = poles_of(bodies, points)
    return put_together(bodies, elements, points, loads_about(scene, poles), centres)


def poles_of(bodies: tuple[str, ...], points: dict[str, list[Array]]) -> Array:
    """The mean of the points of application on each body, world [m], (n, 3)."""
    return np.array([np.mean(points[name], axis=0) for name in bodies]).reshape(-1, 3)


def put_together(
    bodies: tuple[str, ...],
    elements: tuple[Element, ...],
    points: dict[str, list[Array]],
    loads: Array,
    centres: Array,
    apart: tuple[str, ...] = (),
) -> Equilibrium:
    """The system of elements and loads.

    points: where something acts on each body, world [m]; their mean is its pole.
    loads: active wrench on each body about its pole, (n, 6) [N, N m].
    """
    poles = poles_of(bodies, points)
    ends = np.cumsum([0, *(element.size for element in elements)])
    columns = tuple(slice(int(a), int(b)) for a, b in zip(ends[:-1], ends[1:], strict=True))
    matrix = np.zeros((6 * len(bodies), int(ends[-1])))
    is_torque = np.zeros(int(ends[-1]), dtype=bool)
    active, loads = loads, loads.copy()
    for element, column in zip(elements, columns, strict=True):
        is_torque[column] = ~element.force_W.any(axis=0)
        add_end(matrix, loads, column, element, bodies, poles)
    levers = [
        float(np.linalg.norm(point - pole))
        for name, pole in zip(bodies, poles, strict=True)
        for point in points[name]
    ]
    lever = max(levers, default=0.0)
    reach = max((float(np.linalg.norm(p)) for at in points.values() for p in at), default=0.0)
    return Equilibrium(
        bodies=bodies,
        elements=elements,
        columns=columns,
        poles=poles,
        matrix=matrix,
        load=loads.ravel(),
        active=active,
        is_torque=is_torque,
        lever=lever if lever > 0.0 else 1.0,
        reach=reach,
        centres=centres,
        apart=apart,
    )


def loads_about(scene: StaticsScene, poles: Array) -> Array:
    """Active wrench on each body about its pole, world axes, (n, 6) [N, N m]."""
    total = np.zeros((len(scene.bodies), 6))
    for load in scene.loads.values():
        if isinstance(load, Gravity):
            for row, (name, pole) in enumerate(zip(scene.bodies, poles, strict=True)):
                if load.bodies is None or name in load.bodies:
                    body = scene.bodies[name]
                    force = body.mass * np.array(load.acceleration)
                    arm = placed(body, body.center_of_mass) - pole
                    total[row] += np.concatenate([force, np.cross(arm, force)])
        else:
            row = list(scene.bodies).index(load.body)
            point, force, torque = load_in_world(scene, load)
            turning = torque + np.cross(point - poles[row], force)
            total[row] += np.concatenate([force, turning])
    return total


def load_in_world(scene: StaticsScene, load: Wrench) -> tuple[Array, Array, Array]:
    """Point of application [m], force [N] and free torque [N m] of a load, world axes."""
    body = scene.bodies[load.body]
    turn = np.eye(3) if load.frame == "world" else body.rotation()
    return placed(body, load.point_B), turn @ np.array(load.force), turn @ np.array(load.torque)


def add_end(
    matrix: Array,
    loads: Array,
    column: slice,
    element: Element,
    bodies: tuple[str, ...],
    poles: Array,
) -> None:
    """Add the element's wrench on its body and the opposite one on its parent."""
    for name, anchor, sign in (
        (element.body, element.anchor_W, 1.0),
        (element.parent, element.parent_anchor_W, -1.0),
    ):
        if name is not None:
            row = bodies.index(name)
            lever = anchor - poles[row]
            turning = element.torque_W + np.cross(lever, element.force_W, axisb=0, axisc=0)
            matrix[6 * row : 6 * row + 3, column] += sign * element.force_W
            matrix[6 * row + 3 : 6 * row + 6, column] += sign * turning
            loads[row, :3] += sign * element.given_W
            loads[row, 3:] += sign * np.cross(lever, element.given_W)


def points_of_application(
    scene: StaticsScene, elements: tuple[Element, ...]
) -> dict[str, list[Array]]:
    """Centre of mass, loaded points and ends of supports of each body, world [m]."""
    points = {name: [placed(body, body.center_of_mass)] for name, body in scene.bodies.items()}
    for load in scene.loads.values():
        if isinstance(load, Wrench):
            points[load.body].append(load_in_world(scene, load)[0])
    for element in elements:
        points[element.body].append(element.anchor_W)
        if element.parent is not None:
            points[element.parent].append(element.parent_anchor_W)
    return points
