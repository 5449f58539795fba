# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""joint_states, robot description (URDF) and markers of a scene, for viewers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from rb_sim.base.names import ros_name
from rb_sim.io.messages import cdr
from rb_sim.io.messages.packing import stamps_of
from rb_sim.io.messages.topic_names import JOINT_STATES, WORLD, body_frame
from rb_sim.mechanics.samples import centers_of_mass, origins
from rb_sim.numerics.rotations import conjugate, product, roll_pitch_yaw, rotate
from rb_sim.numerics.vectors import quaternion_product
from rb_sim.scene.extent import drawn_solid

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Body, Scene


# joint_states: position and velocity of each joint, named after its constraint.
#
# A `fixed_axis` has angle [rad] and rate [rad/s], a `translation` along a line displacement [m] and
# speed [m/s] along the guide's direction; the displacement is zero in the first sample.
#
# The angle is that of the body relative to its parent, right-handed about axis_B, zero in the first
# sample, and continuous beyond a full turn. The number of turns between two samples follows from
# their mean rate; it is wrong only if that is off by half a turn, as after an impact.


TURN = 2.0 * np.pi


class JointTable:
    """joint_states messages of successive samples. names: of the joints; units: of positions."""

    topics = ((JOINT_STATES, cdr.JOINT_STATE),)
    latched = True

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        joints: dict[str, Any] = {
            n: c for n, c in scene.constraints.items() if c.type == "fixed_axis" or slides(c)
        }
        self.names = list(joints)
        self._slides = np.array([slides(c) for c in joints.values()], dtype=bool)
        self.units = ["m" if sliding else "rad" for sliding in self._slides]
        axes = [c for c in joints.values() if not slides(c)]
        self._axis_B = np.array([c.axis_B for c in axes]).reshape(-1, 3)
        index = {name: i for i, name in enumerate(layout.bodies)}
        self._body = [index[c.body] for c in axes]
        self._parent = [-1 if c.parent is None else index[c.parent] for c in axes]
        guided = [c for c in joints.values() if slides(c)]
        self._slider = [index[c.body] for c in guided]
        self._direction = np.array([c.guide.direction for c in guided]).reshape(-1, 3)
        names, lengths = map(ros_name, self.names), [len(self.names)] * 3
        self._codec = cdr.codec(cdr.JOINT_STATE, "", *names, lengths=[*lengths, 0])
        self._last: tuple[float, Array, Array, Array] | None = None
        """last sample: time [s], and for each axis its angle from the first sample modulo a turn
        [rad], the number of full turns, its rate [rad/s]."""
        self._start = np.zeros((len(guided), 3))
        """centre of mass of each guided body in the first sample, world axes [m]."""

    def rows(self, block: SampleBlock) -> list[Any]:
        """As in MessageTable."""
        return [self._codec.pack_rows(stamps_of(block), self.values(block))]

    def values(self, block: SampleBlock) -> Array:
        """Positions and velocities of the joints in the next samples, shape (n, 2 J)."""
        n = len(block)
        restarts = {given.index for given in block.inputs if not given.body}
        placed = sorted({given.index for given in block.inputs if given.state})
        relative, rate = self._relative(block)
        position, velocity = np.empty((2, n, len(self.names)))
        velocity[:, ~self._slides] = rate
        # a guided body does not rotate: its centre of mass moves like all its points
        place, speed = block.position[:, self._slider], block.linear_velocity[:, self._slider]
        velocity[:, self._slides] = np.sum(speed * self._direction, axis=-1)
        borders = sorted({0, n} | {k for k in restarts if k < n})
        for first, end in zip(borders, borders[1:], strict=False):
            part = slice(first, end)
            jumps = [k - first for k in placed if first <= k < end]
            restart = first in restarts or self._last is None
            if restart:
                self._start = place[first]
            way = np.sum((place[part] - self._start) * self._direction, axis=-1)
            angle = self._go_on(block.t[part], relative[part], rate[part], jumps, restart)
            position[part, self._slides], position[part, ~self._slides] = way, angle
        return np.hstack([position, velocity])

    def _relative(self, block: SampleBlock) -> tuple[Array, Array]:
        """Orientations relative to the parents (n, J, 4), and rates (n, J), of the axes."""
        orientation, spin = block.orientation, block.angular_velocity
        own = orientation[:, self._body]
        parent = _of_parents(orientation, self._parent, (0.0, 0.0, 0.0, 1.0))
        relative = product(conjugate(parent), own)
        carried = rotate(parent, _of_parents(spin, self._parent, (0.0, 0.0, 0.0)))
        along = np.sum(carried * rotate(own, self._axis_B), axis=-1)
        return relative, np.sum(spin[:, self._body] * self._axis_B, axis=-1) - along

    def _go_on(
        self, t: Array, relative: Array, rate: Array, jumps: list[int], restart: bool
    ) -> Array:
        """Continuous angles of the next samples; jumps: indices at which a state was set."""
        if restart or self._last is None:
            none = np.zeros(len(self._body))
            self._initial, self._last = relative[0], (t[0], none, none, rate[0])
        t_last, turn_last, turns_last, rate_last = self._last
        # rotation from the first pose in body axes: only about axis_B
        x, y, z, w = np.moveaxis(product(conjugate(self._initial), relative), -1, 0)
        along = x * self._axis_B[:, 0] + y * self._axis_B[:, 1] + z * self._axis_B[:, 2]
        turn = 2.0 * np.arctan2(along, w)
        mean = 0.5 * (np.vstack([rate_last, rate[:-1]]) + rate)
        way = np.diff(t, prepend=t_last)[:, None] * mean
        way[jumps] = 0.0
        more = np.round((np.vstack([turn_last, turn[:-1]]) + way - turn) / TURN)
        turns = turns_last + np.cumsum(more, axis=0)
        self._last = t[-1], turn[-1], turns[-1], rate[-1]
        return turn + TURN * turns


def slides(constraint: Any) -> bool:
    """Whether the constraint is a prismatic joint: a `translation` along a line."""
    guide = constraint.guide if constraint.type == "translation" else None
    return guide is not None and guide.type == "line"


def _of_parents(of_bodies: Array, parents: list[int], of_world: tuple[float, ...]) -> Array:
    """Values of bodies, shape (n, N, k), for each parent; index -1: the value for the world."""
    values = of_bodies[:, parents]
    values[:, [i < 0 for i in parents]] = of_world
    return values


# URDF of a scene: links with inertia and shape, and joints as far as URDF supports them.
#
# A `fixed_axis` becomes a continuous joint of the same name, a `translation` along a line a
# prismatic one, with positions as in `joint_states`; a `weld` becomes a fixed joint; any other body
# has a floating joint to the world and its pose on /tf. URDF requires a tree, and joints at the
# child's origin: constraints that would close a loop are omitted, and an axis off the body's origin
# gets a link of its own, CONSTRAINT/bearing.


Element = ElementTree.Element
UNLIMITED = 1e9
"""[m, m/s, N]: limits of a prismatic joint, which URDF requires although a guide has none."""


def urdf(scene: Scene, layout: SampleLayout, initial: SampleBlock) -> str:
    """The URDF document. initial: the first sample, which defines zero joint positions."""
    robot = ElementTree.Element("robot", name=scene.name)
    ElementTree.SubElement(robot, "link", name=WORLD)
    motion = origins(initial, centers_of_mass(scene.bodies, layout.bodies))
    poses = {
        name: (motion.position[0, i], initial.orientation[0, i])
        for i, name in enumerate(layout.bodies)
    }
    joints = joints_above(scene)
    for name, body in scene.bodies.items():
        robot.append(_link(name, body))
        _join(robot, name, joints.get(name), poses)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True)


def joints_above(scene: Scene) -> dict[str, tuple[str, Any]]:
    """Constraint (name, spec) that becomes each body's joint: the first closing no loop."""
    found: dict[str, tuple[str, Any]] = {}
    specs: dict[str, Any] = dict(scene.constraints)
    for name, spec in specs.items():
        if not (spec.type in ("fixed_axis", "weld") or slides(spec)) or spec.body in found:
            continue
        above = _parent(spec)
        while above in found and above != spec.body:
            above = _parent(found[above][1])
        if above != spec.body:
            found[spec.body] = name, spec
    return found


def _parent(spec: Any) -> str | None:
    """Parent body of the joint; None: the world, as for every guide."""
    return None if slides(spec) else spec.parent


def _link(name: str, body: Body) -> Element:
    link = ElementTree.Element("link", name=body_frame(name))
    inertial = ElementTree.SubElement(link, "inertial")
    _origin(inertial, np.array(body.center_of_mass))
    ElementTree.SubElement(inertial, "mass", value=_text(body.mass))
    tensor = np.asarray(body.inertia)
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": _text(tensor[i, j]) for i in range(3) for j in range(i, 3)}
    ElementTree.SubElement(inertial, "inertia", entries)
    if body.shape is not None:
        for purpose in ("visual", "collision"):
            part = ElementTree.SubElement(link, purpose)
            _shape(part, body.shape)
    return link


def _shape(part: Element, shape: Any) -> None:
    """Add the geometry; an ellipsoid, which URDF lacks, as a sphere with its largest semi-axis."""
    solid = drawn_solid(shape)
    _origin(part, np.array(shape.center_B), solid.turn)
    geometry = ElementTree.SubElement(part, "geometry")
    match solid.kind:
        case "box":
            ElementTree.SubElement(geometry, "box", size=_texts(2.0 * solid.half))
        case "cylinder":
            entries = {"length": _text(solid.length), "radius": _text(solid.radius)}
            ElementTree.SubElement(geometry, "cylinder", entries)
        case _:
            ElementTree.SubElement(geometry, "sphere", radius=_text(solid.radius))


def _join(
    robot: Element,
    body: str,
    hangs: tuple[str, Any] | None,
    poses: dict[str, tuple[Array, Array]],
) -> None:
    """Add the joint, or two, between the body and its parent."""
    position, orientation = poses[body]
    link = body_frame(body)
    if hangs is None:
        joint = _joint(robot, f"{link}/free", "floating", WORLD, link)
        _origin(joint, position, orientation)
        return
    name, spec = ros_name(hangs[0]), hangs[1]
    hung_on = _parent(spec) or WORLD
    parent = body_frame(hung_on)
    p_A, q_A = poses.get(hung_on, (np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])))
    turn = np.array(quaternion_product(conjugate(q_A), orientation))
    if spec.type == "weld":
        joint = _joint(robot, name, "fixed", parent, link)
        _origin(joint, rotate(conjugate(q_A), position - p_A), turn)
        return
    if slides(spec):
        joint = _joint(robot, name, "prismatic", parent, link)
        _origin(joint, position, orientation)
        axis = rotate(conjugate(orientation), np.array(spec.guide.direction))
        ElementTree.SubElement(joint, "axis", xyz=_texts(axis))
        limits = {"lower": -UNLIMITED, "upper": UNLIMITED}
        limits |= {"effort": UNLIMITED, "velocity": UNLIMITED}
        entries = {key: _text(value) for key, value in limits.items()}
        ElementTree.SubElement(joint, "limit", entries)
        return
    point_B = np.array(spec.point_B)
    bearing = f"{name}/bearing" if point_B.any() else link
    joint = _joint(robot, name, "continuous", parent, bearing)
    point = position + rotate(orientation, point_B)
    _origin(joint, rotate(conjugate(q_A), point - p_A), turn)
    ElementTree.SubElement(joint, "axis", xyz=_texts(spec.axis_B))
    if bearing != link:
        ElementTree.SubElement(robot, "link", name=bearing)
        _origin(_joint(robot, f"{name}/offset", "fixed", bearing, link), -point_B)


def _joint(robot: Element, name: str, kind: str, parent: str, child: str) -> Element:
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint


def _origin(of: Element, xyz: Array, turn: Array | None = None) -> None:
    q = np.array([0.0, 0.0, 0.0, 1.0]) if turn is None else turn
    ElementTree.SubElement(of, "origin", xyz=_texts(xyz), rpy=_texts(roll_pitch_yaw(q)))


# Markers: each body's shape in its own frame, locked to the frames of /tf and thus sent only once.
# A body without shape has none.


MARKERS = {"box": 1, "ball": 2, "ellipsoid": 2, "cylinder": 3}
"""Types of visualization_msgs/Marker: cube, sphere, cylinder."""
COLOUR = (0.35, 0.55, 0.85, 1.0)
"""Colour of bodies: red, green, blue, opacity."""


def marker_array(scene: Scene, prefix: str = "") -> bytes:
    """The visualization_msgs/MarkerArray of a scene. prefix: prepended to each frame name."""
    shapes = [(n, body.shape) for n, body in scene.bodies.items() if body.shape is not None]
    layout = cdr.Layout().count(len(shapes))
    for number, (name, shape) in enumerate(shapes):
        solid = drawn_solid(shape)
        layout.fixed("I", 0, 0).text(prefix + body_frame(name)).text(name)  # stamp, frame, ns
        layout.fixed("i", number, MARKERS[solid.kind], 0)  # id, type, action: add
        layout.fixed("d", *shape.center_B, *solid.turn, *(2.0 * solid.half))
        layout.fixed("f", *COLOUR).fixed("I", 0, 0).fixed("B", 1)  # lifetime: endless; locked
        layout.count(0).count(0).text("")  # points, colours, texture
        layout.fixed("I", 0, 0).text("").text("").count(0).count(0)  # image, coordinates in it
        layout.text("").text("").text("").count(0).fixed("B", 0)  # text, mesh and its file
    return layout.codec().pack(0, ())


def _text(value: float) -> str:
    return repr(float(value))


def _texts(values: Any) -> str:
    return " ".join(_text(value) for value in values)
