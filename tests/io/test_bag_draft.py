# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What waits in the open chunk of a bag is at the end of the file, for whoever reads it then."""

from __future__ import annotations

import errno
import os
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader

from rb_sim.io.bag import file
from rb_sim.io.bag.file import Draft
from rb_sim.io.bag.reader import BagReader
from rb_sim.io.bag.recover import recover_bag
from rb_sim.io.bag.sink import BagSink

TOPICS = 17
LATCHED = 3
"""Messages that are recorded once."""


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


def test_a_draft_waits_for_half_a_second() -> None:
    now = 10.0
    draft = Draft(lambda: now)
    assert not draft.due
    draft.wait()
    assert not draft.due
    now += file.PERIOD / 2.0
    draft.wait()
    now += file.PERIOD / 2.0
    assert draft.due
    draft.clear()
    assert not draft.due


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
