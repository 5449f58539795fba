# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Records samples for the Rerun viewer: a 3D view and plots, in one .rrd file.

Rows are collected and sent in columns, at most ROWS at a time, so memory does not grow. What is
drawn and how the viewer is laid out is in `view`.
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


# A file for a writer that cannot cope with a failing disk.
#
# Rerun may wait for ever once a write of its own has failed. So it gets the end of a pipe, and a
# thread here moves the bytes into the file. When that fails it keeps the reason and goes on
# reading: the writer never notices.


_PIECE = 1 << 16


class PipedFile:
    """Creates or replaces the file. Raises OSError where that is impossible.

    name: path for the writer to open; call `opened` when it has.
    error: why the file could not be written on, or None. It then ends with what came before.
    """

    def __init__(self, path: Path) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
        self._file = os.open(path, flags, 0o666)
        self._source, self._sink = os.pipe()
        self.name = f"/dev/fd/{self._sink}"
        self.error: OSError | None = None
        # a daemon, so that a process can end without closing; what the writer sends at exit is read
        self._thread = threading.Thread(target=self._move, name="rb_sim recording", daemon=True)
        self._thread.start()

    def opened(self) -> None:
        """The writer holds the pipe now: its closing is the end."""
        os.close(self._sink)

    @property
    def vanished(self) -> bool:
        """True if the file was removed. Ask before `wait`."""
        return os.fstat(self._file).st_nlink == 0

    @property
    def free(self) -> int:
        """Space on its disk [bytes]. Ask before `wait`."""
        disk = os.fstatvfs(self._file)
        return disk.f_bavail * disk.f_frsize

    def wait(self) -> None:
        """Return when everything up to the writer's end is in the file, and close it."""
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
"""Seconds of real time after which samples go to the file, so that a live viewer sees them."""

ROOM = 1 << 20
"""Free space that is kept, so that the file can be ended properly [bytes]."""

BYTES_PER_ROW = 1024
"""Generous estimate for one body."""


quiet = partial(np.errstate, all="ignore")
"""While samples go to Rerun, which has single precision: a run that blows up has none so large."""


class RerunSink:
    """Writes one .rrd file; replaces an older one. motion_only: shown is the 3D view alone.

    Raises MissingExtraError where rerun-sdk is not installed; SinkError from `open` and `write`
    where the file cannot be written, is removed or the disk is full. The recording is closed then
    and can be viewed up to there.
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
        """Create the file. The 3D view is set up with the first samples, which give its scale."""
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
            with quiet():
                self._view.finish(summary)
        self._end()
        self._check_written()

    def _flush(self) -> None:
        """Send what was collected."""
        self._flushed = time.monotonic()
        blocks, self._blocks, self._rows = self._blocks, [], 0
        if not blocks:
            return
        self._check_room(sum(len(block) for block in blocks))
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

    def _check_room(self, rows: int) -> None:
        """Stop while the file can still be ended."""
        if self._file.vanished:
            self._end()
            raise SinkError(f"{self.path}: the recording was removed while it was written")
        need = ROOM + rows * BYTES_PER_ROW * max(1, len(self._layout.bodies))
        if self._file.free < need:
            self._end()
            raise SinkError(f"{self.path}: disk full; the recording ends here")

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
