"""A layout for RViz 2 (YAML): `rviz2 -d FILE`.

The shapes come from /robot_description (of the node with `robot_description:=true`, and of every
bag), or from the markers of a node with `markers:=true`.
"""

from __future__ import annotations

from typing import Any

import yaml

from rb_sim.io.layouts.shown import DESCRIPTION, MARKERS, Shown, camera, grid
from rb_sim.io.messages.topic_names import NAMESPACE, WORLD

PLUGINS = "rviz_default_plugins"
REACTION, COMMAND, TORQUE = "224; 123; 0", "194; 37; 122", "122; 79; 192"
ARROW = 0.02
"""Width of an arrow, in sizes of the scene."""


def text_of(shown: Shown) -> str:
    """The configuration as the program reads it."""
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
