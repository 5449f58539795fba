# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim replay`, `show` and `recover`: display recorded runs in the viewer or as HTML; repair
bags."""

from __future__ import annotations

import contextlib
import json
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.accuracy.closed_forms import exact_samples
from rb_sim.bags.compare import CALENDAR
from rb_sim.bags.comparison_views import drawn
from rb_sim.bags.info import linear
from rb_sim.bags.tracks import Track, Tracks
from rb_sim.base import __version__
from rb_sim.base.errors import AccuracyWarning, RbSimError, SinkError, check_ending, lines_of
from rb_sim.base.palette import CYCLE
from rb_sim.cli.plain import warn
from rb_sim.io.drawn_supports import ground
from rb_sim.io.motion_page import COLORS, FEW_BODIES, Applied, Lawful, RunPage, packed, spread
from rb_sim.numerics.rotations import continuous, unit
from rb_sim.scene.schema import Scene
from rb_sim.simulation.record import Record, wrenches_by_body

if TYPE_CHECKING:
    from rb_sim.io.bag.reader import BagReader
    from rb_sim.mechanics.samples import SampleBlock
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.trajectory import Trajectory


MOST_RATE = 1e4
"""Largest playback rate, in simulated seconds per second, as for the node."""


def of_arguments(
    bag: Path, *, publish: bool, rate: float | None, loop: bool, start: float | None, **files: Any
) -> int:
    """`replay` with these files, or `play` with --publish."""
    options = PlayOptions(rate, loop, start)
    if publish:
        return play(bag, options, alone=not any(files.values()))
    options.refuse()
    replay(bag, **files)
    return 0


def replay(
    bag: Path,
    save: Path | None = None,
    screenshot: Path | None = None,
    video: Path | None = None,
    scene: str | None = None,
) -> None:
    """Show a bag in the Rerun viewer, or save it as .rrd, picture or film.

    bag: folder or file, recorded by rb_sim or any other bag with poses (shown as frames with
    trails). scene: scene whose bodies are placed by the joint states of a bag not recorded by
    rb_sim.

    Raises SinkError for a missing or unfinished bag, one without poses, a wrong file suffix,
    nothing to draw with, or `scene` for a bag recorded by rb_sim; MissingExtraError without
    rerun-sdk.
    """
    from rb_sim.io.bag.reader import reader_of
    from rb_sim.io.rerun.viewer import save_screenshot, show

    check_ending(save, ".rrd")
    check_ending(screenshot, ".png")
    check_ending(video, ".mp4")
    if video is not None:
        from rb_sim.io.rerun.viewer import find_ffmpeg

        find_ffmpeg()  # fails before the work begins
    reader = reader_of(bag)
    if reader is not None and scene is not None:
        raise SinkError(f"--scene: {bag} was recorded by rb_sim and has its own scene")
    name = bag.stem if reader is None else reader.scene.name
    draw = _others(bag, scene) if reader is None else partial(convert, reader)
    with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
        recording = save or Path(folder) / f"{name}.rrd"
        with _whole_or_none(recording):
            draw(recording)
        warn([] if reader is None else reader.left_out)
        if screenshot is not None:
            save_screenshot(recording, screenshot)
        if video is not None:
            _film(draw, Path(folder) / "motion.rrd", video)
        if save is None and screenshot is None and video is None:
            show(recording)
    for path in (save, screenshot, video):
        if path is not None:
            print(f"wrote {path}")


@contextlib.contextmanager
def _whole_or_none(path: Path) -> Iterator[None]:
    """Context that deletes an unfinished file after an exception, Ctrl-C included.

    A file that was there before and is untouched stays.
    """
    before = _changed(path)
    try:
        yield
    except BaseException:
        if _changed(path) != before:
            with contextlib.suppress(OSError):
                path.unlink()
        raise


def _changed(path: Path) -> int | None:
    """Time of the last change of a file [ns]; None if it does not exist."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return None


def _others(bag: Path, scene: str | None) -> Callable[..., float]:
    """Function that writes the motion of a bag not recorded by rb_sim to a recording, as
    `convert`."""
    from rb_sim.bags.comparison_views import drawn, motion_of
    from rb_sim.bags.tracks import tracks_of_bag
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import load_scene

    tracks = tracks_of_bag(bag, None if scene is None else load_scene(find_scene(scene)))
    warn(tracks.notes)
    frames = dict.fromkeys(f for name in drawn(tracks) if (f := tracks.bodies[name].frame))
    if len(frames) > 1:
        warn([f"no transform connects the frames {', '.join(frames)}: drawn as if they were one"])
    return partial(motion_of, tracks)


def _film(draw: Callable[..., float], recording: Path, video: Path) -> None:
    """Save the 3D view as a film; prints its playback speed."""
    from rb_sim.io.rerun.viewer import save_video

    span = draw(recording, motion_only=True)
    film = save_video(recording, video, span)
    print(
        f"{film.pictures} pictures, {film.seconds:g} s of film at {film.speed:.3g} times real time"
    )


@dataclass(frozen=True)
class PlayOptions:
    """Options of `replay --publish`; None: not given."""

    rate: float | None = None
    loop: bool = False
    start: float | None = None

    def refuse(self) -> None:
        """Raise RbSimError if an option was given without `--publish`."""
        given = {"--rate": self.rate is not None, "--loop": self.loop,
                 "--start": self.start is not None}  # fmt: skip
        for name, there in given.items():
            if there:
                raise RbSimError(f"{name}: only with --publish")


def play(bag: Path, options: PlayOptions, *, alone: bool = True) -> int:
    """Play a recorded bag over DDS; returns 0. alone: no option for a file was given.

    Raises RbSimError for bad options, without rclpy, for a missing bag or one not recorded by
    rb_sim, or if there is nothing to play.
    """
    if not alone:
        raise RbSimError("--publish: not with --save, --screenshot, --video or --scene")
    rate = 1.0 if options.rate is None else options.rate
    start = 0.0 if options.start is None else options.start
    if not 0.0 <= rate <= MOST_RATE:
        raise RbSimError(f"--rate: got {rate:g}; must be from 0 (no pacing) to {MOST_RATE:g}")
    if not 0.0 <= start < float("inf"):
        raise RbSimError(f"--start: got {start:g}; must be a time >= 0 [s]")
    from rb_sim.io.bag.reader import reader_of
    from rb_sim.ros.main import need_rclpy

    reader = reader_of(bag)
    if reader is None:
        raise RbSimError(f"--publish: {bag} was not recorded by rb_sim; play it with "
                         f"ros2 bag play --clock 100 {bag}")  # fmt: skip
    need_rclpy()
    from rb_sim.ros.bag_player import Playing, publish

    code = publish(reader, Playing(rate, options.loop, start))
    warn(reader.left_out)
    return code


def recover(bag: Path, directory: Path | None = None) -> None:
    """Make a readable bag from an unfinished one, beside it or in `directory`.

    Raises SinkError as `recover_bag` does.
    """
    from rb_sim.io.bag.folder import recover_bag, unlisted

    result = recover_bag(bag, directory)
    what = "the bag was complete" if result.complete else "all readable messages"
    if result.unchecked:
        some = "any" if result.unchecked == result.messages else f"{result.unchecked} of them"
        what += f"; no checksum covers {some}, so damage in them cannot be detected"
    print(f"wrote {result.directory}: {result.messages} messages, {what}")
    warn(dict.fromkeys([*unlisted(bag), *result.damage]))


def _drawn(reader: BagReader) -> Scene:
    """The scene with its joints; if this version cannot read it, the bag's own description of
    it."""
    from rb_sim.io.bag.reader import scene_as_run

    try:
        return scene_as_run(reader)
    except RbSimError:
        return reader.scene  # type: ignore[return-value]  # has all that a sink must read


def convert(reader: BagReader, recording: Path, *, motion_only: bool = False) -> float:
    """Write the samples of a bag to a recording for the viewer (.rrd); returns its span [s].

    motion_only: lay out the 3D view only. Raises SinkError.
    """
    from rb_sim.io.rerun.rerun_sink import RerunSink
    from rb_sim.io.sink import Timeline

    sink = RerunSink(recording, motion_only=motion_only)
    sink.open(_drawn(reader), reader.layout)
    timeline = Timeline()
    ends: list[float] = []
    for block in reader.blocks():
        sink.write(block)
        times = timeline.follow(block.t)
        ends = [ends[0] if ends else float(times[0]), float(times[-1])]
    sink.close(reader.summary)
    return ends[1] - ends[0] if ends else 0.0


def show(source: str, save: Path | None = None, browse: bool = False) -> None:
    """Write a page (.html) that shows a run in 3D: of an output folder, any bag, or a scene.

    save: path of the page; None: show.html in the output folder, else NAME.html in the current one.
    browse: open the page in the web browser. A scene is simulated; a bag not recorded by rb_sim has
    poses only. Raises RbSimError.
    """
    from rb_sim.io.motion_page import save as write_page

    check_ending(save, ".html")
    path = Path(source)
    if (path / "bag").is_dir():
        target, bag = path / "show.html", path / "bag"
    elif (path / "summary.json").is_file():
        raise RbSimError(f"{source}: this run has no bag, so nothing to show; run without --no-bag")
    elif path.is_dir() or path.suffix in (".mcap", ".db3"):
        target, bag = Path(f"{path.absolute().stem}.html"), path
    else:
        target, bag = Path(f"{path.stem}.html"), None
    page = _page_of_scene(source) if bag is None else _page_of_bag(bag)
    target = save or target
    write_page(page, target)
    print(f"wrote {target}: {target.stat().st_size / 1e6:.2g} MB")
    if browse:
        import webbrowser

        webbrowser.open(target.absolute().as_uri())


def _page_of_scene(source: str) -> dict[str, Any]:
    from rb_sim.cli.verbs.run import progress_bar
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import load_scene
    from rb_sim.simulation.simulation import Simulation

    simulation = Simulation(load_scene(find_scene(source, "the folder of a run, a bag")))
    with (
        warnings.catch_warnings(),
        progress_bar(simulation.scene.simulation.duration, False) as show,
    ):
        warnings.simplefilter("ignore", AccuracyWarning)  # the page lists them
        run = simulation.run(progress=lambda t, end: show(t))
    lines = [f"warning: {line}" for line in lines_of(run.findings)]
    return page_of_run(run, _facts(run, {}), lines)


def _page_of_bag(bag: Path) -> dict[str, Any]:
    """Data of the page of a bag; from an unfinished bag all readable samples."""
    from rb_sim.io.bag.folder import is_complete
    from rb_sim.io.bag.reader import reader_of
    from rb_sim.simulation.trajectory import recorded

    reader = reader_of(bag, unfinished=True)
    if reader is None:
        return _page_of_others(bag)
    run = recorded(reader)
    lines = [f"warning: {line}" for line in (*lines_of(run.findings), *reader.left_out)]
    if not all(is_complete(path) for path in reader.paths):
        lines.append(f"warning: the bag was never finished; the last sample that can be read is of "
                     f"t = {run.t[-1] if len(run) else 0.0:.6g} s")  # fmt: skip
    warn(line.removeprefix("warning: ") for line in lines[len(run.findings) :])
    return page_of_run(run, _facts(run, reader.summary or {}, reader.record), lines)


def _page_of_others(bag: Path) -> dict[str, Any]:
    from rb_sim.bags.tracks import tracks_of_bag

    tracks = tracks_of_bag(bag)
    warn(tracks.notes)
    facts = [("bag", bag.name), ("page by", f"rb_sim {__version__}")]
    return page_of_tracks(tracks, bag.absolute().stem, facts, tracks.notes)


def _facts(
    run: Trajectory, summary: Mapping[str, Any], record: Mapping[str, str] | None = None
) -> list[tuple[str, str]]:
    """Rows of the page about a run: method, error, balances, versions."""
    first, last = float(run.t[0]), float(run.t[-1])
    rows = [("method", run.method), ("simulated", f"{last - first:.6g} s")]
    if summary.get("outcome") not in (None, "finished"):
        rows.append(("outcome", summary["outcome"]))
    error = run.global_error
    rows.append(("global error", "not measured" if error is None else str(error)))
    energy = summary.get("energy")
    if energy and energy.get("relative") is not None:
        text = f"{energy['error']:.2g} J (relative {energy['relative']:.2g})"
        rows.append(("energy error", text))
    rows.append(("constraint violation", f"at most {run.residual.max():.2g} (relative)"))
    versions = json.loads((record or {}).get("versions", "{}")) or {"rb_sim": __version__}
    rows.append(("versions", ", ".join(f"{name} {text}" for name, text in versions.items())))
    return rows


AXES = 0.12
"""Length of the axes of a pose, relative to the size of the motion."""
SMALLEST = 0.1
"""Least size of a motion [m], as for a body that only rotates."""


def page_of_tracks(
    tracks: Tracks, title: str, facts: Sequence[tuple[str, str]], warnings: Sequence[str]
) -> dict[str, Any]:
    """Data of the page of tracks, at instants common to all poses; linear between messages."""
    names = drawn(tracks)
    shown = [tracks.bodies[name] for name in names]
    t, left_out = _instants(shown)
    zero = float(t[0]) if abs(t[0]) > CALENDAR else 0.0
    position = np.stack([linear(t, track.t, track.position) for track in shown], axis=1)
    turns = [linear(t, track.t, continuous(track.orientation)) for track in shown]
    orientation = unit(np.stack(turns, axis=1))
    places = np.concatenate([track.position for track in shown])
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    center, size = 0.5 * (low + high), max(float(np.linalg.norm(high - low)), SMALLEST)
    rows = [*facts, ("poses", f"{sum(len(track.t) for track in shown)}{left_out}")]
    if zero:
        rows.append(("t = 0", f"{zero:.6f} s by the stamps"))
    torques = [w.values[:, 3:] for w in tracks.reactions.values()]
    forces = [w.values[:, :3] for w in tracks.reactions.values()]
    plane = ground(center, size, float(low[2]))
    return {
        "title": title,
        "description": "",
        "facts": rows,
        "warnings": list(warnings),
        "legend": [f"grid {plane['step']:g} m"],
        "view": {"center": center.tolist(), "size": size * (1.0 + 2.0 * AXES)},
        "colors": COLORS,
        "bodies": [
            {"name": name, "solid": None, "color": CYCLE[i % len(CYCLE)], "reach": AXES * size}
            for i, name in enumerate(names)
        ],
        "supports": {"solids": [], "planes": [plane], "lines": [], "links": [], "joints": []},
        "t": packed(t - zero, "float64"),
        "position": packed(position),
        "orientation": packed(orientation),
        "groups": {},
        "arrows": [],
        "curves": {
            "t": packed(t - zero, "float64"),
            "energy": None,
            "scale": {"force": _largest(forces), "torque": _largest(torques)},
        },
        "reactions": [
            {
                "name": name,
                "body": wrench.frame or "its frame",
                "about": "its frame's origin",
                "force": packed(linear(t, wrench.t, wrench.values[:, :3])),
                "torque": packed(linear(t, wrench.t, wrench.values[:, 3:])),
            }
            for name, wrench in tracks.reactions.items()
        ],
        "exact": None,
        "events": [],
        "point": "origin of its frame",
        "trace": True,
        "axes": True,
        "names": True,
    }


def _instants(tracks: list[Track]) -> tuple[np.ndarray, str]:
    """(instants of all poses, as many as fit on a page; text on the omitted ones)."""
    every = np.unique(np.concatenate([track.t for track in tracks]))
    rows = spread(len(every), 28.0 * len(tracks))
    if len(rows) == len(every):
        return every, ""
    return every[rows], f"; the page shows {len(rows)} of {len(every)} instants"


def _largest(vectors: list[np.ndarray]) -> float:
    return max((float(np.nanmax(np.abs(v), initial=0.0)) for v in vectors), default=0.0)


# Page of a run: its samples with applied wrenches, and the closed form for comparison.


GIVEN = ("wrench", "wrench_table")
"""Types of effects that are applied from outside; `commanded_wrench` is among the samples."""


def page_of_run(
    run: Trajectory, facts: Sequence[tuple[str, str]], warnings: Sequence[str]
) -> dict[str, Any]:
    """Data of the page of a run. facts: rows of its table; warnings: lines above the view.

    Raises RbSimError for a run without samples or without a scene.
    """
    if not len(run) or run.scene is None:
        raise RbSimError("there is no sample to show")
    page = RunPage(run.scene, run.layout, run.block)
    lawful = _closed_form(run, page.kept)
    rows = list(facts)
    if lawful is not None:
        rows.append(("closed form", f"dashed: {lawful.name}"))
    applied = _applied(Record(page.kept, run.layout, run.scene))
    return page.data(facts=rows, warnings=warnings, applied=applied, lawful=lawful)


def _closed_form(run: Trajectory, kept: SampleBlock) -> Lawful | None:
    """The closed form of the motion; None if unknown, or for a run with commands or resets."""
    if run.block.inputs or not isinstance(run.scene, Scene):
        return None
    try:
        found = exact_samples(run.scene, kept.t)
    except RbSimError:  # e.g. of another version of the program
        return None
    return None if found is None else Lawful(*found)


def _applied(record: Record) -> list[Applied]:
    """Wrenches of all effects except commanded ones, at the samples of the page."""
    if not isinstance(record.scene, Scene) or len(record.layout.bodies) > FEW_BODIES:
        return []
    effects = {n: e for n, e in record.scene.effects.items() if e.type != "commanded_wrench"}
    scene = record.scene.model_copy(update={"effects": effects})
    found = []
    for name, by_body in wrenches_by_body(Record(record.block, record.layout, scene)).items():
        for body, wrench in by_body.items():
            given = effects[name].type in GIVEN
            found.append(Applied(name, body, given, wrench.force, wrench.torque))
    return found
