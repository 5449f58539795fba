# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The records of an MCAP file with their checksums checked, and what of the file is broken.

A chunk whose checksum is wrong is skipped. Where even the lengths are broken, reading goes on at
the next record that the file's own index names; without an index, at the next chunk that is whole;
in a file with messages in no chunk, at the next of these (`salvage`).
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

# What can be broken in a file of a bag, and how a reader tells it.


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
    """A part of a file that cannot be read.

    offset, end: [bytes]; reason: one of the texts above.
    after, before: log times between which messages are missing [ns]; None: not known.
    """

    offset: int
    end: int
    reason: str
    after: int | None = None
    before: int | None = None


class Missing(NamedTuple):
    """What a reader could not read of a bag."""

    path: Path
    damages: list[Damage]
    messages: int | None
    """that are missing; None: the file does not tell."""
    start: int | None
    """log time of the first message that was read [ns]."""

    @property
    def within(self) -> bool:
        """Whether something is missing between messages that were read."""
        return any(d.after is not None and d.before is not None for d in self.damages)

    def lines(self) -> list[str]:
        """One line for each damaged part; times in seconds since the first message."""
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
        first = time if self.start is None else self.start  # nothing was read: all from its begin
        return f"{((time or 0) - (first or 0)) * 1e-9:.9g}"


# A record of an MCAP file; of a chunk its records, its checksum checked, and where it ends.


CHUNK = int(Opcode.CHUNK)
_HEAD = struct.Struct("<QQQII")
_LENGTH = struct.Struct("<Q")
SHORTEST_HEAD = _HEAD.size + _LENGTH.size
LONGEST_HEAD = SHORTEST_HEAD + 8
"""Bytes before the records of a chunk, at least and at most."""

WRONG_CHECKSUM = "its checksum is wrong"
NOT_DECOMPRESSED = "it cannot be decompressed"
NO_DECOMPRESSOR = "its compression is none of zstd and lz4"
REASONS = (WRONG_CHECKSUM, NOT_DECOMPRESSED, NO_DECOMPRESSOR)


class Frame(NamedTuple):
    """One record: the content; of a chunk the checked records in it, with its log times [ns]."""

    offset: int
    opcode: int
    content: bytes
    start: int = 0
    end: int = 0
    checked: bool = True
    """False: a chunk that carries no checksum."""
    compressed: bool = False
    inside: int = 0
    """where the records begin of a chunk that is not compressed [bytes]."""
    indices: bytes = b""
    """the message indices behind a chunk without a checksum."""
    missing: int = 0
    """bytes at the end of a chunk that is cut off."""


def said_size(content: bytes) -> int | None:
    """The size of a chunk's content by the length within it; None: it is none.

    content: all of it or its first LONGEST_HEAD bytes.
    """
    if len(content) < _HEAD.size:
        return None
    *_, name = _HEAD.unpack_from(content)
    at = _HEAD.size + name
    if name > 8 or at + _LENGTH.size > len(content):
        return None
    return at + _LENGTH.size + _LENGTH.unpack_from(content, at)[0]


def open_chunk(offset: int, content: bytes, *, missing: int = 0) -> Frame | str:
    """The chunk at `offset` whose content this is, or why it cannot be read.

    missing: bytes at its end that are cut off; only what is not compressed can be read then, and
    not checked.
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
"""Content of a metadata record or an attachment: its lengths at least [bytes]."""
_KEPT = 1 << 18
"""Bytes that are read at once: records are many and small, calls of the file dear."""
_CHUNK_HEAD = re.compile(rb"\x06(?=.{5}\x00\x00\x00)", re.DOTALL)
"""A chunk of less than 2^40 bytes."""


class Frames:
    """Iterates once over the whole records of the data section; `damages` is then complete.

    Raises SinkError for a file that is no MCAP or cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damages: list[Damage] = []
        self.unchecked_chunks = 0
        """whole chunks without a checksum so far."""
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
            raise SinkError(f"{path}: not an MCAP file; a bag is a folder, an .mcap or a .db3 file")
        magic = len(MCAP0_MAGIC)
        self.complete = self.size >= 2 * magic and self._at(self.size - magic, magic) == MCAP0_MAGIC
        """the file ends as a finished one does."""
        summary = read_summary(self._at, self.size) if self.complete else NO_SUMMARY
        self.index = summary.index if summary.checked else None
        self.claimed = summary.index.messages if summary.index and not summary.checked else None
        """messages that an index without a checksum counts; None: there is none."""
        self._broken_index = summary.broken
        self._channels: set[int] = set()
        self._loose = False  # messages that stand in no chunk
        self._last_time: int | None = None
        self._open: list[Damage] = []  # of which the first log time after it is not known yet

    def __iter__(self) -> Iterator[Frame]:
        with self._file:
            yield from self._frames()
        self.damages += self._open

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def named(self) -> Iterator[Frame]:
        """The records that the index names, but for chunks; instead of iterating over all."""
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
                finished, end, reason = True, self.size, None  # whoever reads the frame tells it
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
        """What is wrong with the record at `at`, and the record if nothing is."""
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
        """The end of the whole message indices from `at` on: most of the records of a file."""
        self._at(at, INDEX_HEAD.size)
        here, room = at - self._kept_from, self.size - self._kept_from
        return self._kept_from + past_indices(self._kept, here, room)

    def _with_indices(self, frame: Frame, length: int, end: int) -> Frame:
        at = frame.offset + FRAME.size + length
        return frame._replace(indices=self._at(at, max(0, end - at)))

    def _open_chunk(self, at: int, length: int) -> tuple[str | None, Frame | None]:
        content = self._at(at + FRAME.size, min(length, self.size - at - FRAME.size))
        missing = length - len(content)
        if len(content) < SHORTEST_HEAD or (missing and said_size(content) != length):
            return (CUT_OFF if missing else NO_RECORD), None
        opened = open_chunk(at, content, missing=missing)
        if isinstance(opened, str):
            return (CUT_OFF if missing else opened), None
        self.chunks += not missing
        self.unchecked_chunks += not (missing or opened.checked)
        return (CUT_OFF if missing else None), opened

    def _chunk_size(self, at: int, length: int) -> int:
        """The size of the content of the chunk at `at`, which says it twice; 0 if it is none.

        Where the two differ, the one by which it is a chunk: with the right checksum or, without
        any, of the size that it has without compression, and a record behind it.
        """
        room = self.size - at - FRAME.size
        said = said_size(self._at(at + FRAME.size, LONGEST_HEAD))
        if said == length:
            return length
        for size in (said or 0, length):
            if not SHORTEST_HEAD <= size <= room:
                continue
            opened = open_chunk(at, self._at(at + FRAME.size, size))
            end = at + FRAME.size + size
            if not isinstance(opened, str) and (opened.checked or self._is_record(end)):
                self.damages.append(Damage(at, at, ONE_LENGTH))
                return size
        return length if length > room else 0

    def _note_times(self, frame: Frame) -> None:
        """Close the gaps before this chunk or message; note the channels that stand in no chunk."""
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
        """Log time of the first message of a chunk of which only the beginning is there [ns]."""
        head = self._at(at + FRAME.size, _LENGTH.size) if opcode == Opcode.CHUNK else b""
        return _LENGTH.unpack(head)[0] if len(head) == _LENGTH.size else None

    def _note_damage(self, offset: int, end: int, reason: str, begins: int | None = None) -> None:
        """begins: log time from which messages are missing where none before it is there."""
        lost = [] if self.index is None else self._indexed(offset, end)
        known = begins if self._last_time is None else self._last_time
        after = min((c.message_start_time for c in lost), default=known)
        before = max((c.message_end_time for c in lost), default=None)
        if self.index is not None and not lost and not self._loose:
            # the index knows of no chunk there: no message is missing
            self.damages.append(Damage(offset, end, reason))
            return
        self._open.append(Damage(offset, end, reason, after, before))

    def _indexed(self, offset: int, end: int) -> list[ChunkPlace]:
        assert self.index is not None
        return [c for at, c in self.index.chunks.items() if offset <= at < end]

    def _resume(self, at: int) -> int:
        """Where to read on after `at`; the end of the file if nowhere."""
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
        """The messages that stand in no chunk, up to `end`."""
        end, cut = end or self.size, not self.complete
        return Unchecked(self._at, end, self._channels, closes=self._is_end, cut=cut)

    def _is_followed(self, at: int, end: int) -> bool:
        """False if the length of the message at `at` may be the broken one: no record is at its
        end, and none that reading could go on from says that one was there."""
        opcode, length = self._head(end)
        if opcode == Opcode.MESSAGE and MESSAGE_HEAD.size <= length <= self.size - end - FRAME.size:
            return True
        if self._is_record(end):
            return True
        messages = self._messages()
        resumed = messages.resume(at + 1)
        return (resumed is None or resumed > end) and messages.is_record(end, resumed)

    def _is_end(self, at: int) -> bool:
        """A chunk begins there, or the data end."""
        head = self._head(at)
        return head == (Opcode.DATA_END, 4) or (head[0] == Opcode.CHUNK and self._is_record(at))

    def _is_record(self, at: int) -> bool:
        """A record can begin there, by its opcode and its lengths."""
        opcode, length = self._head(at)
        content = at + FRAME.size
        if at == self.size and not self.complete:
            return True
        fits = length <= self.size - content
        if opcode == Opcode.CHUNK:
            return (fits or not self.complete) and (
                said_size(self._at(content, LONGEST_HEAD)) == length
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
