"""Makes a readable bag out of one that was never finished: killed process, full disk."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import yaml

from rb_sim.errors import SinkError
from rb_sim.sinks import bag_records
from rb_sim.sinks.bag import LIBRARY
from rb_sim.sinks.bag_file import BagFile


class Recovered(NamedTuple):
    """What came of it. `complete`: the source was finished, so nothing was missing."""

    directory: Path
    messages: int
    complete: bool


def recover_bag(bag: Path, directory: Path | None = None) -> Recovered:
    """Copy everything readable of `bag` (directory or .mcap) into a new bag directory.

    That is all but the last, unfinished chunk. The source is left as it is.
    directory: where to; None: beside the source, with `_recovered` added to its name.
    Raises SinkError: no MCAP, nothing readable in it, no room, the directory exists.
    """
    source = bag_records.bag_path(bag)
    target = _beside(bag) if directory is None else directory
    if target.exists():
        raise SinkError(f"{target}: exists already; name another folder to recover into")
    try:
        _check(source)
        file = BagFile(target, LIBRARY)
        try:
            _copy(source, file)
        except OSError:
            file.abandon()
            raise
        file.finish()
    except OSError as error:
        raise SinkError(f"{target}: cannot recover: {error.strerror}") from None
    return Recovered(target, file.count, bag_records.is_complete(source))


def _check(source: Path) -> None:
    """Refuse what is no ROS 2 bag or holds no message."""
    for record in bag_records.read_records(source):
        if isinstance(record, bag_records.Header) and record.profile != "ros2":
            raise SinkError(f"{source}: not a ROS 2 bag: its profile is {record.profile!r}")
        if isinstance(record, bag_records.Message):
            return
    raise SinkError(f"{source}: nothing to recover: not one chunk of it was finished")


def _beside(bag: Path) -> Path:
    bag = bag.resolve()
    return bag.with_name(f"{bag.stem if bag.is_file() else bag.name}_recovered")


def _copy(source: Path, file: BagFile) -> None:
    schemas: dict[int, bag_records.Schema] = {}
    channels: dict[int, int] = {}
    for record in bag_records.read_records(source):
        match record:
            case bag_records.Message() if record.channel_id in channels:
                number = channels[record.channel_id]
                file.write(number, record.log_time, record.sequence, record.data)
            case bag_records.Schema():
                schemas[record.id] = record
            case bag_records.Channel() if record.schema_id in schemas:
                channels[record.id] = _copy_channel(record, schemas[record.schema_id], file)
            case bag_records.Metadata() if record.name != "rosbag2":  # that one is made anew
                file.add_metadata(record.name, record.metadata)
            case bag_records.Attachment():
                data, time = record.data, record.log_time
                file.add_attachment(record.name, record.media_type, data, time)


def _copy_channel(channel: bag_records.Channel, schema: bag_records.Schema, file: BagFile) -> int:
    qos = yaml.safe_load(channel.metadata.get("offered_qos_profiles", "[]"))
    type_hash = channel.metadata.get("topic_type_hash", "")
    return file.add_channel(channel.topic, schema.name, schema.data, type_hash, qos)
