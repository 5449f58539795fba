# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Records of an MCAP file: parsing, its index, and recovery of records without checksums."""

from __future__ import annotations

import re
import struct
import zlib
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from io import BytesIO
from struct import Struct
from typing import Any, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Footer,
    Header,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.writer import MCAP0_MAGIC

FRAME = struct.Struct("<BQ")
"""Head of each record: opcode and length of the content."""
_FOOTER_SIZE = FRAME.size + 20
_DATA_END = struct.Struct("<BQI")
_PLACE = struct.Struct("<QQQ")


class ChunkPlace(NamedTuple):
    """Index entry of a chunk: the beginning of an MCAP ChunkIndex record."""

    message_start_time: int
    """[ns]"""
    message_end_time: int
    offset: int
    """[bytes]"""


ENTRY = struct.Struct("<QQ")
"""Entry of a message index: log time [ns] and offset of a message in its chunk."""
INDEX_HEAD = struct.Struct("<BQHI")
"""Head of a message index: opcode, length, channel, bytes of entries."""


def past_indices(data: bytes, at: int, room: int) -> int:
    """End of the complete message indices from `at` on; they may not extend beyond `room`."""
    while 0 <= at <= len(data) - INDEX_HEAD.size:
        opcode, length, _, entries = INDEX_HEAD.unpack_from(data, at)
        end = at + FRAME.size + length
        if opcode != Opcode.MESSAGE_INDEX or entries != length - 6 or end > room:
            break
        at = end
    return at


def index_entries(indices: bytes) -> Iterator[tuple[int, int, int]]:
    """Channel, log time [ns] and offset in the chunk, of all entries of message index records."""
    at = 0
    while at < len(indices):
        _, length, channel, size = INDEX_HEAD.unpack_from(indices, at)
        content = indices[at + INDEX_HEAD.size : at + INDEX_HEAD.size + size // 16 * 16]
        yield from ((channel, *entry) for entry in ENTRY.iter_unpack(content))
        at += FRAME.size + length


def count_entries(indices: bytes) -> int:
    """Number of entries that `index_entries` yields."""
    count = at = 0
    while at < len(indices):
        _, length, _, size = INDEX_HEAD.unpack_from(indices, at)
        count += size // ENTRY.size
        at += FRAME.size + length
    return count


class Index(NamedTuple):
    """Index of a finished file."""

    chunks: dict[int, ChunkPlace]
    offsets: tuple[int, ...]
    """offsets of all indexed records, increasing; the last one is the end of the data."""
    messages: int | None
    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    names: dict[int, str]
    """names of the metadata records by offset; the copies in the records have no checksum."""
    kinds: dict[int, int]
    """opcodes of metadata and attachments by offset."""


def name_of(index: Index | None, offset: int, name: str) -> str:
    """Name of the metadata record at this offset: from the index, else the record's own `name`."""
    return name if index is None else index.names.get(offset, name)


class Summary(NamedTuple):
    """The index of a finished file, if readable.

    checked: its checksum is right. broken: it exists but is damaged.
    """

    index: Index | None
    checked: bool = False
    broken: bool = False


NO_SUMMARY = Summary(None)


def read_summary(read: Callable[[int, int], bytes], size: int) -> Summary:
    """The summary of a finished file of `size` bytes. read: bytes at (offset, size)."""
    at = max(0, size - len(MCAP0_MAGIC) - _FOOTER_SIZE)
    tail = read(at, _FOOTER_SIZE)
    if len(tail) < _FOOTER_SIZE or FRAME.unpack_from(tail) != (Opcode.FOOTER, 20):
        return Summary(None, broken=True)
    footer = Footer.read(ReadDataStream(BytesIO(tail[FRAME.size :])))
    start = footer.summary_start
    if start == 0:
        return NO_SUMMARY
    summary = read(start, at - start) if len(MCAP0_MAGIC) < start <= at else b""
    checked = footer.summary_crc == zlib.crc32(tail[:-4], zlib.crc32(summary)) != 0
    try:
        index = parse_index(summary, start)
    except Exception:  # content is broken, with a right checksum or without one
        index = None
    wrong = footer.summary_crc != 0 and not checked
    if not checked and read(start - _DATA_END.size, FRAME.size) != FRAME.pack(Opcode.DATA_END, 4):
        wrong = True  # no summary at that offset: bytes were inserted before it, or are missing
    return Summary(None if wrong else index, checked, wrong or index is None)


_IN_SUMMARY: dict[int, Any] = {
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
}


def parse_index(summary: bytes, start: int) -> Index:
    """The index in the summary section, which starts at offset `start` [bytes]."""
    chunks: dict[int, ChunkPlace] = {}
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    names: dict[int, str] = {}
    kinds: dict[int, int] = {}
    messages, at = None, 0
    while at < len(summary):
        opcode, length = FRAME.unpack_from(summary, at)
        at += FRAME.size
        content = summary[at : at + length]
        at += length
        if opcode == Opcode.CHUNK_INDEX:  # there are many of them
            place = ChunkPlace(*_PLACE.unpack_from(content))
            chunks[place.offset] = place
        elif opcode in _IN_SUMMARY:
            match _IN_SUMMARY[opcode].read(ReadDataStream(BytesIO(content))):
                case MetadataIndex(offset=offset, name=name):
                    names[offset], kinds[offset] = name, Opcode.METADATA
                case AttachmentIndex(offset=offset):
                    kinds[offset] = Opcode.ATTACHMENT
                case Statistics(message_count=count):
                    messages = count
                case Schema() as schema:
                    schemas[schema.id] = schema
                case Channel() as channel:
                    channels[channel.id] = channel
    offsets = sorted({start - _DATA_END.size, *chunks, *kinds})
    return Index(chunks, tuple(offsets), messages, schemas, channels, names, kinds)


Record = Header | Schema | Channel | Message | Metadata | Attachment

_KINDS = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}


class WholeStream(ReadDataStream):
    """Stream that raises EOFError if fewer bytes are left than requested (mcap's returns fewer)."""

    def read(self, length: int) -> bytes:
        """Exactly `length` bytes."""
        data = super().read(length)
        if len(data) < length:
            raise EOFError
        return data


class BrokenRecordError(Exception):
    """A record does not match its type."""


def parse_record(opcode: int, content: bytes) -> Record | None:
    """The record, or None for another type. Raises BrokenRecordError."""
    stream = WholeStream(BytesIO(content))
    try:
        if opcode == Opcode.MESSAGE:
            return Message.read(stream, len(content))
        kind = _KINDS.get(opcode)  # type: ignore[call-overload]
        if kind is Attachment and not _attachment_is_whole(content):
            raise BrokenRecordError
        return None if kind is None else kind.read(stream)
    except Exception:  # decoders raise various errors on damaged bytes
        raise BrokenRecordError from None


def _attachment_is_whole(content: bytes) -> bool:
    (checksum,) = struct.unpack_from("<I", content, len(content) - 4)
    return checksum in (0, zlib.crc32(content[:-4]))


# Search for intact records in bytes without a checksum, if a length is broken.
#
# A record counts as intact if its opcode, its length and (for a message) its log time are
# plausible, and a record follows it. Reading resumes only where records certainly start: at a
# message of a known channel, or at a channel or schema that fills its length, and RUN records, or
# records up to the end, follow. Bytes within a message match by chance only if as many 64-bit
# lengths do.


RUN = 4
"""Number of consecutive records that exclude a match by chance."""
MESSAGE_HEAD = Struct("<HIQQ")
"""Head of a message's content: channel, sequence, log time and publish time [ns]."""
_WINDOW = 1 << 20
_RECORD_HEAD = re.compile(rb"[\x03-\x05](?=.{5}\x00\x00\x00)", re.DOTALL)
"""Start of a schema, channel or message of less than 2^40 bytes."""
_LONGEST_DEFINITION = 1 << 24
_PARSED: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}


def offsets(
    read: Callable[[int, int], bytes], head: re.Pattern[bytes], at: int, end: int
) -> Iterator[int]:
    """Yield the offsets between `at` and `end` at which the head of a record matches."""
    while at < end:
        for match in head.finditer(read(at, min(_WINDOW + FRAME.size, end - at))):
            if match.start() < _WINDOW:
                yield at + match.start()
        at += _WINDOW


class Gap(NamedTuple):
    """Bytes without an intact record, and the log times before and after [ns]."""

    begin: int
    end: int
    after: int
    before: int


class Unchecked(NamedTuple):
    """Consecutive records whose lengths may be broken.

    read: bytes at (offset, size), fewer at the end. end: end of the last record [bytes]. channels:
    known ids; new ones are added. times: first and last log time of the messages [ns]; None:
    unknown. closes: whether something other than these records starts at an offset. starts: offsets
    of messages according to an index, increasing. cut: whether the rest is truncated.
    """

    read: Callable[[int, int], bytes]
    end: int
    channels: set[int]
    times: tuple[int, int] | None = None
    closes: Callable[[int], bool] = lambda at: False
    starts: Sequence[int] = ()
    cut: bool = False

    def indexed(self, entries: Iterable[tuple[int, int, int]]) -> Unchecked:
        """Copy with the starts of index entries (channel, log time, offset) that match."""
        return self._replace(
            starts=sorted(at for channel, time, at in entries if self._stands(at, channel, time))
        )

    def next_of(self, at: int) -> int | None:
        """End of the record at `at`; None if no record is possible there."""
        opcode, length, content = self._head(at)
        end = at + FRAME.size + length
        if end > self.end or bisect_left(self.starts, end) > bisect_right(self.starts, at):
            return None
        if opcode == Opcode.MESSAGE:
            return end if length >= MESSAGE_HEAD.size and self._in_time(content) else None
        if opcode not in _PARSED or length > _LONGEST_DEFINITION:
            return None
        content = self.read(at + FRAME.size, length)
        return end if _fills(_PARSED[opcode], content) else None

    def resume(self, at: int) -> int | None:
        """First offset from `at` on at which records certainly start; None if there is none."""
        return next(
            (k for k in offsets(self.read, _RECORD_HEAD, at, self.end) if self._begins(k)), None
        )

    def is_record(self, at: int, resumed: int | None) -> bool:
        """Whether a record starts at `at` although its length may be broken.

        True if its length leads to `resumed`, or only its length is implausible.
        """
        opcode, length, content = self._head(at)
        if at + FRAME.size + length == (self.end if resumed is None else resumed):
            return True
        if self.cut and self.end - at < FRAME.size + MESSAGE_HEAD.size:
            return True
        return opcode == Opcode.MESSAGE and self._is_known(content) and self._in_time(content)

    def stretches(self, at: int = 0) -> Iterator[tuple[int, int]]:
        """Yield start and end of stretches of intact records from `at` on.

        A message whose length may be broken is not included.
        """
        begin, last = at, None
        while at < self.end:
            after = self.next_of(at)
            if after is not None:
                self._learn(at)
                last, at = at, after
                continue
            resumed = self.resume(at + 1 if last is None else last + 1)
            behind = resumed is None or resumed > at
            whole = at if last is None or (behind and self.is_record(at, resumed)) else last
            if whole > begin:
                yield begin, whole
            if resumed is None:
                return
            begin, last, at = resumed, None, resumed
        if at > begin:
            yield begin, at

    def time_of(self, at: int) -> int | None:
        """Log time of the message at `at` [ns]; None if it is not a message."""
        opcode, _, content = self._head(at)
        return MESSAGE_HEAD.unpack_from(content)[2] if opcode == Opcode.MESSAGE else None

    def gaps(self, parts: list[tuple[int, int]], times: tuple[int, int]) -> Iterator[Gap]:
        """Yield the gaps between the stretches `parts` of bytes that start at 0.

        times: first and last log time, used if the stretches give no better bound [ns].
        """
        edges = [0, *(edge for part in parts for edge in part), self.end]
        inside = [self._times_in(*part) for part in parts]
        known = [time for part in inside for time in part]
        ordered = known == sorted(known)
        for k in range(0, len(edges), 2):
            begin, end = edges[k : k + 2]
            if begin == end:
                continue
            before = [time for part in inside[: k // 2] for time in part] if ordered else []
            later = [time for part in inside[k // 2 :] for time in part] if ordered else []
            yield Gap(begin, end, (before or times[:1])[-1], (later or times[1:])[0])

    def _times_in(self, at: int, end: int) -> list[int]:
        found = []
        while at < end:
            time = self.time_of(at)
            if time is not None:
                found.append(time)
            at = self.next_of(at) or end
        return found

    def _head(self, at: int) -> tuple[int, int, bytes]:
        head = self.read(at, FRAME.size + MESSAGE_HEAD.size)
        opcode, length = FRAME.unpack_from(head) if len(head) >= FRAME.size else (0, 0)
        return opcode, length, head[FRAME.size :]

    def _learn(self, at: int) -> None:
        opcode, _, content = self._head(at)
        if opcode == Opcode.CHANNEL:
            self.channels.add(int.from_bytes(content[:2], "little"))

    def _stands(self, at: int, channel: int, time: int) -> bool:
        opcode, _, content = self._head(at)
        if opcode != Opcode.MESSAGE or len(content) < MESSAGE_HEAD.size:
            return False
        found, _, at_time, _ = MESSAGE_HEAD.unpack_from(content)
        return (found, at_time) == (channel, time)

    def _is_known(self, content: bytes) -> bool:
        return (
            len(content) >= MESSAGE_HEAD.size
            and MESSAGE_HEAD.unpack_from(content)[0] in self.channels
        )

    def _in_time(self, content: bytes) -> bool:
        if len(content) < MESSAGE_HEAD.size:
            return False
        first, last = self.times or (0, 1 << 64)
        return first <= MESSAGE_HEAD.unpack_from(content)[2] <= last

    def _begins(self, at: int) -> bool:
        opcode, _, content = self._head(at)
        if opcode == Opcode.MESSAGE and not self._is_known(content):
            return False
        for count in range(RUN):
            if at == self.end or self.closes(at):
                return count > 0
            after = self.next_of(at)
            if after is None:
                return False
            at = after
        return True


def _fills(kind: Any, content: bytes) -> bool:
    """Whether a record of that type uses all of these bytes."""
    stream = WholeStream(BytesIO(content))
    try:
        kind.read(stream)
    except Exception:  # decoders raise various errors on other bytes
        return False
    return stream.count == len(content)
