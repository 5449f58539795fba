# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recorder of samples into a ROS 2 bag (MCAP); needs no ROS installation.

The messages are those of `topics`, stamped with simulated time. For `reader` the bag also contains
the metadata record `rb_sim` with the bodies, the layout and the options of the run, and the file
scene.yaml, both before the first message. The summary is added as record `rb_sim_summary` on close.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from bisect import bisect_right
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.errors import SinkError
from rb_sim.io.bag.file import CHUNK_SIZE, LATCHED, BagFile, mcap_path
from rb_sim.io.bag.writer import Rows
from rb_sim.io.contact_power import contacts_of
from rb_sim.io.messages import cdr
from rb_sim.io.messages.cdr import NANO, STRING, TYPE_HASHES, schema_text, stamp_of
from rb_sim.io.messages.packing import MessageTable, stamps_of
from rb_sim.io.messages.robot_description import JointTable
from rb_sim.io.messages.topic_names import NAMESPACE, STATE
from rb_sim.io.messages.topics import (
    AccelTable,
    Asked,
    InputTable,
    OdometryTable,
    TopicTable,
    event_message,
    events_before,
    latched_messages,
)
from rb_sim.scene.load import as_run_text

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Input, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# Environment of a run: versions of programs, and the processor.


PACKAGES = ("rb_sim", "numpy", "scipy", "llvmlite", "mcap")


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Version of each program that a result depends on; the ROS distribution if installed."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    ros = os.environ.get("ROS_DISTRO") or _ros_of_wheels()
    return found | ({"ros": ros} if ros else {})


def _ros_of_wheels() -> str:
    """Version of a rclpy installed from wheels; "" if there is none."""
    for name in ("ros-jazzy-rclpy", "ros-rclpy", "rclpy"):
        try:
            return f"rclpy {version(name)}"
        except PackageNotFoundError:
            continue
    return ""


@lru_cache(maxsize=1)
def host() -> dict[str, str]:
    """Processor and operating system, without names of machine or user."""
    return {"cpu": _cpu(), "machine": platform.machine(), "system": platform.system()}


def _cpu() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or "unknown"
    names = [line.partition(":")[2].strip() for line in text.splitlines() if "model name" in line]
    return names[0] if names else platform.processor() or "unknown"


# The metadata record `rb_sim`: scene and layout of a bag.


FORMAT = "1"
"""Version of the record; readers refuse others."""


def describe(scene: Scene, layout: SampleLayout) -> dict[str, str]:
    """The metadata record of scene and layout; values are JSON, or plain text."""
    bodies = {
        name: {
            "mass": body.mass,
            "inertia": body.inertia.tolist(),
            "center_of_mass": list(body.center_of_mass),
            "shape": None if body.shape is None else body.shape.model_dump(mode="json"),
        }
        for name, body in scene.bodies.items()
    }
    names = layout._asdict()
    supports = describe_supports(scene)
    if not supports:
        del names["contacts"]
    return {
        "format": FORMAT,
        "name": scene.name,
        "description": scene.description,
        "scene": scene.text,
        "bodies": json.dumps(bodies),
        "layout": json.dumps(names),
        "simulation": json.dumps(scene.simulation.model_dump(mode="json")),
        **({"contacts": json.dumps(supports)} if supports else {}),
    }


def describe_supports(scene: Scene) -> dict[str, Any]:
    """Body, parent and surface of each contact."""
    return {
        name: {
            "body": spec.body,
            "parent": spec.parent,
            "surface": spec.surface.model_dump(mode="json"),
        }
        for name, spec in contacts_of(scene).items()
    }


READABLE = ("1",)
"""Formats that `reader` can read."""

REQUIRED = ("format", "name", "scene", "bodies", "layout", "simulation", "namespace", "start")
"""Keys required to read a bag back."""

RECORD = "rb_sim"
SUMMARY_RECORD = "rb_sim_summary"
LIBRARY = "rb_sim"

MEASURED = frozenset(
    ("nanoseconds_per_step", "processor_time", "wall_time", "real_time_factor", "overruns")
)
"""Entries of a summary that differ between runs of the same input."""


LEAST_SPLIT = 100_000
"""Minimum file size for splitting [bytes], about that of a chunk."""


class BagSink:
    """Writes DIRECTORY/<its name>_0.mcap and DIRECTORY/metadata.yaml; replaces an older bag there.

    start_ns: log time of simulated time 0 [ns]: 0, so that log times are simulated time, or
    wall-clock time [ns since the epoch]. Log times continue after a reset of the simulation. Equal
    samples, start and summary give equal bytes: durations (MEASURED) are not recorded.

    namespace: name of the node in the topic names.

    accelerations: also record BODY/accel; odometry: also BODY/odometry.

    run: how the simulation is run, plain values: `by` ("node" or "run") and its own settings.

    split_size [bytes], split_duration [s]: when either is reached, the next sample starts another
    file, <its name>_1.mcap ..., which is readable on its own; None: never.

    `open` and `write` raise SinkError: folder not writable or removed, disk full. The bag is then
    closed and readable up to that point, after `rb_sim recover` if even its index could not be
    written.
    """

    def __init__(
        self,
        directory: Path,
        *,
        start_ns: int = 0,
        namespace: str = NAMESPACE,
        run: Mapping[str, Any] | None = None,
        chunk_size: int = CHUNK_SIZE,
        split_size: int | None = None,
        split_duration: float | None = None,
        accelerations: Asked | None = None,
        odometry: bool = False,
    ) -> None:
        self.directory = Path(directory)
        self._start = start_ns
        self._namespace = namespace
        self._run = dict(run or {}) | ({"accelerations": True} if accelerations else {})
        self._run |= {"odometry": True} if odometry else {}
        self._chunk_size = chunk_size
        self._split_size = float("inf") if split_size is None else split_size
        self._split_after = float("inf") if split_duration is None else NANO * split_duration
        self._file: BagFile | None = None
        self._numbers: dict[str, int] = {}
        """number of each channel, by its topic."""
        self._channels: list[int] = []
        """those with a message of each sample."""
        self._asked, self._odometry = accelerations, odometry
        self._tables: list[MessageTable] = []
        """messages of each sample in addition to the table of topics."""
        self._latched: dict[int, bytes] = {}
        """last message of each latched channel that is sent only occasionally."""
        self._state: str | None = None
        """state of the node, if set before the first sample."""
        self._sample = 0
        self._base = 0
        self._last_stamp = 0

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the file and record the scene in it."""
        self._table = TopicTable(scene, layout)
        self._tables = []
        if self._asked is not None:
            self._tables.append(AccelTable(scene, layout, self._asked))
        if self._odometry:
            self._tables.append(OdometryTable(scene, layout))
        joints = JointTable(scene, layout)
        if joints.names:
            self._tables.append(joints)
        start = self._base = self._start
        try:
            self._file = BagFile(self.directory, LIBRARY, self._chunk_size)
            record = describe(scene, layout) | {"namespace": self._namespace, "start": str(start)}
            record |= {"run": json.dumps(self._run), "versions": json.dumps(versions())}
            record |= {"host": json.dumps(host())}
            self._record = record | {"sha256": checksum(record)}
            texts = {"scene.yaml": scene.text, "scene_as_run.yaml": as_run_text(scene)}
            self._texts = {name: text.encode() for name, text in texts.items()}
            self._describe(self._file)
        except BlockingIOError:
            raise SinkError(f"{mcap_path(self.directory)}: another process is writing it") from None
        except OSError as error:
            self._drop()
            raise SinkError(f"{self.directory}: cannot record here: {error.strerror}") from None
        own = self._namespace
        self._numbers = {}
        self._channels = [
            self._channel(self._file, topic.full_name(own), topic.ros_type)
            for topic in self._table.topics
        ]
        for table in self._tables:
            qos = LATCHED if table.latched else None
            self._channels += [
                self._channel(self._file, f"{own}/{name}", ros_type, qos)
                for name, ros_type in table.topics
            ]
        self._scene, self._layout = scene, layout
        self._input_table = InputTable(layout)
        if self._table.event_topic is not None:
            name, ros_type = self._table.event_topic
            self._events = self._channel(self._file, f"{own}/{name}", ros_type)

    def _describe(self, file: BagFile) -> None:
        """Write the records that a reader needs before the first message."""
        file.add_metadata(RECORD, self._record)
        for name, text in self._texts.items():
            file.add_attachment(self._start, name, "application/yaml", text)

    def _split_before(self, file: BagFile, stamp: int) -> BagFile:
        """The file for a sample: a new one if the current one reached a limit."""
        if file.first is None or file.count <= len(self._latched):
            return file
        time = self._base + max(stamp, self._last_stamp)
        if file.stream.tell() < self._split_size and time - file.first < self._split_after:
            return file
        after = file.follow()
        if after is file:
            return file
        self._file = after
        self._describe(after)
        self._write_latched(after, time)
        return after

    def _channel(
        self, file: BagFile, topic: str, ros_type: str, qos: dict[str, Any] | None = None
    ) -> int:
        """Number of the channel of a topic, which is added where it has none."""
        if topic not in self._numbers:
            schema, type_hash = schema_text(ros_type).encode(), TYPE_HASHES[ros_type]
            profiles = None if qos is None else [qos]
            self._numbers[topic] = file.add_channel(topic, ros_type, schema, type_hash, profiles)
        return self._numbers[topic]

    def _latch(self, file: BagFile, first: SampleBlock) -> None:
        """Write the latched messages, before the first sample."""
        messages = latched_messages(self._scene, self._layout, first, self._namespace, self._record)
        self._latched = {
            self._channel(file, one.topic, one.ros_type, LATCHED): one.data for one in messages
        }
        self._write_latched(file, self._base + int(stamps_of(first)[0]))
        if self._state is not None:
            self.note_state(self._state, int(stamps_of(first)[0]))

    def _write_latched(self, file: BagFile, time: int) -> None:
        for channel, data in self._latched.items():
            file.add_message(channel, time, self._sample, data)

    def note_state(self, state: str, stamp: int = 0) -> None:
        """Record a change of the node's state (runs of the command line have none).

        stamp: its time [ns], if later than the last sample.
        """
        self._state = state
        if self._file is None or not self._latched:  # written with the first sample
            return
        channel = self._channel(self._file, f"{self._namespace}/{STATE}", STRING, LATCHED)
        data = self._latched[channel] = cdr.string(state)
        time = self._base + max(stamp, self._last_stamp)
        self._file.add_message(channel, time, self._sample, data)

    def write(self, block: SampleBlock) -> None:
        """Append the samples of `block`; an empty block only flushes pending messages when due.

        Raises SinkError."""
        if self._file is None:
            raise SinkError(f"{self.directory}: the bag is closed")
        if self._file.stream.vanished:
            self._drop()
            raise SinkError(f"{self.directory}: the bag was removed while it was written")
        try:
            if len(block) and not self._latched:
                self._latch(self._file, block)
            if len(block):
                self._write_samples(self._file, block)
            self._file.keep()
        except OSError as error:
            path = self._file.path
            self._drop()
            raise SinkError(
                f"{path}: {error.strerror}; recording stopped; "
                f"read it with: rb_sim recover {self.directory}"
            ) from None
        if self._file.stream.full:
            self._finish_full()

    def _write_samples(self, file: BagFile, block: SampleBlock) -> None:
        """Write the samples with the inputs and events before them, until the disk is full."""
        stamps, data, bounds = self._table.packed(block)
        for more in [part for table in self._tables for part in table.rows(block)]:
            end = data.shape[1]
            data, bounds = np.hstack([data, more]), [*bounds, (end, end + more.shape[1])]
        rows = Rows(data, bounds)
        inputs, events = list(block.inputs), events_before(block, stamps)
        alone = {*events, *(given.index for given in inputs)}
        back = np.flatnonzero(np.diff(stamps) < 0) + 1
        borders = sorted({*alone, *(k + 1 for k in alone), *back.tolist(), len(stamps)})
        width, first = rows.width, 0
        while first < len(stamps) and not file.stream.full:
            stamp = int(stamps[first])
            file = self._split_before(file, stamp)
            while inputs and inputs[0].index <= first:
                self._write_input(file, inputs.pop(0))
            # if the simulation was reset, log times continue
            self._base += max(0, self._last_stamp - stamp)
            for event in events.get(first, ()):
                own_time = self._base + min(stamp_of(event.t), stamp)
                file.add_message(self._events, own_time, self._sample, event_message(event))
            end = min(borders[bisect_right(borders, first)], first + file.room // width + 1)
            times = self._base + stamps[first:end]
            assert file.first is not None  # the latched messages are in it
            times = times[: max(1, int(np.searchsorted(times - file.first, self._split_after)))]
            part = Rows(data[first : first + len(times)], bounds)
            file.add_rows(self._channels, times, self._sample, part)
            first += len(times)
            self._sample += len(times)
            self._last_stamp = int(times[-1]) - self._base

    def _write_input(self, file: BagFile, given: Input) -> None:
        topic, data = self._input_table.message(given)
        log_time = self._base + max(stamp_of(given.t), self._last_stamp)
        name, ros_type = self._input_table.topics[topic]  # most runs have no inputs
        channel = self._channel(file, f"{self._namespace}/{name}", ros_type)
        file.add_message(channel, log_time, self._sample, data)

    def _finish_full(self) -> None:
        self.close(None)
        upto = self._last_stamp * 1e-9
        raise SinkError(f"{self.directory}: disk full; the bag ends at t = {upto:g}")

    def _drop(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            file.abandon()

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Write the summary, the index and metadata.yaml. Raises SinkError if the disk is full."""
        file, self._file = self._file, None
        if file is None:
            return
        if file.stream.vanished:
            file.abandon()
            return
        try:
            if summary is not None:
                recorded = {key: value for key, value in summary.items() if key not in MEASURED}
                text = json.dumps(recorded, sort_keys=True, default=_plain)
                record = {"summary": text}
                file.add_metadata(SUMMARY_RECORD, record | {"sha256": checksum(record)})
            file.finish()
        except OSError as error:
            raise SinkError(
                f"{file.path}: {error.strerror}; the bag has no index; "
                f"read it with: rb_sim recover {self.directory}"
            ) from None


def checksum(record: Mapping[str, str]) -> str:
    """SHA-256 of the values of a record except its own entry: MCAP has no checksum for metadata."""
    text = json.dumps(
        {key: value for key, value in record.items() if key != "sha256"}, sort_keys=True
    )
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: Any) -> Any:
    """A JSON value: numpy numbers and arrays as lists, anything else as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


BROKEN_SUMMARY = "the record of the run's summary is broken; it is not copied"


def summary_in(record: Mapping[str, str] | None) -> dict[str, Any] | None:
    """The run's summary in its record; None without a record. Raises ValueError if it is broken."""
    if record is None:
        return None
    if "sha256" in record and record["sha256"] != checksum(record):
        raise ValueError(BROKEN_SUMMARY)
    try:
        return json.loads(record["summary"])
    except (KeyError, ValueError):
        raise ValueError(BROKEN_SUMMARY) from None
