"""Records samples for the Rerun viewer: a 3D view and plots, in one .rrd file.

Rows are collected and sent in columns, at most ROWS at a time, so memory does not grow. What is
drawn and how the viewer is laid out is in `rerun_view`.
"""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.engine.samples import SampleBlock, concatenate
from rb_sim.errors import MissingExtraError, SinkError

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleLayout
    from rb_sim.scene.schema import Scene
    from rb_sim.sinks.rerun_view import View

ROWS = 4096
"""Samples per flush, unless PERIOD comes first."""

PERIOD = 2.0
"""Seconds of real time after which samples go to the file, so that a live viewer sees them."""

ROOM = 1 << 20
"""Free space that is kept, so that the file can be ended properly [bytes]."""

BYTES_PER_ROW = 1024
"""Generous estimate for one body."""


class RerunSink:
    """Writes one .rrd file; replaces an older one.

    Raises MissingExtraError where rerun-sdk is not installed; SinkError from `open` and `write`
    where the file cannot be written, is removed or the disk is full. The recording is closed then
    and can be viewed up to there.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._rerun = _load_rerun()
        self._recording: Any = None
        self._view: View | None = None
        self._blocks: list[SampleBlock] = []
        self._rows = 0

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the file. The 3D view is set up with the first samples, which give its scale."""
        self._scene, self._layout = scene, layout
        self._recording = self._rerun.RecordingStream("rb_sim")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.path.open("wb").close()
            self._recording.save(self.path)
        except (OSError, RuntimeError) as error:
            self._recording = None
            reason = getattr(error, "strerror", None) or str(error).splitlines()[0]
            raise SinkError(f"{self.path}: cannot record here: {reason}") from None
        self._flushed = time.monotonic()

    def write(self, block: SampleBlock) -> None:
        """Take the samples of `block`; every so often they go to the file."""
        if self._recording is None:
            raise SinkError(f"{self.path}: the recording is closed")
        if not len(block):
            return
        self._blocks.append(concatenate([block], self._layout))  # the caller may reuse its arrays
        self._rows += len(block)
        if self._rows >= ROWS or time.monotonic() - self._flushed > PERIOD:
            self._flush()

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Write the rest and the trails. Raises SinkError as `write` does."""
        if self._recording is None:
            return
        self._flush()
        if self._view is not None:
            try:
                self._view.finish(summary)
                self._recording.flush()
            except RuntimeError as error:
                self._end()
                raise SinkError(f"{self.path}: not ended properly: {error}") from None
        self._end()

    def _flush(self) -> None:
        """Send what was collected and have it written."""
        self._flushed = time.monotonic()
        blocks, self._blocks, self._rows = self._blocks, [], 0
        if not blocks:
            return
        self._check_room(sum(len(block) for block in blocks))
        block = concatenate(blocks, self._layout)
        try:
            if self._view is None:
                self._view = self._begin(block)
            self._view.send(block)
            self._recording.flush()
        except RuntimeError as error:  # what rerun raises where the file cannot be written
            self._end()
            raise SinkError(f"{self.path}: recording stopped: {error}") from None

    def _begin(self, first: SampleBlock) -> View:
        from rb_sim.sinks.rerun_view import View

        return View(self._recording, self._scene, self._layout, first)

    def _check_room(self, rows: int) -> None:
        """Stop while the file can still be ended."""
        if not self.path.exists():
            self._end()
            raise SinkError(f"{self.path}: the recording was removed while it was written")
        need = ROOM + rows * BYTES_PER_ROW * max(1, len(self._layout.bodies))
        if shutil.disk_usage(self.path.parent).free < need:
            self._end()
            raise SinkError(f"{self.path}: disk full; the recording ends here")

    def _end(self) -> None:
        """Close the file."""
        recording, self._recording = self._recording, None
        try:
            recording.disconnect()
        except RuntimeError:  # the reason was given when it was found
            return


def _load_rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise MissingExtraError("rerun-sdk", "rerun", "a recording for Rerun") from None
    return rerun
