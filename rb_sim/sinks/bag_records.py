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
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema

from rb_sim.errors import SinkError
from rb_sim.sinks.bag_chunks import Frame
from rb_sim.sinks.bag_damage import NO_RECORD, Damage
from rb_sim.sinks.bag_frames import Frames
from rb_sim.sinks.bag_index import name_of
from rb_sim.sinks.bag_salvage import WholeStream

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


def bag_paths(bag: Path, *, partial: bool = False) -> list[Path]:
    """The MCAP files of `bag` in their order: of a directory, or the file itself.

    partial: leave out files that metadata.yaml names and that are not there, if others are.
    Raises SinkError where there is none, or the directory's files are not of one bag.
    """
    if not bag.is_dir():
        if not bag.exists():
            raise SinkError(f"{bag}: no such bag")
        return [bag]
    listed = _listed(bag / "metadata.yaml")
    if listed:
        missing = [path.name for path in listed if not path.exists()]
        there = [path for path in listed if path.exists()]
        if missing and not (partial and there):
            cure = f"; read the others with: rb_sim recover {bag}" if there else ""
            line = f"{bag}: its metadata.yaml names {missing[0]}, which is not there{cure}"
            raise SinkError(line)
        return there
    found = sorted(bag.glob("*.mcap"), key=_number)
    if not found:
        other = [path for kind in ("*.db3", "*.mcap.zstd", "*.db3.zstd") for path in bag.glob(kind)]
        other.sort()
        what = "no .mcap file in it"
        if other:
            what += f" but {other[0].name} (convert it to MCAP with rosbags-convert)"
        raise SinkError(f"{bag}: not a bag of rb_sim: {what}")
    stems = {path.stem.rpartition("_")[0] for path in found}
    if len(found) > 1 and (len(stems) > 1 or stems == {""}):
        raise SinkError(f"{bag}: not a bag of rb_sim: {len(found)} .mcap files in it")
    return found


def unlisted(bag: Path) -> list[str]:
    """A line for the MCAP files of a folder that its metadata.yaml leaves out, and nobody reads."""
    if not bag.is_dir():
        return []
    listed = {os.path.normpath(path) for path in _listed(bag / "metadata.yaml")}
    others = sorted(p.name for p in bag.glob("*.mcap") if os.path.normpath(p) not in listed)
    if not listed or not others:
        return []
    more = f" and {len(others) - 1} more" if len(others) > 1 else ""
    return [f"{bag}: its metadata.yaml does not name {others[0]}{more}, which is not read"]


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
