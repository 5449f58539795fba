# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a recording shows: the bodies in 3D with their trails and arrows, and plots beside them.

| entity                  | what                                                              |
|-------------------------|-------------------------------------------------------------------|
| world/BODY              | frame of the body: its shape (edges of a box of the same inertia  |
|                         | for a body without one) and axes                                  |
| world/trail/BODY        | way of the centre of mass so far, piece by piece                  |
| world/velocity/BODY     | where the velocity of the centre of mass is drawn                 |
| world/reaction/NAME     | where the force on the body is drawn: on its line of action       |
| world/command/BODY      | where the commanded force is drawn: at the body's origin          |
| .../arrow               | the vector itself, in m/s or N, and how long it is drawn          |
| world/support/NAME      | surface of a contact, a plane or a rail in the world              |
| world/BODY/support/NAME | surface of a contact on BODY; pivot or bearing about which it turns |
| world/contact/NAME      | point of contact, while it is closed: orange slips, blue holds    |
| plots/contacts/NAME     | its state: 0 open, 1 slip, 2 stick or roll                        |
| events                  | what happened to the contacts, as text                            |
| plots/BODY/..., plots/reactions/NAME/..., plots/command/BODY/..., plots/joints/NAME,         |
| plots/energy, plots/residual: numbers                                                       |

The timeline is `sim_time` [s]. Imported only when a recording is opened.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from rb_sim.base.palette import SLIPPING, STICKING, rgb
from rb_sim.io.contact_power import contacts_of
from rb_sim.io.extent import half_box
from rb_sim.io.panels import Panel, panels_of
from rb_sim.io.rerun.arrow_scales import (
    Extent,
    Lengths,
    Resolved,
    clear_of,
    drawn_reactions,
    scales_of,
)
from rb_sim.io.rerun.static import Static, entity_path, has_plane, spacing
from rb_sim.io.rerun.viewer import MOTION
from rb_sim.io.sink import Timeline, event_text
from rb_sim.mechanics.samples import centers_of_mass, origins
from rb_sim.numerics.rotations import rotate

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from rb_sim.io.rerun.arrow_scales import Scales
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# What a recording says in words: its legend, events, the summary.
#
# Imported only when a recording is opened.


def about(scene: Scene, layout: SampleLayout, scales: Scales, *, forces: bool) -> str:
    """What is drawn, and at which scale. forces: whether reactions are."""
    lines = [f"## {scene.name}", scene.description, ""]
    lines += [f"**velocity** (light blue): 1 m of arrow is {1 / scales.per_speed:g} m/s  "]
    if forces:
        newton = f"{1 / scales.per_newton:g} N"
        lines += [f"**reaction** on the body (orange): 1 m of arrow is {newton}  "]
    if layout.commanded:
        lines += ["**commanded force** (pink): same scale as the reactions  "]
    if layout.contacts:
        lines += ["**contact** points of closed contacts: orange slips, blue sticks or rolls  "]
    if scales.origin.any():
        lines += [f"**positions** in the 3D view are relative to {scales.origin.tolist()} m  "]
    lines += ["**trail** of the centre of mass so far (grey); body axes x red, y green, z blue"]
    return "\n".join(lines)


def markdown(text: str) -> Any:
    """The text as a document of the recording."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def summary_text(summary: dict[str, Any]) -> str:
    """The numbers of the summary as a list; what is nested as JSON."""
    rows = [f"- {key}: {_short(value)}" for key, value in summary.items()]
    return "\n\n**Summary**\n" + "\n".join(rows)


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return value if isinstance(value, str) else json.dumps(value, default=str)


# The way of a point in pieces, so that a viewer can show what lies behind it and no more.


PIECES = 2048
"""After so many the pieces become twice as long, so that a long run stays small."""

SHORTEST = 0.002
"""Of the size of the scene; first length of a piece."""


class Trail:
    """Cuts the way into pieces of at least a certain length. size: of the scene [m]."""

    def __init__(self, size: float) -> None:
        self._shortest = SHORTEST * size
        self._piece: list[list[float]] = []
        self._length = 0.0
        self._made = 0

    def add(self, position: Array) -> tuple[NDArray[np.intp], list[list[list[float]]]]:
        """The next positions, shape (n, 3); (rows at which a piece ended, its points)."""
        rows, pieces = [], []
        for row, point in enumerate(position.tolist()):
            if self._piece:
                self._length += float(np.linalg.norm(np.subtract(point, self._piece[-1])))
            self._piece.append(point)
            if self._length > self._shortest:
                rows.append(row)
                pieces.append(self._piece)
                self._piece, self._length = [point], 0.0
                self._made += 1
                if self._made % PIECES == 0:
                    self._shortest *= 2.0
        return np.array(rows, dtype=np.intp), pieces


# How the Rerun viewer lays a recording out: 3D and text on the left, plots on the right.


_EYE = np.array([0.48, -0.72, 0.45])
"""From the centre of the scene to the eye, in sizes of the scene."""


class Shown(NamedTuple):
    """What the viewer is to lay out."""

    layout: SampleLayout
    panels: list[Panel]
    plane: bool
    """whether a plane of the world is drawn."""
    center: Array
    """of what the 3D view is to show [m]."""
    size: float
    zero: frozenset[str] = frozenset()
    """plots of what is zero throughout, which have no panel."""

    def plots(self, panels: Iterable[Panel]) -> list[Any]:
        """Views of these panels, but of those of zeros."""
        return [
            _plot(
                f"plots/{panel.entity}",
                f"log10 of the {panel.entity}" if panel.logarithmic else panel.heading,
            )
            for panel in panels
            if f"plots/{panel.entity}" not in self.zero
        ]


def motion_blueprint(shown: Shown) -> Any:
    """The 3D view alone, without panels, for pictures of the motion."""
    return rrb.Blueprint(
        _spatial_view(shown, titled=False),
        rrb.TopPanel(state="hidden"),
        rrb.TimePanel(state="hidden", timeline="sim_time", play_state="paused"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def blueprint(shown: Shown) -> Any:
    """The layout."""
    layout = shown.layout
    about = rrb.TextDocumentView(origin="/about", name="about")
    if layout.contacts:
        log = rrb.TextLogView(origin="/events", name="contact events")
        about = rrb.Horizontal(about, log)
    left = rrb.Vertical(_spatial_view(shown), about, row_shares=[5, 2])
    energy = shown.plots(panel for panel in shown.panels if panel.body is None)
    columns = _forces(shown)
    forces = [rrb.Vertical(_tabs(columns), row_shares=[1])] if columns else []
    states = [_plot("plots/contacts", "contacts: 0 open, 1 slip, 2 stick")]
    energy = (states if layout.contacts else []) + energy
    right = rrb.Vertical(*forces, *energy, row_shares=[2] * len(forces) + [1] * len(energy))
    return rrb.Blueprint(
        rrb.Horizontal(left, _bodies(shown), right, column_shares=[5, 3, 3]),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _spatial_view(shown: Shown, titled: bool = True) -> Any:
    layout, center, size = shown.layout, shown.center, shown.size
    grid: Any = rrb.LineGrid3D(
        visible=not shown.plane, spacing=spacing(size), color=[255, 255, 255, 40]
    )
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=center + size * _EYE,
        look_target=center,
        eye_up=(0, 0, 1),
    )
    so_far = rrb.VisibleTimeRanges(
        timeline="sim_time",
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        origin="/world",
        name=MOTION,
        titlebar=titled,
        eye_controls=eye,
        background=[22, 24, 30],
        overrides={entity_path(f"/world/trail/{name}"): so_far for name in layout.bodies},
        line_grid=grid,
    )


ACTING = ("reactions/", "command/")
"""How the entities of what acts on a body begin."""


def _bodies(shown: Shown) -> Any:
    """The motion of each body and of the joints that hold it, behind tabs if there are several."""
    columns = []
    for name in shown.layout.bodies:
        mine = [p for p in shown.panels if p.body == name and not p.entity.startswith(ACTING)]
        mine.sort(key=lambda panel: not panel.entity.startswith("joints/"))
        columns.append(rrb.Vertical(*shown.plots(mine), name=name))
    return _tabs(columns)


def _forces(shown: Shown) -> list[Any]:
    """Force and torque of each reaction, and of each command."""
    groups: dict[str, list[Panel]] = {}
    for panel in shown.panels:
        if panel.entity.startswith(ACTING):
            groups.setdefault(panel.entity.rpartition("/")[0], []).append(panel)
    views = [
        (name.removeprefix("reactions/").replace("command/", "command ", 1), shown.plots(panels))
        for name, panels in groups.items()
    ]
    return [rrb.Vertical(*plots, name=name) for name, plots in views if plots]


def _tabs(columns: list[Any]) -> Any:
    """Behind tabs if there are several."""
    return columns[0] if len(columns) == 1 else rrb.Tabs(*columns)


def _plot(entity: str, name: str) -> Any:
    return rrb.TimeSeriesView(
        origin=entity_path(f"/{entity}"), name=name, plot_legend=rrb.Corner2D.RightTop
    )


TIMELINE = "sim_time"

NOT_SHOWN = ("balance", "power")
"""Panels of plots.png that a recording has not."""

STATES = np.array([(120, 120, 120), rgb(SLIPPING), rgb(STICKING)], dtype=np.uint8)
"""Of a contact that is open, slips, sticks or rolls."""


class View:
    """Sends a scene's samples to a recording. first: samples that give the scale of the arrows.

    motion_only: lay out nothing but the 3D view. Plots draw what is constant to round-off as
    constant, so that no axis zooms into it.
    """

    def __init__(
        self,
        recording: Any,
        scene: Scene,
        layout: SampleLayout,
        first: SampleBlock,
        motion_only: bool = False,
    ) -> None:
        self._recording = recording
        self._scene, self._layout = scene, layout
        self._center_of_mass = centers_of_mass(scene.bodies, layout.bodies)
        self._scales = scales_of(scene, layout, first)
        self._timeline = Timeline()
        self._trails = [Trail(self._scales.size) for _ in layout.bodies]
        self._drawn = drawn_reactions(layout)
        self._extent = Extent(scene, layout)
        self._forces_seen, self._speeds_seen = Lengths(), Lengths()
        self._resolved = Resolved(self._scales.size)
        self._blueprint = motion_blueprint if motion_only else blueprint
        panels = panels_of(scene, layout)
        self._panels = [panel for panel in panels if panel.entity not in NOT_SHOWN]
        self._most: dict[str, tuple[str, float]] = {}
        """by plot its kind, and the largest number so far."""
        self._static = Static(recording, scene, layout, self._scales, first)
        self._static.log(self._panels)
        self._log_scales()
        self._log("about", markdown(self._about()))
        center, size = self._scales.center, self._scales.size
        self._shown = Shown(layout, self._panels, has_plane(scene), center, size)
        recording.send_blueprint(self._blueprint(self._shown))

    def send(self, block: SampleBlock) -> None:
        """The next samples."""
        nanoseconds = np.rint(self._timeline.follow(block.t) * 1e9)  # rerun itself would cut off
        times = nanoseconds.astype("timedelta64[ns]")
        self._times = times
        here = self._from_local_origin(block)
        self._extent.add(here)
        self._speeds_seen.add(block.linear_velocity)
        forces = np.concatenate([block.reaction_force, block.command[..., :3]], axis=1)
        self._forces_seen.add(forces)
        self._index = [rr.TimeColumn(TIMELINE, duration=times)]
        self._send_motion(here)
        self._send_forces(here)
        self._send_plots(block)
        self._send_contacts(here)
        self._send_strings(here)

    def finish(self, summary: dict[str, Any] | None) -> None:
        """Camera and arrows at the scale of the whole motion, the summary beside the words."""
        center, size = self._extent.center_and_size()
        least = self._resolved.least
        zero = frozenset(
            entity for entity, (kind, most) in self._most.items() if most <= least(kind)
        )
        shown = self._shown._replace(center=center, size=size, zero=zero)
        self._recording.send_blueprint(self._blueprint(shown))
        self._static.log_supports(center, size)
        length = max(self._scales.length, size / 8.0)
        self._scales = self._scales._replace(
            per_newton=self._forces_seen.per_metre(length),
            per_speed=self._speeds_seen.per_metre(length),
        )
        self._log_scales()
        ending = "" if summary is None else summary_text(summary)
        self._log("about", markdown(self._about() + ending))

    def _from_local_origin(self, block: SampleBlock) -> SampleBlock:
        """The samples with their places from the local origin of the 3D view."""
        origin = self._scales.origin
        if not origin.any():
            return block
        return replace(block, position=block.position - origin, anchor=block.anchor - origin)

    def _log(self, entity: str, archetype: Any) -> None:
        self._recording.log(entity_path(entity), archetype, static=True)

    def _send_motion(self, block: SampleBlock) -> None:
        motion = origins(block, self._center_of_mass)
        for i, name in enumerate(self._layout.bodies):
            pose = rr.Transform3D.columns(
                translation=motion.position[:, i], quaternion=block.orientation[:, i]
            )
            self._columns(f"world/{name}", pose)
            speed = block.linear_velocity[:, i]
            start = self._clear_of(block, i, block.position[:, i], speed)
            self._arrows(f"world/velocity/{name}", start, speed)
            self._send_trail(i, block.position[:, i])
        for i, name in enumerate(self._layout.commanded):
            origin = motion.position[:, self._layout.bodies.index(name)]
            self._arrows(f"world/command/{name}", origin, block.command[:, i, :3])

    def _send_forces(self, block: SampleBlock) -> None:
        for k in self._drawn:
            entity = f"world/reaction/{self._layout.reactions[k]}"
            arrow = block.reaction_force[:, k]
            body = self._layout.bodies.index(self._layout.reaction_bodies[k])
            self._arrows(entity, self._clear_of(block, body, block.anchor[:, k], arrow), arrow)

    def _clear_of(self, block: SampleBlock, body: int, point: Array, arrow: Array) -> Array:
        """The start of an arrow that would begin at `point`, outside of the body."""
        shape = self._scene.bodies[self._layout.bodies[body]].shape
        if shape is None:
            return point
        q = block.orientation[:, body]
        from_com = np.array(shape.center_B) - self._center_of_mass[body]
        center = block.position[:, body] + rotate(q, from_com)
        return clear_of(half_box(shape), center, q, point, arrow)

    def _send_plots(self, block: SampleBlock) -> None:
        for panel in self._panels:
            entity, values = f"plots/{panel.entity}", panel.values(block)
            if panel.logarithmic:
                self._note_most(panel.kind, entity, values)
                self._plot(entity, np.log10(values))
            else:
                self._show(panel.kind, entity, values)

    def _show(self, kind: str, entity: str, values: Array) -> None:
        """Numbers without their round-off."""
        if len(values):
            self._note_most(kind, entity, values)
            self._plot(entity, self._resolved(kind, entity, values))

    def _note_most(self, kind: str, entity: str, values: Array) -> None:
        """What is not finite is to be seen."""
        most = np.abs(np.where(np.isfinite(values), values, np.inf)).max(initial=0.0)
        self._most[entity] = kind, max(self._most.get(entity, (kind, 0.0))[1], float(most))

    def _send_contacts(self, block: SampleBlock) -> None:
        """State, point where closed, and events."""
        for c, name in enumerate(self._layout.contacts):
            state = block.contact_state[:, c]
            self._plot(f"plots/contacts/{name}", state[:, None])
            closed = state > 0
            points = block.anchor[closed, self._layout.reactions.index(name)]
            columns = rr.Points3D.columns(
                positions=points, colors=STATES[state[closed].astype(int)]
            ).partition(closed.astype(int))
            self._columns(f"world/contact/{name}", columns)
        if block.events:
            times = np.array([event.t for event in block.events]) + self._timeline.offset
            index = rr.TimeColumn(TIMELINE, duration=np.rint(times * 1e9).astype("timedelta64[ns]"))
            texts = [event_text(event) for event in block.events]
            self._recording.send_columns("events", [index], columns=rr.TextLog.columns(text=texts))

    def _send_strings(self, block: SampleBlock) -> None:
        """Each string as a line between its ends."""
        for name, spec in contacts_of(self._scene).items():
            if spec.surface.type == "string":
                ends = [
                    self._carried(block, spec.body, spec.surface.point_B),
                    self._carried(block, spec.parent, spec.surface.point_A),
                ]
                columns = rr.LineStrips3D.columns(strips=list(np.stack(ends, axis=1)))
                self._columns(f"world/string/{name}", columns)

    def _carried(self, block: SampleBlock, body: str | None, point: Any) -> Array:
        """Where a point of a body, from its origin, or of the world is [m], (n, 3)."""
        if body is None:
            return np.tile(np.array(point, float) - self._scales.origin, (len(block), 1))
        i = self._layout.bodies.index(body)
        arm = np.array(point) - self._center_of_mass[i]
        return block.position[:, i] + rotate(block.orientation[:, i], arm)

    def _send_trail(self, i: int, position: Array) -> None:
        """The pieces of way that were finished, each at its end's time."""
        rows, pieces = self._trails[i].add(position)
        if not len(rows):
            return
        index = [rr.TimeColumn(TIMELINE, duration=self._times[rows])]
        columns = rr.LineStrips3D.columns(strips=pieces)
        trail = entity_path(f"world/trail/{self._layout.bodies[i]}")
        self._recording.send_columns(trail, index, columns)

    def _columns(self, entity: str, columns: Any) -> None:
        self._recording.send_columns(entity_path(entity), self._index, columns=columns)

    def _arrows(self, entity: str, points: Array, vectors: Array) -> None:
        """Vectors in their own unit; how long a unit is drawn is known at the end of the run.

        Place and scale belong to two entities, since the viewer takes a transform as a whole."""
        self._columns(entity, rr.Transform3D.columns(translation=points))
        self._columns(f"{entity}/arrow", rr.Arrows3D.columns(vectors=vectors))

    def _log_scales(self) -> None:
        """How long arrows are drawn: one scale for forces and one for velocities."""
        forces = [f"world/reaction/{self._layout.reactions[k]}" for k in self._drawn]
        forces += [f"world/command/{name}" for name in self._layout.commanded]
        speeds = [f"world/velocity/{name}" for name in self._layout.bodies]
        for entities, scale in (
            (forces, self._scales.per_newton),
            (speeds, self._scales.per_speed),
        ):
            for entity in entities:
                self._log(f"{entity}/arrow", rr.Transform3D(scale=scale))

    def _plot(self, entity: str, values: Array) -> None:
        rows, width = values.shape
        columns = rr.Scalars.columns(scalars=values.ravel()).partition(np.full(rows, width))
        self._columns(entity, columns)

    def _about(self) -> str:
        return about(self._scene, self._layout, self._scales, forces=bool(self._drawn))
