"""The records of an MCAP file with their checksums checked, and what of the file is broken.

A chunk whose checksum is wrong is skipped. Where even the lengths are broken, reading goes on at
the next record that the file's own index names; without an index, at the next chunk that is whole.
"""

from __future__ import annotations

import re
import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from rb_sim.errors import SinkError
from rb_sim.sinks.bag_index import FRAME, ChunkPlace, Index, parse_index

_CHUNK = struct.Struct("<QQQII")
_INDEX = struct.Struct("<HI")
_INDEX_HEAD = struct.Struct("<BQHI")
_LENGTH = struct.Struct("<Q")
_FOOTER_SIZE = FRAME.size + 20
_LAST_OPCODE, _FIRST_PRIVATE = int(Opcode.DATA_END), 0x80
_WINDOW = 1 << 20
_KEPT = 1 << 18
"""Bytes that are read at once: records are many and small, calls of the file dear."""
_CHUNK_HEAD = re.compile(rb"\x06.{5}\x00\x00\x00", re.DOTALL)
"""A chunk of less than 2^40 bytes."""

WRONG_CHECKSUM = "its checksum is wrong"
NO_DECOMPRESSOR = "its compression is none of zstd and lz4"
NO_RECORD = "no record can be read there"
CUT_OFF = "the file is cut off"
BROKEN_INDEX = "its index is broken"
NO_CHANNEL = "messages whose topic stood in a broken part"


class Damage(NamedTuple):
    """A part of a file that cannot be read.

    offset, end: [bytes]; reason: one of the texts above.
    after, before: log times between which messages are missing [ns]; None: not known.
    """

    offset: int
    end: int
    reason: str
    after: int | None = None
    before: int | None = None


class Frame(NamedTuple):
    """One record: the content; of a chunk the checked records in it, with its log times [ns]."""

    offset: int
    opcode: int
    content: bytes
    start: int = 0
    end: int = 0
    checked: bool = True
    """False: a chunk that carries no checksum."""


class Frames:
    """Iterates once over the whole records of the data section; `damages` is then complete.

    Raises SinkError for a file that is no MCAP or cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damages: list[Damage] = []
        self.unchecked = 0
        """chunks without a checksum."""
        self.chunks = 0
        """whole chunks so far."""
        self._kept, self._kept_from = b"", 0
        try:
            self._file: BinaryIO = path.open("rb")
        except OSError as error:
            raise SinkError(f"{path}: {error.strerror}") from None
        self.size = path.stat().st_size
        if self._at(0, len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            self._file.close()
            raise SinkError(f"{path}: not an MCAP file")
        magic = len(MCAP0_MAGIC)
        self.complete = self.size >= 2 * magic and self._at(self.size - magic, magic) == MCAP0_MAGIC
        """the file ends as a finished one does."""
        self.index = self._read_index() if self.complete else None
        self._last_time: int | None = None
        self._open: list[Damage] = []  # of which the first log time after it is not known yet

    def __iter__(self) -> Iterator[Frame]:
        with self._file:
            yield from self._walk()
        self.damages += self._open

    def named(self) -> Iterator[Frame]:
        """The records that the index names, but for chunks; instead of iterating over all."""
        assert self.index is not None
        with self._file:
            for at in self.index.offsets[:-1]:
                opcode, length = self._head(at)
                if opcode != Opcode.CHUNK and length <= self.size - at:
                    yield Frame(at, opcode, self._at(at + FRAME.size, length))

    def _walk(self) -> Iterator[Frame]:
        at, finished = len(MCAP0_MAGIC), False
        while at < self.size:
            opcode, length = self._head(at)
            if opcode == Opcode.DATA_END and length == 4:
                finished = True
                break
            reason, frame = self._read(at, opcode, length)
            if frame is not None:
                self._note_times(frame)
                yield frame
            if reason in (None, WRONG_CHECKSUM, NO_DECOMPRESSOR):
                end = self._past_indices(at + FRAME.size + length)
            else:
                end = self._resume(at + 1)
            if reason is not None:
                begins = self._begin_of(at, opcode) if reason == CUT_OFF else None
                self._note_damage(at, end, reason, begins)
            at = end
        if not finished and not self._open:
            self._note_damage(self.size, self.size, CUT_OFF)
        if self.complete and self.index is None and not self._unindexed():
            self._open.append(Damage(self.size, self.size, BROKEN_INDEX))

    def _at(self, offset: int, size: int) -> bytes:
        first = offset - self._kept_from
        if first < 0 or first + size > len(self._kept):
            self._file.seek(offset)
            if size >= _KEPT:
                return self._file.read(size)
            self._kept, self._kept_from, first = self._file.read(_KEPT), offset, 0
        return self._kept[first : first + size]

    def _head(self, at: int) -> tuple[int, int]:
        head = self._at(at, FRAME.size)
        return FRAME.unpack(head) if len(head) == FRAME.size else (0, 0)

    def _read(self, at: int, opcode: int, length: int) -> tuple[str | None, Frame | None]:
        """What is wrong with the record at `at`, and the record if nothing is."""
        if not 1 <= opcode <= _LAST_OPCODE and opcode < _FIRST_PRIVATE:
            return NO_RECORD, None
        if length > self.size - at - FRAME.size:
            return (NO_RECORD if self.complete else CUT_OFF), None
        if opcode == Opcode.MESSAGE_INDEX:
            head = self._at(at + FRAME.size, _INDEX.size)
            whole = length >= _INDEX.size and _INDEX.unpack(head)[1] == length - _INDEX.size
            return (None if whole else NO_RECORD), None
        content = self._at(at + FRAME.size, length)
        if opcode == Opcode.CHUNK:
            return self._open_chunk(at, content)
        return None, Frame(at, opcode, content)

    def _past_indices(self, at: int) -> int:
        """The end of the whole message indices from `at` on: most of the records of a file."""
        self._at(at, _INDEX_HEAD.size)
        kept, room = self._kept, self.size - self._kept_from
        here = at - self._kept_from
        while 0 <= here <= len(kept) - _INDEX_HEAD.size:
            opcode, length, _, entries = _INDEX_HEAD.unpack_from(kept, here)
            end = here + FRAME.size + length
            if opcode != Opcode.MESSAGE_INDEX or entries != length - _INDEX.size or end > room:
                break
            here = end
        return self._kept_from + here

    def _open_chunk(self, at: int, content: bytes) -> tuple[str | None, Frame | None]:
        if not _is_chunk(content):
            return NO_RECORD, None
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(content)))
            if chunk.compression not in ("", "zstd", "lz4"):
                return NO_DECOMPRESSOR, None
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            data = stream.read(size)
        except Exception:  # decompressors and checksums fail with classes of their own
            return WRONG_CHECKSUM, None
        if size != chunk.uncompressed_size:
            return WRONG_CHECKSUM, None
        self.chunks += 1
        checked = chunk.uncompressed_crc != 0
        self.unchecked += not checked
        start, end = chunk.message_start_time, chunk.message_end_time
        return None, Frame(at, Opcode.CHUNK, data, start, end, checked)

    def _note_times(self, frame: Frame) -> None:
        """Close the gaps before this chunk."""
        if frame.opcode == Opcode.CHUNK and frame.end:
            self.damages += [gap._replace(before=gap.before or frame.start) for gap in self._open]
            self._open = []
            self._last_time = frame.end

    def _begin_of(self, at: int, opcode: int) -> int | None:
        """Log time of the first message of a chunk of which only the beginning is there [ns]."""
        head = self._at(at + FRAME.size, _LENGTH.size) if opcode == Opcode.CHUNK else b""
        return _LENGTH.unpack(head)[0] if len(head) == _LENGTH.size else None

    def _note_damage(self, offset: int, end: int, reason: str, begins: int | None = None) -> None:
        """begins: log time from which messages are missing where none before it is there."""
        lost = [] if self.index is None else self._indexed(offset, end)
        known = begins if self._last_time is None else self._last_time
        after = min((c.message_start_time for c in lost), default=known)
        before = max((c.message_end_time for c in lost), default=None)
        if self.index is not None and not lost:
            # the index knows of no chunk there: no message is missing
            after = before = None
            self.damages.append(Damage(offset, end, reason))
            return
        self._open.append(Damage(offset, end, reason, after, before))

    def _indexed(self, offset: int, end: int) -> list[ChunkPlace]:
        assert self.index is not None
        return [c for at, c in self.index.chunks.items() if offset <= at < end]

    def _resume(self, at: int) -> int:
        """Where to read on after `at`; the end of the file if nowhere."""
        if self.index is not None:
            k = bisect_right(self.index.offsets, at - 1)
            return self.index.offsets[k] if k < len(self.index.offsets) else self.size
        while at < self.size:
            window = self._at(at, _WINDOW + FRAME.size)
            for match in _CHUNK_HEAD.finditer(window):
                if self._whole_chunk(at + match.start()):
                    return at + match.start()
            at += _WINDOW
        return self.size

    def _whole_chunk(self, at: int) -> bool:
        _, length = self._head(at)
        if length > self.size - at - FRAME.size:
            return False
        start = self._at(at + FRAME.size, 64)
        return _is_chunk(start, length)

    def _unindexed(self) -> bool:
        """No index was written, or none that can be checked: rosbags gives no checksum."""
        at = max(0, self.size - len(MCAP0_MAGIC) - _FOOTER_SIZE)
        if self._head(at) != (Opcode.FOOTER, 20):
            return False
        with self.path.open("rb") as file:
            file.seek(at + FRAME.size)
            footer = Footer.read(ReadDataStream(BytesIO(file.read(20))))
        return footer.summary_start == 0 or footer.summary_crc == 0

    def _read_index(self) -> Index | None:
        at = max(0, self.size - len(MCAP0_MAGIC) - _FOOTER_SIZE)
        opcode, length = self._head(at)
        if opcode != Opcode.FOOTER or length != 20:
            return None
        footer = Footer.read(ReadDataStream(BytesIO(self._at(at + FRAME.size, 20))))
        start = footer.summary_start
        if not (start and footer.summary_crc and len(MCAP0_MAGIC) < start <= at):
            return None
        summary = self._at(start, at - start)
        tail = self._at(at, _FOOTER_SIZE - 4)
        if zlib.crc32(tail, zlib.crc32(summary)) != footer.summary_crc:
            return None
        try:
            return parse_index(summary, start)
        except Exception:  # a checksum that is right over content that is not
            return None


def _is_chunk(content: bytes, size: int | None = None) -> bool:
    """True if the lengths within a chunk's content (or its beginning) add up to its size."""
    size = len(content) if size is None else size
    if len(content) < _CHUNK.size:
        return False
    *_, name = _CHUNK.unpack_from(content)
    at = _CHUNK.size + name
    if name > 8 or at + _LENGTH.size > len(content):
        return False
    return at + _LENGTH.size + _LENGTH.unpack_from(content, at)[0] == size
