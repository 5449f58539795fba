# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pictures of a run: pose, twist, reactions, energy and residual over time (PNG, matplotlib).

One page; for a scene with many bodies and reactions one page for the whole and one for each body.
Memory is bounded: a long run is plotted as the envelope of its samples, which preserves peaks.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import MissingExtraError, SinkError
from rb_sim.base.palette import AXES, EVENT, FAINT, GRID, SLIPPING, STICKING
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.io.panels import ANGLES, Accelerating, Panel, panels_of, scales
from rb_sim.io.sink import Envelope, Timeline

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, ContactEvent, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# Panels as matplotlib figures: varying quantities are plotted, constant ones listed.


_DPI = 110
_WIDTH = 13.0
_ROW = 2.2
_TOP, _BOTTOM = 1.05, 0.5
_LINE = 0.2
"""Height of a line of text below the panels [inch]."""

_STATES = {1.0: (SLIPPING, "slips"), 2.0: (STICKING, "sticks or rolls")}
"""Colour and name of the states slip and stick (or roll) in a contact's strip."""

_STRIP = 0.035
"""Height of the strip, relative to the panel."""

_WRAP = 170
"""Characters per line below the panels."""


class Contacts(NamedTuple):
    """Data of the contacts: times, shape (n,), states, shape (n, C), and events."""

    t: Array
    states: Array
    names: tuple[str, ...]
    events: list[ContactEvent]


class Curves(NamedTuple):
    """A panel and its data."""

    panel: Panel
    t: Array
    values: Array
    """shape (n, labels)."""


def resolved(curves: Curves, scale: float) -> Curves | None:
    """The curves with components that are constant within the resolution made constant; None if all
    are, since they are then listed as text.

    scale: reference magnitude of this kind of quantity in the run; 0 if there is none.
    """
    panel, t, values = curves
    finite = values[np.isfinite(values).all(axis=1)]
    if panel.logarithmic:
        return None if finite.size and finite.max() <= WRITTEN_ROUNDING else curves
    if not finite.size:
        return curves
    least = WRITTEN_ROUNDING * scale
    if len(finite) < len(values):
        return curves
    flat = np.ptp(values, axis=0) <= least
    if flat.all() and len(values) > 1:
        return None
    shown = np.where(flat, np.median(values, axis=0), values)
    return Curves(panel, t, np.where(flat & (np.abs(shown) <= least), 0.0, shown))


def with_jumps(t: Array, values: Array, instants: Array) -> tuple[Array, Array]:
    """The curves with a vertical line at each of the instants, at which they may jump.

    The curve is extrapolated to the instant linearly from the two samples on the same side, if no
    other instant lies between them; else it is held.
    """
    if len(t) < 2 or not len(instants):
        return t, values
    gaps = np.searchsorted(t, instants, side="right") - 1
    inside = (gaps >= 0) & (gaps < len(t) - 1)
    gaps, instants = gaps[inside], instants[inside]
    broken = set(gaps.tolist())
    times, rows, at = [], [], []
    for gap in sorted(broken):
        mine = instants[gaps == gap]
        left = _carried(t, values, gap, gap - 1, broken, mine[0])
        right = _carried(t, values, gap + 1, gap + 1, broken, mine[-1])
        times += [mine[0], mine[-1]]
        rows += [left, right]
        at += [gap + 1, gap + 1]
    if not at:
        return t, values
    return np.insert(t, at, times), np.insert(values, at, np.array(rows), axis=0)


def _carried(t: Array, values: Array, i: int, gap: int, broken: set[int], to: float) -> Array:
    """values[i] extrapolated to the time `to` along the line through the samples of `gap`."""
    if not 0 <= gap < len(t) - 1 or gap in broken or t[gap + 1] <= t[gap]:
        return values[i]
    slope = (values[gap + 1] - values[gap]) / (t[gap + 1] - t[gap])
    return values[i] + (to - t[i]) * slope


def page(title: str, curves: list[Curves], notes: list[str], contacts: Contacts | None) -> Any:
    """A matplotlib figure with the curves in two columns, and notes below."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = (len(curves) + 1) // 2
    below = _BOTTOM + _LINE * len(notes)
    height = _ROW * rows + _TOP + below
    figure = Figure(figsize=(_WIDTH, height), dpi=_DPI)
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.012, y=1 - 0.2 * _TOP / height, ha="left", va="top", fontsize=13)
    margins = {"left": 0.05, "right": 0.985, "wspace": 0.13, "hspace": 0.36}
    margins |= {"top": 1 - _TOP / height, "bottom": below / height}
    if rows:
        axes = figure.subplots(rows, 2, sharex=True, squeeze=False, gridspec_kw=margins).ravel()
        for ax, drawn in zip(axes, curves, strict=False):
            draw_panel(ax, drawn, contacts)
        for ax in axes[len(curves) :]:
            ax.set_axis_off()
        for ax in axes[max(0, len(curves) - 2) : len(curves)]:
            ax.set_xlabel("time [s]")
            ax.tick_params(labelbottom=True)
        handles = _legend([each.panel for each in curves], contacts)
        corner = (0.004, 1 - 0.42 * _TOP / height)
        style = {"frameon": False, "fontsize": 9, "handlelength": 1.4, "ncols": len(handles) or 1}
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=corner, **style)
    for k, note in enumerate(reversed(notes)):
        figure.text(0.012, (0.06 + _LINE * k) / height, note, fontsize=8, color=FAINT)
    return figure


def _legend(panels: list[Panel], contacts: Contacts | None) -> list[Any]:
    """Legend of the axis colours, common to all panels, and of contact marks."""
    from matplotlib.lines import Line2D

    axes = [panel.labels for panel in panels if panel.colors[:3] == AXES[:3]]
    angles = any(labels == ANGLES for labels in axes)
    names = [f"{axis}, {angle}" if angles else axis for axis, angle in zip("xyz", ANGLES)]  # noqa: B905
    names = [*names, *(["w"] if any(len(labels) == 4 for labels in axes) else [])] if axes else []
    found = [Line2D([], [], color=color, label=name) for name, color in zip(names, AXES)]  # noqa: B905
    states = [panel.contact for panel in panels if panel.contact is not None]
    if contacts is not None and states:
        seen = contacts.states[:, states]
        for state, (color, label) in _STATES.items():
            if (seen == state).any():
                found.append(Line2D([], [], color=color, label=label, linewidth=5))
        shown = {contacts.names[c] for c in states}
        if any(event.kind == "impact" and event.contact in shown for event in contacts.events):
            mark: dict[str, Any] = {
                "marker": "v",
                "color": EVENT,
                "linestyle": "none",
                "markersize": 5,
            }
            found.append(Line2D([], [], label="impact", **mark))
    return found


def draw_panel(ax: Any, curves: Curves, contacts: Contacts | None) -> None:
    """Draw the curves of one panel, with jumps at changes of contact, and contact states below."""
    panel, t, values = curves
    if contacts is not None and panel.jumps:
        instants = np.unique([event.t for event in contacts.events])
        t, values = with_jumps(t, values, instants)
    for k, (label, color) in enumerate(zip(panel.labels, panel.colors, strict=True)):
        style = "--" if label.startswith("work") else "-"
        steps = "steps-pre" if panel.held else "default"
        ax.plot(t, values[:, k], style, color=color, label=label, linewidth=1.2, drawstyle=steps)
    ax.set_title(panel.heading, loc="left", fontsize=10, fontweight="bold")
    ax.grid(color=GRID, linewidth=0.6)
    ax.margins(x=0)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize=8)
    if panel.logarithmic:
        ax.set_yscale("log")
        ax.set_ylim(*_decades(values))
    else:
        _widen(ax, values)
        ax.ticklabel_format(axis="y", scilimits=(-3, 6), useOffset=False)
        ax.yaxis.get_offset_text().set_fontsize(8)
    if len(panel.labels) > 1 and panel.colors[:2] != AXES[:2]:  # not in the figure's legend
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=len(panel.labels),
                  frameon=False, fontsize=9, handlelength=1.2, borderpad=0.1)  # fmt: skip
    if contacts is not None and panel.contact is not None:
        draw_contact(ax, contacts, panel.contact)


def draw_contact(ax: Any, contacts: Contacts, c: int) -> None:
    """Draw a strip with the contact's state; changes as dotted lines, impacts as triangles."""
    t, states = contacts.t, contacts.states[:, c]
    borders = np.concatenate([[0], np.flatnonzero(np.diff(states)) + 1, [len(t) - 1]])
    across = ax.get_xaxis_transform()
    for state, (color, _) in _STATES.items():
        edges = zip(borders, borders[1:], strict=False)
        spans = [(t[a], t[b] - t[a]) for a, b in edges if states[a] == state]
        if not spans:
            continue
        ax.broken_barh(spans, (0.0, _STRIP), transform=across, facecolors=color, zorder=3)
    mine = [event for event in contacts.events if event.contact == contacts.names[c]]
    struck = [event.t for event in mine if event.kind == "impact"]
    for when in {event.t for event in mine} - set(struck):
        ax.axvline(when, color="#999999", linewidth=0.7, linestyle=":", zorder=1)
    ax.plot(struck, np.ones(len(struck)), "v", transform=across, color=EVENT, markersize=4,
            clip_on=False)  # fmt: skip


def not_drawn(still: list[Curves], scale: dict[str, float]) -> list[str]:
    """Lines that list quantities that are zero or constant throughout, and the residual."""
    from textwrap import wrap

    zero, constant, lines = [], [], []
    for panel, _, values in still:
        worst = float(np.nanmax(np.abs(values))) if values.size else 0.0
        name = panel.title.partition(", world")[0]
        if panel.logarithmic:
            lines.append(f"{panel.title}: at most {worst:.0e}")
        elif panel.kind == "energy" and 0.0 < worst and np.ptp(values) > 0.0:
            lines.append(f"{panel.title}: at most {worst:.1e} J")
        elif worst <= WRITTEN_ROUNDING * scale[panel.kind]:
            zero.append(name)
        else:
            middle = np.median(values, axis=0)
            middle[np.abs(middle) <= WRITTEN_ROUNDING * scale[panel.kind]] = 0.0
            numbers = ", ".join(f"{value:.4g}" for value in middle)
            constant.append(f"{name} ({numbers}) {panel.unit}".strip())
    for what, names in (("constant", constant), ("zero", zero)):
        if names:
            lines = wrap(f"{what} throughout: {'; '.join(names)}", _WRAP) + lines
    return lines


def _decades(values: Array) -> tuple[float, float]:
    """Powers of ten below and above all values."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.1, 10.0
    low, high = np.log10(finite.min()), np.log10(finite.max())
    return float(10.0 ** np.floor(low - 0.5)), float(10.0 ** np.ceil(high + 0.5))


def _widen(ax: Any, values: Array) -> None:
    """Give the axis a height if all curves are constant and equal."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return
    low, high = float(finite.min()), float(finite.max())
    size = max(abs(low), abs(high))
    if high - low <= 1e-9 * size:
        middle, margin = 0.5 * (low + high), 0.1 * size or 1.0
        ax.set_ylim(middle - margin, middle + margin)


BUCKETS = 1500
"""Number of points per curve: between this and twice this, more than the picture has columns."""

MOST_PANELS = 24
"""Maximum number of panels on one page; a scene with more gets a page for each body."""

MOST_PAGES = 24
"""Maximum number of pages of bodies; each takes half a second."""

MOST_MARKS = 400
"""Maximum number of events marked."""


class Plots:
    """Collects samples and plots them, page by page.

    accelerations: function of a block, if accelerations are to be plotted too.
    """

    def __init__(
        self, scene: Scene, layout: SampleLayout, accelerations: Accelerating | None = None
    ) -> None:
        self._scene, self._layout = scene, layout
        self._panels = panels_of(scene, layout, accelerations)
        self._curves = [Envelope(len(panel.labels), BUCKETS) for panel in self._panels]
        self._states = Envelope(len(layout.contacts), BUCKETS)
        self._events: list[ContactEvent] = []
        self._timeline = Timeline()
        self.samples = 0
        """number of samples so far."""

    def add(self, block: SampleBlock) -> None:
        """Add the samples of `block`."""
        t = np.array(self._timeline.follow(block.t))
        for panel, curve in zip(self._panels, self._curves, strict=True):
            curve.add(t, np.array(panel.values(block)))
        if self._layout.contacts and len(block):
            self._states.add(t, np.array(block.contact_state))
            shift = self._timeline.offset
            room = MOST_MARKS - len(self._events)
            self._events += [replace(event, t=event.t + shift) for event in block.events[:room]]
        self.samples += len(block)

    def figures(self) -> dict[str, Any]:
        """Matplotlib figures by page: "" is the first one, the others are named after a body."""
        drawn: list[Curves] = []
        zero: list[Curves] = []
        curves = [curve.curves() for curve in self._curves]
        scale = scales(self._scene, self._panels, [values for _, values in curves])
        for panel, (t, values) in zip(self._panels, curves, strict=True):
            shown = resolved(Curves(panel, t, values), scale[panel.kind])
            if shown is None:
                zero.append(Curves(panel, t, values))
            else:
                drawn.append(shown)
        contacts = None
        if self._layout.contacts:
            contacts = Contacts(*self._states.curves(), self._layout.contacts, self._events)
        if len(drawn) <= MOST_PANELS:
            return {"": page(self._title(), drawn, not_drawn(zero, scale), contacts)}
        notes, bodies = not_drawn(_of(zero, None), scale), self._layout.bodies
        if len(bodies) > MOST_PAGES:
            notes.append(
                f"pages of the first {MOST_PAGES} of {len(bodies)} bodies; the others are in the "
                "bag, and in FILE.npz of --npz"
            )
        pages = {"": page(self._title(), _of(drawn, None), notes, contacts)}
        for body in bodies[:MOST_PAGES]:
            title = f"{self._scene.name}: {body}"
            pages[body] = page(title, _of(drawn, body), not_drawn(_of(zero, body), scale), contacts)
        return pages

    def _title(self) -> str:
        scene = self._scene
        return f"{scene.name}: {scene.description}" if scene.description else scene.name


def _of(curves: list[Curves], body: str | None) -> list[Curves]:
    """The curves of a body; None: of the whole scene."""
    return [each for each in curves if each.panel.body == body]


class PlotSink:
    """Writes the pages as PNG when it is closed, if there were samples.

    path: of the first page; that of a body is next to it, NAME_BODY.png. accelerations: makes the
    function of a block for this scene and layout, if accelerations are to be plotted too. `open`
    and `close` raise SinkError if the pictures cannot be written; MissingExtraError without
    matplotlib, which is imported only at the end.
    """

    def __init__(
        self,
        path: Path,
        accelerations: Callable[[Scene, SampleLayout], Accelerating] | None = None,
    ) -> None:
        if find_spec("matplotlib") is None:
            raise MissingExtraError("matplotlib", "", "a picture of the run")
        self.path = Path(path)
        self._accelerations = accelerations
        self._plots: Plots | None = None

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the panels and the folder. Raises SinkError."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SinkError(f"{self.path}: cannot draw here: {error.strerror}") from None
        of = self._accelerations
        self._plots = Plots(scene, layout, None if of is None else of(scene, layout))

    def write(self, block: SampleBlock) -> None:
        """Add the samples of `block`."""
        if self._plots is not None:
            self._plots.add(block)

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Draw and write the pages. Raises SinkError."""
        plots, self._plots = self._plots, None
        if plots is not None and plots.samples:
            save(plots.figures(), self.path)


def save(figures: dict[str, Any], path: Path) -> None:
    """Write the pages atomically. Raises SinkError."""
    for name, figure in figures.items():
        target = path.with_name(f"{path.stem}_{name}{path.suffix}") if name else path
        draft = target.with_name(f".{target.name}")
        try:
            with draft.open("wb") as file:
                figure.savefig(file, format="png", metadata={"Software": None})
            os.replace(draft, target)
        except OSError as error:
            raise SinkError(f"{target}: cannot be written: {error.strerror}") from None
        finally:
            draft.unlink(missing_ok=True)
