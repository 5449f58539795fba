# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recorder of samples for the Rerun viewer (3D view and plots) in one .rrd file.

Rows are collected and sent in columns, at most ROWS at a time, so that memory is bounded. Contents
and layout are in `view`.
"""

from __future__ import annotations

import os
import threading
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import MissingExtraError, SinkError
from rb_sim.mechanics.samples import SampleBlock, concatenate

if TYPE_CHECKING:
    from rb_sim.io.rerun.view import View
    from rb_sim.mechanics.samples import SampleLayout
    from rb_sim.scene.schema import Scene


# Output file for a writer that cannot handle disk errors.
#
# Rerun may block forever after a failed write. So it writes to a pipe, and a thread copies the
# bytes to the file. If that fails, the thread keeps the error and continues to read.


_PIECE = 1 << 16


class PipedFile:
    """A file written through a pipe; created or replaced. Raises OSError if that is impossible.

    name: path for the writer to open; call `opened` afterwards. error: error at which the file
    ends, or None.
    """

    def __init__(self, path: Path) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
        self._file = os.open(path, flags, 0o666)
        self._source, self._sink = os.pipe()
        self.name = f"/dev/fd/{self._sink}"
        self.error: OSError | None = None
        # a daemon, so that a process can exit without closing; data written at exit are still read
        self._thread = threading.Thread(target=self._move, name="rb_sim recording", daemon=True)
        self._thread.start()

    def opened(self) -> None:
        """Tell that the writer has opened the pipe: its closing now ends the file."""
        os.close(self._sink)

    @property
    def vanished(self) -> bool:
        """True if the file was deleted. Invalid after `wait`."""
        return os.fstat(self._file).st_nlink == 0

    def wait(self) -> None:
        """Wait until all data of the writer are in the file, and close it."""
        self._thread.join()
        os.close(self._file)

    def _move(self) -> None:
        while data := os.read(self._source, _PIECE):
            if self.error is None:
                try:
                    self._append(data)
                except OSError as error:
                    self.error = error
        os.close(self._source)

    def _append(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._file, rest) :]


ROWS = 4096
"""Samples per flush, unless PERIOD comes first."""

PERIOD = 2.0
"""[s] of wall-clock time after which samples are written, so that a live viewer shows them."""

quiet = partial(np.errstate, all="ignore")
"""Suppresses numpy's warnings of overflow in Rerun's single precision, for diverging runs."""


class RerunSink:
    """Writes one .rrd file; replaces an older one. motion_only: show only the 3D view.

    Raises MissingExtraError without rerun-sdk; `open` and `write` raise SinkError if the file
    cannot be written, is deleted, or the disk is full. The recording is then closed and readable up
    to that point.
    """

    def __init__(self, path: Path, *, motion_only: bool = False) -> None:
        self.path = Path(path)
        self._motion_only = motion_only
        self._rerun = _load_rerun()
        self._recording: Any = None
        self._view: View | None = None
        self._blocks: list[SampleBlock] = []
        self._rows = 0

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the file. The first samples later determine the scale of the 3D view."""
        self._scene, self._layout = scene, layout
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = PipedFile(self.path)
        except OSError as error:
            raise SinkError(f"{self.path}: cannot record here: {error.strerror}") from None
        self._recording = self._rerun.RecordingStream("rb_sim")
        self._recording.save(self._file.name)
        self._file.opened()
        self._flushed = time.monotonic()

    def write(self, block: SampleBlock) -> None:
        """Add the samples of `block`; they are written to the file periodically."""
        if self._recording is None:
            raise SinkError(f"{self.path}: the recording is closed")
        if not len(block):
            return
        self._blocks.append(concatenate([block], self._layout))  # the caller may reuse its arrays
        self._rows += len(block)
        if self._rows >= ROWS or time.monotonic() - self._flushed > PERIOD:
            self._flush()

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Write the remaining samples and the trails. Raises SinkError as `write` does."""
        if self._recording is None:
            return
        self._flush()
        if self._view is not None:
            with quiet():
                self._view.finish(summary)
        self._end()
        self._check_written()

    def _flush(self) -> None:
        """Write the collected samples."""
        self._flushed = time.monotonic()
        blocks, self._blocks, self._rows = self._blocks, [], 0
        if not blocks:
            return
        if self._file.vanished:
            self._end()
            raise SinkError(f"{self.path}: the recording was removed while it was written")
        block = concatenate(blocks, self._layout)
        with quiet():
            if self._view is None:
                self._view = self._begin(block)
            self._view.send(block)
        self._recording.flush()
        self._check_written()

    def _begin(self, first: SampleBlock) -> View:
        from rb_sim.io.rerun.view import View

        return View(self._recording, self._scene, self._layout, first, self._motion_only)

    def _check_written(self) -> None:
        error = self._file.error
        if error is not None:
            self._end()
            raise SinkError(f"{self.path}: recording stopped: {error.strerror}")

    def _end(self) -> None:
        """Close the file, if it is open."""
        recording, self._recording = self._recording, None
        if recording is not None:
            recording.disconnect()
            self._file.wait()


def _load_rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise MissingExtraError("rerun-sdk", "rerun", "a recording for Rerun") from None
    return rerun
