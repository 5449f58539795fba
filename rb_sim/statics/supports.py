"""Supports in the world: where they hold, and in which directions."""

from __future__ import annotations

import numpy as np

from rb_sim.statics.element import Array, Bound, Element, Law
from rb_sim.statics.model import StaticsScene, placed
from rb_sim.statics.support_kinds import ORIGIN, Contact, Hinge, Rod, String, Support, Weld


def place_support(scene: StaticsScene, name: str) -> Element:
    """The element of one support."""
    support = scene.supports[name]
    anchor, far = anchors(scene, support)
    force, torque, law, friction = unknowns_of(scene, support, anchor, far)
    return Element(
        name=name,
        kind=support.type,
        body=support.body,
        parent=support.parent,
        anchor_W=anchor,
        parent_anchor_W=far,
        force_W=force,
        torque_W=torque,
        law=law,
        friction=friction,
        bounds=(Bound("slips", friction, (1, 2)),) if 0.0 < friction < np.inf else (),
    )


def anchors(scene: StaticsScene, support: Support) -> tuple[Array, Array]:
    """Points of application on the body and on the parent, world [m]."""
    body = scene.bodies[support.body]
    parent = scene.parent(support)
    if isinstance(support, (String, Rod)):
        return placed(body, support.point_B), placed(parent, support.point_A)
    if support.point_B is None and support.point_A is not None:
        point = placed(parent, support.point_A)
    else:
        point = placed(body, support.point_B or ORIGIN)
    return point, point


def unknowns_of(
    scene: StaticsScene, support: Support, anchor: Array, far: Array
) -> tuple[Array, Array, Law, float]:
    """Force and torque columns on the body, law and friction coefficient."""
    none = np.zeros((3, 1))
    match support:
        case String() | Rod():
            toward = (far - anchor) / np.linalg.norm(far - anchor)
            return toward[:, None], none, "one-way" if support.type == "string" else "two-way", 0.0
        case Contact():
            normal = contact_normal(scene, support)
            if support.friction == "smooth" or support.friction == 0.0:
                return normal[:, None], none, "one-way", 0.0
            frame = np.column_stack([normal, *tangents(normal)])
            if support.friction == "rough":
                return frame, np.zeros((3, 3)), "one-way", np.inf
            return frame, np.zeros((3, 3)), "one-way", float(support.friction)
        case Hinge():
            if support.axis_A is not None:
                axis = in_world(scene.parent(support), support.axis_A)
            elif support.axis_B is not None:
                axis = in_world(scene.bodies[support.body], support.axis_B)
            else:
                return np.eye(3), np.zeros((3, 3)), "two-way", 0.0
            across = np.column_stack(tangents(axis))
            forces = np.hstack([np.eye(3), np.zeros((3, 2))])
            return forces, np.hstack([np.zeros((3, 3)), across]), "two-way", 0.0
        case Weld():
            zero = np.zeros((3, 3))
            return np.hstack([np.eye(3), zero]), np.hstack([zero, np.eye(3)]), "two-way", 0.0


def contact_normal(scene: StaticsScene, contact: Contact) -> Array:
    """Unit normal into the body, world, (3,)."""
    if contact.normal_B is not None:
        return in_world(scene.bodies[contact.body], contact.normal_B)
    assert contact.normal_A is not None
    return in_world(scene.parent(contact), contact.normal_A)


def in_world(body, direction) -> Array:
    vector = np.array(direction)
    return vector if body is None else body.rotation() @ vector


def tangents(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors across a unit normal, right-handed with it."""
    away = np.zeros(3)
    away[np.argmin(np.abs(normal))] = 1.0
    first = np.cross(normal, away)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)
