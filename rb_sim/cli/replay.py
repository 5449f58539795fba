"""`rb_sim replay` and `rb_sim recover`: what was recorded, to look at again."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rb_sim.errors import RbSimError, SinkError

if TYPE_CHECKING:
    from rb_sim.sinks.bag_reader import BagReader


MOST_RATE = 1e4
"""Of playing, in simulated seconds per second, as for the node."""


def replay(bag: Path, save: Path | None = None, screenshot: Path | None = None) -> None:
    """Show a recorded bag in the Rerun viewer, or save it as .rrd, or as a picture, or both.

    bag: directory or .mcap file that rb_sim recorded.
    Raises SinkError: no such bag, unfinished, not of rb_sim, wrong ending, nothing to draw with;
    MissingExtraError without rerun-sdk.
    """
    from rb_sim.sinks.bag_reader import BagReader
    from rb_sim.sinks.rerun_screenshot import save_screenshot
    from rb_sim.sinks.rerun_window import show

    _check_ending(save, ".rrd")
    _check_ending(screenshot, ".png")
    reader = BagReader(bag)
    with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
        recording = save or Path(folder) / f"{reader.scene.name}.rrd"
        convert(reader, recording)
        warn(reader.damage)
        if screenshot is not None:
            save_screenshot(recording, screenshot)
        if save is None and screenshot is None:
            show(recording)
    for path in (save, screenshot):
        if path is not None:
            print(f"wrote {path}")


@dataclass(frozen=True)
class PlayOptions:
    """What the command line says of `--publish`; None: not given."""

    rate: float | None = None
    loop: bool = False
    start: float | None = None

    def refuse(self) -> None:
        """Raise RbSimError if one of them was given without `--publish`."""
        given = {"--rate": self.rate is not None, "--loop": self.loop,
                 "--start": self.start is not None}  # fmt: skip
        for name, there in given.items():
            if there:
                raise RbSimError(f"{name}: only with --publish")


def play(bag: Path, options: PlayOptions, *, alone: bool = True) -> int:
    """Play a recorded bag over DDS; 0. alone: no file is to be written beside.

    Raises RbSimError: bad options, no rclpy, no such bag, not of rb_sim, nothing to play.
    """
    if not alone:
        raise RbSimError("--publish: not with --save or --screenshot")
    rate = 1.0 if options.rate is None else options.rate
    start = 0.0 if options.start is None else options.start
    if not 0.0 <= rate <= MOST_RATE:
        raise RbSimError(f"--rate: got {rate:g}; must be from 0 (no pacing) to {MOST_RATE:g}")
    if not 0.0 <= start < float("inf"):
        raise RbSimError(f"--start: got {start:g}; must be a time >= 0 [s]")
    from rb_sim.ros.main import need_rclpy
    from rb_sim.sinks.bag_reader import BagReader

    need_rclpy()
    from rb_sim.ros.replay import Playing, publish

    reader = BagReader(bag)
    code = publish(reader, Playing(rate, options.loop, start))
    warn(reader.damage)
    return code


def recover(bag: Path, directory: Path | None = None) -> None:
    """Make a readable bag of one that was never finished, beside it or in `directory`.

    Raises SinkError as `recover_bag` does.
    """
    from rb_sim.sinks.recover import recover_bag

    result = recover_bag(bag, directory)
    what = "the bag was complete" if result.complete else "all that could be read of it"
    print(f"wrote {result.directory}: {result.messages} messages, {what}")
    warn(result.damage)


def warn(lines: Iterable[str]) -> None:
    """Say what is missing in a bag."""
    for line in lines:
        print(f"warning: {line}", file=sys.stderr, flush=True)


def _check_ending(path: Path | None, ending: str) -> None:
    if path is not None and path.suffix != ending:
        raise SinkError(f"{path}: the name must end in {ending}")


def convert(reader: BagReader, recording: Path) -> None:
    """Write the samples of a bag as a recording for the viewer (.rrd). Raises SinkError."""
    from rb_sim.sinks.rerun import RerunSink

    sink = RerunSink(recording)
    sink.open(reader.scene, reader.layout)  # type: ignore[arg-type]  # has all that a sink reads
    for block in reader.blocks():
        sink.write(block)
    sink.close(reader.summary)
