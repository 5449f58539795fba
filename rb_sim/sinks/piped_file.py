"""A file for a writer that cannot cope with a failing disk.

Rerun may wait for ever once a write of its own has failed. So it gets the end of a pipe, and a
thread here moves the bytes into the file. When that fails it keeps the reason and goes on reading:
the writer never notices.
"""

from __future__ import annotations

import os
import threading
from pathlib import Path

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
