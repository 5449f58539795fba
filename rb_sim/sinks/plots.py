"""Pictures of a run: pose, twist, reactions, energy and residual over time (PNG, matplotlib).

One page; of a scene with many bodies and reactions one page about the whole and one for each body.
Memory is bounded: a long run is drawn as the envelope of its samples, which loses no peak.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.errors import SinkError
from rb_sim.sinks.decimate import Envelope
from rb_sim.sinks.drawing import Contacts, Curves, page, resolved, told
from rb_sim.sinks.panels import Accelerating, panels_of, scales
from rb_sim.sinks.timeline import Timeline

if TYPE_CHECKING:
    from rb_sim.engine.samples import ContactEvent, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

BUCKETS = 1500
"""Points per curve are between this and twice this, more than the picture has columns."""

MOST_PANELS = 24
"""On one page; a scene with more gets a page for each body."""

MOST_MARKS = 400
"""Instants of events that are marked, the first ones."""


class Plots:
    """Collects samples and draws them as figures, page by page.

    accelerations: gives those of a block, which are drawn, too.
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
        """taken so far."""

    def add(self, block: SampleBlock) -> None:
        """Take the samples of `block`."""
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
        """Matplotlib figures by page: "" is the first one, the others are named by a body."""
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
            return {"": page(self._title(), drawn, told(zero), contacts)}
        pages = {"": page(self._title(), _of(drawn, None), told(_of(zero, None)), contacts)}
        for body in self._layout.bodies:
            title = f"{self._scene.name}: {body}"
            pages[body] = page(title, _of(drawn, body), told(_of(zero, body)), contacts)
        return pages

    def _title(self) -> str:
        scene = self._scene
        return f"{scene.name}: {scene.description}" if scene.description else scene.name


def _of(curves: list[Curves], body: str | None) -> list[Curves]:
    """Those of a body, or about the whole."""
    return [each for each in curves if each.panel.body == body]


class PlotSink:
    """Writes the pages as PNG when it is closed, if there was any sample.

    path: of the first page; that of a body is beside it, NAME_BODY.png. accelerations: gives what
    gives those of a block of this scene and layout, which are drawn, too.
    `open` and `close` raise SinkError where the pictures cannot be written.
    """

    def __init__(
        self,
        path: Path,
        accelerations: Callable[[Scene, SampleLayout], Accelerating] | None = None,
    ) -> None:
        self.path = Path(path)
        self._accelerations = accelerations
        self._plots: Plots | None = None

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Choose the panels."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SinkError(f"{self.path}: cannot draw here: {error.strerror}") from None
        of = self._accelerations
        self._plots = Plots(scene, layout, None if of is None else of(scene, layout))

    def write(self, block: SampleBlock) -> None:
        """Take the samples of `block`."""
        if self._plots is not None:
            self._plots.add(block)

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Draw."""
        plots, self._plots = self._plots, None
        if plots is not None and plots.samples:
            save(plots.figures(), self.path)


def save(figures: dict[str, Any], path: Path) -> None:
    """Write the pages, none of them half; raises SinkError."""
    for name, figure in figures.items():
        target = path.with_name(f"{path.stem}_{name}{path.suffix}") if name else path
        draft = target.with_name(f".{target.name}")
        try:
            with draft.open("wb") as file:
                figure.savefig(file, format="png", metadata={"Software": None})
            os.replace(draft, target)
        except OSError as error:
            raise SinkError(f"{target}: cannot write it: {error.strerror}") from None
        finally:
            draft.unlink(missing_ok=True)
