"""The records of an MCAP file one after the other, and what of it cannot be read."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path, PurePath

import yaml
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema

from rb_sim.base.errors import SinkError
from rb_sim.io.bag.checked_records import NO_RECORD, Damage, Frame, Frames
from rb_sim.io.bag.index import name_of
from rb_sim.io.bag.salvage import WholeStream

Record = Header | Schema | Channel | Message | Metadata | Attachment

_FRAME = struct.Struct("<BQ")
_KINDS = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}

_YAML = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The one in C where it was built: metadata.yaml holds every topic's QoS."""


def bag_paths(bag: Path) -> list[Path]:
    """The MCAP files of `bag` in their order: of a directory, or the file itself.

    Those that its metadata.yaml names, as far as they are there (`absent` tells the others);
    without it all, if they follow each other in time. The order is that of their numbers, or of
    their first stamps if they have none: log times of a bag may go back where its clock was reset.
    Raises SinkError where there is none, or they are several bags.
    """
    if not bag.is_dir():
        if not bag.exists():
            raise SinkError(f"{bag}: no such bag")
        return [bag]
    listed = _listed(bag / "metadata.yaml")
    there = [path for path in listed if path.exists()]
    if listed and not there:
        raise SinkError(f"{bag}: its metadata.yaml names {listed[0].name}, which is not there")
    found = there or sorted(bag.glob("*.mcap"), key=_number)
    if not found:
        other = [path for kind in ("*.db3", "*.mcap.zstd", "*.db3.zstd") for path in bag.glob(kind)]
        other.sort()
        what = "no .mcap file in it"
        if other:
            what += f" but {other[0].name} (convert it to MCAP with rosbags-convert)"
        raise SinkError(f"{bag}: not a bag of rb_sim: {what}")
    if len(found) == 1:
        return found
    numbered = all(path.stem.rpartition("_")[2].isdigit() for path in found)
    if numbered and len({path.stem.rpartition("_")[0] for path in found}) == 1:
        return sorted(found, key=_number)
    spans = {path: _span(path) for path in found}
    found = sorted(found, key=lambda path: spans[path][0])  # equal ones, as of empty files, stay
    if not listed:
        for one, two in zip(found, found[1:], strict=False):
            if spans[one][1] >= spans[two][0]:
                raise SinkError(
                    f"{bag}: not a bag of rb_sim: {len(found)} .mcap files without metadata.yaml,"
                    f" of which {one.name} and {two.name} overlap in time; name one of them"
                )
    return found


_TIMES, _HEAD = struct.Struct("<QQ"), struct.Struct("<HIQ")
"""How a chunk begins, and a message."""
_MAGIC = 8
"""Bytes before the first record of an MCAP file."""


def _span(path: Path) -> tuple[int, int]:
    """Log times of the first and of the last message of a file, as its summary, or its first chunk
    or message, has them [ns]; (0, 0) for a file that has none."""
    try:
        with path.open("rb") as file:
            try:
                summary = make_reader(file).get_summary()
            except (McapError, ValueError, struct.error):
                summary = None
            if summary is not None and summary.statistics is not None:
                times = summary.statistics
                return times.message_start_time, times.message_end_time
            at = _MAGIC
            while True:
                file.seek(at)
                opcode, length = _FRAME.unpack(file.read(_FRAME.size))
                if opcode == Opcode.CHUNK:
                    first, last = _TIMES.unpack(file.read(_TIMES.size))
                    return first, last
                if opcode == Opcode.MESSAGE:
                    _, _, time = _HEAD.unpack(file.read(_HEAD.size))
                    return time, time
                at += _FRAME.size + length
    except (OSError, struct.error, OverflowError):
        return 0, 0


def unlisted(bag: Path) -> list[str]:
    """Lines on the MCAP files of a folder that its metadata.yaml leaves out, which nobody reads,
    and on those that it names and that are not there."""
    if not bag.is_dir():
        return []
    named = _listed(bag / "metadata.yaml")
    listed = {os.path.normpath(path) for path in named}
    others = sorted(p.name for p in bag.glob("*.mcap") if os.path.normpath(p) not in listed)
    lines = absent(bag)
    if listed and others:
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        lines.append(f"{bag}: its metadata.yaml does not name {others[0]}{more}, which is not read")
    return lines


def absent(bag: Path) -> list[str]:
    """A line for each file that metadata.yaml of a folder names and that is not there."""
    gone = [path.name for path in _listed(bag / "metadata.yaml") if not path.exists()]
    return [f"{bag}: its metadata.yaml names {name}, which is not there" for name in gone]


def bag_path(bag: Path) -> Path:
    """The only MCAP file of `bag`. Raises SinkError where there is none or there are several."""
    paths = bag_paths(bag)
    if len(paths) > 1:
        raise SinkError(f"{bag}: not a bag of rb_sim: {len(paths)} .mcap files in it")
    return paths[0]


def _listed(metadata: Path) -> list[Path]:
    """The MCAP files that a metadata.yaml names; none if it cannot be read."""
    try:
        document = yaml.load(metadata.read_text(encoding="utf-8"), Loader=_YAML)
        names = document["rosbag2_bagfile_information"]["relative_file_paths"]
        # without a folder, as rosbags does: rosbag2 wrote it before version 4 of metadata.yaml
        paths = [metadata.parent / PurePath(str(name)).name for name in names]
    except (OSError, ValueError, yaml.YAMLError, TypeError, KeyError):
        return []
    return paths if all(path.suffix == ".mcap" for path in paths) else []


def _number(path: Path) -> tuple[str, int]:
    stem, _, number = path.stem.rpartition("_")
    return (stem, int(number)) if number.isdigit() else (path.stem, 0)


def read_records(path: Path, damages: list[Damage] | None = None) -> Iterator[Record]:
    """Records of the data section in file order, those within chunks one by one.

    What is broken is left out, and told at the end in `damages`.
    Raises SinkError for a file that is no MCAP or cannot be opened.
    """
    frames = Frames(path)
    for frame in frames:
        try:
            yield from _parse(frame)
        except BrokenRecordError:
            frames.damages.append(Damage(frame.offset, frame.offset, NO_RECORD))
    if damages is not None:
        damages += frames.damages


class BrokenRecordError(Exception):
    """A record is not what its kind says."""


def _parse(frame: Frame) -> Iterator[Record]:
    if frame.opcode != Opcode.CHUNK:
        record = parse_record(frame.opcode, frame.content)
        if record is not None:
            yield record
        return
    data, at = frame.content, 0
    while at < len(data):
        if at + _FRAME.size > len(data):
            raise BrokenRecordError
        opcode, length = _FRAME.unpack_from(data, at)
        at += _FRAME.size + length
        record = parse_record(opcode, data[at - length : at])
        if record is not None:
            yield record


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


def read_metadata(path: Path) -> Iterator[Metadata]:
    """The metadata records of a file: those that its index names, else by reading all of it.

    Raises SinkError as `read_records` does.
    """
    frames = Frames(path)
    found = frames.named() if frames.index is not None else iter(frames)
    for frame in found:
        if frame.opcode != Opcode.METADATA:  # chunks hold none
            continue
        try:
            record = parse_record(frame.opcode, frame.content)
        except BrokenRecordError:
            continue
        if isinstance(record, Metadata):
            yield replace(record, name=name_of(frames.index, frame.offset, record.name))


def metadata_names(path: Path) -> set[str]:
    """Of all metadata records that the index of a file names."""
    frames = Frames(path)
    frames.close()
    return set() if frames.index is None else set(frames.index.names.values())


def is_complete(path: Path) -> bool:
    """True if the file ends as a finished one does."""
    from mcap.writer import MCAP0_MAGIC

    with path.open("rb") as file:
        size = file.seek(0, 2)
        if size < 2 * len(MCAP0_MAGIC):
            return False
        file.seek(size - len(MCAP0_MAGIC))
        return file.read() == MCAP0_MAGIC
