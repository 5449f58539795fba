"""A layout for PlotJuggler (XML): App, Layout, Load; or `plotjuggler --layout FILE`."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, indent, tostring

from rb_sim.io.layouts.shown import Curve, Panel, Shown

ROWS = 4
"""Plots above each other in a tab."""


def text_of(shown: Shown) -> str:
    """The layout as the program loads it."""
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
    """/topic/field/field, as the program calls the numbers of a ROS message."""
    return "/".join((curve.topic, *curve.field))
