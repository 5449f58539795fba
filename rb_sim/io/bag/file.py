# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Writer of a rosbag2 directory: DIR/<name of DIR>_0.mcap, _1 ... if split, and DIR/metadata.yaml.

The MCAP files follow the ros2 profile and contain rosbag2's metadata. metadata.yaml is written
last, so that its presence marks a complete directory.
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

# Drafts: the open chunk is written as if it ended now, so that a killed process loses little.
#
# If chunks ended by the clock, equal runs would give different files. So a chunk ends only by its
# size, and the messages of the open one are written at the end of the file as a draft, which
# readers of unfinished files accept as a chunk; the next chunk overwrites it.


PERIOD = 0.5
"""[s] of wall-clock time after which a pending message is written as a draft."""


class Draft:
    """Timer of the drafts. clock: returns wall-clock time [s]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._since: float | None = None

    def wait(self) -> None:
        """Note that a message is pending in the open chunk."""
        if self._since is None:
            self._since = self._clock()

    def clear(self) -> None:
        """Note that no message is pending: the chunk ended, or a draft was written."""
        self._since = None

    @property
    def due(self) -> bool:
        """True if a message has been pending for PERIOD."""
        return self._since is not None and self._clock() - self._since >= PERIOD


# Output file that appends whole records, also when the disk is full.
#
# A full disk would leave a bag without its index. So a reserve file is allocated at the start and
# released then: enough to finish the bag.


RESERVE = 1 << 20
"""Space reserved for the open chunk and the index [bytes]: the index of about 1 GB of samples."""

_FULL = (errno.ENOSPC, errno.EDQUOT)


class BagStream:
    """A locked file that grows by whole unbuffered writes, so that written data survive a crash.

    full: True once the disk was full; later writes use the reserve. Raises OSError if it cannot be
    opened or written; BlockingIOError if another process is writing it.
    """

    def __init__(self, path: Path, reserve: int = RESERVE) -> None:
        self.full = False
        self._position = 0
        self._draft_end = 0
        self._reserve = path.with_name(f".{path.name}.reserve")
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self.close()
            raise
        try:
            os.ftruncate(self._file, 0)
            self._keep(reserve)
        except OSError:
            path.unlink(missing_ok=True)  # an empty file is no part of a bag
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
        """Append all of `data`; on OSError nothing is appended."""
        start = self._position
        try:
            self._append(data)
        except OSError as error:
            self._rewind(start)
            if error.errno not in _FULL or self.full:
                raise
            self.use_reserve()
            try:
                self._append(data)
            except OSError:
                self._rewind(start)
                raise
        return len(data)

    def use_reserve(self) -> None:
        """The disk is full: what is still written has the space of the reserve."""
        self.full = True
        self._reserve.unlink(missing_ok=True)

    def write_draft(self, data: bytes) -> None:
        """Write `data` at the end of the file, where the next write overwrites it.

        Without space nothing is written, as drafts may not use the reserve.
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
        """Truncate the rest of a draft behind the last write."""
        if self._draft_end > self._position:
            os.ftruncate(self._file, self._position)
        self._draft_end = 0

    def _rewind(self, position: int) -> None:
        os.ftruncate(self._file, position)
        os.lseek(self._file, position, os.SEEK_SET)
        self._position = position
        self._draft_end = 0

    def tell(self) -> int:
        """Number of bytes written."""
        return self._position

    def flush(self) -> None:
        """Does nothing: writes are unbuffered."""

    @property
    def vanished(self) -> bool:
        """True if the file was deleted."""
        return os.fstat(self._file).st_nlink == 0

    def close(self) -> None:
        """Release the file and the reserve; repeated calls do nothing."""
        if self._file >= 0:
            self._reserve.unlink(missing_ok=True)
            os.close(self._file)
            self._file = -1


CHUNK_SIZE = 128 * 1024
"""Bytes of messages per chunk; the open one is drafted every half second."""

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
"""QoS offered by every topic; durations are the largest that rosbag2 can write (infinite)."""
LATCHED: dict[str, Any] = QOS | {"depth": 1, "durability": "transient_local"}
"""QoS of topics whose last message is also delivered to late subscribers."""

ROS_DISTRO = "jazzy"
_METADATA_VERSION = 9


def mcap_path(directory: Path, number: int = 0) -> Path:
    """Path of the MCAP file with that number in a bag directory."""
    return directory / f"{directory.resolve().name}_{number}.mcap"


class _Channel(NamedTuple):
    topic: str
    ros_type: str
    type_hash: str
    qos: list[Any]


class BagFile:
    """Writes one file of a bag directory. Raises OSError as BagStream does.

    Existing files with the same names are replaced. before: preceding files of a split bag.
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
        """Number of messages so far."""
        return sum(self._counts.values())

    @property
    def first(self) -> int | None:
        """Earliest log time [ns]; None before the first message."""
        return self._first

    @property
    def last(self) -> int:
        """Latest log time [ns]."""
        return self._last

    def add_channel(
        self, topic: str, ros_type: str, schema: bytes, type_hash: str, qos: list[Any] | None = None
    ) -> int:
        """Add a topic; returns the channel number for `write`."""
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
        """Write a metadata record at once."""
        self._writer.add_metadata(name, values)

    def add_attachment(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """Write an attached file at once. time: [ns] since the epoch."""
        self._writer.add_attachment(time, name, media_type, data)

    def write(self, channel: int, time: int, sequence: int, data: bytes) -> None:
        """Write one message. time: [ns] since the epoch; sequence: number of the sample."""
        self.write_all((channel,), time, sequence, (data,))

    def write_all(
        self, channels: Sequence[int], time: int, sequence: int, messages: Sequence[bytes]
    ) -> None:
        """Write one message on each channel, with the time and sequence of `write`."""
        ended = self._writer.add_messages(channels, time, sequence & 0xFFFFFFFF, messages)
        self._note(channels, 1, (time, time), ended)

    def write_rows(self, channels: Sequence[int], times: Any, sequence: int, rows: Rows) -> None:
        """Write messages on each channel, row by row; `times` [ns] and sequence increase."""
        ended = self._writer.add_rows(channels, times, sequence, rows)
        self._note(channels, len(times), (int(times[0]), int(times[-1])), ended)

    def _note(
        self, channels: Sequence[int], count: int, span: tuple[int, int], ended: bool
    ) -> None:
        """Count messages. span: earliest and latest time; ended: whether a chunk ended."""
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
        """Write a draft if a message has been pending for PERIOD; to be called regularly."""
        if self._draft.due:
            self.stream.write_draft(self._writer.draft())
            self._draft.clear()

    def _remove_older(self) -> None:
        """Delete later files of an older bag, which would otherwise seem to continue this one."""
        pattern = re.compile(re.escape(self.path.stem[:-1]) + r"[1-9][0-9]*\.mcap")
        for path in self.path.parent.iterdir():
            if pattern.fullmatch(path.name):
                path.unlink()

    def follow(self) -> BagFile:
        """Finish this file; returns the next one with the same topics and channel numbers, or this
        one, which then uses its reserve, if the disk has no room for another."""
        try:
            after = BagFile(*self._opened, before=(*self._before, self))
        except OSError as error:
            if error.errno not in _FULL:
                raise
            self.stream.use_reserve()
            return self
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
        """Write the index and close the file; it is closed even if that fails."""
        try:
            text = yaml.safe_dump(_information((self,)), sort_keys=False)
            self._writer.add_metadata("rosbag2", {"serialized_metadata": text})
            self._writer.finish()
        finally:
            self.stream.close()

    def finish(self) -> None:
        """Write the index and metadata.yaml and close the file; it is closed even if that fails."""
        self._end()
        info = _information((*self._before, self))
        draft = self._metadata_path.with_name(".metadata.yaml")
        document = {"rosbag2_bagfile_information": info}
        draft.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
        os.replace(draft, self._metadata_path)

    def abandon(self) -> None:
        """Close the file without an index; `rb_sim recover` makes it readable."""
        self.stream.close()

    def span(self) -> dict[str, Any]:
        """Times and number of the messages, in the format of metadata.yaml."""
        return _span(self._first or 0, self._last, self.count)

    def counts(self) -> list[tuple[_Channel, int]]:
        """Channel and number of messages of each topic."""
        return [(channel, self._counts[number]) for number, channel in self._channels.items()]


def _span(first: int, last: int, count: int) -> dict[str, Any]:
    return {
        "duration": {"nanoseconds": max(0, last - first)},
        "starting_time": {"nanoseconds_since_epoch": first},
        "message_count": count,
    }


def _information(files: tuple[BagFile, ...]) -> dict[str, Any]:
    """Content of metadata.yaml for these files."""
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
