"""The records of an MCAP file one after the other, and where a broken one ends."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import MCAP0_MAGIC

from rb_sim.errors import SinkError

Record = Header | Schema | Channel | Message | Metadata | Attachment

_FRAME = struct.Struct("<BQ")
_KINDS = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}


def bag_path(bag: Path) -> Path:
    """The MCAP file of `bag`: a directory that holds one, or the file itself.

    Raises SinkError where there is none or there are several.
    """
    if bag.is_dir():
        found = sorted(bag.glob("*.mcap"))
        if len(found) != 1:
            what = "no .mcap file in it" if not found else f"{len(found)} .mcap files in it"
            raise SinkError(f"{bag}: not a bag of rb_sim: {what}")
        return found[0]
    if not bag.exists():
        raise SinkError(f"{bag}: no such bag")
    return bag


def read_records(path: Path) -> Iterator[Record]:
    """Records of the data section in file order, those within chunks one by one.

    Stops silently where the file ends too early or is damaged; ask `is_complete` beforehand.
    Raises SinkError for a file that is no MCAP or cannot be opened.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise SinkError(f"{path}: {error.strerror}") from None
    with file:
        if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise SinkError(f"{path}: not an MCAP file")
        for opcode, content in _frames(file, path.stat().st_size):
            if opcode == Opcode.DATA_END:
                return
            try:
                records = _parse(opcode, content)
            except Exception:  # whatever a decoder makes of damaged bytes: the readable part ends
                return
            yield from records


def is_complete(path: Path) -> bool:
    """True if the file ends as a finished one does."""
    with path.open("rb") as file:
        size = file.seek(0, 2)
        if size < 2 * len(MCAP0_MAGIC):
            return False
        file.seek(size - len(MCAP0_MAGIC))
        return file.read() == MCAP0_MAGIC


def _frames(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """(opcode, content) of each record that is wholly in the file."""
    while len(head := file.read(_FRAME.size)) == _FRAME.size:
        opcode, length = _FRAME.unpack(head)
        if length > size - file.tell():
            return
        yield opcode, file.read(length)


def _parse(opcode: int, content: bytes) -> list[Record]:
    stream = ReadDataStream(BytesIO(content))
    if opcode == Opcode.CHUNK:
        return breakup_chunk(Chunk.read(stream), validate_crc=True)  # type: ignore[return-value]
    if opcode == Opcode.MESSAGE:
        return [Message.read(stream, len(content))]
    kind = _KINDS.get(opcode)  # type: ignore[call-overload]
    return [] if kind is None else [kind.read(stream)]
