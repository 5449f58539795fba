"""`rb_sim replay` and `rb_sim recover`: what was recorded, to look at again."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rb_sim.errors import SinkError

if TYPE_CHECKING:
    from rb_sim.sinks.bag_reader import BagReader


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
