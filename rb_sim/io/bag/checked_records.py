# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Records of an MCAP file with verified checksums, and the damage found.

A chunk with a wrong checksum is skipped. If even the lengths are broken, reading resumes at the
next record in the file's index; without an index at the next intact chunk; in a file with messages
outside of chunks at the next such message (`records.Unchecked`).
"""

from __future__ import annotations

import re
import struct
from bisect import bisect_right
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from rb_sim.base.errors import SinkError
from rb_sim.io.bag.records import (
    FRAME,
    INDEX_HEAD,
    MESSAGE_HEAD,
    NO_SUMMARY,
    ChunkPlace,
    Unchecked,
    offsets,
    past_indices,
    read_summary,
)

# Kinds of damage, and their messages.


NO_RECORD = "unreadable record"
CUT_OFF = "the file is cut off"
BROKEN_INDEX = "its index is broken"
WRONG_TIMES = "its times or its index are not those of its messages"
OTHER_COUNT = "its count of messages is wrong"
ONE_LENGTH = "one of its two lengths is broken, and the other was read"
OTHER_NAME = "its name is damaged and was taken from the index"
NO_CHANNEL = "messages of a topic whose record is damaged"
BROKEN_DATABASE = "damaged: the database cannot be read any further"
JOURNAL = "its recorder was killed; messages in its journal (-wal) are not read"


class Damage(NamedTuple):
    """An unreadable part of a file.

    offset, end: [bytes]; reason: one of the texts above. after, before: log times between which
    messages are missing [ns]; None: unknown.
    """

    offset: int
    end: int
    reason: str
    after: int | None = None
    before: int | None = None


class Missing(NamedTuple):
    """Unreadable parts of a bag file."""

    path: Path
    damages: list[Damage]
    messages: int | None
    """number of missing messages; None: unknown."""
    start: int | None
    """log time of the first message read [ns]."""

    @property
    def within(self) -> bool:
        """Whether messages are missing between messages that were read."""
        return any(d.after is not None and d.before is not None for d in self.damages)

    def lines(self) -> list[str]:
        """One line for each damaged part, with times in seconds since the first message."""
        lost = "" if not self.messages else f"; {self.messages} messages are missing in all"
        texts = [f"{self.path}: {self._line(damage)}" for damage in self.damages]
        return [text + (lost if k == len(texts) - 1 else "") for k, text in enumerate(texts)]

    def _line(self, damage: Damage) -> str:
        if damage.reason == BROKEN_INDEX:
            return f"damaged: {damage.reason}, and is not used; the messages are read without it"
        if damage.reason == OTHER_COUNT:
            return f"damaged: {damage.reason}, and no checksum shows which is right"
        where = f"damaged at byte {damage.offset}: {damage.reason}"
        if damage.reason in (NO_CHANNEL, BROKEN_DATABASE, JOURNAL):
            where = damage.reason
        if damage.after is None and damage.before is None:
            return f"{where}; no known message is missing there"
        return f"{where}; messages missing {self._between(damage)}"

    def _between(self, damage: Damage) -> str:
        if damage.before is None:
            return f"after t = {self._seconds(damage.after)} s of the bag"
        if damage.after is None:
            return f"before t = {self._seconds(damage.before)} s of the bag"
        first, last = self._seconds(damage.after), self._seconds(damage.before)
        return f"between t = {first} s and t = {last} s of the bag"

    def _seconds(self, time: int | None) -> str:
        first = time if self.start is None else self.start  # if nothing was read, time starts here
        return f"{((time or 0) - (first or 0)) * 1e-9:.9g}"


# Reading of single records and chunks.


CHUNK = int(Opcode.CHUNK)
_HEAD = struct.Struct("<QQQII")
_LENGTH = struct.Struct("<Q")
SHORTEST_HEAD = _HEAD.size + _LENGTH.size
LONGEST_HEAD = SHORTEST_HEAD + 8
"""Bytes before the records of a chunk: at least SHORTEST_HEAD, at most LONGEST_HEAD."""

WRONG_CHECKSUM = "its checksum is wrong"
NOT_DECOMPRESSED = "it cannot be decompressed"
NO_DECOMPRESSOR = "its compression is neither zstd nor lz4"
REASONS = (WRONG_CHECKSUM, NOT_DECOMPRESSED, NO_DECOMPRESSOR)


class Frame(NamedTuple):
    """One record: its content; for a chunk the decompressed records, with its log times [ns]."""

    offset: int
    opcode: int
    content: bytes
    start: int = 0
    end: int = 0
    checked: bool = True
    """False: a chunk without a checksum."""
    compressed: bool = False
    inside: int = 0
    """offset of the records of an uncompressed chunk in the file [bytes]."""
    indices: bytes = b""
    """message indices behind a chunk without a checksum."""
    missing: int = 0
    """number of bytes missing at the end of a truncated chunk."""


def declared_size(content: bytes) -> int | None:
    """Size of a chunk's content according to the lengths within it; None if it is not a chunk.

    content: the whole or its first LONGEST_HEAD bytes.
    """
    if len(content) < _HEAD.size:
        return None
    *_, name = _HEAD.unpack_from(content)
    at = _HEAD.size + name
    if name > 8 or at + _LENGTH.size > len(content):
        return None
    return at + _LENGTH.size + _LENGTH.unpack_from(content, at)[0]


def open_chunk(offset: int, content: bytes, *, missing: int = 0) -> Frame | str:
    """The chunk at `offset` with this content, or the reason why it cannot be read.

    missing: number of bytes truncated at its end; then only uncompressed data can be read,
    unchecked.
    """
    start, end, size, checksum, name = _HEAD.unpack_from(content)
    head = _HEAD.size + name + _LENGTH.size
    compression = content[_HEAD.size : _HEAD.size + name].decode(errors="replace")
    if compression not in ("", "zstd", "lz4"):
        return NO_DECOMPRESSOR
    inside = offset + FRAME.size + head
    if missing:
        if compression:
            return NOT_DECOMPRESSED
        data = content[head:]
        return Frame(offset, CHUNK, data, start, end, False, inside=inside, missing=missing)
    chunk = Chunk(compression, content[head:], end, start, checksum, size)
    try:
        stream, found = get_chunk_data_stream(chunk, validate_crc=True)
        data = stream.read(found)
    except Exception:  # decompressors and checksums fail with classes of their own
        found = None
    if found != size:
        return WRONG_CHECKSUM if checksum else NOT_DECOMPRESSED
    return Frame(offset, CHUNK, data, start, end, checksum != 0, bool(compression), inside)


_INDEX = struct.Struct("<HI")
_LAST_OPCODE, _FIRST_PRIVATE = int(Opcode.DATA_END), 0x80
_SHORTEST_FILE = 8
"""Minimum content of a metadata record or an attachment: its lengths [bytes]."""
_KEPT = 1 << 18
"""Bytes read at once: records are many and small, system calls slow."""
_CHUNK_HEAD = re.compile(rb"\x06(?=.{5}\x00\x00\x00)", re.DOTALL)
"""Start of a chunk of less than 2^40 bytes."""


class Frames:
    """Iterates once over the intact records of the data section; `damages` is complete afterwards.

    Raises SinkError if the file is not MCAP or cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damages: list[Damage] = []
        self.unchecked_chunks = 0
        """intact chunks without a checksum so far."""
        self.chunks = 0
        """intact chunks so far."""
        self._kept, self._kept_from = b"", 0
        try:
            self._file: BinaryIO = path.open("rb")
        except OSError as error:
            raise SinkError(f"{path}: {error.strerror}") from None
        self.size = path.stat().st_size
        if self._at(0, len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            self._file.close()
            raise SinkError(f"{path}: not an MCAP file; a bag is a folder, an .mcap or a .db3 file")
        magic = len(MCAP0_MAGIC)
        self.complete = self.size >= 2 * magic and self._at(self.size - magic, magic) == MCAP0_MAGIC
        """whether the file has the end of a finished one."""
        summary = read_summary(self._at, self.size) if self.complete else NO_SUMMARY
        self.index = summary.index if summary.checked else None
        self.claimed = summary.index.messages if summary.index and not summary.checked else None
        """number of messages according to an index without a checksum; None: no such index."""
        self._broken_index = summary.broken
        self._channels: set[int] = set()
        self._loose = False  # whether there are messages outside of chunks
        self._last_time: int | None = None
        self._open: list[Damage] = []  # damages without a known log time after them yet

    def __iter__(self) -> Iterator[Frame]:
        with self._file:
            yield from self._frames()
        self.damages += self._open

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def named(self) -> Iterator[Frame]:
        """Yield only the records in the index, except chunks."""
        assert self.index is not None
        with self._file:
            for at in self.index.offsets[:-1]:
                opcode, length = self._head(at)
                if opcode != Opcode.CHUNK and length <= self.size - at:
                    yield Frame(at, opcode, self._at(at + FRAME.size, length))

    def _frames(self) -> Iterator[Frame]:
        at, finished = len(MCAP0_MAGIC), False
        while at < self.size:
            opcode, length = self._head(at)
            if opcode == Opcode.DATA_END and length == 4:
                finished = True
                break
            if opcode == Opcode.CHUNK:
                length = self._chunk_size(at, length)
            reason, frame = self._read(at, opcode, length)
            if reason == CUT_OFF and frame is not None:
                finished, end, reason = True, self.size, None  # reported by the reader of the frame
            elif reason in (None, *REASONS):
                end = self._past_indices(at + FRAME.size + length)
            else:
                end = self._resume(at + 1)
            if frame is not None:
                self._note_times(frame)
                yield frame if frame.checked else self._with_indices(frame, length, end)
            if reason is not None:
                begins = self._begin_of(at, opcode) if reason == CUT_OFF else None
                self._note_damage(at, end, reason, begins)
            at = end
        if not finished and not self._open:
            self._note_damage(self.size, self.size, CUT_OFF)
        if self._broken_index:
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
        """(damage, record) at `at`; a truncated chunk has both, a message index neither."""
        if not 1 <= opcode <= _LAST_OPCODE and opcode < _FIRST_PRIVATE:
            return NO_RECORD, None
        if length > self.size - at - FRAME.size:
            if self.complete:
                return NO_RECORD, None
            return self._open_chunk(at, length) if opcode == Opcode.CHUNK else (CUT_OFF, None)
        if opcode == Opcode.MESSAGE_INDEX:
            return (None if self._is_record(at) else NO_RECORD), None
        if opcode == Opcode.CHUNK:
            return self._open_chunk(at, length)
        if opcode == Opcode.MESSAGE and not self._is_followed(at, at + FRAME.size + length):
            return NO_RECORD, None
        return None, Frame(at, opcode, self._at(at + FRAME.size, length))

    def _past_indices(self, at: int) -> int:
        """End of the intact message indices from `at` on (most records of a file are indices)."""
        self._at(at, INDEX_HEAD.size)
        here, room = at - self._kept_from, self.size - self._kept_from
        return self._kept_from + past_indices(self._kept, here, room)

    def _with_indices(self, frame: Frame, length: int, end: int) -> Frame:
        at = frame.offset + FRAME.size + length
        return frame._replace(indices=self._at(at, max(0, end - at)))

    def _open_chunk(self, at: int, length: int) -> tuple[str | None, Frame | None]:
        content = self._at(at + FRAME.size, min(length, self.size - at - FRAME.size))
        missing = length - len(content)
        if len(content) < SHORTEST_HEAD or (missing and declared_size(content) != length):
            return (CUT_OFF if missing else NO_RECORD), None
        opened = open_chunk(at, content, missing=missing)
        if isinstance(opened, str):
            return (CUT_OFF if missing else opened), None
        self.chunks += not missing
        self.unchecked_chunks += not (missing or opened.checked)
        return (CUT_OFF if missing else None), opened

    def _chunk_size(self, at: int, length: int) -> int:
        """Size of the content of the chunk at `at`, which is stored twice; 0 if there is no chunk.

        If the two differ, the one that gives a valid chunk: with the right checksum or, without
        checksum, the right uncompressed size and a record behind it.
        """
        room = self.size - at - FRAME.size
        declared = declared_size(self._at(at + FRAME.size, LONGEST_HEAD))
        if declared == length:
            return length
        for size in (declared or 0, length):
            if not SHORTEST_HEAD <= size <= room:
                continue
            opened = open_chunk(at, self._at(at + FRAME.size, size))
            end = at + FRAME.size + size
            if not isinstance(opened, str) and (opened.checked or self._is_record(end)):
                self.damages.append(Damage(at, at, ONE_LENGTH))
                return size
        return length if length > room else 0

    def _note_times(self, frame: Frame) -> None:
        """Update log times, close the gaps before this record, note channels outside chunks."""
        first, last = frame.start, frame.end
        if frame.opcode == Opcode.CHANNEL:
            self._channels.add(int.from_bytes(frame.content[:2], "little"))
        elif frame.opcode == Opcode.MESSAGE:
            first = last = MESSAGE_HEAD.unpack_from(frame.content)[2]
            self._loose = True
        if last:
            self.damages += [gap._replace(before=gap.before or first) for gap in self._open]
            self._open = []
            self._last_time = last

    def _begin_of(self, at: int, opcode: int) -> int | None:
        """Log time of the first message of a truncated chunk [ns]; None if its head is missing."""
        head = self._at(at + FRAME.size, _LENGTH.size) if opcode == Opcode.CHUNK else b""
        return _LENGTH.unpack(head)[0] if len(head) == _LENGTH.size else None

    def _note_damage(self, offset: int, end: int, reason: str, begins: int | None = None) -> None:
        """Register damage. begins: log time from which messages are missing if none precedes it."""
        lost = [] if self.index is None else self._indexed(offset, end)
        known = begins if self._last_time is None else self._last_time
        after = min((c.message_start_time for c in lost), default=known)
        before = max((c.message_end_time for c in lost), default=None)
        if self.index is not None and not lost and not self._loose:
            # no chunk there according to the index: no message is missing
            self.damages.append(Damage(offset, end, reason))
            return
        self._open.append(Damage(offset, end, reason, after, before))

    def _indexed(self, offset: int, end: int) -> list[ChunkPlace]:
        assert self.index is not None
        return [c for at, c in self.index.chunks.items() if offset <= at < end]

    def _resume(self, at: int) -> int:
        """Offset at which to continue reading after `at`; the end of the file if nowhere."""
        if self.index is None:
            end = self._next_chunk(at)
        else:
            k = bisect_right(self.index.offsets, at - 1)
            end = (*self.index.offsets[k : k + 1], self.size)[0]
        return (self._messages(end).resume(at) or end) if self._channels else end

    def _next_chunk(self, at: int) -> int:
        chunks = offsets(self._at, _CHUNK_HEAD, at, self.size)
        return next((offset for offset in chunks if self._is_record(offset)), self.size)

    def _messages(self, end: int | None = None) -> Unchecked:
        """The records outside of chunks, up to `end`."""
        end, cut = end or self.size, not self.complete
        return Unchecked(self._at, end, self._channels, closes=self._is_end, cut=cut)

    def _is_followed(self, at: int, end: int) -> bool:
        """Whether the length of the message at `at`, which ends at `end`, is plausible.

        False if no record starts at `end` and reading could resume before it: the length may be
        broken."""
        opcode, length = self._head(end)
        if opcode == Opcode.MESSAGE and MESSAGE_HEAD.size <= length <= self.size - end - FRAME.size:
            return True
        if self._is_record(end):
            return True
        messages = self._messages()
        resumed = messages.resume(at + 1)
        return (resumed is None or resumed > end) and messages.is_record(end, resumed)

    def _is_end(self, at: int) -> bool:
        """Whether a chunk or the end of the data starts at `at`."""
        head = self._head(at)
        return head == (Opcode.DATA_END, 4) or (head[0] == Opcode.CHUNK and self._is_record(at))

    def _is_record(self, at: int) -> bool:
        """Whether a record may start at `at`, by its opcode and lengths."""
        opcode, length = self._head(at)
        content = at + FRAME.size
        if at == self.size and not self.complete:
            return True
        fits = length <= self.size - content
        if opcode == Opcode.CHUNK:
            return (fits or not self.complete) and (
                declared_size(self._at(content, LONGEST_HEAD)) == length
            )
        if not fits:
            return False
        if opcode == Opcode.MESSAGE_INDEX:
            head = self._at(content, _INDEX.size)
            return length >= _INDEX.size and _INDEX.unpack(head)[1] == length - _INDEX.size
        if opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL):
            return self._messages().next_of(at) is not None
        if opcode == Opcode.DATA_END:
            return length == 4
        return opcode in (Opcode.METADATA, Opcode.ATTACHMENT) and length >= _SHORTEST_FILE
