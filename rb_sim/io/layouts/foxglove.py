"""A layout for Foxglove (JSON): Layouts, Import from file.

The 3D panel draws the URDF of /robot_description on the frames of /tf; it has no wrenches.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from rb_sim.io.layouts.shown import (
    DESCRIPTION,
    JOINTS,
    MARKERS,
    Curve,
    Panel,
    Shown,
    camera,
    grid,
)
from rb_sim.io.messages.topic_names import NAMESPACE, TF, WORLD

ROWS = 4
"""Plots above each other in a tab."""


def text_of(shown: Shown) -> str:
    """The layout as the program imports it."""
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
    """/topic.field.field; of a joint by its place in the message."""
    if curve.topic == JOINTS:
        name, field = curve.field
        return f"{curve.topic}.{field}[{shown.joints.index(name)}]"
    return ".".join((curve.topic, *curve.field))


def _pieces(names: list[str]) -> list[tuple[str, list[str]]]:
    """A tab, or several with numbers."""
    if len(names) <= ROWS:
        return [("", names)]
    return [(str(k // ROWS + 1), names[k : k + ROWS]) for k in range(0, len(names), ROWS)]


def _above(names: list[str]) -> Any:
    """Panels above each other, equally high."""
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
