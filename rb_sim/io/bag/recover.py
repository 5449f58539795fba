# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Makes a readable bag out of one that was never finished: killed process, full disk."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path
from typing import NamedTuple

import yaml
from mcap.records import Attachment, Channel, Metadata, Schema

from rb_sim.base.errors import SinkError
from rb_sim.io.bag import folder
from rb_sim.io.bag.batches import Batch
from rb_sim.io.bag.file import BagFile
from rb_sim.io.bag.folder import Scan, scan_of
from rb_sim.io.bag.sink import LIBRARY


class Recovered(NamedTuple):
    """What came of it. `complete`: the source was finished and whole, so nothing was missing."""

    directory: Path
    messages: int
    complete: bool
    damage: tuple[str, ...] = ()
    """Lines that say what could not be read, and between which times it was."""
    unchecked: int = 0
    """Messages that no checksum covers: whether they are as written, nothing tells."""


def recover_bag(bag: Path, directory: Path | None = None) -> Recovered:
    """Copy everything readable of `bag` (directory or .mcap) into a new bag directory.

    That is all but what is damaged, and the last chunk if it was not finished. The source is left
    as it is.
    directory: where to; None: beside the source, with `_recovered` added to its name.
    Raises SinkError: no MCAP, nothing readable in it, no room, the directory exists.
    """
    sources = folder.bag_paths(bag)
    target = _beside(bag) if directory is None else directory
    if target.exists():
        raise SinkError(f"{target}: exists already; name another folder to recover into")
    scans: list[Scan] = []
    try:
        _check(sources)
        file = None
        try:
            file = BagFile(target, LIBRARY)
            copied = _Copied(file)
            scans = [_copy(source, copied) for source in sources]
            file.finish()
        except BaseException:  # Ctrl-C, too: half a copy would be in the way of the next try
            if file is not None:
                with contextlib.suppress(OSError):
                    file.abandon()
            shutil.rmtree(target, ignore_errors=True)
            raise
    except OSError as error:
        raise SinkError(f"{target}: cannot recover: {error.strerror}") from None
    complete = all(scan.complete for scan in scans)
    missing = [scan.missing for scan in scans]
    damaged = any(part.damages for part in missing)
    gone = folder.absent(bag)
    lines = (*gone, *(line for part in missing for line in part.lines()))
    unchecked = sum(scan.unchecked for scan in scans)
    return Recovered(target, file.count, complete and not damaged and not gone, lines, unchecked)


def _check(sources: list[Path]) -> None:
    """Refuse what is no ROS 2 bag or holds no message."""
    for source in sources:
        scan = scan_of(source)
        for batch in scan.batches():
            header = scan.header
            if header is not None and header.profile != "ros2":
                raise SinkError(f"{source}: not a ROS 2 bag: its profile is {header.profile!r}")
            if batch:
                return
    raise SinkError(f"{sources[0]}: nothing to recover: not one chunk of it was finished")


def _beside(bag: Path) -> Path:
    bag = bag.resolve()
    return bag.with_name(f"{bag.stem if bag.is_file() else bag.name}_recovered")


class _Copied:
    """What a new bag has already: each file of a bag that was split says most of it again."""

    def __init__(self, file: BagFile) -> None:
        self.file = file
        self._channels: dict[tuple[str, ...], int] = {}
        self._files: set[tuple[object, ...]] = set()

    def channel(self, channel: Channel, schema: Schema) -> int:
        """Its number in the new bag."""
        profiles = channel.metadata.get("offered_qos_profiles", "[]")
        type_hash = channel.metadata.get("topic_type_hash", "")
        key = channel.topic, schema.name, schema.data.hex(), type_hash, profiles
        if key not in self._channels:
            qos = yaml.safe_load(profiles)
            added = self.file.add_channel(channel.topic, schema.name, schema.data, type_hash, qos)
            self._channels[key] = added
        return self._channels[key]

    def metadata(self, record: Metadata) -> None:
        """Take over a record, once."""
        if record.name != "rosbag2" and self._is_new(record.name, *sorted(record.metadata.items())):
            self.file.add_metadata(record.name, record.metadata)  # rosbag2's is made anew

    def attachment(self, record: Attachment) -> None:
        """Take over an attachment, once."""
        if self._is_new(record.name, record.media_type, record.data):
            self.file.add_attachment(record.name, record.media_type, record.data, record.log_time)

    def _is_new(self, *content: object) -> bool:
        known = content in self._files
        self._files.add(content)
        return not known


def _copy(source: Path, copied: _Copied) -> Scan:
    """Copy what can be read; the scan says what could not."""
    scan = scan_of(source)
    channels: dict[int, int] = {}
    metadata = attachments = 0
    for batch in scan.batches():
        for number, channel in scan.channels.items():
            if number not in channels and channel.schema_id in scan.schemas:
                channels[number] = copied.channel(channel, scan.schemas[channel.schema_id])
        metadata, attachments = _copy_files(scan, copied, metadata, attachments)
        _copy_batch(batch, channels, copied.file)
    _copy_files(scan, copied, metadata, attachments)
    return scan


def _copy_batch(batch: Batch, channels: dict[int, int], file: BagFile) -> None:
    """The messages of a batch, as they lie in the file."""
    known = [(number, m) for number, m in batch.items() if number in channels]
    order = [(int(m.start[k]), number, k) for number, m in known for k in range(len(m.start))]
    for _, number, k in sorted(order):
        m = batch[number]
        file.write(channels[number], int(m.log_time[k]), int(m.sequence[k]), m.data(k))


def _copy_files(scan: Scan, copied: _Copied, metadata: int, attachments: int) -> tuple[int, int]:
    """Records and attachments that are new since `metadata` and `attachments` of them."""
    for record in scan.metadata[metadata:]:
        copied.metadata(record)
    for record in scan.attachments[attachments:]:
        copied.attachment(record)
    return len(scan.metadata), len(scan.attachments)
