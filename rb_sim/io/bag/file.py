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
from copy import deepcopy
from pathlib import Path
from typing import Any

import yaml
from mcap.records import Channel

from rb_sim.io.bag.writer import McapWriter

# Drafts: the open chunk is written as if it ended now, so that a killed process loses little.
#
# If chunks ended by the clock, equal runs would give different files. So a chunk ends only by its
# size, and the messages of the open one are written at the end of the file as a draft, which
# readers of unfinished files accept as a chunk; the next chunk overwrites it.


PERIOD = 0.5
"""[s] of wall-clock time between drafts."""

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
        mine = False
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            mine = True
            os.ftruncate(self._file, 0)
            self._keep(reserve)
        except OSError:
            if mine:
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
            return self.write(data)
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


class BagFile(McapWriter):
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
        super().__init__(self.stream, chunk_size)
        self.qos: list[list[Any]] = []
        """profiles of each channel."""
        self._schema_of: dict[tuple[str, bytes], int] = {}
        self._drafted = 0, time.monotonic()
        """number of messages at the last draft, and its wall-clock time [s]."""
        self.start(profile="ros2", library=library)

    @property
    def count(self) -> int:
        """Number of messages so far."""
        return sum(self.counts.values())

    @property
    def first(self) -> int | None:
        """Earliest log time [ns]; None before the first message."""
        return self.span and self.span[0]

    def add_channel(
        self, topic: str, ros_type: str, schema: bytes, type_hash: str, qos: list[Any] | None = None
    ) -> int:
        """Add a topic; returns the channel number of its messages."""
        key = ros_type, schema
        if key not in self._schema_of:
            self._schema_of[key] = self.register_schema(ros_type, "ros2msg", schema)
        self.qos.append([QOS] if qos is None else qos)
        metadata = {
            "offered_qos_profiles": yaml.safe_dump(self.qos[-1], sort_keys=False),
            "topic_type_hash": type_hash,
        }
        return self.register_channel(topic, "cdr", self._schema_of[key], metadata)

    def keep(self) -> None:
        """Write a draft of messages that are in none, PERIOD after the last one; to be called
        regularly."""
        now = time.monotonic()
        if self.waiting and self.count > self._drafted[0] and now - self._drafted[1] >= PERIOD:
            self.stream.write_draft(self.draft())
            self._drafted = self.count, now

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
            for channel, qos in zip(self.channels, self.qos, strict=True):
                schema, type_hash = self.schemas[channel.schema_id - 1], _type_hash(channel)
                after.add_channel(channel.topic, schema.name, schema.data, type_hash, qos)
            self._end()
        except OSError:
            after.abandon()
            raise
        return after

    def _end(self) -> None:
        """Write the index and close the file; it is closed even if that fails."""
        try:
            text = yaml.safe_dump(_information((self,)), sort_keys=False)
            self.add_metadata("rosbag2", {"serialized_metadata": text})
            super().finish()
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


def _type_hash(channel: Channel) -> str:
    return channel.metadata["topic_type_hash"]


def _span(files: tuple[BagFile, ...]) -> dict[str, Any]:
    """Times and number of the messages of these files, in the format of metadata.yaml."""
    spans = [file.span for file in files if file.span is not None]
    first = min((first for first, _ in spans), default=0)
    last = max((last for _, last in spans), default=0)
    return {
        "duration": {"nanoseconds": max(0, last - first)},
        "starting_time": {"nanoseconds_since_epoch": first},
        "message_count": sum(file.count for file in files),
    }


def _information(files: tuple[BagFile, ...]) -> dict[str, Any]:
    """Content of metadata.yaml for these files."""
    topics: dict[str, dict[str, Any]] = {}
    for file in files:
        for channel, qos in zip(file.channels, file.qos, strict=True):
            metadata = {
                "name": channel.topic,
                "type": file.schemas[channel.schema_id - 1].name,
                "serialization_format": "cdr",
                "offered_qos_profiles": deepcopy(qos),  # YAML would write an alias
                "type_description_hash": _type_hash(channel),
            }
            found = {"topic_metadata": metadata, "message_count": 0}
            entry = topics.setdefault(channel.topic, found)
            entry["message_count"] += file.counts.get(channel.id, 0)
    return {
        "version": _METADATA_VERSION,
        "storage_identifier": "mcap",
        **_span(files),
        "topics_with_message_count": list(topics.values()),
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.path.name for file in files],
        "files": [{"path": file.path.name, **_span((file,))} for file in files],
        "custom_data": None,
        "ros_distro": ROS_DISTRO,
    }
