"""The initial situation of a scene, as specs ask for it while they are compiled into rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rb_sim.catalogue.types import WORLD, BodyState, Inertial, Quaternion, Symmetric, Vec3
from rb_sim.maths.vectors import add, cross, rotate, sub, unrotate
from rb_sim.scene.schema import Body, Scene


def vector(values: Any) -> Vec3:
    """Three Python floats."""
    x, y, z = map(float, values)
    return x, y, z


def quaternion(values: Any) -> Quaternion:
    """Four Python floats."""
    x, y, z, w = map(float, values)
    return x, y, z, w


def symmetric(values: Any) -> Symmetric:
    """Six Python floats."""
    xx, yy, zz, xy, xz, yz = map(float, values)
    return xx, yy, zz, xy, xz, yz


def inertial_of(body: Body) -> Inertial:
    """Constants of one body as kernels take them."""
    i = np.asarray(body.inertia)
    six = symmetric((i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]))
    return Inertial(float(body.mass), six, vector(body.center_of_mass))


def initial_state(body: Body) -> BodyState:
    """State of the centre of mass from that of the body origin."""
    q, w, r = (
        quaternion(body.orientation),
        vector(body.angular_velocity),
        vector(body.center_of_mass),
    )
    p = add(vector(body.position), rotate(q, r))
    v = add(vector(body.linear_velocity), rotate(q, cross(w, r)))
    return BodyState(p, q, v, w)


class InitialPlace:
    """Implements `Place` for a scene.

    starts: states of centres of mass from which the motion starts at `time` [s] instead of the
    scene's; what the scene takes from its initial pose is still taken from there.
    """

    def __init__(
        self, scene: Scene, starts: Mapping[str, BodyState] | None = None, time: float = 0.0
    ) -> None:
        self.scene, self.time = scene, time
        self.inertials = {name: inertial_of(body) for name, body in scene.bodies.items()}
        self.states = {name: initial_state(body) for name, body in scene.bodies.items()}
        self._starts = dict(starts or {})

    def body_names(self) -> tuple[str, ...]:
        return tuple(self.scene.bodies)

    def inertial(self, body: str) -> Inertial:
        return self.inertials[body]

    def state(self, body: str | None) -> BodyState:
        return WORLD if body is None else self.states[body]

    def start(self, body: str) -> BodyState:
        """From which the motion starts."""
        return self._starts.get(body) or self.states[body]

    def shape(self, body: str) -> Any:
        return self.scene.bodies[body].shape

    def from_com(self, body: str | None, point: Vec3) -> Vec3:
        return vector(point) if body is None else sub(vector(point), self.inertials[body].r_OC)

    def partner_point(
        self, parent: str | None, point: Vec3 | None, body: str, point_B: Vec3
    ) -> Vec3:
        if point is not None:
            return self.from_com(parent, point)
        B, A = self.state(body), self.state(parent)
        world = add(B.p_WC, rotate(B.q_WB, self.from_com(body, point_B)))
        return unrotate(A.q_WB, sub(world, A.p_WC))

    def partner_axis(self, parent: str | None, axis: Vec3 | None, body: str, axis_B: Vec3) -> Vec3:
        if axis is not None:
            return vector(axis)
        return unrotate(self.state(parent).q_WB, rotate(self.state(body).q_WB, vector(axis_B)))
