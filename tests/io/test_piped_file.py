# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A pipe into a file: all bytes arrive, and a disk that fails does not stop the writer."""

from __future__ import annotations

import errno
import random
import threading
from pathlib import Path

import pytest

from rb_sim.io.rerun.sink import PipedFile


def feed(file: PipedFile, data: bytes) -> None:
    """Write as another program would: by name, and more than the pipe holds."""
    with open(file.name, "wb") as writer:
        file.opened()
        for start in range(0, len(data), 10_000):
            writer.write(data[start : start + 10_000])
    file.wait()


def test_all_bytes_arrive(tmp_path):
    data = random.Random(0).randbytes(3_000_000)
    path = tmp_path / "file"
    path.write_bytes(b"what was there before, and longer" * 200_000)
    file = PipedFile(path)
    assert file.free > 0 and not file.vanished
    feed(file, data)
    assert file.error is None and path.read_bytes() == data


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full: not Linux")
def test_a_full_disk_is_kept_from_the_writer():
    file = PipedFile(Path("/dev/full"))
    writer = threading.Thread(target=feed, args=(file, bytes(1_000_000)), daemon=True)
    writer.start()
    writer.join(timeout=30)
    assert not writer.is_alive()
    assert file.error is not None and file.error.errno == errno.ENOSPC


def test_a_removed_file_is_noticed(tmp_path):
    file = PipedFile(tmp_path / "file")
    (tmp_path / "file").unlink()
    assert file.vanished
    feed(file, b"for nobody")


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(FileNotFoundError):
        PipedFile(tmp_path / "none" / "file")
