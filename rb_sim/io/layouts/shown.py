"""What a layout shows of a scene: its topics, in panels of curves, as all three programs have them.

Topics are those of the table in `io/messages/topics`, which node and bag have in common.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base import palette
from rb_sim.base.names import ros_name
from rb_sim.base.palette import AXES
from rb_sim.io.extent import reach_of
from rb_sim.io.messages import topic_names as names
from rb_sim.io.messages.topic_names import NAMESPACE
from rb_sim.io.rerun.arrow_scales import drawn_reactions, nice
from rb_sim.numerics.rotations import rotate

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import SampleLayout
    from rb_sim.scene.schema import Scene

MOST_BODIES, MOST_REACTIONS = 12, 24
"""That a layout has panels for; a scene may have a thousand contacts."""

ENERGIES = tuple(palette.ENERGIES[name] for name in ("kinetic", "potential", "total"))
MARKERS = "markers"
"""In each bag, and of the node with `markers:=true`."""


class Curve(NamedTuple):
    """A number of a message over time."""

    topic: str
    """absolute."""
    field: tuple[str, ...]
    label: str
    color: str


class Panel(NamedTuple):
    """Curves with one axis."""

    title: str
    curves: tuple[Curve, ...]
    tab: str


class Shown(NamedTuple):
    """The topics of a scene that layouts show."""

    scene: str
    panels: tuple[Panel, ...]
    poses: tuple[str, ...]
    wrenches: tuple[tuple[str, str], ...]
    """title and topic of each reaction and applied wrench."""
    states: tuple[tuple[str, str], ...]
    """title and topic of each point of contact."""
    joints: tuple[str, ...]
    """names in joint_states."""
    events: str | None
    center: tuple[float, float, float]
    size: float
    """of the scene at its start [m]."""
    newton: float
    """force [N] whose arrow is 1 m long."""
    left_out: tuple[str, ...]
    """what the scene has too much of, in words."""

    @property
    def topics(self) -> set[str]:
        """All that are shown, but for the markers, which a node publishes only if asked."""
        curves = {curve.topic for panel in self.panels for curve in panel.curves}
        events = set() if self.events is None else {self.events}
        drawn = {topic for _, topic in (*self.wrenches, *self.states)}
        return curves | events | drawn | set(self.poses) | {names.TF, DESCRIPTION}


DESCRIPTION = f"/{names.ROBOT_DESCRIPTION}"
JOINTS = f"{NAMESPACE}/{names.JOINT_STATES}"


def shown(scene: Scene, layout: SampleLayout) -> Shown:
    """What is shown of a scene."""
    bodies = layout.bodies[:MOST_BODIES]
    reactions = [layout.reactions[k] for k in drawn_reactions(layout)]
    contacts = layout.contacts[:MOST_REACTIONS]
    joints = tuple(ros_name(n) for n, c in scene.constraints.items() if c.type == "fixed_axis")
    left_out = [
        f"{what}: the first {most} of {count}"
        for what, most, count in (
            ("bodies", MOST_BODIES, len(layout.bodies)),
            ("reactions", MOST_REACTIONS, len(reactions)),
        )
        if count > most
    ]
    reactions = reactions[:MOST_REACTIONS]
    commanded = [body for body in layout.commanded if body in bodies]
    wrenches = [(f"reaction {name}", _own(names.reaction_topic(name))) for name in reactions]
    wrenches += [
        (f"applied to {body}", _own(names.body_topic(body, "wrench_applied"))) for body in commanded
    ]
    panels = [panel for body in bodies for panel in _of_body(body)]
    panels += [_wrench(title, topic, part) for title, topic in wrenches for part in _PARTS]
    panels += [_of_joints(joints)] if joints else []
    panels += _of_whole(bool(layout.contacts))
    places = np.array([
        np.array(body.position) + rotate(np.array(body.orientation), np.array(body.center_of_mass))
        for body in scene.bodies.values()
    ])  # fmt: skip
    low, high = places.min(axis=0), places.max(axis=0)
    reach = max(map(reach_of, scene.bodies.values()), default=0.0) or 0.5
    size = float(np.linalg.norm(high - low)) + 2.0 * reach
    weight = 9.81 * sum(body.mass for body in scene.bodies.values())
    x, y, z = (0.5 * (low + high)).tolist()
    return Shown(
        scene=scene.name,
        panels=tuple(panels),
        poses=tuple(_own(names.body_topic(body, "pose")) for body in bodies),
        wrenches=tuple(wrenches),
        states=tuple((name, _own(names.state_topic(name))) for name in contacts),
        joints=joints,
        events=_own(names.CONTACT_EVENTS) if layout.contacts else None,
        center=(x, y, z),
        size=size,
        newton=nice(2.0 * weight / size),
        left_out=tuple(left_out),
    )


def _own(topic: str) -> str:
    return f"{NAMESPACE}/{topic}"


_PARTS = (("force", "F", "N"), ("torque", "M", "N m"))


def _of_body(body: str) -> Iterator[Panel]:
    def panel(title: str, topic: str, field: tuple[str, ...], axes: str) -> Panel:
        colors = zip(axes, AXES, strict=False)
        curves = (Curve(topic, (*field, axis), axis, color) for axis, color in colors)
        return Panel(f"{body}: {title}", tuple(curves), body)

    pose, twist = _own(names.body_topic(body, "pose")), _own(names.body_topic(body, "twist"))
    yield panel("position [m]", pose, ("pose", "position"), "xyz")
    yield panel("orientation, quaternion", pose, ("pose", "orientation"), "xyzw")
    yield panel("velocity [m/s]", twist, ("twist", "linear"), "xyz")
    yield panel("angular velocity [rad/s]", twist, ("twist", "angular"), "xyz")


def _wrench(title: str, topic: str, part: tuple[str, str, str]) -> Panel:
    field, letter, unit = part
    curves = (
        Curve(topic, ("wrench", field, axis), f"{letter}{axis}", color)
        for axis, color in zip("xyz", AXES, strict=False)
    )
    return Panel(f"{title}: {field} [{unit}]", tuple(curves), "wrenches")


def _of_joints(joints: tuple[str, ...]) -> Panel:
    curves = (
        Curve(JOINTS, (name, "position"), name, AXES[k % len(AXES)])
        for k, name in enumerate(joints)
    )
    return Panel("joint angles [rad]", tuple(curves), "energy")


def _of_whole(has_contacts: bool) -> Iterator[Panel]:
    parts = (("energy/kinetic", "kinetic"), ("energy/potential", "potential"), ("energy", "total"))
    energies = (
        Curve(_own(topic), ("data",), label, color)
        for (topic, label), color in zip(parts, ENERGIES, strict=True)
    )
    yield Panel("energy [J]", tuple(energies), "energy")
    lone = [
        ("power", "power of forces without potential [W]"),
        ("residual", "constraint violation"),
    ]
    if has_contacts:
        lone.insert(1, (names.CONTACT_WORK, "work of contacts [J]"))
    for topic, title in lone:
        yield Panel(title, (Curve(_own(topic), ("data",), topic, AXES[3]),), "energy")


def grid(size: float) -> tuple[float, int]:
    """Width of a grid [m] that a scene stands on, and its cells across."""
    cell = nice(size / 10.0)
    cells = 2 * int(np.ceil(size / cell))
    return cells * cell, cells


def camera(shown: Shown) -> dict[str, Any]:
    """Distance [m] and angles [rad] from which the whole scene is seen."""
    return {"distance": 1.8 * shown.size, "yaw": -0.98, "pitch": 0.4}
