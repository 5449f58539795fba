# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags: read by independent readers, byte-identical, safe against kill -9 and full disks."""

from __future__ import annotations

import errno
import hashlib
import os
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from importlib.metadata import version
from io import BytesIO
from pathlib import Path

import mcap.reader
import numpy as np
import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rb_sim.base.errors import SinkError
from rb_sim.io.bag import file
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.io.bag.folder import recover_bag
from rb_sim.io.bag.reader import BagReader
from rb_sim.mechanics.samples import ARRAYS, empty_block

START = 1_700_000_000_000_000_000
TOPICS = 17
LATCHED = 3
"""Messages that are recorded once."""


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("lone_file", [False, True], ids=["directory", "file"])
def test_rosbags_reads_it(record, samples, lone_file):
    if lone_file and version("rosbags").startswith("0.10."):
        pytest.skip("rosbags before 0.11 opens directories only")
    bag = record(n=200)
    path = bag / "bag_0.mcap" if lone_file else bag
    block = samples(200)
    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([path], default_typestore=store) as reader:
        assert reader.message_count == 200 * TOPICS + LATCHED
        assert {c.topic for c in reader.connections} >= {"/rb_sim/ball/pose", "/tf", "/clock"}
        poses = [c for c in reader.connections if c.topic == "/rb_sim/ball/pose"]
        rows = [(t, reader.deserialize(data, c.msgtype)) for c, t, data in reader.messages(poses)]
    assert [t for t, _ in rows] == [START + round(t * 1e9) for t in block.t]
    position = [[p.pose.position.x, p.pose.position.y, p.pose.position.z] for _, p in rows]
    np.testing.assert_array_equal(position, block.position[:, 0])


def test_mcap_reads_it(record):
    with (record() / "bag_0.mcap").open("rb") as file:
        reader = mcap.reader.make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        assert sum(1 for _ in reader.iter_messages()) == 200 * TOPICS + LATCHED
        attachments = {a.name: a.data.decode() for a in reader.iter_attachments()}
        records = {m.name: m.metadata for m in reader.iter_metadata()}
        channels = {c.topic: c for c in reader.get_summary().channels.values()}
    assert attachments["scene.yaml"] == records["rb_sim"]["scene"]
    assert "a door on two bearings" in attachments["scene.yaml"]
    assert '"method": "rk4"' in records["rb_sim"]["simulation"]
    metadata = channels["/rb_sim/reactions/hinge/A"].metadata
    assert metadata["topic_type_hash"].startswith("RIHS01_8dc3deaf")
    assert yaml.safe_load(metadata["offered_qos_profiles"])[0]["reliability"] == "reliable"


def test_rosbag2_metadata(record):
    bag = record(n=101)
    info = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert info["version"] == 9 and info["storage_identifier"] == "mcap"
    assert info["message_count"] == 101 * TOPICS + LATCHED
    assert info["duration"]["nanoseconds"] == 1_000_000_000
    assert info["starting_time"]["nanoseconds_since_epoch"] == START
    assert info["relative_file_paths"] == ["bag_0.mcap"]
    assert {t["message_count"] for t in info["topics_with_message_count"]} == {101, 1}
    with (bag / "bag_0.mcap").open("rb") as file:
        records = {m.name: m.metadata for m in mcap.reader.make_reader(file).iter_metadata()}
    assert yaml.safe_load(records["rosbag2"]["serialized_metadata"]) == info


def test_rerun_checks_it(record):
    rerun = Path(sys.executable).with_name("rerun")
    if not rerun.exists():
        pytest.skip("rerun-sdk is not installed")
    path = record() / "bag_0.mcap"
    subprocess.run([rerun, "mcap", "check", path], check=True, capture_output=True, timeout=240)


def test_equal_input_gives_equal_bytes(record):
    one, two = record("one/bag", n=3000), record("two/bag", n=3000)
    for name in ("bag_0.mcap", "metadata.yaml"):
        assert sha256(one / name) == sha256(two / name)
    assert sorted(p.name for p in one.iterdir()) == ["bag_0.mcap", "metadata.yaml"]


@pytest.mark.parametrize("sizes", [[400], [1, 7, 150, 242]], ids=len)
def test_samples_written_together_are_those_written_one_by_one(
    tmp_path, scene, layout, samples, sizes
):
    """Also after a reset, where the log goes on."""
    found, block = [], samples(400)
    for grouped in (sizes, [1] * 400):
        directory = tmp_path / str(len(found)) / "bag"
        sink = BagSink(directory)
        sink.open(scene, layout)
        for _ in range(2):
            for first, size in zip(np.cumsum(grouped) - grouped, grouped, strict=True):
                part = slice(first, first + size)
                arrays = {name: getattr(block, name)[part] for name in ARRAYS}
                sink.write(replace(block, **arrays))
                sink.write(empty_block(0, layout))
        sink.close({})
        found.append((directory / "bag_0.mcap").read_bytes())
    assert found[0] == found[1]


def test_a_bag_without_samples_opens(record):
    bag = record(n=0)
    assert list(BagReader(bag).blocks()) == []
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        assert reader.message_count == 0


def test_close_twice_and_write_after_close(record, tmp_path, scene, layout, samples):
    sink = BagSink(tmp_path / "bag")
    sink.close()
    sink.open(scene, layout)
    sink.write(samples(3))
    sink.close({"steps": np.int64(3), "drift": np.float64(1e-12)})
    digest = sha256(tmp_path / "bag/bag_0.mcap")
    sink.close({"steps": 4})
    assert sha256(tmp_path / "bag/bag_0.mcap") == digest
    assert BagReader(tmp_path / "bag").summary == {"steps": 3, "drift": 1e-12}
    with pytest.raises(SinkError, match="the bag is closed$"):
        sink.write(samples(3))


def test_memory_does_not_grow_with_samples(monkeypatch, tmp_path, scene, layout, samples):
    """Python's peak memory over the next 50 samples is the same early and late (but the index).

    The least of several: other threads of this process may hold memory meanwhile.
    """
    monkeypatch.setattr(file, "PERIOD", float("inf"))  # a draft falls into one of them by the clock
    block, peaks = samples(50), []
    sink = BagSink(tmp_path / "bag", chunk_size=10_000)
    sink.open(scene, layout)
    for blocks in (1, 60):
        for _ in range(blocks):
            sink.write(block)
        some = []
        for _ in range(5):
            tracemalloc.start()
            sink.write(block)
            some.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        peaks.append(min(some))
    sink.close()
    assert peaks[1] < 1.1 * peaks[0]


# How much of a bag is read at once.


CHANNELS, EACH = 8, 40


# What waits in the open chunk of a bag is at the end of the file, for whoever reads it then.


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A draft after every block."""
    monkeypatch.setattr(file, "PERIOD", 0.0)


def messages(data: bytes) -> int:
    """How many a reader of broken files finds, that knows nothing of drafts."""
    found = 0
    try:
        for record in StreamReader(BytesIO(data), validate_crcs=True).records:
            found += isinstance(record, Message)
    except EndOfFile:
        pass
    return found


def test_every_written_sample_is_in_the_file_before_its_chunk_ends(
    impatient, tmp_path: Path, scene, layout, samples
) -> None:
    """As it would be found after kill -9; some chunks end on the way."""
    sink = BagSink(tmp_path / "bag", chunk_size=20_000)
    sink.open(scene, layout)
    path = tmp_path / "bag" / "bag_0.mcap"
    for k in range(40):
        sink.write(samples(2, start=k / 50.0))
        assert messages(path.read_bytes()) == 2 * (k + 1) * TOPICS + LATCHED
    result = recover_bag(tmp_path / "bag")
    t = np.concatenate([block.t for block in BagReader(result.directory).blocks()])
    np.testing.assert_allclose(t, np.arange(80) / 100.0, atol=1e-9)
    sink.close()
    assert messages(path.read_bytes()) == 80 * TOPICS + LATCHED


def test_drafts_leave_no_trace(
    tmp_path: Path, scene, layout, samples, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However the clock ran, the finished files are equal."""
    files = []
    for name, period in (("patient/bag", 1e9), ("impatient/bag", 0.0)):
        monkeypatch.setattr(file, "PERIOD", period)
        sink = BagSink(tmp_path / name, chunk_size=20_000)
        sink.open(scene, layout)
        for k in range(40):
            sink.write(samples(2, start=k / 50.0))
        sink.close({"steps": 7, "wall_time": period})
        files.append((tmp_path / name / "bag_0.mcap").read_bytes())
    assert files[0] == files[1]


def test_no_room_for_a_draft_is_no_failure(
    impatient, tmp_path: Path, scene, layout, samples, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(os, "pwrite", full)
    sink = BagSink(tmp_path / "bag")
    sink.open(scene, layout)
    sink.write(samples(20))
    sink.close()
    assert sum(len(block) for block in BagReader(tmp_path / "bag").blocks()) == 20
