"""An ordinary scene asked for its equilibrium: its initial pose, at rest (LL 38.1).

The constraints give the same lines, with the same signs, as when they move; effects load the bodies
as their laws say for bodies at rest; contacts push within their laws of friction where surfaces
touch. Initial velocities, driven rates and the motion of supports count as none, commands too.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rb_sim.catalogue.constraints.rows import COUNT, ROW_WIDTH, anchor, fill
from rb_sim.catalogue.types import WORLD, BodyState, wrench
from rb_sim.contact.scene.touching import Touching
from rb_sim.errors import SceneError
from rb_sim.maths.vectors import rotate, sub
from rb_sim.scene.compile import compile_motion, named
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene
from rb_sim.statics.element import Element
from rb_sim.statics.equilibrium import Equilibrium, poles_of, put_together
from rb_sim.statics.touching import Standing, touching_elements

Array = NDArray[np.float64]

KINDS = {"distance": "rod"}
"""What a statics scene calls the same support. Its number is the pull, positive in tension, where
the row of the constraint pushes the body away from the other end."""


def at_rest(scene: Scene) -> Equilibrium:
    """The equilibrium of the scene's bodies at their initial pose.

    Raises SceneError as compiling does, and for a bilateral contact with Coulomb friction.
    """
    place = InitialPlace(scene)
    scale = float(compile_motion(scene, "maximal").system.length)  # refuses what cannot start
    states = {name: still(place.state(name)) for name in scene.bodies}
    elements: list[Element] = []
    apart: list[str] = []
    constraints: dict[str, Any] = dict(scene.constraints)
    for name, spec in constraints.items():
        if getattr(spec, "between", None) is not None:
            raise SceneError(
                f"got {spec.between!r}; must be left out for statics, which needs each pair that "
                "touches as a contact with body and parent",
                key=f"constraints.{name}.between",
                file=scene.file,
            )
        B, A = states[spec.body], states.get(spec.parent, WORLD) if has_parent(spec) else WORLD
        if isinstance(spec, Touching):
            standing = Standing(place, name, spec, B, A, scale)
            found = named(scene, f"constraints.{name}", lambda s=standing: touching_elements(s))
            elements += found.closed
            apart += found.apart
        else:
            elements += joint_elements(name, spec, place, B, A)
    loads = list(active_loads(scene, place, states))
    bodies = tuple(scene.bodies)
    centres = np.array([states[name].p_WC for name in bodies])
    points = {name: [np.array(states[name].p_WC)] for name in bodies}
    for element in elements:
        points[element.body].append(element.anchor_W)
        if element.parent is not None:
            points[element.parent].append(element.parent_anchor_W)
    wrenches = np.zeros((len(bodies), 6))
    for _, body, force, torque in loads:
        row = bodies.index(body)
        wrenches[row, :3] += force
        wrenches[row, 3:] += torque
    poles = poles_of(bodies, points)
    wrenches[:, 3:] += np.cross(centres - poles, wrenches[:, :3])
    return put_together(bodies, tuple(elements), points, wrenches, centres, tuple(apart))


def has_parent(spec: Any) -> bool:
    """Whether a body, not the world, holds it."""
    return getattr(spec, "parent", None) is not None


def still(state: BodyState) -> BodyState:
    """The same pose without velocities."""
    return state._replace(v_WC=(0.0, 0.0, 0.0), w_WB_B=(0.0, 0.0, 0.0))


def joint_elements(
    name: str, spec: Any, place: InitialPlace, B: BodyState, A: BodyState, *, whole: bool = False
) -> Iterator[Element]:
    """An element for each reaction of a joint that is no total; whole: one for their total."""
    groups: dict[str, list[Any]] = {}
    for part in spec.parts(place):
        groups.setdefault("" if whole else part.outputs[-1], []).append(part.row)
    parent = spec.parent if has_parent(spec) else None
    for suffix, rows in groups.items():
        point = np.array(anchor(rows[0], B, A), float)
        lines = np.vstack([lines_of(row, B, A) for row in rows])
        force = lines[:, :3]
        about_centre = np.array([rotate(B.q_WB, tuple(line)) for line in lines[:, 3:6]])
        torque = about_centre - np.cross(point - np.array(B.p_WC), force)
        torque[np.abs(torque) <= ROUND_OFF * np.abs(about_centre).max(initial=0.0)] = 0.0
        kind = KINDS.get(str(spec.type), str(spec.type))
        if kind == "rod":
            force, torque = -force, -torque
        yield Element(
            name=f"{name}/{suffix}" if suffix else name,
            kind=kind,
            body=spec.body,
            parent=parent,
            anchor_W=point,
            parent_anchor_W=point,
            force_W=force.T,
            torque_W=torque.T,
            law="two-way",
        )


ROUND_OFF = 1e-14
"""Of the largest torque about C, below which a torque about the anchor is rounding."""


def lines_of(row: Any, B: BodyState, A: BodyState) -> Array:
    """The Jacobian of one part of a constraint: (lines, 12)."""
    G = np.zeros((COUNT[type(row)], ROW_WIDTH))
    fill(row, 0.0, B, A, G, 0)
    return G[:, :12]


def active_loads(
    scene: Scene, place: InitialPlace, states: dict[str, BodyState]
) -> Iterator[tuple[str, str, Array, Array]]:
    """(effect, body, force, torque about C) of the effects and their opposites, world axes."""
    effects: dict[str, Any] = dict(scene.effects)
    for name, spec in effects.items():
        if spec.commandable:
            continue
        for row, body, parent in spec.rows(place):
            B, A = states[body], WORLD if parent is None else states[parent]
            force, torque_B = wrench(row, 0.0, place.inertial(body), B, A)
            torque = rotate(B.q_WB, torque_B)
            yield name, body, np.array(force, float), np.array(torque, float)
            if parent is not None:
                turned = np.array(torque, float) + np.cross(sub(B.p_WC, A.p_WC), force)
                yield name, parent, -np.array(force, float), -turned
