"""A record of an MCAP file; of a chunk its records, its checksum checked, and where it ends."""

from __future__ import annotations

import struct
from typing import NamedTuple

from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream

_HEAD = struct.Struct("<QQQII")
_LENGTH = struct.Struct("<Q")
SHORTEST_HEAD = _HEAD.size + _LENGTH.size
LONGEST_HEAD = SHORTEST_HEAD + 8
"""Bytes before the records of a chunk, at least and at most."""

WRONG_CHECKSUM = "its checksum is wrong"
NOT_DECOMPRESSED = "it cannot be decompressed"
NO_DECOMPRESSOR = "its compression is none of zstd and lz4"
REASONS = (WRONG_CHECKSUM, NOT_DECOMPRESSED, NO_DECOMPRESSOR)


class Opened(NamedTuple):
    """The records of a chunk, and their log times [ns]."""

    data: bytes
    start: int
    end: int
    checked: bool
    """a checksum covers them, and is right."""
    compressed: bool
    head: int
    """bytes before them in the chunk."""


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


def open_chunk(content: bytes, *, short: bool = False) -> Opened | str:
    """The chunk whose content this is all of, or why it cannot be read.

    short: it is the beginning; only what is not compressed can be read then, and not checked.
    """
    start, end, size, checksum, name = _HEAD.unpack_from(content)
    head = _HEAD.size + name + _LENGTH.size
    compression = content[_HEAD.size : _HEAD.size + name].decode(errors="replace")
    if compression not in ("", "zstd", "lz4"):
        return NO_DECOMPRESSOR
    if short:
        data = content[head:]
        return NOT_DECOMPRESSED if compression else Opened(data, start, end, False, False, head)
    chunk = Chunk(compression, content[head:], end, start, checksum, size)
    try:
        stream, found = get_chunk_data_stream(chunk, validate_crc=True)
        data = stream.read(found)
    except Exception:  # decompressors and checksums fail with classes of their own
        return WRONG_CHECKSUM if checksum else NOT_DECOMPRESSED
    if found != size:
        return WRONG_CHECKSUM if checksum else NOT_DECOMPRESSED
    return Opened(data, start, end, checksum != 0, bool(compression), head)
