# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A rosbag2 directory: DIR/<name of DIR>_0.mcap, _1 ... where it is split, and DIR/metadata.yaml.

The MCAP files follow the ros2 profile and carry rosbag2's own metadata; metadata.yaml is written
last, so that a directory which has it is complete.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import time
from collections.abc import Callable, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from rb_sim.io.bag.writer import McapWriter, Rows

# The open chunk of a bag as it would be if it ended now, so that a killed process loses little.
#
# Where chunks ended by the clock, equal runs would give different files. So a chunk ends by its
# size alone, and what waits in the open one stands at the end of the file as a draft, which any
# reader of unfinished files takes for a chunk; the next chunk is written over it.


PERIOD = 0.5
"""[s] of wall time that a message waits for the next draft."""


class Draft:
    """Says when one is due. clock: gives wall time [s]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._since: float | None = None

    def wait(self) -> None:
        """A message waits in the open chunk."""
        if self._since is None:
            self._since = self._clock()

    def clear(self) -> None:
        """None waits any more: the chunk has ended, or a draft was written."""
        self._since = None

    @property
    def due(self) -> bool:
        """True if a message has waited for PERIOD."""
        return self._since is not None and self._clock() - self._since >= PERIOD


# The file below a bag: appends whole records, and says when it cannot.
#
# A disk that fills up leaves a bag without its index. So a little space is kept from the start and
# given back then: enough to finish the file.


RESERVE = 1 << 20
"""Space kept for the open chunk and the index [bytes]: the index of about 1 GB of samples."""

_FULL = (errno.ENOSPC, errno.EDQUOT)


class BagStream:
    """A locked file that grows by whole writes, unbuffered: what was written survives a crash.

    full: True as soon as the disk was found full; what is written then comes from the reserve.
    Raises OSError where it cannot be opened, or written even so; BlockingIOError if another
    process is writing it.
    """

    def __init__(self, path: Path, reserve: int = RESERVE) -> None:
        self.full = False
        self._position = 0
        self._draft_end = 0
        self._reserve = path.with_name(f".{path.name}.reserve")
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.ftruncate(self._file, 0)
            self._keep(reserve)
        except OSError:
            self.close()
            raise

    def _keep(self, size: int) -> None:
        file = os.open(self._reserve, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            if size:
                os.posix_fallocate(file, 0, size)
        finally:
            os.close(file)

    def write(self, data: bytes) -> int:
        """Append all of `data` or, raising OSError, nothing."""
        start = self._position
        try:
            self._append(data)
        except OSError as error:
            self._rewind(start)
            if error.errno not in _FULL or self.full:
                raise
            self.full = True
            self._reserve.unlink(missing_ok=True)
            try:
                self._append(data)
            except OSError:
                self._rewind(start)
                raise
        return len(data)

    def write_draft(self, data: bytes) -> None:
        """Put `data` at the end of the file, where the next write goes over it.

        Where there is no room it is left out: a draft is worth no space kept for better things.
        """
        try:
            written = os.pwrite(self._file, data, self._position)
        except OSError:
            written = 0
        self._draft_end = max(self._draft_end, self._position + written)
        if written < len(data):
            self._drop_draft()

    def _append(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            written = os.write(self._file, rest)
            self._position += written
            rest = rest[written:]
        self._drop_draft()

    def _drop_draft(self) -> None:
        """Cut off what is left of a draft behind the last write."""
        if self._draft_end > self._position:
            os.ftruncate(self._file, self._position)
        self._draft_end = 0

    def _rewind(self, position: int) -> None:
        os.ftruncate(self._file, position)
        os.lseek(self._file, position, os.SEEK_SET)
        self._position = position
        self._draft_end = 0

    def tell(self) -> int:
        """Bytes written."""
        return self._position

    def flush(self) -> None:
        """Nothing is buffered."""

    @property
    def vanished(self) -> bool:
        """True if the file was removed, so that writing on would be for nobody."""
        return os.fstat(self._file).st_nlink == 0

    def close(self) -> None:
        """Release the file and the reserve; a second time does nothing."""
        if self._file >= 0:
            self._reserve.unlink(missing_ok=True)
            os.close(self._file)
            self._file = -1


CHUNK_SIZE = 128 * 1024
"""Bytes of messages in a chunk; what waits in the open one is drafted every half second."""

QOS: dict[str, Any] = {
    "history": "keep_last",
    "depth": 10,
    "reliability": "reliable",
    "durability": "volatile",
    "deadline": {"sec": 9223372036, "nsec": 854775807},
    "lifespan": {"sec": 9223372036, "nsec": 854775807},
    "liveliness": "automatic",
    "liveliness_lease_duration": {"sec": 9223372036, "nsec": 854775807},
    "avoid_ros_namespace_conventions": False,
}
"""Offered by every topic. An endless time is the longest that rosbag2 can write."""
LATCHED: dict[str, Any] = QOS | {"depth": 1, "durability": "transient_local"}
"""Offered by topics whose last message is for who comes late, too."""

ROS_DISTRO = "jazzy"
_METADATA_VERSION = 9


def mcap_path(directory: Path, number: int = 0) -> Path:
    """An MCAP file of a bag directory."""
    return directory / f"{directory.resolve().name}_{number}.mcap"


class _Channel(NamedTuple):
    topic: str
    ros_type: str
    type_hash: str
    qos: list[Any]


class BagFile:
    """Writes one bag directory. Raises OSError as BagStream does.

    Whatever was in the directory under the names used here is replaced.
    before: the files before this one, where the bag is split.
    """

    def __init__(
        self,
        directory: Path,
        library: str,
        chunk_size: int = CHUNK_SIZE,
        before: tuple[BagFile, ...] = (),
    ) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self.path = mcap_path(directory, len(before))
        self._metadata_path = directory / "metadata.yaml"
        self._opened = directory, library, chunk_size
        self._before = before
        self.stream = BagStream(self.path)
        self._metadata_path.unlink(missing_ok=True)
        if not before:
            self._remove_older()
        self._writer = McapWriter(self.stream, chunk_size)
        self._channels: dict[int, _Channel] = {}
        self._counts: dict[int, int] = {}
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._schema_of: dict[int, int] = {}
        self._draft = Draft()
        self._first: int | None = None
        self._last = 0
        self._writer.start(profile="ros2", library=library)

    @property
    def count(self) -> int:
        """Messages so far."""
        return sum(self._counts.values())

    @property
    def first(self) -> int | None:
        """Earliest time of a message [ns]; None before the first."""
        return self._first

    @property
    def last(self) -> int:
        """Latest time of a message [ns]."""
        return self._last

    def add_channel(
        self, topic: str, ros_type: str, schema: bytes, type_hash: str, qos: list[Any] | None = None
    ) -> int:
        """A new topic; returns the number to write its messages with."""
        key = ros_type, schema
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(ros_type, "ros2msg", schema)
        profiles = [QOS] if qos is None else qos
        metadata = {
            "offered_qos_profiles": yaml.safe_dump(profiles, sort_keys=False),
            "topic_type_hash": type_hash,
        }
        schema_id = self._schemas[key]
        channel = self._writer.register_channel(topic, "cdr", schema_id, metadata)
        self._channels[channel] = _Channel(topic, ros_type, type_hash, profiles)
        self._schema_of[channel] = schema_id
        self._counts[channel] = 0
        return channel

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """A metadata record, on the disk at once."""
        self._writer.add_metadata(name, values)

    def add_attachment(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """A file within the bag, on the disk at once. time: [ns] since the epoch."""
        self._writer.add_attachment(time, name, media_type, data)

    def write(self, channel: int, time: int, sequence: int, data: bytes) -> None:
        """One message. time: [ns] since the epoch; sequence: number of the sample."""
        self.write_all((channel,), time, sequence, (data,))

    def write_all(
        self, channels: Sequence[int], time: int, sequence: int, messages: Sequence[bytes]
    ) -> None:
        """A message on each of the channels, as `write` has it."""
        ended = self._writer.add_messages(channels, time, sequence & 0xFFFFFFFF, messages)
        self._note(channels, 1, (time, time), ended)

    def write_rows(self, channels: Sequence[int], times: Any, sequence: int, rows: Rows) -> None:
        """Messages on each of the channels, row by row: `times` [ns] and numbers increase."""
        ended = self._writer.add_rows(channels, times, sequence, rows)
        self._note(channels, len(times), (int(times[0]), int(times[-1])), ended)

    def _note(
        self, channels: Sequence[int], count: int, span: tuple[int, int], ended: bool
    ) -> None:
        """Count messages of each channel. span: earliest and latest time; ended: a chunk did."""
        if ended:
            self._draft.clear()
        if self._writer.waiting:
            self._draft.wait()
        for channel in channels:
            self._counts[channel] += count
        first, last = span
        self._first = first if self._first is None else min(self._first, first)
        self._last = max(self._last, last)

    def keep(self) -> None:
        """See that no message waits for longer than a draft's PERIOD; call it now and then."""
        if self._draft.due:
            self.stream.write_draft(self._writer.draft())
            self._draft.clear()

    def _remove_older(self) -> None:
        """Later files of an older bag: an unfinished one would be taken to go on with them."""
        pattern = re.compile(re.escape(self.path.stem[:-1]) + r"[1-9][0-9]*\.mcap")
        for path in self.path.parent.iterdir():
            if pattern.fullmatch(path.name):
                path.unlink()

    def follow(self) -> BagFile:
        """Finish this file; the next one of the bag, its topics under the same numbers."""
        after = BagFile(*self._opened, before=(*self._before, self))
        try:
            schemas = {number: schema for (_, schema), number in self._schemas.items()}
            for number, channel in self._channels.items():
                text = schemas[self._schema_of[number]]
                after.add_channel(
                    channel.topic, channel.ros_type, text, channel.type_hash, channel.qos
                )
            self._end()
        except OSError:
            after.abandon()
            raise
        return after

    def _end(self) -> None:
        """Index, and the file is closed; without the first if that fails."""
        try:
            text = yaml.safe_dump(_information((self,)), sort_keys=False)
            self._writer.add_metadata("rosbag2", {"serialized_metadata": text})
            self._writer.finish()
        finally:
            self.stream.close()

    def finish(self) -> None:
        """Index, metadata.yaml, and the file is closed; without the first two if that fails."""
        self._end()
        info = _information((*self._before, self))
        draft = self._metadata_path.with_name(".metadata.yaml")
        document = {"rosbag2_bagfile_information": info}
        draft.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
        os.replace(draft, self._metadata_path)

    def abandon(self) -> None:
        """Close the file as it is; `rb_sim recover` makes it readable."""
        self.stream.close()

    def span(self) -> dict[str, Any]:
        """Times and number of the messages, as metadata.yaml has them."""
        return _span(self._first or 0, self._last, self.count)

    def counts(self) -> list[tuple[_Channel, int]]:
        """Messages of each topic."""
        return [(channel, self._counts[number]) for number, channel in self._channels.items()]


def _span(first: int, last: int, count: int) -> dict[str, Any]:
    return {
        "duration": {"nanoseconds": max(0, last - first)},
        "starting_time": {"nanoseconds_since_epoch": first},
        "message_count": count,
    }


def _information(files: tuple[BagFile, ...]) -> dict[str, Any]:
    """What rosbag2 wants to know of these files together."""
    starts = [file.first for file in files if file.first is not None]
    last = max(file.last for file in files)
    channels: dict[str, tuple[_Channel, int]] = {}
    for file in files:
        for channel, count in file.counts():
            before = channels[channel.topic][1] if channel.topic in channels else 0
            channels[channel.topic] = channel, before + count
    return {
        "version": _METADATA_VERSION,
        "storage_identifier": "mcap",
        **_span(min(starts, default=0), last, sum(file.count for file in files)),
        "topics_with_message_count": [
            {"topic_metadata": _topic_metadata(channel), "message_count": count}
            for channel, count in channels.values()
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.path.name for file in files],
        "files": [{"path": file.path.name, **file.span()} for file in files],
        "custom_data": None,
        "ros_distro": ROS_DISTRO,
    }


def _topic_metadata(channel: _Channel) -> dict[str, Any]:
    return {
        "name": channel.topic,
        "type": channel.ros_type,
        "serialization_format": "cdr",
        "offered_qos_profiles": deepcopy(channel.qos),  # YAML would write an alias
        "type_description_hash": channel.type_hash,
    }
