# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contents of a recording: the bodies in 3D with trails and arrows, and plots.

| entity                  | content                                                           |
|-------------------------|-------------------------------------------------------------------|
| world/BODY              | body frame: its shape (without one edges of the box with the same |
|                         | inertia) and axes                                                 |
| world/trail/BODY        | path of the centre of mass so far, in pieces                      |
| world/velocity/BODY     | start of the velocity arrow of the centre of mass                 |
| world/reaction/NAME     | start of the force arrow, on the line of action of the reaction   |
| world/command/BODY      | start of the commanded force arrow, at the body's origin          |
| .../arrow               | the vector itself [m/s or N], and its scale                       |
| world/support/NAME/...  | what the constraint or effect NAME has in the world: planes,      |
|                         | lines, solids, joints, and links (rods, springs and strings);     |
|                         | the ground                                                        |
| world/BODY/support/NAME/... | what it has on BODY                                           |
| world/contact/NAME      | contact point while closed: orange slips, blue sticks or rolls    |
| plots/contacts/NAME     | its state: 0 open, 1 slip, 2 stick or roll                        |
| events                  | contact events as text                                            |
| plots/BODY/..., plots/reactions/NAME/..., plots/command/BODY/..., plots/joints/NAME,         |
| plots/energy, plots/residual: values                                                        |

The timeline is `sim_time` [s]. Imported only when a recording is opened.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from rb_sim.base.palette import SLIPPING, STICKING, rgb
from rb_sim.io.drawn_supports import Sight
from rb_sim.io.panels import Panel, panels_of
from rb_sim.io.rerun.arrow_scales import (
    Extent,
    Lengths,
    Resolved,
    clear_of,
    drawn_reactions,
    scales_of,
)
from rb_sim.io.rerun.static import Static, entity_path
from rb_sim.io.rerun.viewer import MOTION
from rb_sim.io.sink import Timeline, event_text
from rb_sim.mechanics.samples import centers_of_mass, origins
from rb_sim.numerics.rotations import rotate
from rb_sim.scene.extent import half_box

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from rb_sim.io.rerun.arrow_scales import Scales
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# Texts of a recording: legend, events, summary.
#
# Imported only when a recording is opened.


def about(scene: Scene, layout: SampleLayout, scales: Scales, *, forces: bool) -> str:
    """Legend of the 3D view with the scales of the arrows. forces: whether reactions are drawn."""
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
    """The text as a Rerun document."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


SUMMARY = {
    "method": "method",
    "step": "step [s]",
    "tolerance": "tolerance",
    "simulated": "simulated [s]",
    "samples": "samples",
    "steps": "steps",
    "global_error": "global error, of the motion",
    "energy": "energy error [J]",
    "worst_residual": "constraint violation, relative",
    "outcome": "outcome",
}
"""Entries of the summary that a recording shows, with their names and units."""


def summary_text(summary: dict[str, Any]) -> str:
    """What the run is and how accurate, as a list, and its warnings."""
    rows = [f"- {name}: {_short(key, summary[key])}" for key, name in SUMMARY.items()
            if summary.get(key) is not None]  # fmt: skip
    rows += [f"- warning: {warning}" for warning in summary.get("warnings", ())]
    return "\n\n**Summary**\n" + "\n".join(rows)


def _short(key: str, value: Any) -> str:
    part = {"global_error": "relative", "energy": "error"}.get(key)
    if part is not None and isinstance(value, dict):
        value = value[part]
    return f"{value:.3g}" if isinstance(value, float) else str(value)


# Path of a point in pieces, so that a viewer can show only its past.


PIECES = 2048
"""Number of pieces after which their length doubles, to bound a long run."""

SHORTEST = 0.002
"""First minimum length of a piece, relative to the scene's size."""


class Trail:
    """Cuts a path into pieces of a minimum length. size: of the scene [m]."""

    def __init__(self, size: float) -> None:
        self._shortest = SHORTEST * size
        self._piece: list[list[float]] = []
        self._length = 0.0
        self._made = 0

    def add(self, position: Array) -> tuple[NDArray[np.intp], list[list[list[float]]]]:
        """Append positions, shape (n, 3); returns (rows at which a piece ended, its points)."""
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


# Blueprint (layout) of the Rerun viewer: 3D and text on the left, plots on the right.


_EYE = np.array([0.48, -0.72, 0.45])
"""Vector from the centre of the scene to the camera, relative to the scene's size."""


class Shown(NamedTuple):
    """Contents of the layout."""

    layout: SampleLayout
    panels: list[Panel]
    center: Array
    """centre of the 3D view, relative to the local origin [m]."""
    size: float
    zero: frozenset[str] = frozenset()
    """plots that are zero throughout and have no panel."""

    def plots(self, panels: Iterable[Panel]) -> list[Any]:
        """Views of these panels, without those that are zero throughout."""
        return [
            _plot(
                f"plots/{panel.entity}",
                f"log10 of the {panel.entity}" if panel.logarithmic else panel.heading,
            )
            for panel in panels
            if f"plots/{panel.entity}" not in self.zero
        ]


def motion_blueprint(shown: Shown) -> Any:
    """Layout with only the 3D view, for pictures of the motion."""
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
    """The full layout."""
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
    grid: Any = rrb.LineGrid3D(visible=False)  # the ground is one of the supports
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
"""Prefixes of the entities of reactions and commands."""


def _bodies(shown: Shown) -> Any:
    """Motion of each body and its joints, in tabs if there are several."""
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
    """The columns in tabs if there are several."""
    return columns[0] if len(columns) == 1 else rrb.Tabs(*columns)


def _plot(entity: str, name: str) -> Any:
    return rrb.TimeSeriesView(
        origin=entity_path(f"/{entity}"), name=name, plot_legend=rrb.Corner2D.RightTop
    )


TIMELINE = "sim_time"

NOT_SHOWN = ("balance", "power")
"""Panels of plots.png that a recording does not have."""

STATES = np.array([(120, 120, 120), rgb(SLIPPING), rgb(STICKING)], dtype=np.uint8)
"""Colour of a contact: open, slipping, sticking or rolling."""


class View:
    """Sends a scene's samples to a recording.

    first: samples that determine the scale of the arrows. motion_only: show only the 3D view.
    Values that are constant to rounding are plotted as constant, since axes would scale to the
    rounding.
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
        """kind and largest value so far of each plot."""
        self._first_attitude: dict[str, Array] = {}
        here = self._from_local_origin(first)
        self._extent.add(here)
        self._static = Static(recording, scene, layout, self._scales, here)
        self._static.log(self._panels)
        self._log_scales()
        self._log("about", markdown(self._about()))
        center, size = self._scales.center, self._scales.size
        self._static.log_supports(Sight(center, size, self._extent.lowest))
        self._shown = Shown(layout, self._panels, center, size)
        recording.send_blueprint(self._blueprint(self._shown))

    def send(self, block: SampleBlock) -> None:
        """Send samples."""
        nanoseconds = np.rint(self._timeline.follow(block.t) * 1e9)  # rerun itself would truncate
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
        self._send_links(here)

    def finish(self, summary: dict[str, Any] | None) -> None:
        """Set camera and arrow scales for the whole motion, and add the summary to the legend."""
        center, size = self._extent.center_and_size()
        least = self._resolved.least
        zero = frozenset(
            entity for entity, (kind, most) in self._most.items() if most <= least(kind)
        )
        shown = self._shown._replace(center=center, size=size, zero=zero)
        self._recording.send_blueprint(self._blueprint(shown))
        self._static.log_supports(Sight(center, size, self._extent.lowest))
        length = max(self._scales.length, size / 8.0)
        self._scales = self._scales._replace(
            per_newton=self._forces_seen.per_metre(length),
            per_speed=self._speeds_seen.per_metre(length),
        )
        self._log_scales()
        ending = "" if summary is None else summary_text(summary)
        self._log("about", markdown(self._about() + ending))

    def _from_local_origin(self, block: SampleBlock) -> SampleBlock:
        """The samples with positions relative to the local origin of the 3D view."""
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
        """Start of an arrow from `point`, moved outside of the body."""
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
        """Plot values without their rounding."""
        if len(values):
            self._note_most(kind, entity, values)
            self._plot(entity, self._resolved(kind, entity, values))

    def _note_most(self, kind: str, entity: str, values: Array) -> None:
        """Update the largest value of a plot; values that are not finite count as infinite.

        Of quaternions the change counts: the angles show how a body is turned that does not turn.
        """
        if kind == "attitude":
            values = values - self._first_attitude.setdefault(entity, values[0])
        most = np.abs(np.where(np.isfinite(values), values, np.inf)).max(initial=0.0)
        self._most[entity] = kind, max(self._most.get(entity, (kind, 0.0))[1], float(most))

    def _send_contacts(self, block: SampleBlock) -> None:
        """Send state, closed contact points, and events."""
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

    def _send_links(self, block: SampleBlock) -> None:
        """Send each rod, spring and string as a line between its ends."""
        for entity, link in self._static.links.items():
            ends = [self._carried(block, link[end]) for end in ("from", "to")]
            columns = rr.LineStrips3D.columns(strips=list(np.stack(ends, axis=1)))
            self._columns(entity, columns)

    def _carried(self, block: SampleBlock, end: dict[str, Any]) -> Array:
        """Positions (n, 3) [m] of an end of a link."""
        i, point = end["on"], np.array(end["point"])
        if i < 0:
            return np.tile(point, (len(block), 1))
        return block.position[:, i] + rotate(block.orientation[:, i], point)

    def _send_trail(self, i: int, position: Array) -> None:
        """Send the finished pieces of a path, each at the time of its end."""
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
        """Send vectors in their own unit; their scale is set at the end of the run.

        Start point and scale are two entities, since the viewer takes a transform as a whole."""
        self._columns(entity, rr.Transform3D.columns(translation=points))
        self._columns(f"{entity}/arrow", rr.Arrows3D.columns(vectors=vectors))

    def _log_scales(self) -> None:
        """Log the scales of the arrows: one for forces and one for velocities."""
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
