# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Damage is told: what is broken is skipped, what is whole is read, what is missing is said."""

from __future__ import annotations

import random
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from rb_sim.bags.analysis.run import analyze
from rb_sim.bags.info import info
from rb_sim.base.errors import SinkError
from rb_sim.cli.verbs.replay import recover, replay
from rb_sim.io.bag.checked_records import Frames
from rb_sim.io.bag.reader import BagReader
from rb_sim.io.bag.recover import recover_bag
from tests.io.conftest import START

TOPICS = 17
N = 600


def file_of(bag: Path) -> Path:
    return bag / "bag_0.mcap"


def chunks_of(path: Path):
    """The chunks as the mcap library's own reader finds them in the index."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    return sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)


def change(path: Path, *offsets: int) -> None:
    data = bytearray(path.read_bytes())
    for offset in offsets:
        data[offset] ^= 0x55
    path.write_bytes(data)


def times(reader: BagReader) -> np.ndarray:
    return np.concatenate([[], *(block.t for block in reader.blocks())])


def seconds(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"t = (\S+) s", text)]


@pytest.fixture
def bag(record) -> Path:
    """A bag of some five chunks."""
    return record(n=N, chunk_size=230_000)


def test_two_bytes_in_the_second_chunk(bag, samples):
    """All other chunks are read; the line names the times of the chunk as its index has them."""
    chunks = chunks_of(file_of(bag))
    assert 4 <= len(chunks) <= 6
    middle = chunks[1].chunk_start_offset + chunks[1].chunk_length // 2
    change(file_of(bag), middle, middle + 1)
    reader = BagReader(bag)
    found = times(reader)
    first, last = ((t - START) / 1e9 for t in (chunks[1].message_start_time,
                                               chunks[1].message_end_time))  # fmt: skip
    expected = samples(N).t
    np.testing.assert_allclose(
        found, expected[(expected < first - 1e-9) | (expected > last + 1e-9)], atol=1e-9
    )
    (line,) = reader.damage
    assert "its checksum is wrong; messages missing between" in line
    np.testing.assert_allclose(seconds(line), [first, last], atol=1e-8)
    with file_of(bag).open("rb") as file:
        whole = sum(1 for _ in make_reader(file).get_summary().chunk_indexes)
    assert whole == len(chunks)
    lost = int(re.search(r"(\d+) messages are missing", line)[1])
    assert abs(lost - TOPICS * (last - first) * 100) <= 2 * TOPICS


def test_a_length_that_is_broken(bag, samples):
    """Even the framing is lost: reading goes on at the next chunk, with the index or without.

    A chunk says its length twice: one of the two is enough.
    """
    path = file_of(bag)
    at = chunks_of(path)[1].chunk_start_offset
    change(path, at + 3)
    reader = BagReader(bag)
    assert len(times(reader)) == N and "one of its two lengths is broken" in reader.damage[0]
    (name,) = struct.unpack_from("<I", path.read_bytes(), at + 9 + 28)
    change(path, at + 9 + 32 + name + 2)
    assert 0.7 * N < len(times(BagReader(bag))) < N
    path.write_bytes(path.read_bytes()[:-30])  # now it has no index any more
    reader = BagReader(bag, unfinished=True)
    found = times(reader)
    assert len(found) > 0.7 * N and found[-1] == pytest.approx((N - 1) / 100)
    gap = np.flatnonzero(np.diff(found) > 0.011)
    assert len(gap) == 1
    (line,) = [line for line in reader.damage if "between" in line]
    between = seconds(line)
    assert between[0] <= found[gap[0]] + 0.0101 and between[1] >= found[gap[0] + 1] - 0.0101
    assert between[1] - between[0] < 2.0


def test_python_fit_and_analyze_say_it(bag, capsys):
    from rb_sim import Trajectory
    from rb_sim.cli.verbs.fit import FitOptions, set_up

    chunks = chunks_of(file_of(bag))
    change(file_of(bag), chunks[1].chunk_start_offset + chunks[1].chunk_length // 2)
    with pytest.warns(UserWarning, match="messages missing between t = ") as warned:
        run = Trajectory.from_bag(bag)
    assert len(warned) == 1 and 0.5 * N < len(run) < N
    notes = analyze(bag).notes
    assert any("messages missing" in line for line in notes)
    assert any("balances span the missing messages" in line for line in notes)
    set_up(FitOptions(bag, "bodies.a.mass"))
    assert "messages missing between t = " in capsys.readouterr().err


def test_recover_and_replay_say_it(bag, tmp_path, capsys):
    chunks = chunks_of(file_of(bag))
    change(file_of(bag), chunks[1].chunk_start_offset + chunks[1].chunk_length // 2)
    recover(bag, tmp_path / "saved")
    told = capsys.readouterr()
    assert "the bag was complete" not in told.out
    assert re.search(r"^warning: .*bag_0.mcap: damaged at byte \d+: .* between t = ", told.err)
    again = recover_bag(tmp_path / "saved", tmp_path / "again")
    assert again.complete and again.damage == ()
    assert len(times(BagReader(tmp_path / "saved"))) == len(times(BagReader(bag)))
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    replay(bag, save=tmp_path / "r.rrd")
    assert "messages missing between t = " in capsys.readouterr().err


def test_a_broken_index_is_told_and_not_used(bag, samples):
    """Nothing is lost then, and the bag is read without it."""
    data = file_of(bag).read_bytes()
    change(file_of(bag), len(data) - 200)
    reader = BagReader(bag)
    assert len(times(reader)) == N
    (line,) = reader.damage
    assert "its index is broken, and is not used" in line
    assert analyze(bag).notes == [line]  # no balance goes across anything


def test_the_head_of_a_record_beside_the_messages(bag, samples):
    """Of metadata no checksum covers opcode and name: the index has both, and the name is taken
    from there; a record that is none any more is told, and costs a bag of ours no silence."""
    path = file_of(bag)
    data = path.read_bytes()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    seen = set()
    for index in summary.metadata_indexes:
        change(path, index.offset + 9 + 4)  # the first letter of the name
        found = info(bag)
        assert not found["health"]["whole"] and found["run"] is not None
        assert "its name is damaged" in found["health"]["damage"][0]
        assert len(times(BagReader(bag))) == N
        path.write_bytes(data)
        seen.add(index.name)
    assert "rb_sim" in seen
    for index in (*summary.metadata_indexes, *summary.attachment_indexes):
        change(path, index.offset)  # the opcode
        assert "unreadable record" in info(bag)["health"]["damage"][0]
        if index.name == "rb_sim":
            with pytest.raises(SinkError, match="record of the simulation cannot be read"):
                BagReader(bag)
        path.write_bytes(data)


def test_no_single_byte_makes_a_silent_difference(record, samples, tmp_path):
    """Wherever one byte changes: the same samples, or fewer and it is said, or one line."""
    source = record(n=300, chunk_size=30_000)
    data = file_of(source).read_bytes()
    expected = samples(300)
    path = tmp_path / "changed.mcap"
    rng = random.Random(7)
    told = 0
    names = ("position", "orientation", "reaction_force", "command")
    for _ in range(60):
        changed = bytearray(data)
        at = rng.randrange(len(data))
        changed[at] ^= 1 << rng.randrange(8)
        path.write_bytes(changed)
        try:
            reader = BagReader(path)
            blocks = list(reader.blocks())
        except SinkError as error:
            assert len(str(error).splitlines()) == 1
            told += 1
            continue
        t = np.concatenate([[], *(block.t for block in blocks)])
        k = np.rint(t * 100).astype(int)
        for name in names if blocks else ():
            values = np.concatenate([getattr(block, name) for block in blocks])
            np.testing.assert_allclose(values, getattr(expected, name)[k], atol=1e-13)
        assert len(k) == 300 or reader.damage, at
        told += bool(reader.damage)
    assert told > 30


def test_a_reader_that_never_ends_is_no_reader(tmp_path):
    """Lengths that lie, zeros and noise: iteration comes to its end."""
    magic = b"\x89MCAP0\r\n"
    rng = random.Random(1)
    for body in (b"", bytes(5000), b"\x06" * 5000, rng.randbytes(20_000), b"\x06" + b"\xff" * 8):
        path = tmp_path / "noise.mcap"
        path.write_bytes(magic + body + magic)
        frames = Frames(path)
        assert sum(1 for _ in frames) < 5000
        assert frames.damages


@pytest.mark.parametrize("old", [b'{"', b"finished"])
def test_a_broken_summary_is_told_and_left_out(record, old):
    """No JSON any more, or another word: neither is a traceback, nor taken for what was written."""
    path = file_of(record(summary={"outcome": "finished"}))
    assert BagReader(path).summary == {"outcome": "finished"}
    data = path.read_bytes()
    at = data.index(old, data.index(b"rb_sim_summary"))
    path.write_bytes(data[:at] + b"x" + data[at + 1 :])
    reader = BagReader(path)
    assert reader.summary is None
    assert any("summary is broken" in line for line in reader.damage)
    assert not info(path)["health"]["whole"]
