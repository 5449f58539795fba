"""The file below a bag: appends whole records, and says when it cannot.

A disk that fills up leaves a bag without its index. So a little space is kept from the start and
given back then: enough to finish the file.
"""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

RESERVE = 1 << 20
"""Space kept for the open chunk and the index [bytes]: the index of about 1 GB of samples."""

_FULL = (errno.ENOSPC, errno.EDQUOT)


class BagStream:
    """A locked file that grows by whole writes, unbuffered: what was written survives a crash.

    full: True as soon as the disk was found full; what is written then comes from the reserve.
    Raises OSError where it cannot be opened, or written even so; BlockingIOError if another
    process is writing it.
    """

    def __init__(self, path: Path, reserve: int = RESERVE) -> None:
        self.full = False
        self._position = 0
        self._draft_end = 0
        self._reserve = path.with_name(f".{path.name}.reserve")
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.ftruncate(self._file, 0)
            self._keep(reserve)
        except OSError:
            self.close()
            raise

    def _keep(self, size: int) -> None:
        file = os.open(self._reserve, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            if size:
                os.posix_fallocate(file, 0, size)
        finally:
            os.close(file)

    def write(self, data: bytes) -> int:
        """Append all of `data` or, raising OSError, nothing."""
        start = self._position
        try:
            self._append(data)
        except OSError as error:
            self._rewind(start)
            if error.errno not in _FULL or self.full:
                raise
            self.full = True
            self._reserve.unlink(missing_ok=True)
            try:
                self._append(data)
            except OSError:
                self._rewind(start)
                raise
        return len(data)

    def write_draft(self, data: bytes) -> None:
        """Put `data` at the end of the file, where the next write goes over it.

        Where there is no room it is left out: a draft is worth no space kept for better things.
        """
        try:
            written = os.pwrite(self._file, data, self._position)
        except OSError:
            written = 0
        self._draft_end = max(self._draft_end, self._position + written)
        if written < len(data):
            self._drop_draft()

    def _append(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            written = os.write(self._file, rest)
            self._position += written
            rest = rest[written:]
        self._drop_draft()

    def _drop_draft(self) -> None:
        """Cut off what is left of a draft behind the last write."""
        if self._draft_end > self._position:
            os.ftruncate(self._file, self._position)
        self._draft_end = 0

    def _rewind(self, position: int) -> None:
        os.ftruncate(self._file, position)
        os.lseek(self._file, position, os.SEEK_SET)
        self._position = position
        self._draft_end = 0

    def tell(self) -> int:
        """Bytes written."""
        return self._position

    def flush(self) -> None:
        """Nothing is buffered."""

    @property
    def vanished(self) -> bool:
        """True if the file was removed, so that writing on would be for nobody."""
        return os.fstat(self._file).st_nlink == 0

    def close(self) -> None:
        """Release the file and the reserve; a second time does nothing."""
        if self._file >= 0:
            self._reserve.unlink(missing_ok=True)
            os.close(self._file)
            self._file = -1
