# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags that were cut off: kill -9, full disk, removed folder; and what `recover` makes of them."""

from __future__ import annotations

import hashlib
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rb_sim.base.errors import SinkError
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.io.bag.folder import recover_bag
from rb_sim.io.bag.reader import BagReader

TOPICS = 17

RECORD_FOREVER = """
import sys
from pathlib import Path
from rb_sim.mechanics.samples import SampleLayout, empty_block
from rb_sim.scene.load import load_scene
from rb_sim.io.bag.bag_sink import BagSink
scene = load_scene({"bodies": {"ball": {"mass": 1, "inertia": [1, 1, 1]}}})
layout = SampleLayout(("ball",), (), (), ())
split = int(sys.argv[2]) if len(sys.argv) > 2 else None
sink = BagSink(Path(sys.argv[1]), start_ns=0, split_size=split)
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
    for k, length in enumerate(range(0, len(source), len(source) // 12)):
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
    assert len(seen) > 5


def test_recover_refuses_an_existing_folder_and_leaves_the_source(record, tmp_path):
    bag = record()
    before = sha256(bag / "bag_0.mcap")
    assert recover_bag(bag).complete
    with pytest.raises(SinkError, match="bag_recovered: exists already"):
        recover_bag(bag)
    assert sha256(bag / "bag_0.mcap") == before


@pytest.mark.parametrize("trouble", [KeyboardInterrupt, OSError(28, "No space left")])
def test_recover_that_is_broken_off_leaves_nothing(record, tmp_path, monkeypatch, trouble):
    """Half a copy would be in the way of the next try; the source is there still."""
    bag = record(tmp_path / "bag")
    with monkeypatch.context() as patched:
        patched.setattr("rb_sim.io.bag.folder.BagFile.add_message", Mock(side_effect=trouble))
        with pytest.raises((KeyboardInterrupt, SinkError)):
            recover_bag(bag)
    assert not (tmp_path / "bag_recovered").exists()
    assert recover_bag(bag).complete


def test_file_size_limit(tmp_path):
    """RLIMIT_FSIZE stands for any write that fails; the rest of the run is not disturbed."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1_100_000, 1_100_000))\n"
    code = limit + RECORD_FOREVER
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "bag")], capture_output=True, text=True
    )
    *_, last = done.stderr.strip().splitlines()
    assert last.startswith("rb_sim.base.errors.SinkError: ")
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


@pytest.mark.parametrize("split", [[], ["100000"]])
def test_full_disk_leaves_a_complete_bag(small_disk, split):
    """The reserve pays for the last chunk and the index, also where another file has no room."""
    bag = small_disk / "bag"
    done = subprocess.run(
        [sys.executable, "-c", RECORD_FOREVER, str(bag), *split], capture_output=True, text=True
    )
    *_, last = done.stderr.strip().splitlines()
    assert f"SinkError: {bag}: disk full; the bag ends at t = " in last
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
