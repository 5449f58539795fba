# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Plots of two motions and their differences, as a picture and as a Rerun recording."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from rb_sim.bags.alignment import Interpolated, stretches
from rb_sim.bags.compare import CALENDAR, UNITS, Differences
from rb_sim.bags.info import after_gaps, linear
from rb_sim.bags.tracks import ROUNDING, Track, Tracks
from rb_sim.bags.transforms import is_static
from rb_sim.base.errors import MissingExtraError
from rb_sim.base.palette import CYCLE, GRID, MOTIONS, TEXT, rgb
from rb_sim.base.rounding import NEGLIGIBLE
from rb_sim.io.panels import LEAST_DRAWN
from rb_sim.io.rerun.arrow_scales import local_origin
from rb_sim.io.rerun.viewer import MOTION
from rb_sim.numerics.rotations import other_triple, roll_pitch_yaw, without_jumps

# Picture: two motions over time in the same panels, with their differences below.


CURVE_POINTS = 4000
MOST_BODIES = 3
"""Maximum number of bodies whose motion is plotted: those that differ most."""


FLIP = 90.0
"""[degrees]: larger steps between samples break the curve; roll and yaw jump at a pitch of 90."""

WRAP = 130
"""Characters per line of the title."""


class Overlaid(NamedTuple):
    """A panel with one component of A and of B."""

    label: str
    a: tuple[np.ndarray, np.ndarray]
    """times and values, with a NaN at each break of the curve."""
    b: tuple[np.ndarray, np.ndarray]
    size: float
    """reference magnitude for `moves`."""

    @property
    def moves(self) -> bool:
        """Whether A or B visibly changes in this panel."""
        return any(
            np.nanmax(y) - np.nanmin(y) > NEGLIGIBLE * self.size for _, y in (self.a, self.b)
        )


def picture(found: Differences, a: Tracks, b: Tracks, path: Path) -> None:
    """Write a picture of A and B (x, y, z; roll, pitch, yaw), with the magnitudes of their
    differences on logarithmic axes below. Curves are broken at gaps and restarts."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    shown = _worst_bodies(found)
    blocks = [_overlaid(found, a.bodies[name], b.bodies[found.pairs[name]]) for name in shown]
    parts, same = _apart(found)
    rows = [(len(block) + 1) // 2 for block in blocks]
    below = (len(parts) + 1) // 2
    figure = Figure(figsize=(11.0, 1.5 + 1.45 * sum(rows) + 1.9 * below), layout="constrained")
    heights = [1.45] * sum(rows) + [1.9] * below
    grid = figure.subplots(len(heights), 2, sharex=True, squeeze=False, height_ratios=heights)
    title = [f"A: {a.name}", f"B: {b.name}"]
    title += wrap(f"same to rounding: {', '.join(same)}", WRAP) if same else []
    if len(shown) < len(found.pairs):
        title.append(f"motion of {len(shown)} of {len(found.pairs)} bodies: those that differ most")
    figure.suptitle("\n".join(title), fontsize=9.5, x=0.01, ha="left", color=TEXT)
    for axis in grid.ravel():
        axis.set_axis_off()
    top = 0
    for name, block, count in zip(shown, blocks, rows, strict=True):
        for k, panel in enumerate(block):
            axis = _open(grid[top + k % count, k // count], panel.label)
            axis.plot(*panel.a, color=MOTIONS["A"], linewidth=2.2)
            axis.plot(*panel.b, color=MOTIONS["B"], linewidth=1.2, linestyle=(0, (4, 1.5)))
        grid[top, 0].set_title(name, fontsize=9, loc="left", color=TEXT)
        top += count
    colours = {name: CYCLE[2 + k % (len(CYCLE) - 2)] for k, name in enumerate(found.series)}
    rounding = False
    for axis, quantity in zip(grid[top:].ravel(), parts, strict=False):
        _open(axis, f"{quantity} difference [{UNITS[quantity]}]").set_yscale("log")
        for name, series in found.series.items():
            if quantity in series:
                t, values = broken(found.t[name] - found.start, _above_floor(series[quantity]))
                axis.plot(t, values, color=colours[name], linewidth=1.0)
        rounding |= _shade_rounding(axis, found.floors[quantity])
    for axis in _lowest(grid):
        axis.tick_params(labelbottom=True)
        axis.set_xlabel(f"t - {found.start:.6f} [s]" if found.start else "t [s]", fontsize=9)
    names = [name for name in found.series if set(parts) & found.series[name].keys()]
    handles: list[Any] = [
        Line2D([], [], color=MOTIONS["A"], linewidth=2.2, label="A"),
        Line2D([], [], color=MOTIONS["B"], linewidth=1.2, linestyle=(0, (4, 1.5)), label="B"),
        *(Line2D([], [], color=colours[name], linewidth=1.0, label=name) for name in names),
    ]
    if rounding:
        handles.append(Patch(color="0.9", label="rounding"))
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=8.5)
    figure.savefig(path, dpi=110)


def _worst_bodies(found: Differences) -> list[str]:
    """The MOST_BODIES bodies that differ most, in the order of A."""
    bodies = [name for name in found.pairs if name in found.t]

    def most(name: str) -> float:
        scales = found.scales[name]
        sizes = ((q, float(values.max())) for q, values in found.series[name].items())
        return max(size / (scales[q] or 1.0) for q, size in sizes if q in ("position", "angle"))

    worst = sorted(bodies, key=most, reverse=True)[:MOST_BODIES]
    return [name for name in bodies if name in worst]


def _overlaid(found: Differences, a: Track, b: Track) -> list[Overlaid]:
    """Panels of the positions and angles that move; only x if none does."""
    shift, clock = found.start, _on_clock(b, found).t
    p_a, p_b = (_lines(t - shift, track.position, track) for t, track in ((a.t, a), (clock, b)))
    first = attitude_angles(a)
    angles = first, attitude_angles(b, linear(clock, a.t, first))
    r_a, r_b = (
        _lines(t - shift, values, track, FLIP)
        for t, values, track in ((a.t, angles[0], a), (clock, angles[1], b))
    )
    size = found.floors["position"] / ROUNDING
    places = [Overlaid(f"{axis} [m]", p_a[k], p_b[k], size) for k, axis in enumerate("xyz")]
    names = ("roll", "pitch", "yaw")
    turned = [Overlaid(f"{name} [°]", r_a[k], r_b[k], 90.0) for k, name in enumerate(names)]
    return [panel for panel in (*places, *turned) if panel.moves] or places[:1]


def _lines(
    t: np.ndarray, values: np.ndarray, track: Track, most: float = np.inf
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Each column over time, broken at gaps, restarts, and jumps larger than `most`."""
    begins = [part.start for part in stretches(track)[1:]]
    return [_curve(t, column, begins, most) for column in values.T]


def broken(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The curve, thinned, with a NaN in each LONG interval."""
    return _curve(t, values, after_gaps(t))


def _curve(
    t: np.ndarray, values: np.ndarray, begins: Any, most: float = np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """The curve, thinned, with a NaN before samples `begins` and at jumps above `most`."""
    new = np.zeros(len(t), bool)
    new[begins] = True
    kept = new.copy()
    kept[:: max(1, len(t) // CURVE_POINTS)] = True
    new[1:] |= np.abs(np.diff(values)) > most
    at = np.flatnonzero(new[kept])
    return np.insert(t[kept], at, t[kept][at]), np.insert(values[kept], at, np.nan)


def attitude_angles(track: Track, near: np.ndarray | None = None) -> np.ndarray:
    """Roll, pitch and yaw [degrees], shape (n, 3).

    Of the two equivalent triples, and of whole turns, the one nearest to `near` is chosen; without
    it, nearest to the preceding sample.
    """
    angles = roll_pitch_yaw(track.orientation)
    if near is None:
        return np.degrees(without_jumps(angles))
    both = [np.degrees(each) for each in (angles, other_triple(angles))]
    both = [each - 360.0 * np.round((each - near) / 360.0) for each in both]
    off = [np.abs(each - near).sum(axis=1) for each in both]
    return np.where((off[0] <= off[1])[:, None], *both)


def _apart(found: Differences) -> tuple[list[str], list[str]]:
    """Quantities whose differences are plotted, and captions for those equal to rounding."""
    drawn, same = [], []
    for quantity in UNITS:
        sizes = [s[quantity].max() for s in found.series.values() if quantity in s]
        if not sizes:
            continue
        if max(sizes) > found.floors[quantity]:
            drawn.append(quantity)
        else:
            size = f" ({max(sizes):.0e} {UNITS[quantity]})" if max(sizes) > 0.0 else ""
            same.append(f"{quantity}{size}")
    return drawn, same


def _open(axis: Any, label: str) -> Any:
    """Activate an axis and give it a label."""
    axis.set_axis_on()
    axis.set_ylabel(label, fontsize=9)
    axis.tick_params(which="both", labelsize=8)
    axis.grid(color=GRID, linewidth=0.6)
    axis.margins(x=0.01)
    axis.spines[["top", "right"]].set_visible(False)
    return axis


def _lowest(grid: np.ndarray) -> list[Any]:
    """The lowest used axis of each column."""
    used = [[axis for axis in column if axis.axison] for column in grid.T]
    return [column[-1] for column in used if column]


def _shade_rounding(axis: Any, floor: float) -> bool:
    """Shade the range below the rounding floor grey; returns whether it is in view."""
    low, high = axis.get_ylim()
    axis.set_ylim(low, high)
    if not 0.0 < floor or low >= floor:
        return False
    axis.axhspan(low, floor, color="0.9", zorder=0)
    return True


def _above_floor(values: np.ndarray) -> np.ndarray:
    """The values with NaN (a break) for those too small to plot; a flat line if all are."""
    hole = LEAST_DRAWN if (values <= LEAST_DRAWN).all() else np.nan
    return np.where(values > LEAST_DRAWN, values, hole)


# Rerun recordings with frames and trails: of a foreign bag, or of two motions on A's clock, A in
# blue, B in orange.


TIMELINE = "sim_time"
TRAIL_POINTS = 20_000
"""Maximum number of points of a trail."""
FRAME = 0.2
"""Length of a frame's axes, relative to the extent of the motion."""
EYE = np.array([0.9, -1.35, 0.85])
"""Vector from the middle of the motion to the camera, relative to its extent."""


def overlay(a: Tracks, b: Tracks, found: Differences, path: Path) -> None:
    """Write FILE.rrd with frames and trails of both motions, and plots of their differences.

    Raises MissingExtraError without rerun-sdk.
    """
    rr, rrb, recording = _rerun("an overlay", "rb_sim_compare", path)
    center, size, origin = _extent(a.bodies[name] for name in found.pairs)
    for name, other in found.pairs.items():
        if name not in found.t:
            continue
        one, two = a.bodies[name], _on_clock(b.bodies[other], found)
        # axes of different length, so that neither hides the other
        for which, track, length in (("A", one, 0.25 * size), ("B", two, 0.2 * size)):
            entity = rr.new_entity_path(["world", which, name])
            _motion(rr, recording, entity, track, origin, rgb(MOTIONS[which]), length)
    for name, series in found.series.items():
        for quantity, values in series.items():
            entity = f"apart/{quantity}/{name.replace(' ', '_')}"
            if values.max() <= found.floors[quantity]:  # the axis would scale to the noise
                entity, values = f"{entity}_rounding", np.zeros(len(values))
            times = rr.TimeColumn(TIMELINE, duration=found.t[name])
            recording.send_columns(entity, [times], rr.Scalars.columns(scalars=values))
    plots, _ = _apart(found)
    views = [rrb.TimeSeriesView(origin=f"apart/{q}", name=f"{q} [{UNITS[q]}]") for q in plots]
    scene = _view(rrb, "A blue, B orange", center, size, origin)
    beside = [rrb.Vertical(*views)] if views else []
    _end(recording, rrb, rrb.Horizontal(scene, *beside))


def motion_of(tracks: Tracks, path: Path, *, motion_only: bool = False) -> float:
    """Write FILE.rrd with frames and trails of the poses in a bag, and plots of all values; returns
    its time span [s].

    motion_only: show only the 3D view. Frames of a tree of transforms are drawn in its root,
    without static ones. Raises MissingExtraError without rerun-sdk.
    """
    rr, rrb, recording = _rerun("a recording for Rerun", "rb_sim", path)
    shown = {name: tracks.bodies[name] for name in drawn(tracks)}
    start, end = (float(pick(pick(track.t) for track in shown.values())) for pick in (min, max))
    zero = start if abs(start) > CALENDAR else 0.0
    center, size, origin = _extent(shown.values())
    plots: set[str] = set()

    def plot(quantity: str, name: str, t: np.ndarray, values: np.ndarray | None) -> None:
        if values is None:
            return
        entity = rr.new_entity_path(["plots", quantity, name])
        parts = [f"{name} {axis}" for axis in "xyzw"[: values.shape[1]]]
        recording.log(entity, rr.SeriesLines(names=parts), static=True)
        rows = rr.Scalars.columns(scalars=values.ravel()).partition([values.shape[1]] * len(values))
        recording.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=t - zero)], rows)
        plots.add(quantity)

    for k, (name, track) in enumerate(shown.items()):
        on_clock, color = replace(track, t=track.t - zero), rgb(CYCLE[k % len(CYCLE)])
        entity = rr.new_entity_path(["world", name])
        _motion(rr, recording, entity, on_clock, origin, color, FRAME * size)
        plot("position", name, track.t, track.position)
        plot("orientation", name, track.t, track.orientation)
        plot("velocity", name, track.t, track.linear_velocity)
        plot("spin", name, track.t, track.angular_velocity)
    for name, wrench in tracks.reactions.items():
        plot("force", name, wrench.t, wrench.values[:, :3])
        plot("torque", name, wrench.t, wrench.values[:, 3:])
    scene = _view(rrb, MOTION, center, size, origin)
    units = {**UNITS, "orientation": "x, y, z, w"}
    views = [
        rrb.TimeSeriesView(origin=f"plots/{q}", name=f"{q} [{unit}]")
        for q, unit in units.items()
        if q in plots
    ]
    _end(recording, rrb, scene if motion_only else rrb.Horizontal(scene, rrb.Vertical(*views)))
    return end - start


def drawn(tracks: Tracks) -> list[str]:
    """Names of the poses to draw, all in one world: none relative to a moving frame."""
    outer = [name for name in tracks.bodies if name not in tracks.composed]
    return [name for name in outer if not is_static(name)] or outer


def _rerun(what: str, name: str, path: Path) -> tuple[Any, Any, Any]:
    """The modules of Rerun, and the recording that `path` receives."""
    try:
        rr, rrb = import_module("rerun"), import_module("rerun.blueprint")
    except ImportError:
        raise MissingExtraError("rerun-sdk", "rerun", what) from None
    recording = rr.RecordingStream(name)
    recording.save(str(path))
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    return rr, rrb, recording


def _view(rrb: Any, name: str, center: np.ndarray, size: float, origin: np.ndarray) -> Any:
    """A 3D view, named with the local origin if there is one."""
    if origin.any():
        name, center = f"{name} (relative to {origin.tolist()} m)", center - origin
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=center + size * EYE,
        look_target=center,
        eye_up=(0, 0, 1),
    )
    return rrb.Spatial3DView(origin="world", name=name, eye_controls=eye)


def _end(recording: Any, rrb: Any, layout: Any) -> None:
    panels = (
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )
    recording.send_blueprint(rrb.Blueprint(layout, *panels))
    recording.flush()
    recording.disconnect()


def _extent(tracks: Iterable[Track]) -> tuple[np.ndarray, float, np.ndarray]:
    """Middle and extent [m] of motions, at least 0.1 m, for bodies that only rotate; and the local
    origin, relative to which single precision is smooth."""
    places = np.concatenate([track.position for track in tracks])
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    center, size = (low + high) / 2.0, max(float((high - low).max()), 0.1)
    return center, size, local_origin(center, size)


def _on_clock(track: Track, found: Differences) -> Track:
    """The track with its times on A's clock."""
    clocks = found.clocks
    t = clocks.start + (track.t - clocks.offset - clocks.start) / (1.0 + clocks.drift)
    return Track(t, track.position, Interpolated(track).q, anew=track.anew)


def _motion(
    rr: Any,
    recording: Any,
    entity: str,
    track: Track,
    origin: np.ndarray,
    color: tuple[int, int, int],
    length: float,
) -> None:
    position = track.position - origin
    recording.log(
        entity,
        rr.Arrows3D(vectors=length * np.eye(3), colors=[color] * 3, radii=0.03 * length),
        rr.Points3D([[0.0, 0.0, 0.0]], radii=[0.06 * length], colors=[color]),
        static=True,
    )
    stride = max(1, len(track.t) // TRAIL_POINTS)
    strips = [position[part][::stride] for part in stretches(track)]
    line = rr.LineStrips3D(strips, colors=[color], radii=0.01 * length)
    recording.log(f"{entity}_trail", line, static=True)
    columns = rr.Transform3D.columns(translation=position, quaternion=track.orientation)
    recording.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=track.t)], columns)
