"""Bags: read by independent readers, byte-identical, safe against kill -9 and full disks."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import mcap.reader
import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rb_sim.errors import SinkError
from rb_sim.sinks.bag import BagSink
from rb_sim.sinks.bag_reader import BagReader
from rb_sim.sinks.recover import recover_bag

START = 1_700_000_000_000_000_000
TOPICS = 16

RECORD_FOREVER = """
import sys
from pathlib import Path
from rb_sim.engine.samples import SampleLayout, empty_block
from rb_sim.scene.load import load_scene
from rb_sim.sinks.bag import BagSink
scene = load_scene({"bodies": {"ball": {"mass": 1, "inertia": [1, 1, 1]}}})
layout = SampleLayout(("ball",), (), (), ())
sink = BagSink(Path(sys.argv[1]), start_ns=0)
sink.open(scene, layout)
block = empty_block(10, layout)
block.orientation[..., 3] = 1.0
for k in range(10**9):
    block.t[:] = [(10 * k + i) * 0.01 for i in range(10)]
    block.position[:, 0, 0] = block.t
    sink.write(block)
    print(10 * k + 10, flush=True)
"""


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("lone_file", [False, True], ids=["directory", "file"])
def test_rosbags_reads_it(record, samples, lone_file):
    bag = record(n=200)
    path = bag / "bag_0.mcap" if lone_file else bag
    block = samples(200)
    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([path], default_typestore=store) as reader:
        assert reader.message_count == 200 * TOPICS
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
        assert sum(1 for _ in reader.iter_messages()) == 200 * TOPICS
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
    assert info["message_count"] == 101 * TOPICS
    assert info["duration"]["nanoseconds"] == 1_000_000_000
    assert info["starting_time"]["nanoseconds_since_epoch"] == START
    assert info["relative_file_paths"] == ["bag_0.mcap"]
    assert {t["message_count"] for t in info["topics_with_message_count"]} == {101}
    with (bag / "bag_0.mcap").open("rb") as file:
        records = {m.name: m.metadata for m in mcap.reader.make_reader(file).iter_metadata()}
    assert yaml.safe_load(records["rosbag2"]["serialized_metadata"]) == info


def test_rerun_checks_it(record):
    rerun = Path(sys.executable).with_name("rerun")
    if not rerun.exists():
        pytest.skip("rerun-sdk is not installed")
    path = record() / "bag_0.mcap"
    subprocess.run([rerun, "mcap", "check", path], check=True, capture_output=True, timeout=60)


def test_equal_input_gives_equal_bytes(record):
    one, two = record("one/bag", n=3000), record("two/bag", n=3000)
    for name in ("bag_0.mcap", "metadata.yaml"):
        assert sha256(one / name) == sha256(two / name)
    assert sorted(p.name for p in one.iterdir()) == ["bag_0.mcap", "metadata.yaml"]


def test_the_log_goes_on_where_a_simulation_was_reset(tmp_path, scene, layout, samples):
    sink = BagSink(tmp_path / "bag", start_ns=START)
    sink.open(scene, layout)
    sink.write(samples(100))
    sink.write(samples(50))
    sink.close()
    with (tmp_path / "bag/bag_0.mcap").open("rb") as file:
        messages = mcap.reader.make_reader(file).iter_messages(["/clock"], log_time_order=False)
        times = [message.log_time for _, _, message in messages]
    assert len(times) == 150 and times == sorted(times)
    block = next(BagReader(tmp_path / "bag").blocks())
    np.testing.assert_allclose(block.t, np.r_[samples(100).t, samples(50).t], rtol=0, atol=1e-9)


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


def test_kill_9_loses_no_more_than_the_open_chunk(tmp_path):
    bag = tmp_path / "bag"
    command = [sys.executable, "-c", RECORD_FOREVER, str(bag)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if int(line) >= 5000:
                break
        process.send_signal(signal.SIGKILL)
        written = [int(line), *(int(rest) for rest in process.stdout if rest.strip().isdigit())][-1]
    assert not (bag / "metadata.yaml").exists()
    with pytest.raises(SinkError, match=f"unfinished; first run: rb_sim recover {bag}$"):
        BagReader(bag)
    result = recover_bag(bag)
    assert result.directory == tmp_path / "bag_recovered" and not result.complete
    t = np.concatenate([block.t for block in BagReader(result.directory).blocks()])
    np.testing.assert_array_equal(t, np.arange(len(t)) / 100.0)
    bytes_per_sample = 900
    assert written - len(t) < 128 * 1024 / bytes_per_sample * 2
    with AnyReader(
        [result.directory], default_typestore=get_typestore(Stores.ROS2_JAZZY)
    ) as reader:
        assert reader.message_count == result.messages


def test_recover_at_every_length(record, tmp_path, samples):
    """Cut anywhere: either one clear line or a whole beginning."""
    source = (record(n=300, chunk_size=10_000) / "bag_0.mcap").read_bytes()
    expected = samples(300).t
    seen = set()
    for k, length in enumerate(range(0, len(source), len(source) // 25)):
        path = tmp_path / f"cut{k}.mcap"
        path.write_bytes(source[:length])
        try:
            result = recover_bag(path)
        except SinkError as error:
            assert len(str(error).splitlines()) == 1
            continue
        assert not result.complete
        t = np.concatenate([[], *(block.t for block in BagReader(result.directory).blocks())])
        np.testing.assert_allclose(t, expected[: len(t)], rtol=0, atol=1e-9)
        seen.add(len(t))
    assert len(seen) > 10


def test_recover_a_damaged_chunk(record, tmp_path):
    """What stands before the damage is kept; a checksum tells."""
    bag = record(n=600, chunk_size=20_000)
    data = bytearray((bag / "bag_0.mcap").read_bytes())
    data[len(data) // 2] ^= 0xFF
    (bag / "bag_0.mcap").write_bytes(data)
    result = recover_bag(bag, tmp_path / "saved")
    assert 0 < result.messages < 600 * TOPICS
    assert sum(len(b) for b in BagReader(result.directory).blocks()) > 100


def test_recover_refuses_an_existing_folder_and_leaves_the_source(record, tmp_path):
    bag = record()
    before = sha256(bag / "bag_0.mcap")
    assert recover_bag(bag).complete
    with pytest.raises(SinkError, match="bag_recovered: exists already"):
        recover_bag(bag)
    assert sha256(bag / "bag_0.mcap") == before


def test_recover_what_has_nothing(tmp_path):
    (tmp_path / "text.mcap").write_text("hello, I am not a bag")
    with pytest.raises(SinkError, match="not an MCAP file$"):
        recover_bag(tmp_path / "text.mcap")
    with pytest.raises(SinkError, match="no such bag$"):
        recover_bag(tmp_path / "none")


def test_file_size_limit(tmp_path):
    """RLIMIT_FSIZE stands for any write that fails; the rest of the run is not disturbed."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1_100_000, 1_100_000))\n"
    code = limit + RECORD_FOREVER
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "bag")], capture_output=True, text=True
    )
    *_, last = done.stderr.strip().splitlines()
    assert last.startswith("rb_sim.errors.SinkError: ")
    assert last.endswith(f"bag_0.mcap: File too large; recording stopped; read it with: "
                         f"rb_sim recover {tmp_path / 'bag'}")  # fmt: skip
    written = int(done.stdout.split()[-1])
    found = sum(len(b) for b in BagReader(recover_bag(tmp_path / "bag").directory).blocks())
    assert written - 400 < found <= written + 10


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1.5 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1500k", "tmpfs", str(disk)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("needs the right to mount a file system")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


def test_full_disk_leaves_a_complete_bag(small_disk):
    """The reserve pays for the last chunk and the index."""
    bag = small_disk / "bag"
    done = subprocess.run(
        [sys.executable, "-c", RECORD_FOREVER, str(bag)], capture_output=True, text=True
    )
    *_, last = done.stderr.strip().splitlines()
    assert f"SinkError: {bag}: disk full; the bag holds what was before t = " in last
    written = int(done.stdout.split()[-1])
    assert sum(len(block) for block in BagReader(bag).blocks()) >= written
    assert (bag / "metadata.yaml").exists()
    assert shutil.disk_usage(small_disk).free > 0


def test_disk_full_at_once(small_disk, scene, layout):
    (small_disk / "filler").write_bytes(bytes(1_000_000))
    with pytest.raises(SinkError, match="cannot record here: No space left on device$"):
        BagSink(small_disk / "bag").open(scene, layout)


def test_removed_folder(tmp_path, scene, layout, samples):
    sink = BagSink(tmp_path / "bag")
    sink.open(scene, layout)
    sink.write(samples(10))
    shutil.rmtree(tmp_path / "bag")
    with pytest.raises(SinkError, match="the bag was removed while it was written$"):
        sink.write(samples(10))
    sink.close()
    assert not (tmp_path / "bag").exists()


def test_folder_that_cannot_be_written(tmp_path, scene, layout):
    (tmp_path / "file").write_text("")
    with pytest.raises(SinkError, match="file/bag: cannot record here: Not a directory$"):
        BagSink(tmp_path / "file" / "bag").open(scene, layout)


def test_two_processes_do_not_write_one_bag(tmp_path, scene, layout, samples):
    first = BagSink(tmp_path / "bag")
    first.open(scene, layout)
    first.write(samples(10))
    with pytest.raises(SinkError, match="bag_0.mcap: another process is writing it$"):
        BagSink(tmp_path / "bag").open(scene, layout)
    first.close()
    assert sum(len(block) for block in BagReader(tmp_path / "bag").blocks()) == 10


def test_memory_does_not_grow_with_samples(tmp_path, scene, layout, samples):
    """Python's peak memory over the next 50 samples is the same early and late (but the index)."""
    block, peaks = samples(50), []
    sink = BagSink(tmp_path / "bag", chunk_size=10_000)
    sink.open(scene, layout)
    for blocks in (1, 60):
        for _ in range(blocks):
            sink.write(block)
        tracemalloc.start()
        sink.write(block)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    sink.close()
    assert peaks[1] < 1.1 * peaks[0]


def test_a_live_file_is_on_the_disk(tmp_path, scene, layout, samples):
    """Unbuffered: finished chunks are there for a reader before the bag is closed."""
    sink = BagSink(tmp_path / "bag", chunk_size=10_000)
    sink.open(scene, layout)
    sink.write(samples(100))
    assert os.path.getsize(tmp_path / "bag/bag_0.mcap") > 20_000
    assert recover_bag(tmp_path / "bag").messages > 80 * TOPICS
    sink.close()


def test_default_start_is_now(tmp_path, scene, layout, samples):
    before = time.time_ns()
    sink = BagSink(tmp_path / "bag")
    sink.open(scene, layout)
    sink.close()
    assert before <= BagReader(tmp_path / "bag").start <= time.time_ns()
