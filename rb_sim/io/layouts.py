# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Layouts of a scene's topics for Foxglove, RViz and PlotJuggler.

The topics are those of `io/messages/topics`, published by the node and recorded in bags.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
import yaml

from rb_sim.base import palette
from rb_sim.base.names import ros_name
from rb_sim.base.palette import AXES
from rb_sim.io.messages import topic_names as names
from rb_sim.io.messages.robot_description import JointTable
from rb_sim.io.messages.topic_names import NAMESPACE, TF, WORLD
from rb_sim.io.rerun.arrow_scales import drawn_reactions, nice
from rb_sim.numerics.rotations import rotate
from rb_sim.scene.extent import reach_of

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import SampleLayout
    from rb_sim.scene.schema import Scene


MOST_BODIES, MOST_REACTIONS = 12, 24
"""Maximum number of bodies and of reactions with panels; a scene may have a thousand contacts."""

ENERGIES = tuple(palette.ENERGIES[name] for name in ("kinetic", "potential", "total"))
MARKERS = "markers"
"""Topic in every bag, and of a node with `markers:=true`."""


class Curve(NamedTuple):
    """One plotted number of a message."""

    topic: str
    """absolute topic name."""
    field: tuple[str, ...]
    label: str
    color: str


class Panel(NamedTuple):
    """Curves with a common axis."""

    title: str
    curves: tuple[Curve, ...]
    tab: str


class Shown(NamedTuple):
    """The topics of a scene in a layout."""

    scene: str
    panels: tuple[Panel, ...]
    poses: tuple[str, ...]
    wrenches: tuple[tuple[str, str], ...]
    """title and topic of each reaction and applied wrench."""
    states: tuple[tuple[str, str], ...]
    """title and topic of each point of contact."""
    joints: tuple[str, ...]
    """names of the joints, in the order of joint_states."""
    events: str | None
    center: tuple[float, float, float]
    size: float
    """size of the scene at its start [m]."""
    newton: float
    """force [N] drawn as an arrow of 1 m."""
    left_out: tuple[str, ...]
    """lines on bodies and reactions without panels."""

    @property
    def topics(self) -> set[str]:
        """All shown topics except the markers, which a node publishes only on request."""
        curves = {curve.topic for panel in self.panels for curve in panel.curves}
        events = set() if self.events is None else {self.events}
        drawn = {topic for _, topic in (*self.wrenches, *self.states)}
        return curves | events | drawn | set(self.poses) | {names.TF, DESCRIPTION}


DESCRIPTION = f"/{names.ROBOT_DESCRIPTION}"
JOINTS = f"{NAMESPACE}/{names.JOINT_STATES}"


def shown(scene: Scene, layout: SampleLayout) -> Shown:
    """Panels and topics of a scene for a layout."""
    bodies = layout.bodies[:MOST_BODIES]
    reactions = [layout.reactions[k] for k in drawn_reactions(layout)]
    contacts = layout.contacts[:MOST_REACTIONS]
    table = JointTable(scene, layout)
    joints = tuple(map(ros_name, table.names))
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
    panels += _of_joints(joints, table.units)
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


def _of_joints(joints: tuple[str, ...], units: list[str]) -> Iterator[Panel]:
    """A panel of angles and one of displacements, of the joints that have them."""
    for title, unit in (("joint angles [rad]", "rad"), ("joint displacements [m]", "m")):
        names = [name for name, own in zip(joints, units, strict=True) if own == unit]
        curves = (
            Curve(JOINTS, (name, "position"), name, AXES[k % len(AXES)])
            for k, name in enumerate(names)
        )
        if names:
            yield Panel(title, tuple(curves), "energy")


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
    """Width of the ground grid [m], and its number of cells."""
    cell = nice(size / 10.0)
    cells = 2 * int(np.ceil(size / cell))
    return cells * cell, cells


def camera(shown: Shown) -> dict[str, Any]:
    """Distance [m] and angles [rad] of a camera that shows the whole scene."""
    return {"distance": 1.8 * shown.size, "yaw": -0.98, "pitch": 0.4}


# Layout for Foxglove (JSON); load by Layouts, Import from file.
#
# The 3D panel draws the URDF of /robot_description on the frames of /tf; it cannot draw wrenches.


ROWS = 4
"""Plots per tab, one above the other."""


def foxglove(shown: Shown) -> str:
    """The Foxglove layout (JSON)."""
    panels: dict[str, Any] = {"3D!scene": _scene(shown)}
    tabs: dict[str, list[str]] = {}
    for k, panel in enumerate(shown.panels):
        panels[f"Plot!p{k}"] = _plot(shown, panel)
        tabs.setdefault(panel.tab, []).append(f"Plot!p{k}")
    if shown.states:
        panels["StateTransitions!contacts"] = {
            "foxglovePanelTitle": "contacts: 0 open, 1 slip, 2 stick or roll",
            "isSynced": True,
            "paths": [
                {"value": f"{topic}.data", "label": name, "timestampMethod": "receiveTime"}
                for name, topic in shown.states
            ],
        }
        tabs["contacts"] = ["StateTransitions!contacts"]
    if shown.events is not None:
        panels["RawMessages!events"] = {"topicPath": shown.events}
        tabs["contacts"].append("RawMessages!events")
    pages = [
        {"title": f"{title} {part}" if part else title, "layout": _above(names)}
        for title, every in tabs.items()
        for part, names in _pieces(every)
    ]
    panels["Tab!plots"] = {"activeTabIdx": 0, "tabs": pages}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split("row", "3D!scene", "Tab!plots", 55),
    }
    return json.dumps(layout, indent=2) + "\n"


def _scene(shown: Shown) -> dict[str, Any]:
    width, cells = grid(shown.size)
    eye = camera(shown)
    seen = [TF, f"{NAMESPACE}/{MARKERS}", *shown.poses]
    return {
        "foxglovePanelTitle": shown.scene,
        "followTf": WORLD,
        "followMode": "follow-none",
        "scene": {"transforms": {"axisScale": 0.5, "showLabel": False}},
        "transforms": {},
        "topics": {topic: {"visible": topic not in shown.poses} for topic in seen},
        "layers": {
            "grid": {
                "layerId": "foxglove.Grid",
                "instanceId": "grid",
                "label": "Grid",
                "visible": True,
                "frameId": WORLD,
                "size": width,
                "divisions": cells,
                "lineWidth": 1,
                "color": "#9aa3adff",
                "position": [0, 0, 0],
                "rotation": [0, 0, 0],
            },
            "shapes": {
                "layerId": "foxglove.Urdf",
                "instanceId": "shapes",
                "label": "Shapes",
                "visible": True,
                "sourceType": "topic",
                "topic": DESCRIPTION,
                "framePrefix": "",
                "displayMode": "visual",
            },
        },
        "cameraState": {
            "perspective": True,
            "distance": eye["distance"],
            "phi": float(np.degrees(0.5 * np.pi - eye["pitch"])),
            "thetaOffset": float(np.degrees(eye["yaw"]) + 90.0),
            "target": [0, 0, 0],
            "targetOffset": list(shown.center),
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.002 * shown.size,
            "far": 200.0 * shown.size,
        },
    }


def _plot(shown: Shown, panel: Panel) -> dict[str, Any]:
    return {
        "foxglovePanelTitle": panel.title,
        "paths": [
            {
                "value": _path(shown, curve),
                "label": curve.label,
                "color": curve.color,
                "enabled": True,
                "timestampMethod": "receiveTime",
            }
            for curve in panel.curves
        ],
        "xAxisVal": "timestamp",
        "isSynced": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showPlotValuesInLegend": True,
    }


def _path(shown: Shown, curve: Curve) -> str:
    """Foxglove path /topic.field.field; a joint by its index in the message."""
    if curve.topic == JOINTS:
        name, field = curve.field
        return f"{curve.topic}.{field}[{shown.joints.index(name)}]"
    return ".".join((curve.topic, *curve.field))


def _pieces(names: list[str]) -> list[tuple[str, list[str]]]:
    """(number, panels) of one tab, or of several numbered tabs."""
    if len(names) <= ROWS:
        return [("", names)]
    return [(str(k // ROWS + 1), names[k : k + ROWS]) for k in range(0, len(names), ROWS)]


def _above(names: list[str]) -> Any:
    """Panels stacked with equal heights."""
    if len(names) == 1:
        return names[0]
    return _split("column", names[0], _above(names[1:]), 100.0 / len(names))


def _split(direction: str, first: Any, second: Any, percentage: float) -> dict[str, Any]:
    return {
        "direction": direction,
        "first": first,
        "second": second,
        "splitPercentage": percentage,
    }


# Layout for PlotJuggler (XML); load by App, Layout, Load, or `plotjuggler --layout FILE`.


def plotjuggler(shown: Shown) -> str:
    """The PlotJuggler layout (XML)."""
    root = Element("root")
    widget = SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    tabs: dict[str, list[Panel]] = {}
    for panel in shown.panels:
        tabs.setdefault(panel.tab, []).append(panel)
    for title, panels in tabs.items():
        for first in range(0, len(panels), ROWS):
            number = f" {first // ROWS + 1}" if len(panels) > ROWS else ""
            _tab(widget, title + number, panels[first : first + ROWS])
    SubElement(widget, "currentTabIndex", index="0")
    SubElement(root, "use_relative_time_offset", enabled="1")
    indent(root)
    return "<?xml version='1.0' encoding='UTF-8'?>\n" + tostring(root, encoding="unicode") + "\n"


def _tab(widget: Element, title: str, panels: list[Panel]) -> None:
    tab = SubElement(widget, "Tab", tab_name=title, containers="1")
    container = SubElement(tab, "Container")
    count = len(panels)
    sizes = ";".join([f"{1.0 / count:.6g}"] * count)
    splitter = SubElement(container, "DockSplitter", orientation="-", count=str(count), sizes=sizes)
    for panel in panels:
        area = SubElement(splitter, "DockArea", name=panel.title)
        plot = SubElement(area, "plot", mode="TimeSeries", style="Lines")
        SubElement(plot, "range", left="0", right="1", bottom="0", top="1")
        SubElement(plot, "limitY")
        for curve in panel.curves:
            SubElement(plot, "curve", name=_name(curve), color=curve.color)


def _name(curve: Curve) -> str:
    """PlotJuggler's name of a number in a ROS message: /topic/field/field."""
    return "/".join((curve.topic, *curve.field))


# Layout for RViz 2 (YAML); load by `rviz2 -d FILE`.
#
# The shapes come from /robot_description (of the node with `robot_description:=true`, and of every
# bag), or from the markers of a node with `markers:=true`.


PLUGINS = "rviz_default_plugins"
REACTION, COMMAND, TORQUE = "224; 123; 0", "194; 37; 122", "122; 79; 192"
ARROW = 0.02
"""Width of an arrow, relative to the scene's size."""


def rviz(shown: Shown) -> str:
    """The RViz configuration (YAML)."""
    eye = camera(shown)
    x, y, z = shown.center
    manager = {
        "Class": "",
        "Displays": _displays(shown),
        "Enabled": True,
        "Global Options": {
            "Background Color": "245; 247; 250",
            "Fixed Frame": WORLD,
            "Frame Rate": 30,
        },
        "Name": "root",
        "Tools": [
            {"Class": f"{PLUGINS}/{name}"} for name in ("MoveCamera", "Select", "FocusCamera")
        ],
        "Value": True,
        "Views": {
            "Current": {
                "Class": f"{PLUGINS}/Orbit",
                "Name": "Current View",
                "Distance": eye["distance"],
                "Focal Point": {"X": x, "Y": y, "Z": z},
                "Near Clip Distance": 0.002 * shown.size,
                "Pitch": eye["pitch"],
                "Yaw": eye["yaw"],
                "Target Frame": WORLD,
                "Value": "Orbit (rviz)",
            },
            "Saved": None,
        },
    }
    panels = [
        {"Class": "rviz_common/Displays", "Name": "Displays"},
        {"Class": "rviz_common/Views", "Name": "Views"},
        {"Class": "rviz_common/Time", "Name": "Time", "SyncMode": 0},
    ]
    config = {"Panels": panels, "Visualization Manager": manager}
    return yaml.safe_dump(config, sort_keys=False, allow_unicode=True)


def _displays(shown: Shown) -> list[dict[str, Any]]:
    width, cells = grid(shown.size)
    latched = {"durability": "Transient Local"}
    found = [
        _display(
            "Grid",
            "Grid",
            **{
                "Cell Size": width / cells,
                "Plane Cell Count": cells,
                "Plane": "XY",
                "Color": "160; 160; 164",
                "Alpha": 0.5,
                "Reference Frame": WORLD,
            },
        ),  # fmt: skip
        _display(
            "TF",
            "TF",
            **{
                "Marker Scale": 0.5 * shown.size,
                "Show Names": False,
                "Show Arrows": False,
                "Show Axes": True,
                "Frame Timeout": 15,
            },
        ),  # fmt: skip
        _display(
            "RobotModel",
            "Shapes",
            **{
                "Description Source": "Topic",
                "Description Topic": _topic(DESCRIPTION, **latched),
                "Visual Enabled": True,
            },
        ),  # fmt: skip
        _display(
            "MarkerArray",
            "Markers (node with markers:=true)",
            enabled=False,
            Topic=_topic(f"{NAMESPACE}/{MARKERS}", **latched),
        ),  # fmt: skip
    ]
    for topic in shown.poses:
        found.append(_display("Pose", topic, enabled=False, Topic=_topic(topic), Shape="Axes",
                              **{"Axes Length": 0.15 * shown.size,
                                 "Axes Radius": 0.01 * shown.size}))  # fmt: skip
    for title, topic in shown.wrenches:
        color = REACTION if title.startswith("reaction") else COMMAND
        scale = {"Force Arrow Scale": 1.0 / shown.newton, "Torque Arrow Scale": 1.0 / shown.newton,
                 "Arrow Width": ARROW * shown.size, "Force Color": color, "Torque Color": TORQUE,
                 "History Length": 1}  # fmt: skip
        found.append(_display("Wrench", title, Topic=_topic(topic), **scale))
    return found


def _display(kind: str, name: str, enabled: bool = True, **settings: Any) -> dict[str, Any]:
    own = {"Class": f"{PLUGINS}/{kind}", "Name": name, "Enabled": enabled, "Value": enabled}
    return own | settings


def _topic(name: str, durability: str = "Volatile") -> dict[str, Any]:
    return {
        "Value": name,
        "Depth": 5,
        "History Policy": "Keep Last",
        "Reliability Policy": "Reliable",
        "Durability Policy": durability,
    }
