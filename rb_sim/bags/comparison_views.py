"""Pictures of two motions beside each other: differences over time, a Rerun recording."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.bags.alignment import Interpolated, stretches
from rb_sim.bags.compare import CALENDAR, UNITS, Differences
from rb_sim.bags.tracks import Track, Tracks
from rb_sim.bags.transforms import is_static
from rb_sim.base.errors import MissingExtraError
from rb_sim.base.palette import CYCLE, MOTIONS, rgb
from rb_sim.io.rerun.viewer import MOTION

# The differences of two motions over time, as a picture.


CURVE_POINTS = 4000
FLOOR = 1e-17
"""A logarithm has no zero: smaller differences are left out, or drawn there if all are."""


def picture(found: Differences, path: Path, title: str) -> None:
    """Write one axis per quantity, logarithmic, with a line for each body or reaction."""
    from matplotlib.figure import Figure

    quantities = [q for q in UNITS if any(q in series for series in found.series.values())]
    figure = Figure(figsize=(9, 1.0 + 2.2 * len(quantities)), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(quantities), 1, sharex=True))
    figure.suptitle(title, fontsize=10)
    for axis, quantity in zip(axes, quantities, strict=True):
        for name, series in found.series.items():
            if quantity in series:
                stride = max(1, len(series[quantity]) // CURVE_POINTS)
                values = _above_floor(series[quantity][::stride])
                axis.semilogy(
                    found.t[name][::stride] - found.start, values, label=name, linewidth=1.0
                )
        _shade_rounding(axis, found.floors[quantity])
        axis.set_ylabel(f"{quantity} apart [{UNITS[quantity]}]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7, loc="best")
    axes[-1].set_xlabel(f"t - {found.start:.6f} [s]" if found.start else "t [s]")
    figure.savefig(path, dpi=120)


def _shade_rounding(axis: Any, floor: float) -> None:
    """Grey below the floor, which is always in view: what lies there is the same motion."""
    if not floor > 0.0:
        return
    low, high = axis.get_ylim()
    axis.set_ylim(low, max(high, 10.0 * floor))
    if low < floor:
        axis.axhspan(low, floor, color="0.9", zorder=0, label="rounding")


def _above_floor(values: np.ndarray) -> np.ndarray:
    """The values; NaN, thus a hole, for those below FLOOR, but a line at FLOOR if all are."""
    hole = FLOOR if (values <= FLOOR).all() else np.nan
    return np.where(values > FLOOR, values, hole)


# Motions as frames and trails in a Rerun recording: those of a bag of somebody else, or two beside
# each other, A in blue, B in orange, on the clock of A.


TIMELINE = "sim_time"
TRAIL_POINTS = 20_000
"""Of a trail."""
FRAME = 0.2
"""Length of the axes of a frame, in sizes of the motion."""
EYE = np.array([0.9, -1.35, 0.85])
"""From the middle of the motion to the eye, in sizes of the motion."""


def overlay(a: Tracks, b: Tracks, found: Differences, path: Path) -> None:
    """Write FILE.rrd: frames and trails of both, and the differences as plots.

    Raises MissingExtraError without rerun-sdk.
    """
    rr, rrb = _rerun("an overlay")
    recording = rr.RecordingStream("rb_sim_compare")
    recording.save(str(path))
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    center, size = _extent(a.bodies[name] for name in found.pairs)
    for name, other in found.pairs.items():
        if name not in found.t:
            continue
        on_clock = _on_clock(b.bodies[other], found)
        # axes of unequal length: neither hides the other
        _motion(rr, recording, f"world/A/{name}", a.bodies[name], rgb(MOTIONS["A"]), 0.25 * size)
        _motion(rr, recording, f"world/B/{name}", on_clock, rgb(MOTIONS["B"]), 0.2 * size)
    for name, series in found.series.items():
        for quantity, values in series.items():
            entity = f"apart/{quantity}/{name.replace(' ', '_')}"
            if values.max() <= found.floors[quantity]:  # else an axis of the noise
                entity, values = f"{entity}_rounding", np.zeros(len(values))
            times = rr.TimeColumn(TIMELINE, duration=found.t[name])
            recording.send_columns(entity, [times], rr.Scalars.columns(scalars=values))
    plots = [q for q in UNITS if any(q in series for series in found.series.values())]
    views = [rrb.TimeSeriesView(origin=f"apart/{q}", name=f"{q} [{UNITS[q]}]") for q in plots]
    scene = _view(rrb, "A blue, B orange", center, size)
    _end(recording, rrb, rrb.Horizontal(scene, rrb.Vertical(*views)))


def motion_of(tracks: Tracks, path: Path, *, motion_only: bool = False) -> float:
    """Write FILE.rrd: frames and trails of the poses in a bag, and all numbers as plots; its span
    [s]. motion_only: lay out nothing but the 3D view.

    Of frames in a tree of transforms those in its root, without those that static ones hold.
    Raises MissingExtraError without rerun-sdk.
    """
    rr, rrb = _rerun("a recording for Rerun")
    recording = rr.RecordingStream("rb_sim")
    recording.save(str(path))
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    shown = {name: tracks.bodies[name] for name in drawn(tracks)}
    start, end = (float(pick(pick(track.t) for track in shown.values())) for pick in (min, max))
    zero = start if abs(start) > CALENDAR else 0.0
    center, size = _extent(shown.values())
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
        on_clock = replace(track, t=track.t - zero)
        entity = rr.new_entity_path(["world", name])
        _motion(rr, recording, entity, on_clock, rgb(CYCLE[k % len(CYCLE)]), FRAME * size)
        plot("position", name, track.t, track.position)
        plot("orientation", name, track.t, track.orientation)
        plot("velocity", name, track.t, track.linear_velocity)
        plot("spin", name, track.t, track.angular_velocity)
    for name, wrench in tracks.reactions.items():
        plot("force", name, wrench.t, wrench.values[:, :3])
        plot("torque", name, wrench.t, wrench.values[:, 3:])
    scene = _view(rrb, MOTION, center, size)
    units = {**UNITS, "orientation": "x, y, z, w"}
    views = [
        rrb.TimeSeriesView(origin=f"plots/{q}", name=f"{q} [{unit}]")
        for q, unit in units.items()
        if q in plots
    ]
    _end(recording, rrb, scene if motion_only else rrb.Horizontal(scene, rrb.Vertical(*views)))
    return end - start


def drawn(tracks: Tracks) -> list[str]:
    """The poses that are drawn, all in one world: those of frames that do not stand in another."""
    outer = [name for name in tracks.bodies if name not in tracks.composed]
    return [name for name in outer if not is_static(name)] or outer


def _rerun(what: str) -> tuple[Any, Any]:
    try:
        return import_module("rerun"), import_module("rerun.blueprint")
    except ImportError:
        raise MissingExtraError("rerun-sdk", "rerun", what) from None


def _view(rrb: Any, name: str, center: np.ndarray, size: float) -> Any:
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


def _extent(tracks: Iterable[Track]) -> tuple[np.ndarray, float]:
    """Middle and size [m] of motions; at least 0.1 m, for bodies that only turn."""
    places = np.concatenate([track.position for track in tracks])
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    return (low + high) / 2.0, max(float((high - low).max()), 0.1)


def _on_clock(track: Track, found: Differences) -> Track:
    """The track with its times on the clock of A."""
    clocks = found.clocks
    t = clocks.start + (track.t - clocks.offset - clocks.start) / (1.0 + clocks.drift)
    return Track(t, track.position, Interpolated(track).q, anew=track.anew)


def _motion(
    rr: Any, recording: Any, entity: str, track: Track, color: tuple[int, int, int], length: float
) -> None:
    recording.log(
        entity,
        rr.Arrows3D(vectors=length * np.eye(3), colors=[color] * 3, radii=0.03 * length),
        rr.Points3D([[0.0, 0.0, 0.0]], radii=[0.06 * length], colors=[color]),
        static=True,
    )
    stride = max(1, len(track.t) // TRAIL_POINTS)
    strips = [track.position[part][::stride] for part in stretches(track)]
    line = rr.LineStrips3D(strips, colors=[color], radii=0.01 * length)
    recording.log(f"{entity}_trail", line, static=True)
    columns = rr.Transform3D.columns(translation=track.position, quaternion=track.orientation)
    recording.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=track.t)], columns)
