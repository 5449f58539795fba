"""What a finished MCAP file says of itself: its chunks and when they are, its topics."""

from __future__ import annotations

import struct
from io import BytesIO
from typing import NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, MetadataIndex, Schema, Statistics

FRAME = struct.Struct("<BQ")
"""Before each record: its opcode and the length of its content."""
_PLACE = struct.Struct("<QQQ")


class ChunkPlace(NamedTuple):
    """What the index says of a chunk: the beginning of an MCAP ChunkIndex record."""

    message_start_time: int
    """[ns]"""
    message_end_time: int
    offset: int
    """[bytes]"""


class Index(NamedTuple):
    """What a finished file says of itself, its checksum right."""

    chunks: dict[int, ChunkPlace]
    offsets: tuple[int, ...]
    """of all records that the index names, increasing; the end of the data is the last one."""
    messages: int | None
    schemas: dict[int, Schema]
    channels: dict[int, Channel]


def parse_index(summary: bytes, start: int) -> Index:
    """The index in the summary section, which begins at `start` [bytes]."""
    chunks: dict[int, ChunkPlace] = {}
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    offsets, messages, at = {start - FRAME.size - 4}, None, 0
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
            offsets.add(MetadataIndex.read(stream).offset)
        elif opcode == Opcode.ATTACHMENT_INDEX:
            offsets.add(AttachmentIndex.read(stream).offset)
        elif opcode == Opcode.STATISTICS:
            messages = Statistics.read(stream).message_count
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            channels[channel.id] = channel
    return Index(chunks, tuple(sorted(offsets)), messages, schemas, channels)
