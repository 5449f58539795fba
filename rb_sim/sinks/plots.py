"""One picture of a run: pose, twist, reactions, energy and residual over time (PNG, matplotlib).

Memory is bounded: a long run is drawn as the envelope of its samples, which loses no peak.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.errors import SinkError
from rb_sim.sinks.contact_power import smooth_power
from rb_sim.sinks.decimate import Envelope
from rb_sim.sinks.timeline import Timeline

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, ContactEvent, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

BUCKETS = 1500
"""Points per curve are between this and twice this, more than the picture has columns."""

MOST_BODIES = 6
MOST_REACTIONS = 12
"""Panels beyond would make no readable picture; the title says what is left out."""

LEAST = 1e-18
"""Residuals below are drawn as this."""

_AXES = ("#c8372d", "#2f8f4e", "#2b62c4", "#6b6b6b")
"""Of x, y, z and the scalar part w."""

_ENERGIES = ("#c8372d", "#2b62c4", "#202020")
_DPI = 110
_WIDTH = 13.0
_ROW = 2.2
_TOP, _BOTTOM = 0.8, 0.5
"""[inch]."""


MOST_MARKS = 400
"""Instants of events that are marked, the first ones."""

_STATES = {1.0: ("#e08a1e", "slips"), 2.0: ("#2b62c4", "holds")}
"""Colour and name in the strip of a contact that slips, and that sticks or rolls."""

_IMPACT = "#b0307a"

_STRIP = 0.035
"""Height of the strip, of that of the panel."""


class Panel(NamedTuple):
    """One pair of axes. values: shape (n, number of labels), from a block.

    contact: index of the point of contact whose state is shown below the curves, or None.
    """

    title: str
    unit: str
    labels: tuple[str, ...]
    colors: tuple[str, ...]
    values: Callable[[SampleBlock], Array]
    logarithmic: bool = False
    contact: int | None = None


class Contacts(NamedTuple):
    """What is drawn of contacts: times, shape (n,), states, shape (n, C), and events."""

    t: Array
    states: Array
    names: tuple[str, ...]
    events: list[ContactEvent]


class PlotSink:
    """Writes one PNG when it is closed, if there was any sample.

    `open` and `close` raise SinkError where the picture cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._panels: list[Panel] = []
        self._curves: list[Envelope] = []
        self._title = ""
        self._samples = 0

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Choose the panels."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SinkError(f"{self.path}: cannot draw here: {error.strerror}") from None
        self._panels = [*_body_panels(layout), *_reaction_panels(layout)]
        self._panels += _energy_panels(scene, layout)
        self._layout = layout
        self._states = Envelope(len(layout.contacts), BUCKETS)
        self._events: list[ContactEvent] = []
        self._curves = [Envelope(len(panel.labels), BUCKETS) for panel in self._panels]
        self._timeline = Timeline()
        self._title = _title(scene, layout)
        self._samples = 0

    def write(self, block: SampleBlock) -> None:
        """Take the samples of `block`."""
        t = np.array(self._timeline.follow(block.t))
        for panel, curve in zip(self._panels, self._curves, strict=True):
            curve.add(t, np.array(panel.values(block)))
        if self._layout.contacts and len(block):
            self._states.add(t, np.array(block.contact_state))
            shift = self._timeline.offset
            room = MOST_MARKS - len(self._events)
            self._events += [replace(event, t=event.t + shift) for event in block.events[:room]]
        self._samples += len(block)

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Draw."""
        panels, self._panels = self._panels, []
        if not panels or not self._samples:
            return
        contacts = None
        if self._layout.contacts:
            contacts = Contacts(*self._states.curves(), self._layout.contacts, self._events)
        draft = self.path.with_name(f".{self.path.name}")
        try:
            with draft.open("wb") as file:
                curves = [curve.curves() for curve in self._curves]
                draw(panels, curves, self._title, file, contacts)
            os.replace(draft, self.path)
        except OSError as error:
            draft.unlink(missing_ok=True)
            raise SinkError(f"{self.path}: cannot write it: {error.strerror}") from None


def draw(
    panels: list[Panel],
    curves: list[tuple[Array, Array]],
    title: str,
    file: Any,
    contacts: Contacts | None = None,
) -> None:
    """Draw the panels in two columns, from top left, into `file`, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = (len(panels) + 1) // 2
    height = _ROW * rows + _TOP + _BOTTOM
    figure = Figure(figsize=(_WIDTH, height), dpi=_DPI)
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.012, y=1 - 0.3 * _TOP / height, ha="left", va="top", fontsize=13)
    margins = {"left": 0.06, "right": 0.925, "wspace": 0.37, "hspace": 0.36}
    margins |= {"top": 1 - _TOP / height, "bottom": _BOTTOM / height}
    axes = figure.subplots(rows, 2, sharex=True, squeeze=False, gridspec_kw=margins).ravel()
    for ax, panel, (t, values) in zip(axes, panels, curves, strict=False):
        _draw_panel(ax, panel, t, values)
        if contacts is not None and panel.contact is not None:
            _draw_contact(ax, contacts, panel.contact)
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    for ax in axes[-2:]:
        ax.set_xlabel("time [s]")
    figure.savefig(file, format="png", metadata={"Software": None})


def _draw_panel(ax: Any, panel: Panel, t: Array, values: Array) -> None:
    for k, (label, color) in enumerate(zip(panel.labels, panel.colors, strict=True)):
        style = "--" if label.startswith("work") else "-"
        ax.plot(t, values[:, k], style, color=color, label=label, linewidth=1.2)
    ax.set_title(panel.title, loc="left", fontsize=10, fontweight="bold")
    ax.set_ylabel(f"[{panel.unit}]" if panel.unit else "")
    ax.grid(color="#dddddd", linewidth=0.6)
    ax.margins(x=0)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize=8)
    if panel.logarithmic:
        ax.set_yscale("log")
        ax.set_ylim(*_decades(values))
    else:
        _widen(ax, values)
        ax.ticklabel_format(axis="y", scilimits=(-3, 4), useOffset=False)
    if len(panel.labels) > 1:
        ax.legend(
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
            frameon=False,
            fontsize=9,
            handlelength=1.2,
        )


def _draw_contact(ax: Any, contacts: Contacts, c: int) -> None:
    """A strip with the state below the curves; changes as dotted lines, impacts as triangles."""
    t, states = contacts.t, contacts.states[:, c]
    borders = np.concatenate([[0], np.flatnonzero(np.diff(states)) + 1, [len(t) - 1]])
    across = ax.get_xaxis_transform()
    labels = []
    for state, (color, label) in _STATES.items():
        edges = zip(borders, borders[1:], strict=False)
        spans = [(t[a], t[b] - t[a]) for a, b in edges if states[a] == state]
        ax.broken_barh(spans, (0.0, _STRIP), transform=across, facecolors=color, zorder=3)
        labels += [(0.08 * (len(labels)), label, color)] if spans else []
    mine = [event for event in contacts.events if event.contact == contacts.names[c]]
    struck = [event.t for event in mine if event.kind == "impact"]
    for when in {event.t for event in mine} - set(struck):
        ax.axvline(when, color="#999999", linewidth=0.7, linestyle=":", zorder=1)
    ax.plot(struck, np.ones(len(struck)), "v", transform=across, color=_IMPACT, markersize=4)
    labels += [(0.94, "impact", _IMPACT)] if struck else []
    for height, label, color in labels:
        ax.text(1.01, height, label, transform=ax.transAxes, color=color, fontsize=7)


def _decades(values: Array) -> tuple[float, float]:
    """Powers of ten below and above all values."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.1, 10.0
    low, high = np.log10(finite.min()), np.log10(finite.max())
    return float(10.0 ** np.floor(low - 0.5)), float(10.0 ** np.ceil(high + 0.5))


def _widen(ax: Any, values: Array) -> None:
    """Keep curves that are constant to round-off from being blown up to the full height."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return
    low, high = float(finite.min()), float(finite.max())
    size = max(abs(low), abs(high))
    if high - low <= 1e-9 * size:
        middle, margin = 0.5 * (low + high), 0.1 * size or 1.0
        ax.set_ylim(middle - margin, middle + margin)


def _title(scene: Scene, layout: SampleLayout) -> str:
    title = f"{scene.name}: {scene.description}" if scene.description else scene.name
    left_out = []
    for names, most, what in (
        (layout.bodies, MOST_BODIES, "bodies"),
        (layout.reactions, MOST_REACTIONS, "reactions"),
    ):
        if len(names) > most:
            left_out.append(f"first {most} of {len(names)} {what}")
    return f"{title}  ({', '.join(left_out)})" if left_out else title


def _body_panels(layout: SampleLayout) -> Iterator[Panel]:
    for i, name in enumerate(layout.bodies[:MOST_BODIES]):
        yield _xyz(f"{name}: position of the centre of mass, world", "m", "position", i)
        yield Panel(
            f"{name}: orientation, quaternion body to world",
            "",
            tuple("xyzw"),
            _AXES,
            _column("orientation", i),
        )
        yield _xyz(f"{name}: velocity of the centre of mass, world", "m/s", "linear_velocity", i)
        yield _xyz(f"{name}: angular velocity, body axes", "rad/s", "angular_velocity", i)


def _reaction_panels(layout: SampleLayout) -> Iterator[Panel]:
    for k, name in enumerate(layout.reactions[:MOST_REACTIONS]):
        body = layout.reaction_bodies[k]
        c = layout.contacts.index(name) if name in layout.contacts else None
        title = f"{name}: reaction force on {body}, world axes"
        yield _xyz(title, "N", "reaction_force", k)._replace(contact=c)
        yield _xyz(f"{name}: reaction torque about its anchor", "N m", "reaction_torque", k)


def _energy_panels(scene: Scene, layout: SampleLayout) -> Iterator[Panel]:
    labels = ("kinetic", "potential", "total")
    yield Panel("energy", "J", labels, _ENERGIES, _energies)
    labels, colors = ("E - E(0)", "work"), (_ENERGIES[2], "#e08a1e")
    title = "change of total energy, and work of forces without potential"
    yield Panel(title, "J", labels, colors, _Balance(scene, layout))
    yield Panel("power of forces without potential", "W", ("power",), (_AXES[3],), _power)
    title = "worst violation of a constraint, relative to the scene's scale"
    yield Panel(title, "", ("residual",), (_AXES[3],), _residual, logarithmic=True)


class _Balance:
    """Change of energy since the first sample, and the work done since.

    That of contacts is as sampled, the rest by the trapezoidal rule.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._scene, self._layout = scene, layout
        self._first_contact_work = 0.0
        self._first: float | None = None
        self._last: tuple[float, float] | None = None
        self._work = 0.0

    def __call__(self, block: SampleBlock) -> Array:
        if not len(block):
            return np.empty((0, 2))
        if self._first is None:
            self._first = float(block.energy[0])
            self._first_contact_work = float(block.contact_work[0])
        power = smooth_power(block, self._scene, self._layout)
        t0, p0 = self._last or (float(block.t[0]), float(power[0]))
        steps = np.maximum(0.0, np.diff(block.t, prepend=t0))  # a reset does no work
        means = 0.5 * (power + np.concatenate([[p0], power[:-1]]))
        work = self._work + np.cumsum(steps * means)
        self._last, self._work = (float(block.t[-1]), float(power[-1])), float(work[-1])
        contacts = block.contact_work - self._first_contact_work
        return np.c_[block.energy - self._first, work + contacts]


def _xyz(title: str, unit: str, field: str, index: int) -> Panel:
    return Panel(title, unit, tuple("xyz"), _AXES[:3], _column(field, index))


def _column(field: str, index: int) -> Callable[[SampleBlock], Array]:
    return lambda block: getattr(block, field)[:, index]


def _energies(block: SampleBlock) -> Array:
    return np.c_[block.kinetic_energy, block.potential_energy, block.energy]


def _power(block: SampleBlock) -> Array:
    return block.power[:, None]


def _residual(block: SampleBlock) -> Array:
    return np.maximum(block.residual, LEAST)[:, None]
