"""What the picture of a scene at rest shows, of a statics scene or an ordinary one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene
from rb_sim.statics.equilibrium import Equilibrium, assemble, load_in_world
from rb_sim.statics.model import Gravity, StaticBody, StaticsScene, placed
from rb_sim.statics.of_scene import active_loads, at_rest, still

Array = NDArray[np.float64]


class Load(NamedTuple):
    """One arrow."""

    name: str
    point: Array
    """world [m], (3,)."""
    force: Array
    """world axes [N], (3,)."""
    torque: Array
    """free, world axes [N m], (3,)."""
    pushes: bool
    """drawn with its tip at the point; else it pulls from there."""


class Drawn(NamedTuple):
    """Everything but the answer."""

    title: str
    bodies: dict[str, StaticBody]
    loads: list[Load]
    system: Equilibrium


def drawn_of(scene: StaticsScene | Scene) -> Drawn:
    """What is drawn of a scene."""
    title = scene.description or scene.name
    if isinstance(scene, StaticsScene):
        return Drawn(title, dict(scene.bodies), _loads_at_rest(scene), assemble(scene))
    bodies = {
        name: StaticBody(
            mass=body.mass,
            center_of_mass=body.center_of_mass,
            position=body.position,
            orientation=body.orientation,
            shape=body.shape,
        )
        for name, body in scene.bodies.items()
    }
    return Drawn(title, bodies, _loads_of_effects(scene), at_rest(scene))


def _loads_at_rest(scene: StaticsScene) -> list[Load]:
    found = []
    for name, load in scene.loads.items():
        if isinstance(load, Gravity):
            for body_name, body in scene.bodies.items():
                if body.mass > 0.0 and (load.bodies is None or body_name in load.bodies):
                    force = body.mass * np.array(load.acceleration)
                    centre = placed(body, body.center_of_mass)
                    found.append(Load(name, centre, force, np.zeros(3), False))
        else:
            found.append(Load(name, *load_in_world(scene, load), True))
    return found


def _loads_of_effects(scene: Scene) -> list[Load]:
    """From the centres of mass; those that are none at rest are left out."""
    place = InitialPlace(scene)
    states = {name: still(place.state(name)) for name in scene.bodies}
    return [
        Load(name, np.array(states[body].p_WC), force, torque, False)
        for name, body, force, torque in active_loads(scene, place, states)
        if force.any() or torque.any()
    ]
