# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Files of a bag in either storage (MCAP, SQLite): lookup, choice of reader, and `recover`.

`recover` makes a readable bag from an unfinished one (killed process, full disk).
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from rb_sim.base.errors import MissingExtraError, RbSimError, SinkError
from rb_sim.io.bag.bag_sink import LIBRARY
from rb_sim.io.bag.batches import BagScan, Batch, Messages, by_channel, together
from rb_sim.io.bag.checked_records import BROKEN_DATABASE, JOURNAL, Damage, Frames, Missing
from rb_sim.io.bag.file import BagFile
from rb_sim.io.bag.records import BrokenRecordError, name_of, parse_record

# Reader of rosbag2's SQLite files (.db3), with the interface of `batches`.
#
# It uses the rosbags library, which supports all versions of rosbag2's tables. Such a file has no
# checksums, metadata records or sequence numbers; messages are read in order of time. The journal
# of a killed recorder is not read.


SUFFIX = ".db3"
_TOGETHER = 1 << 21
"""Bytes of messages per batch."""


def is_sqlite(path: Path) -> bool:
    """Whether it is an SQLite file, by its name."""
    return path.suffix == SUFFIX


class SqliteScan:
    """Reads one file from first to last message; iterate over `batches` once.

    Attributes as in `batches.BagScan`. Raises SinkError if it is not such a file, MissingExtraError
    without rosbags.
    """

    chunks = unchecked_chunks = 0
    header: Header | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self.complete = True
        self.messages = self.unchecked = self.bytes = 0
        self._counted = 0
        self._first: int | None = None
        self._last: int | None = None
        self._damages: list[Damage] = []
        with _opened(path) as reader:
            self._counted = reader.message_count
            for connection in reader.connections:
                self._add(connection)

    def _add(self, connection: Any) -> None:
        definition, extension = connection.msgdef, connection.ext
        encoding = {"MSG": "ros2msg", "IDL": "ros2idl"}.get(definition.format.name, "")
        number = connection.id
        self.schemas[number] = Schema(
            data=definition.data.encode(), encoding=encoding, id=number, name=connection.msgtype
        )
        dump = import_module("rosbags.rosbag2.metadata").dump_qos_v9
        profiles = yaml.safe_dump(dump(extension.offered_qos_profiles), sort_keys=False)
        recorded = {"offered_qos_profiles": profiles, "topic_type_hash": connection.digest or ""}
        self.channels[number] = Channel(
            id=number, topic=connection.topic, message_encoding=extension.serialization_format,
            metadata=recorded, schema_id=number,
        )  # fmt: skip

    @property
    def missing(self) -> Missing:
        """Unreadable parts; complete after the last batch."""
        return Missing(self.path, self._damages, self._counted - self.messages, self._first)

    def batches(self) -> Iterator[Batch]:
        """Yield the messages in order of time."""
        waiting: list[tuple[int, int, bytes]] = []
        size = 0
        try:
            with _opened(self.path) as reader:
                for connection, time, data in reader.messages():
                    waiting.append((connection.id, time, bytes(data)))
                    size += len(data)
                    if size >= _TOGETHER:
                        yield self._batch(waiting)
                        waiting, size = [], 0
        except SinkError:  # a broken page of the database: keep the messages before it
            self._damages.append(Damage(0, 0, BROKEN_DATABASE, self._last_of(waiting)))
        if waiting:
            yield self._batch(waiting)
        journal = self.path.with_name(f"{self.path.name}-wal")
        if journal.exists() and journal.stat().st_size:
            self._damages.append(Damage(0, 0, JOURNAL, self._last))

    def _last_of(self, waiting: list[tuple[int, int, bytes]]) -> int | None:
        return waiting[-1][1] if waiting else self._last

    def _batch(self, rows: list[tuple[int, int, bytes]]) -> Batch:
        buffer, starts, sizes = together([data for *_, data in rows])
        of, times = np.array([row[:2] for row in rows], dtype=np.int64).T
        first = self.messages
        self.messages += len(rows)
        self.unchecked += len(rows)
        self.bytes += int(sizes.sum())
        self._first = int(times[0]) if self._first is None else self._first
        self._last = int(times[-1])
        return {
            number: Messages(times[at], first + at, buffer, starts[at], sizes[at])
            for number, at in by_channel(of)
        }


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The rosbags reader of a file. Raises SinkError if it fails at any time, MissingExtraError."""
    try:
        reader_of = import_module("rosbags.rosbag2").Reader
    except ImportError:
        raise MissingExtraError("rosbags", "analysis", f"{path}: a bag in SQLite storage") from None
    try:
        with reader_of(path) as reader:
            yield reader
    except (RbSimError, GeneratorExit, KeyboardInterrupt):
        raise
    except Exception as error:  # from the library, the SQLite driver, or damaged rows
        reason = str(error).partition("\n")[0]
        if "malformed" in reason:
            mended = path.with_name(f"{path.stem}_mended{SUFFIX}")
            mend = f"sqlite3 {path} .recover | sqlite3 {mended}"
            raise SinkError(
                f"{path}: the database is damaged; to save its undamaged part: {mend}"
            ) from None
        raise SinkError(f"{path}: not an SQLite file of rosbag2: {reason}") from None


STORAGES = (".mcap", SUFFIX)
"""File name extensions of bags."""
_COMPRESSED = ".zstd"
"""Suffix of a file that rosbag2 compressed as a whole."""

_YAML = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The C loader if available: metadata.yaml contains every topic's QoS and is slow to parse."""


def bag_paths(bag: Path) -> list[Path]:
    """The files of `bag` in order: of a directory, or the file itself.

    The folder of a run, which contains a folder `bag`, stands for that bag.

    They are those in metadata.yaml that exist (`absent` reports the others); without it all files,
    if their names form a series (NAME_0, NAME_1 ..., or 0_NAME_TIME, 1_NAME_TIME ... of rosbag2
    since 2026). Empty ones, which a full disk or a killed process leaves behind the last one, are
    left out (`unlisted` reports them). Order: by number, which holds even if the clock was set back
    between two; else by the first times of the log. Raises SinkError if there is no file, or
    several bags.
    """
    if not bag.is_dir():
        if not bag.exists():
            raise SinkError(
                f"{bag}: does not exist; must be a bag or the folder of a run (record one: "
                "rb_sim run SCENE --out DIR)"
            )
        if bag.suffix == _COMPRESSED:
            raise SinkError(_packed(bag, bag))
        return [bag]
    bag = _of_run(bag)
    listed = _listed(bag / "metadata.yaml")
    there = [path for path in listed if path.exists()]
    found = there or ([] if listed else _files(bag))
    if not found:
        packed = sorted(bag.glob(f"*{_COMPRESSED}"))
        if packed:
            raise SinkError(_packed(bag, packed[0]))
        if listed:
            raise SinkError(f"{bag}: its metadata.yaml names {listed[0].name}, which is not there")
        raise SinkError(f"{bag}: not a bag: no {' or '.join(STORAGES)} file in it")
    series = [_number(path) for path in found]
    if len({(path.suffix, stem) for path, (stem, _) in zip(found, series, strict=True)}) == 1:
        found = [path for _, path in sorted(zip(series, found, strict=True))]
    elif not listed:
        raise SinkError(
            f"{bag}: not one bag: {len(found)} files without metadata.yaml whose names are no "
            f"series, as {found[0].name} and {found[-1].name}; name one of them, or call those of "
            f"one recording NAME_0{found[0].suffix}, NAME_1{found[0].suffix} ..."
        )
    else:
        found = sorted(found, key=_begins)
    return [path for path in found if path.stat().st_size] or found


def _begins(path: Path) -> float:
    """The earliest log time in the first batch of a file [ns]; infinite without any."""
    with suppress(SinkError):
        for batch in scan_of(path).batches():
            if times := [messages.log_time.min() for messages in batch.values()]:
                return float(min(times))
    return float("inf")


def _of_run(folder: Path) -> Path:
    """The bag in the folder of a run; any other folder itself."""
    inner = folder / "bag"
    return inner if inner.is_dir() and not _files(folder) else folder


def _files(bag: Path) -> list[Path]:
    """All files of a directory that may belong to a bag."""
    return sorted((path for end in STORAGES for path in bag.glob(f"*{end}")), key=_number)


def _packed(bag: Path, path: Path) -> str:
    return (
        f"{bag}: {path.name} was compressed as a whole by rosbag2; unpack it first: "
        f"zstd -d {path.parent}/*{''.join(path.suffixes[-2:])}"
    )


def holds_bag(folder: Path) -> bool:
    """Whether a directory contains files of a bag, or is the folder of a run with a bag."""
    return bool(_files(_of_run(folder)))


def unlisted(bag: Path) -> list[str]:
    """Lines on files of a directory that its metadata.yaml does not list (they are not read), on
    listed files that do not exist, and on empty ones."""
    if not bag.is_dir():
        return []
    bag = _of_run(bag)
    named = _listed(bag / "metadata.yaml")
    listed = {os.path.normpath(path) for path in named}
    files = _files(bag)
    others = sorted(p.name for p in files if os.path.normpath(p) not in listed)
    lines = absent(bag)
    lines += [f"{path} is empty" for path in files if not path.stat().st_size]
    if listed and others:
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        lines.append(f"{bag}: its metadata.yaml does not name {others[0]}{more}, which is not read")
    return lines


def absent(bag: Path) -> list[str]:
    """A line for each file listed in metadata.yaml that does not exist."""
    listed = _listed(_of_run(bag) / "metadata.yaml")
    gone = [path.name for path in listed if not path.exists()]
    return [f"{bag}: its metadata.yaml names {name}, which is not there" for name in gone]


def _listed(metadata: Path) -> list[Path]:
    """Files listed in a metadata.yaml, without compression suffix; none if unreadable."""
    try:
        document = yaml.load(metadata.read_text(encoding="utf-8"), Loader=_YAML)
        names = document["rosbag2_bagfile_information"]["relative_file_paths"]
        plain = [str(name).replace("\\", "/").removesuffix(_COMPRESSED) for name in names]
        paths = [metadata.parent / name for name in plain]
        # before version 4 of metadata.yaml rosbag2 included the bag's directory: drop it, as
        # rosbags does
        paths = [path if path.is_file() else metadata.parent / path.name for path in paths]
    except (OSError, ValueError, yaml.YAMLError, TypeError, KeyError):
        return []
    return paths if all(path.suffix in STORAGES for path in paths) else []


_NUMBER_FIRST = re.compile(r"([0-9]+)_(.+)_[0-9]{4}_[0-9]{2}_[0-9]{2}-[0-9]{2}_[0-9]{2}_[0-9]{2}")
"""Name of a file of newer versions of rosbag2: number, name of the bag, time of its beginning."""


def _number(path: Path) -> tuple[str, int]:
    if first := _NUMBER_FIRST.fullmatch(path.stem):
        return first[2], int(first[1])
    stem, _, number = path.stem.rpartition("_")
    return (stem, int(number)) if number.isdigit() else (path.stem, 0)


def metadata_of(path: Path, name: str) -> tuple[dict[str, str] | None, bool]:
    """The last metadata record of that name (None if unreadable), and whether there is one.

    The index locates it; without an index the whole file is read. SQLite files have none. Raises
    SinkError if the file is not MCAP or cannot be opened.
    """
    if is_sqlite(path):
        return None, False
    frames = Frames(path)
    found = None
    for frame in frames if frames.index is None else frames.named():
        if frame.opcode == Opcode.METADATA:  # never within chunks
            with suppress(BrokenRecordError):
                record = parse_record(frame.opcode, frame.content)
                assert isinstance(record, Metadata)
                if name_of(frames.index, frame.offset, record.name) == name:
                    found = record.metadata
    named = frames.index is not None and name in frames.index.names.values()
    return found, named or found is not None


def is_complete(path: Path) -> bool:
    """Whether the file has the end of a finished one; always true for SQLite files."""
    if is_sqlite(path):
        return True
    with closing(Frames(path)) as frames:
        return frames.complete


Scan = BagScan | SqliteScan


def scan_of(path: Path) -> Scan:
    """The reader of one file of a bag, by its storage. Raises SinkError, MissingExtraError."""
    return SqliteScan(path) if is_sqlite(path) else BagScan(path)


class Recovered(NamedTuple):
    """Result of `recover_bag`. `complete`: the source was finished and undamaged."""

    directory: Path
    messages: int
    complete: bool
    damage: tuple[str, ...] = ()
    """Lines on the unreadable parts and their time spans."""
    unchecked: int = 0
    """Number of messages not covered by a checksum, which may be corrupt unnoticed."""


def recover_bag(bag: Path, directory: Path | None = None) -> Recovered:
    """Copy all readable messages of `bag` (directory or file) into a new bag directory.

    The source is not changed. directory: target; None: next to the source, with `_recovered`
    appended to its name. Raises SinkError: not a bag, nothing readable, disk full, or the target
    exists.
    """
    sources = bag_paths(bag)
    target = _beside(bag) if directory is None else directory
    if target.exists():
        raise SinkError(f"{target}: exists already; name another folder to recover into")
    copy = None
    try:
        copy = _Copy(BagFile(target, LIBRARY))
        scans = [copy.take(source) for source in sources]
        if not copy.file.count:
            none = "nothing to recover: not one chunk of it was finished"
            raise SinkError(f"{sources[0]}: {none}")
        copy.file.finish()
    except BaseException as error:  # also Ctrl-C: a partial copy would block the next attempt
        if copy is not None:
            with suppress(OSError):
                copy.file.abandon()
        shutil.rmtree(target, ignore_errors=True)
        if isinstance(error, OSError):
            raise SinkError(f"{target}: cannot recover: {error.strerror}") from None
        raise
    complete = all(scan.complete for scan in scans)
    missing = [scan.missing for scan in scans]
    damaged = any(part.damages for part in missing)
    gone = absent(bag)
    lines = (*gone, *(line for part in missing for line in part.lines()))
    unchecked = sum(scan.unchecked for scan in scans)
    whole = complete and not damaged and not gone
    return Recovered(target, copy.file.count, whole, lines, unchecked)


def _beside(bag: Path) -> Path:
    bag = bag.resolve()
    return bag.with_name(f"{bag.stem if bag.is_file() else bag.name}_recovered")


class _Copy:
    """The new bag; takes each channel, record and attachment once (split bags repeat them)."""

    def __init__(self, file: BagFile) -> None:
        self.file = file
        self._channels: dict[tuple[str, ...], int] = {}
        self._known: set[tuple[object, ...]] = set()

    def take(self, source: Path) -> Scan:
        """Copy what is readable in a file; the returned scan reports the rest."""
        scan = scan_of(source)
        channels: dict[int, int] = {}
        for batch in scan.batches():
            if scan.header is not None and (profile := scan.header.profile) != "ros2":
                raise SinkError(f"{source}: not a ROS 2 bag: its profile is {profile!r}")
            for number, channel in scan.channels.items():
                if number not in channels and channel.schema_id in scan.schemas:
                    channels[number] = self._channel(channel, scan.schemas[channel.schema_id])
            self._take_records(scan)
            self._take_messages(batch, channels)
        self._take_records(scan)
        return scan

    def _channel(self, channel: Channel, schema: Schema) -> int:
        """Number of a channel in the new bag."""
        profiles = channel.metadata.get("offered_qos_profiles", "[]")
        type_hash = channel.metadata.get("topic_type_hash", "")
        key = channel.topic, schema.name, schema.data.hex(), type_hash, profiles
        if key not in self._channels:
            qos = yaml.safe_load(profiles)
            added = self.file.add_channel(channel.topic, schema.name, schema.data, type_hash, qos)
            self._channels[key] = added
        return self._channels[key]

    def _take_records(self, scan: Scan) -> None:
        """Copy metadata and attachments found so far, each once."""
        for record in scan.metadata:  # rosbag2's is written by finish
            values = record.metadata
            if record.name != "rosbag2" and self._is_new(record.name, *sorted(values.items())):
                self.file.add_metadata(record.name, values)
        for record in scan.attachments:
            if self._is_new(record.name, record.media_type, record.data):
                self.file.add_attachment(
                    record.log_time, record.name, record.media_type, record.data
                )

    def _is_new(self, *content: object) -> bool:
        known = content in self._known
        self._known.add(content)
        return not known

    def _take_messages(self, batch: Batch, channels: dict[int, int]) -> None:
        """Copy the messages of a batch, in file order."""
        known = [(number, m) for number, m in batch.items() if number in channels]
        order = [(int(m.start[k]), number, k) for number, m in known for k in range(len(m.start))]
        for _, number, k in sorted(order):
            m = batch[number]
            times = int(m.log_time[k]), int(m.sequence[k])
            self.file.add_message(channels[number], *times, m.data(k))
