# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""MCAP writer: the same bytes as the package mcap, at a fifth of the time per message.

A node writes ten or more messages per sample, and that package builds each one field by field. Rare
records are written by the package.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from rb_sim.io.bag.records import ENTRY, INDEX_HEAD

if TYPE_CHECKING:
    from numpy.typing import NDArray


# Messages as records of an MCAP file, singly or as arrays.


MESSAGE = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time; the data follow."""
HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""The same record head as a numpy type."""
OPCODE = int(Opcode.MESSAGE)
OWN = MESSAGE.size - 9
"""Bytes of a message's content before its data."""


class Rows(NamedTuple):
    """Messages of n samples, those of one sample in one row."""

    data: NDArray[np.uint8]
    """shape (n, size)."""
    bounds: Sequence[tuple[int, int]]
    """start and end of each message in a row."""

    @property
    def width(self) -> int:
        """Bytes of the records of a row."""
        return sum(MESSAGE.size + end - start for start, end in self.bounds)

    def records(self, channels: Sequence[int], times: NDArray[Any], sequence: int) -> Rows:
        """The messages as records. times: [ns], shape (n,); sequence numbers count up."""
        n = len(times)
        sizes = [end - start for start, end in self.bounds]
        ends = np.cumsum([MESSAGE.size + size for size in sizes]).tolist()
        bounds = [*zip([0, *ends[:-1]], ends, strict=True)]
        heads = np.empty((n, len(channels)), HEAD)
        heads["opcode"], heads["length"], heads["channel"] = OPCODE, np.add(sizes, OWN), channels
        heads["sequence"] = (sequence + np.arange(n))[:, None] & 0xFFFFFFFF
        heads["log_time"] = heads["publish_time"] = times[:, None]
        front = heads.view(np.uint8).reshape(n, len(channels), MESSAGE.size)
        out = np.empty((n, ends[-1]), np.uint8)
        for j, ((start, end), (a, b)) in enumerate(zip(bounds, self.bounds, strict=True)):
            out[:, start : start + MESSAGE.size] = front[:, j]
            out[:, start + MESSAGE.size : end] = self.data[:, a:b]
        return Rows(out, bounds)


_FOOTER = struct.Struct("<BQQQ")
"""Part of the footer that its checksum covers."""


class Sink(Protocol):
    """Output of the writer."""

    def write(self, data: bytes, /) -> int:
        """Append all of `data`, or raise OSError."""
        ...

    def tell(self) -> int:
        """Number of bytes written."""
        ...


class _Chunk:
    """The open chunk: its records, and the index of its messages by channel."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.index: dict[int, bytearray] = {}
        """by channel: concatenated ENTRY of each message."""

    def times(self) -> tuple[int, int]:
        """Earliest and latest log time [ns]."""
        times = np.concatenate([np.frombuffer(e, "<u8")[0::2] for e in self.index.values()])
        return int(times.min()), int(times.max())


class McapWriter:
    """Writes a chunked, zstd-compressed file with all indices. chunk_size: [bytes]."""

    def __init__(self, sink: Sink, chunk_size: int) -> None:
        self._sink, self._chunk_size = sink, chunk_size
        self._chunk = _Chunk()
        self.schemas: list[Schema] = []
        self.channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self.counts: dict[int, int] = {}
        """number of messages so far, by channel."""
        self.span: tuple[int, int] | None = None
        """earliest and latest log time so far [ns]."""

    def start(self, profile: str, library: str) -> None:
        """Write the start of the file."""
        self._sink.write(MCAP0_MAGIC)
        self._sink.write(_bytes([Header(profile, library)]))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; returns its number."""
        number = len(self.schemas) + 1
        self.schemas.append(Schema(id=number, data=data, encoding=encoding, name=name))
        self._put(self.schemas[-1])
        return number

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: dict[str, str]
    ) -> int:
        """Add a channel; returns its number."""
        number = len(self.channels) + 1
        self.channels.append(Channel(number, topic, message_encoding, metadata, schema_id))
        self._put(self.channels[-1])
        return number

    def add_message(self, channel: int, time: int, sequence: int, data: bytes) -> None:
        """Add one message, logged and published at `time` [ns]."""
        self._note((channel,), 1, time, time)
        chunk = self._chunk
        entries = chunk.index.setdefault(channel, bytearray())
        entries += ENTRY.pack(time, len(chunk.data))
        size = OWN + len(data)
        chunk.data += MESSAGE.pack(OPCODE, size, channel, sequence & 0xFFFFFFFF, time, time) + data
        if len(chunk.data) > self._chunk_size:
            self._end_chunk()

    def add_rows(
        self, channels: Sequence[int], times: NDArray[Any], sequence: int, rows: Rows
    ) -> None:
        """As `add_message` for each message, row by row, the same bytes, faster; times do not
        decrease, sequence counts up."""
        self._note(channels, len(times), int(times[0]), int(times[-1]))
        records, bounds = rows.records(channels, times, sequence)
        n, width = records.shape
        data, each = memoryview(records.tobytes()), len(channels)
        starts, ends = (
            np.add.outer(np.arange(n) * width, x).ravel() for x in zip(*bounds, strict=True)
        )
        entries = np.stack([np.repeat(times, each), starts], axis=1).astype("<i8")
        first = 0
        while first < n * each:
            chunk, begin = self._chunk, int(starts[first])
            over = int(np.searchsorted(ends, begin + self.room, side="right"))
            stop = min(over + 1, n * each)
            entries[first:stop, 1] += len(chunk.data) - begin
            for i in range(first, min(first + each, stop)):
                index = chunk.index.setdefault(channels[i % each], bytearray())
                index += entries[i:stop:each].tobytes()
            chunk.data += data[begin : ends[stop - 1]]
            if stop > over:
                self._end_chunk()
            first = stop

    def _note(self, channels: Sequence[int], count: int, first: int, last: int) -> None:
        """Count `count` messages on each channel, with log times from `first` to `last` [ns]."""
        for channel in channels:
            self.counts[channel] = self.counts.get(channel, 0) + count
        begin, end = self.span or (first, last)
        self.span = min(first, begin), max(last, end)

    @property
    def room(self) -> int:
        """Bytes that fit into the open chunk; it ends with the message beyond them."""
        return max(0, self._chunk_size - len(self._chunk.data))

    @property
    def waiting(self) -> bool:
        """Whether the open chunk has messages."""
        return bool(self._chunk.index)

    def draft(self) -> bytes:
        """The open chunk as an uncompressed record. It starts with all schemas and channels, for
        readers of unfinished files."""
        heads: list[McapRecord] = [*self.schemas, *self.channels]
        data = _bytes(heads) + bytes(self._chunk.data)
        first, last = self._chunk.times()
        return _bytes([Chunk("", data, last, first, zlib.crc32(data), len(data))])

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record at once."""
        record, at = _bytes([Metadata(name=name, metadata=values)]), self._sink.tell()
        self._metadata.append(MetadataIndex(offset=at, length=len(record), name=name))
        self._sink.write(record)

    def add_attachment(self, time: int, name: str, media_type: str, data: bytes) -> None:
        """Write an attached file at once. time: creation and log time [ns]."""
        of_file = {"log_time": time, "create_time": time, "name": name, "media_type": media_type}
        record, at = _bytes([Attachment(data=data, **of_file)]), self._sink.tell()
        index = AttachmentIndex(offset=at, length=len(record), data_size=len(data), **of_file)
        self._attachments.append(index)
        self._sink.write(record)

    def finish(self) -> None:
        """Write the open chunk, the summary and the end of the file."""
        self._end_chunk()
        self._sink.write(_bytes([DataEnd(0)]))
        start = self._sink.tell()
        groups: list[tuple[Opcode, Iterable[McapRecord]]] = [
            (Opcode.SCHEMA, self.schemas),
            (Opcode.CHANNEL, self.channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        summary, places = bytearray(), []
        for opcode, records in groups:
            group = _bytes(records)
            places.append(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offsets = start + len(summary)
        summary += _bytes(places)
        covered = _FOOTER.pack(Opcode.FOOTER, 20, start, offsets)
        checksum = zlib.crc32(covered, zlib.crc32(summary))
        self._sink.write(bytes(summary))
        self._sink.write(_bytes([Footer(start, offsets, checksum)]))
        self._sink.write(MCAP0_MAGIC)

    def _put(self, record: McapRecord) -> None:
        """Add a schema or channel to the open chunk."""
        self._chunk.data += _bytes([record])
        if len(self._chunk.data) > self._chunk_size:
            self._end_chunk()

    def _end_chunk(self) -> None:
        """Write the open chunk, if it has messages, with its indices, and start another one."""
        chunk = self._chunk
        if not chunk.index:
            return
        data, (first, last) = bytes(chunk.data), chunk.times()
        packed = zstandard.compress(data)
        record = _bytes([Chunk("zstd", packed, last, first, zlib.crc32(data), len(data))])
        at = self._sink.tell()
        self._sink.write(record)
        indices, places = bytearray(), {}
        for channel, entries in chunk.index.items():
            places[channel] = at + len(record) + len(indices)
            size = len(entries)
            indices += INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size) + entries
        self._sink.write(bytes(indices))
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=at,
                compression="zstd",
                compressed_size=len(packed),
                message_end_time=last,
                message_index_length=len(indices),
                message_index_offsets=places,
                message_start_time=first,
                uncompressed_size=len(data),
            )
        )
        self._chunk = _Chunk()

    def _statistics(self) -> Statistics:
        start, end = self.span or (0, 0)
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self.channels),
            channel_message_counts=self.counts,
            chunk_count=len(self._chunks),
            message_count=sum(self.counts.values()),
            message_end_time=end,
            message_start_time=start,
            metadata_count=len(self._metadata),
            schema_count=len(self.schemas),
        )


def _bytes(records: Iterable[McapRecord]) -> bytes:
    """The concatenated bytes of the records."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return builder.end()
