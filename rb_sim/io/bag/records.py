"""Records of an MCAP file, and what a finished file says of itself: its chunks, its topics."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import NamedTuple

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
"""Before each record: its opcode and the length of its content."""
_FOOTER_SIZE = FRAME.size + 20
_DATA_END = struct.Struct("<BQI")
_PLACE = struct.Struct("<QQQ")


class ChunkPlace(NamedTuple):
    """What the index says of a chunk: the beginning of an MCAP ChunkIndex record."""

    message_start_time: int
    """[ns]"""
    message_end_time: int
    offset: int
    """[bytes]"""


ENTRY = struct.Struct("<QQ")
"""Of a message index: log time [ns] and offset of a message in its chunk."""
INDEX_HEAD = struct.Struct("<BQHI")
"""The beginning of a message index: opcode, length, channel, bytes of entries."""


def past_indices(data: bytes, at: int, room: int) -> int:
    """The end of the whole message indices from `at` on; they may reach as far as `room`."""
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
    """How many `index_entries` gives."""
    count = at = 0
    while at < len(indices):
        _, length, _, size = INDEX_HEAD.unpack_from(indices, at)
        count += size // ENTRY.size
        at += FRAME.size + length
    return count


class Index(NamedTuple):
    """What a finished file says of itself."""

    chunks: dict[int, ChunkPlace]
    offsets: tuple[int, ...]
    """of all records that the index names, increasing; the end of the data is the last one."""
    messages: int | None
    times: tuple[int, int] | None
    """log times of the first and of the last message [ns]."""
    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    names: dict[int, str]
    """of the metadata records, by their offset; no checksum covers those that stand there."""
    kinds: dict[int, int]
    """opcodes of metadata and attachments, by their offset."""


def name_of(index: Index | None, offset: int, name: str) -> str:
    """The name of the metadata record at this offset, which stands there as `name`."""
    return name if index is None else index.names.get(offset, name)


class Summary(NamedTuple):
    """The index of a finished file, if it can be read.

    checked: its checksum is right. broken: there is one that is not as written.
    """

    index: Index | None
    checked: bool = False
    broken: bool = False


NO_SUMMARY = Summary(None)


def read_summary(read: Callable[[int, int], bytes], size: int) -> Summary:
    """The summary of a finished file of `size` bytes, of which `read` gives (offset, size)."""
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
    except Exception:  # a checksum that is right over content that is not, or none
        index = None
    wrong = footer.summary_crc != 0 and not checked
    if not checked and read(start - _DATA_END.size, FRAME.size) != FRAME.pack(Opcode.DATA_END, 4):
        wrong = True  # what stands there is no summary: something came in before it, or is missing
    return Summary(None if wrong else index, checked, wrong or index is None)


def parse_index(summary: bytes, start: int) -> Index:
    """The index in the summary section, which begins at `start` [bytes]."""
    chunks: dict[int, ChunkPlace] = {}
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    names: dict[int, str] = {}
    kinds: dict[int, int] = {}
    offsets, messages, at = {start - _DATA_END.size}, None, 0
    times: tuple[int, int] | None = None
    while at < len(summary):
        opcode, length = FRAME.unpack_from(summary, at)
        at += FRAME.size
        content = summary[at : at + length]
        at += length
        if opcode == Opcode.CHUNK_INDEX:
            place = ChunkPlace(*_PLACE.unpack_from(content))
            chunks[place.offset] = place
            offsets.add(place.offset)
            continue
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.METADATA_INDEX:
            named = MetadataIndex.read(stream)
            offsets.add(named.offset)
            names[named.offset] = named.name
            kinds[named.offset] = Opcode.METADATA
        elif opcode == Opcode.ATTACHMENT_INDEX:
            offset = AttachmentIndex.read(stream).offset
            offsets.add(offset)
            kinds[offset] = Opcode.ATTACHMENT
        elif opcode == Opcode.STATISTICS:
            counted = Statistics.read(stream)
            messages = counted.message_count
            times = counted.message_start_time, counted.message_end_time
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            channels[channel.id] = channel
    return Index(chunks, tuple(sorted(offsets)), messages, times, schemas, channels, names, kinds)


Record = Header | Schema | Channel | Message | Metadata | Attachment

_KINDS = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}


class WholeStream(ReadDataStream):
    """Raises EOFError where fewer bytes are left than are asked for; mcap's gives what there is."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) < length:
            raise EOFError
        return data


class BrokenRecordError(Exception):
    """A record is not what its kind says."""


def parse_record(opcode: int, content: bytes) -> Record | None:
    """The record, or None for one of another kind. Raises BrokenRecordError."""
    stream = WholeStream(BytesIO(content))
    try:
        if opcode == Opcode.MESSAGE:
            return Message.read(stream, len(content))
        kind = _KINDS.get(opcode)  # type: ignore[call-overload]
        if kind is Attachment and not _attachment_is_whole(content):
            raise BrokenRecordError
        return None if kind is None else kind.read(stream)
    except Exception:  # whatever a decoder makes of damaged bytes
        raise BrokenRecordError from None


def _attachment_is_whole(content: bytes) -> bool:
    (checksum,) = struct.unpack_from("<I", content, len(content) - 4)
    return checksum in (0, zlib.crc32(content[:-4]))
