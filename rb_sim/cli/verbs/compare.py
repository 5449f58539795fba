# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim compare`: comparison of a bag with another bag, a scene or a CSV file."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.base.errors import MissingExtraError, RbSimError, check_ending, lines_of
from rb_sim.base.plain_data import json_text, write_json
from rb_sim.cli.options import CompareOptions
from rb_sim.cli.plain import columns, note, plain_console, warn

if TYPE_CHECKING:
    from rb_sim.bags.compare import Differences
    from rb_sim.bags.tracks import Tracks
    from rb_sim.scene.schema import Scene

TOO_FAR = 1
"""Exit code if a difference exceeds its bound."""


def compare(options: CompareOptions) -> int:
    """Compare two motions; returns 0, or TOO_FAR. Raises RbSimError."""
    from rb_sim.bags.compare import differences, summary

    check_ending(options.screenshot, ".png")
    for name, bound in options.bounds.items():
        if not bound >= 0.0:
            raise RbSimError(f"--max-{name}: got {bound:g}; must be >= 0")
    a = first_tracks(options)
    b = other_tracks(options, a)
    warn([*a.notes, *b.notes])  # before errors, which they may explain
    found = differences(a, b, align=options.align, match=_pairs(options.match or ()))
    report = summary(found, options.bounds)
    warn(found.notes)
    if options.as_json:
        print(json_text(report))
    else:
        _print(report)
    if options.out is not None:
        _write(options.out, report, found, a, b)
    if options.screenshot is not None:
        _draw(options.screenshot, found, a, b)
    for line in report["exceeded"]:
        print(f"exceeds its bound: {line}")
    return TOO_FAR if report["exceeded"] else 0


def _pairs(texts: Sequence[str]) -> dict[str, str]:
    for text in texts:
        if not all(text.partition("=")):
            raise RbSimError(f"--match {text}: must be NAME_IN_A=NAME_IN_B")
    return {text.partition("=")[0]: text.partition("=")[2] for text in texts}


BAGS, TEXTS = (".mcap", ".db3"), (".csv", ".txt", ".tum")
"""File suffixes of bags, and of files with poses."""


def _is_bag(path: Path) -> bool:
    return path.suffix in BAGS or path.is_dir()


def first_tracks(options: CompareOptions) -> Tracks:
    """The motion of A; if OTHER is a scene, including the joint states of a bag not recorded by
    rb_sim."""
    from rb_sim.bags.tracks import tracks_of_bag
    from rb_sim.io.bag.reader import reader_of
    from rb_sim.scene.listing import find_scene, list_scenes
    from rb_sim.scene.load import load_scene

    first, other = Path(options.a), Path(options.b)
    shipped = {scene.name for scene in list_scenes()}

    def kind_of(path: Path) -> str:
        named = not path.exists() and str(path) in shipped
        if named or (path.suffix in (".yaml", ".yml") and path.name != "metadata.yaml"):
            return "a scene"
        return "a file of poses" if path.suffix in TEXTS else ""

    if kind := kind_of(first):
        way = f"OTHER may be {kind}: rb_sim compare {options.b} {options.a}"
        if kind_of(other):
            scene = options.a if kind == "a scene" else "SCENE"
            way = f"record one first: rb_sim run {scene} --out DIR"
        raise RbSimError(f"BAG: got {options.a}, {kind}; must be a bag, {way}")
    is_scene = other.suffix not in TEXTS and not _is_bag(other)
    scene = None
    if is_scene and reader_of(options.a, unfinished=True) is None:
        scene = load_scene(find_scene(options.b, "a bag, a CSV file"))
    return tracks_of_bag(options.a, scene)


def other_tracks(options: CompareOptions, a: Tracks) -> Tracks:
    """The motion of OTHER: of a CSV file, a bag, or a simulated scene."""
    from rb_sim.bags.tracks import tracks_of_bag, tracks_of_csv

    path = Path(options.b)
    is_bag = _is_bag(path)
    is_csv = path.suffix in TEXTS
    if options.wrench and (is_bag or is_csv):
        raise RbSimError(f"--wrench {options.wrench[0]}: only if OTHER is a scene")
    if is_csv:
        return tracks_of_csv(path)
    if is_bag:
        return tracks_of_bag(path)
    return _of_scene(options, a)


def _of_scene(options: CompareOptions, a: Tracks) -> Tracks:
    """The scene simulated with A's commands, duration and rate."""
    from rb_sim.bags.resim import resimulate
    from rb_sim.bags.tracks import tracks_of_bag
    from rb_sim.cli.verbs.fit import refuse_wrench
    from rb_sim.io.bag.reader import reader_of
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import load_scene

    reader = reader_of(options.a, unfinished=True)
    if reader is None:
        return _beside_others(options, load_scene(find_scene(options.b, "a bag, a CSV file")), a)
    refuse_wrench(options.wrench or ())
    own = reader.scene.simulation
    scene = load_scene(
        find_scene(options.b, "a bag, a CSV file"), duration=own.duration, rate=own.rate
    )
    with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
        findings = resimulate(reader, scene, Path(folder) / "bag")
        tracks = tracks_of_bag(Path(folder) / "bag")
    warn(lines_of(findings))
    tracks.name = options.b
    return tracks


def _beside_others(options: CompareOptions, scene: Scene, a: Tracks) -> Tracks:
    """The scene simulated from the first pose of its bodies on, sampled at A's instants."""
    from rb_sim.accuracy.checks.check_list import CheckedSamples
    from rb_sim.bags.compare import shown_offset
    from rb_sim.bags.fit.recording import followed, pairs_of, recorded_by_others
    from rb_sim.bags.tracks import tracks_of_blocks
    from rb_sim.simulation.simulation import Simulation

    pairs, left_out = pairs_of(a, list(scene.bodies), options.match or ())
    recording = recorded_by_others(a, scene, pairs, options.wrench or ())
    warn(left_out)
    note(recording.notes)
    simulation = Simulation(scene)
    checked = CheckedSamples(simulation, followed(simulation, recording))
    found = tracks_of_blocks(checked, scene, simulation.layout, options.b)
    warn(lines_of(checked.findings))
    start = float(recording.times[0])
    first = shown_offset(start)
    note([f"{options.b} starts as the scene says, at the first pose, t = {first}"])
    for track in found.bodies.values():
        track.t = track.t + start
    found.reactions = {n: w._replace(t=w.t + start) for n, w in found.reactions.items()}
    return found


def _print(report: dict[str, Any]) -> None:
    from rb_sim.bags.compare import UNITS

    print(_clocks(report))
    start = report["start"]
    if start:
        print(f"t from {start:.6f} s on")
    heads = (
        *("of", "", "RMS", "largest", "at t [s]"),
        *("interpolation", "apart from t [s]", "growth [1/s]"),
    )
    rows = []
    for name, quantities in report["differences"].items():
        for quantity, row in quantities.items():
            unit = UNITS[quantity]
            since = "never" if row["first_above"] is None else f"{row['first_above'] - start:.6g}"
            growth = "" if row["growth"] is None else f"{row['growth']:.3g}"
            uncertainty = f"{row['interpolation']:.2g}" if row["interpolation"] else ""
            rows.append((name, f"{quantity} [{unit}]", f"{row['rms']:.3g}", f"{row['max']:.3g}",
                         f"{row['at'] - start:.6g}", uncertainty, since, growth))  # fmt: skip
    table = columns(heads, rows, names=heads[:2], folded=(heads[0], *heads[2:]))
    plain_console(highlight=False).print(table)


def _clocks(report: dict[str, Any]) -> str:
    """One line on the alignment of the two clocks."""
    from rb_sim.bags.compare import shown_offset

    if report["align"] == "none":
        return "clocks: as recorded (--align first, offset or clock shifts the second)"
    offset = f"offset {shown_offset(report['offset'])}"
    if report["align"] == "first":
        return f"clocks: first stamps together, {offset}"
    offset += f" +- {report['offset_error']:.1g} s"
    if report["align"] == "offset":
        return f"clocks: {offset}, estimated from the motions"
    drift = f"drift {report['drift']:.2g} +- {report['drift_error']:.1g}"
    return f"clocks: {offset} and {drift} (at most 1e-4), estimated from the motions"


def _write(folder: Path, report: dict[str, Any], found: Differences, a: Tracks, b: Tracks) -> None:
    from rb_sim.bags.comparison_views import overlay, picture
    from rb_sim.simulation.outputs import writing

    written = ["compare.json", "compare.png"]
    with writing(folder):
        write_json(report, folder / "compare.json")
        picture(found, a, b, folder / "compare.png")
        try:
            overlay(a, b, found, folder / "compare.rrd")
            written.append("compare.rrd")
        except MissingExtraError as error:
            print(f"note: no compare.rrd: {error}")
    print(f"wrote {', '.join(str(folder / name) for name in written)}")


def _draw(picture: Path, found: Differences, a: Tracks, b: Tracks) -> None:
    """Save a picture of both motions, as the viewer shows them. Raises SinkError,
    MissingExtraError."""
    from rb_sim.bags.comparison_views import overlay
    from rb_sim.io.rerun.viewer import save_screenshot

    with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
        recording = Path(folder) / "compare.rrd"
        overlay(a, b, found, recording)
        save_screenshot(recording, picture)
    print(f"wrote {picture}")
