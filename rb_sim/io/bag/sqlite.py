"""The messages of an SQLite file of rosbag2 (.db3), as `batches` gives those of an MCAP file.

The rosbags library reads it, which knows all versions of rosbag2's tables. Such a file has neither
checksums nor records of whoever wrote it, and its messages have no numbers: they come in the order
of their times. What stands in the journal beside it, of a recorder that was killed, is not read.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from rb_sim.base.errors import MissingExtraError, RbSimError, SinkError
from rb_sim.io.bag.batches import Batch, Messages
from rb_sim.io.bag.checked_records import BROKEN_DATABASE, JOURNAL, Damage, Missing

SUFFIX = ".db3"
_TOGETHER = 1 << 21
"""Bytes of messages that are read as one batch."""


def is_sqlite(path: Path) -> bool:
    """Whether it is a file of that storage, by its name."""
    return path.suffix == SUFFIX


def span_of(path: Path) -> tuple[int, int]:
    """Log times of the first and of the last message [ns]; (0, 0) for a file that has none."""
    with _opened(path) as reader:
        return (reader.start_time, reader.end_time - 1) if reader.message_count else (0, 0)


class SqliteScan:
    """Reads one file from its first message to its last; iterate over `batches` once.

    Attributes as of `batches.BagScan`. Raises SinkError for what is no such file,
    MissingExtraError without rosbags.
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
        """What could not be read; complete after the last batch."""
        return Missing(self.path, self._damages, self._counted - self.messages, self._first)

    def batches(self) -> Iterator[Batch]:
        """The messages in the order of their times."""
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
        except SinkError:  # a page of the database is broken: what was read before it stands
            self._damages.append(Damage(0, 0, BROKEN_DATABASE, self._last_of(waiting)))
        if waiting:
            yield self._batch(waiting)
        journal = self.path.with_name(f"{self.path.name}-wal")
        if journal.exists() and journal.stat().st_size:
            self._damages.append(Damage(0, 0, JOURNAL, self._last))

    def _last_of(self, waiting: list[tuple[int, int, bytes]]) -> int | None:
        return waiting[-1][1] if waiting else self._last

    def _batch(self, rows: list[tuple[int, int, bytes]]) -> Batch:
        sizes = np.array([len(data) for *_, data in rows], dtype=np.int64)
        starts = np.cumsum(sizes) - sizes
        times = np.array([time for _, time, _ in rows], dtype=np.int64)
        of = np.array([number for number, *_ in rows])
        buffer = np.frombuffer(b"".join(data for *_, data in rows), np.uint8)
        first = self.messages
        self.messages += len(rows)
        self.unchecked += len(rows)
        self.bytes += int(sizes.sum())
        self._first = int(times[0]) if self._first is None else self._first
        self._last = int(times[-1])
        batch: Batch = {}
        for number in np.unique(of).tolist():
            at = np.flatnonzero(of == number)
            batch[number] = Messages(times[at], first + at, buffer, starts[at], sizes[at])
        return batch


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The rosbags reader of a file. Raises SinkError, as soon as what it does fails."""
    try:
        reader_of = import_module("rosbags.rosbag2").Reader
    except ImportError:
        raise MissingExtraError("rosbags", "analysis", f"{path}: a bag in SQLite storage") from None
    try:
        with reader_of(path) as reader:
            yield reader
    except (RbSimError, GeneratorExit, KeyboardInterrupt):
        raise
    except Exception as error:  # of the library, of its driver of SQLite, of damaged rows
        reason = str(error).partition("\n")[0]
        if "malformed" in reason:
            mended = path.with_name(f"{path.stem}_mended{SUFFIX}")
            mend = f"sqlite3 {path} .recover | sqlite3 {mended}"
            raise SinkError(
                f"{path}: the database is damaged; to save its undamaged part: {mend}"
            ) from None
        raise SinkError(f"{path}: not an SQLite file of rosbag2: {reason}") from None
