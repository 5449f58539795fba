# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A broken length in bytes without a checksum: what is whole is read, nothing is invented."""

from __future__ import annotations

import random
import re
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.bags.info import info
from rb_sim.base.errors import SinkError
from rb_sim.cli.verbs.replay import recover, replay
from rb_sim.io.bag.batches import BagScan
from rb_sim.io.bag.checked_records import OTHER_COUNT, WRONG_TIMES, Frames
from rb_sim.io.bag.folder import recover_bag
from rb_sim.io.bag.reader import BagReader
from tests.io.conftest import START

N = 60
T0 = 1_700_000_000_000_000_000
STEP = 10_000_000


class Message(NamedTuple):
    channel: int
    sequence: int
    time: int
    data: bytes


def messages_of(lengths: tuple[int, ...] = (84, 33, 120), t0: int = T0) -> list[Message]:
    """Three topics in turn; the data hold many zeros, as poses do."""
    rng = random.Random(3)
    return [
        Message(
            1 + k % 3,
            k,
            t0 + k * STEP,
            bytes(rng.choice((0, 0, 0, 5, rng.randrange(256))) for _ in range(lengths[k % 3])),
        )
        for k in range(N)
    ]


def write(path: Path, messages: list[Message], *, index: bool = True, **options) -> bytes:
    """A file of the mcap library's own writer."""
    options = {"enable_crcs": False, "compression": CompressionType.NONE, **options}
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=3000, **options)
        writer.start(profile="ros2")
        schema = writer.register_schema("geometry_msgs/msg/Point", "ros2msg", b"float64 x\n")
        for name in ("a", "b", "c"):
            writer.register_channel(f"/{name}", "cdr", schema)
        for m in messages:
            writer.add_message(m.channel, m.time, m.data, m.time, m.sequence)
        writer.finish()
    data = path.read_bytes()
    return data if index else data[: data.index(b"\x0f\x04" + bytes(7))]


def read(path: Path, data: bytes) -> tuple[list[Message], BagScan]:
    path.write_bytes(data)
    scan = BagScan(path)
    found = [
        Message(channel, int(m.sequence[k]), int(m.log_time[k]), m.data(k))
        for batch in scan.batches()
        for channel, m in batch.items()
        for k in range(len(m.start))
    ]
    return sorted(found, key=lambda m: m.sequence), scan


def place_of(data: bytes, message: Message) -> int:
    """Where the record of the message begins."""
    head = struct.pack("<HIQQ", message.channel, message.sequence, message.time, message.time)
    return data.index(head) - 9


def between(scan: BagScan) -> list[tuple[float, float]]:
    found = re.findall(r"between t = (\S+) s and t = (\S+) s", "\n".join(scan.missing.lines()))
    return [(float(first), float(last)) for first, last in found]


KINDS = {
    "chunks": {},
    "chunks, no index": {"index": False},
    "no chunks": {"use_chunking": False},
    "no chunks, no index": {"use_chunking": False, "index": False},
    "no chunks, checked index": {"use_chunking": False, "enable_crcs": True},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("wrong", [0, 1, 21, 22, 60, 83, 499, 1 << 30, 1 << 62])
def test_a_broken_length_costs_its_message(tmp_path, kind, wrong):
    """Of each message in turn, too short, too long, beyond the file: all others are read."""
    path = tmp_path / "x.mcap"
    messages = messages_of()
    data = write(path, messages, **KINDS[kind])
    for k in range(0, N, 7):
        at = place_of(data, messages[k])
        if struct.unpack_from("<Q", data, at + 1)[0] == wrong:
            continue
        found, scan = read(path, data[: at + 1] + struct.pack("<Q", wrong) + data[at + 9 :])
        assert found == messages[:k] + messages[k + 1 :], k
        if "no chunks" in kind and k == 0:
            continue  # nothing tells when it was
        assert any(a - 1e-6 <= k * STEP / 1e9 <= b + 1e-6 for a, b in between(scan)), k


@pytest.mark.parametrize("kind", KINDS)
def test_several_places_at_once(tmp_path, kind):
    """A burst of zeros and two lengths more: each place costs at most itself and one neighbour."""
    path = tmp_path / "x.mcap"
    messages = messages_of()
    data = bytearray(write(path, messages, **KINDS[kind]))
    for k in (11, 40):
        data[place_of(data, messages[k]) + 2] ^= 0x55
    first, last = place_of(data, messages[20]) + 40, place_of(data, messages[24]) + 5
    data[first:last] = bytes(last - first)
    found, scan = read(path, bytes(data))
    lost = {11, 40, 20, 21, 22, 23, 24}
    kept = [m for m in messages if m.sequence not in lost | {19}]
    assert [m for m in found if m.sequence not in {19, 20}] == kept
    assert len(between(scan)) >= 3


@pytest.mark.parametrize("kind", [name for name in KINDS if ", no index" not in name])
def test_a_length_that_takes_its_neighbour_in(tmp_path, kind):
    """By one bit a record of 64 bytes ends where the next one does.

    The index of the chunk tells which it is; without chunks the count tells that one is gone.
    """
    path = tmp_path / "x.mcap"
    messages = messages_of((33, 33, 33))
    data = write(path, messages, **KINDS[kind])
    at = place_of(data, messages[10]) + 1
    changed = bytearray(data)
    changed[at] |= 64
    (length,) = struct.unpack_from("<Q", changed, at)
    assert length == 22 + 33 + 64
    found, scan = read(path, bytes(changed))
    (line,) = scan.missing.lines()
    assert "1 messages are missing" in line
    if kind == "chunks":
        assert found == messages[:10] + messages[11:]
        assert between(scan) == [(0.09, 0.11)]
    else:
        assert OTHER_COUNT in line and len(found) == N - 1


@pytest.mark.parametrize("t0", [T0, 0])
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_invented(tmp_path, kind, t0):
    """Any byte of an opcode, length, channel or log time: what is read was written, or told."""
    path = tmp_path / "x.mcap"
    messages = messages_of(t0=t0)
    data = write(path, messages, **KINDS[kind])
    written = {m.sequence: m for m in messages}
    rng = random.Random(11)
    for _ in range(80):
        k = rng.randrange(N)
        offset = rng.choice([*range(11), *range(15, 23)])
        changed = bytearray(data)
        changed[place_of(data, messages[k]) + offset] ^= rng.randrange(1, 256)
        found, scan = read(path, bytes(changed))
        lines = scan.missing.lines()
        others = [m for m in found if written[m.sequence] != m]
        assert len(found) >= N - 2, (k, offset)
        if offset >= 9:  # another channel or another time within that of the chunk
            assert [m.sequence for m in others] in ([], [k]), (k, offset)
            assert lines or len(found) == N
        else:
            assert not others, (k, offset)
            assert lines, (k, offset)


def test_both_lengths_of_a_chunk(tmp_path):
    """A chunk says its length twice; either is enough with a checksum or a size that fits."""
    path = tmp_path / "x.mcap"
    messages = messages_of()
    for options in ({}, {"enable_crcs": True}, {"compression": CompressionType.ZSTD}):
        compression = len("zstd") if "compression" in options else 0
        for index in (True, False):
            data = write(path, messages, index=index, **options)
            chunks = [m.start() for m in re.finditer(rb"\x06.{5}\x00\x00\x00", data, re.DOTALL)]
            at = next(c for c in chunks if _is_chunk(data, c) and c > 100)
            for place in (at + 1, at + 3, at + 9 + 32 + compression):
                changed = bytearray(data)
                changed[place] ^= 0x15
                found, scan = read(path, bytes(changed))
                assert found == messages
                line = scan.missing.lines()[0]
                assert "one of its two lengths is broken" in line
                assert (
                    "no known message is missing" in line and len(scan.missing.lines()) == 2 - index
                )


def _is_chunk(data: bytes, at: int) -> bool:
    (length,) = struct.unpack_from("<Q", data, at + 1)
    (name,) = struct.unpack_from("<I", data, at + 9 + 28)
    if name > 4:
        return False
    return struct.unpack_from("<Q", data, at + 9 + 32 + name)[0] + 40 + name == length


@pytest.mark.parametrize("options", [{}, {"enable_crcs": True}])
def test_a_chunk_that_is_cut_off(tmp_path, options):
    """Of a file that ends in it: all messages before the cut, and what is missing after them."""
    path = tmp_path / "x.mcap"
    messages = messages_of()
    data = write(path, messages, **options)
    k = 31
    at = place_of(data, messages[k])
    chunk = max(m.start() for m in re.finditer(rb"\x06", data[:at]) if _is_chunk(data, m.start()))
    end = data.index(b"\x07", chunk + 9 + struct.unpack_from("<Q", data, chunk + 1)[0])
    last = max(m.sequence for m in messages if place_of(data, m) < end)
    huge = data[: chunk + 1] + struct.pack("<Q", 1 << 60) + data[chunk + 9 : at]
    assert read(path, huge)[0] == [m for m in messages if place_of(data, m) < chunk]
    for cut in (at, at + 5, at + 40):
        found, scan = read(path, data[:cut])
        assert found == messages[:k]
        (line,) = scan.missing.lines()
        assert "the file is cut off" in line
        assert between(scan) == [((k - 1) * 0.01, last * 0.01)]
        assert scan.unchecked >= 1


def test_a_chunk_that_gives_other_times(tmp_path):
    """Its own times are broken, not those of all its messages: they are read, and it is told."""
    path = tmp_path / "x.mcap"
    messages = messages_of()
    data = bytearray(write(path, messages))
    at = next(m.start() for m in re.finditer(rb"\x06", data) if _is_chunk(data, m.start()))
    data[at + 9 + 6] ^= 8
    found, scan = read(path, bytes(data))
    assert found == messages
    assert any(WRONG_TIMES in line for line in scan.missing.lines())


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_of_what_was_compressed_nothing_is_certain(tmp_path, compression):
    """A chunk that comes out with a broken record is skipped as a whole, and told."""
    path = tmp_path / "x.mcap"
    messages = messages_of()
    data = write(path, messages, compression=compression)
    places = [m.start() for m in re.finditer(rb"\x06", data) if _is_chunk(data, m.start())]
    rng = random.Random(5)
    reported, silent = 0, 0
    for _ in range(150):
        at = rng.choice(places)
        (length,) = struct.unpack_from("<Q", data, at + 1)
        changed = bytearray(data)
        changed[at + 9 + 44 + rng.randrange(length - 44)] ^= rng.randrange(1, 256)
        found, scan = read(path, bytes(changed))
        if scan.missing.lines():
            reported += len(found) < len(messages)
        else:
            silent += found != messages
    assert reported > 0
    assert silent > 0  # why such messages are counted as those that no checksum covers
    assert scan.unchecked == len(found)


@pytest.mark.parametrize("copies", [0, 2])
def test_a_chunk_that_is_gone_or_came_twice(tmp_path, copies):
    """The footer has no checksum; where it points to stands something else than the summary."""
    data = write(tmp_path / "x.mcap", messages_of())
    chunks, at = [], 8
    while at < len(data) - 8:
        (length,) = struct.unpack_from("<Q", data, at + 1)
        chunks += [slice(at, at + 9 + length)] if data[at] == 6 else []
        at += 9 + length
    assert len(chunks) == 3
    for chunk in chunks:
        changed = data[: chunk.start] + copies * data[chunk] + data[chunk.stop :]
        _, scan = read(tmp_path / "y.mcap", changed)
        assert "its index is broken" in "".join(scan.missing.lines())
    assert read(tmp_path / "y.mcap", data)[1].missing.lines() == []


# Damage is told: what is broken is skipped, what is whole is read, what is missing is said.


TOPICS = 17
N_DAMAGE = 600


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
    return record(n=N_DAMAGE, chunk_size=230_000)


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
    expected = samples(N_DAMAGE).t
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
    assert len(times(reader)) == N_DAMAGE and "one of its two lengths is broken" in reader.damage[0]
    (name,) = struct.unpack_from("<I", path.read_bytes(), at + 9 + 28)
    change(path, at + 9 + 32 + name + 2)
    assert 0.7 * N_DAMAGE < len(times(BagReader(bag))) < N_DAMAGE
    path.write_bytes(path.read_bytes()[:-30])  # now it has no index any more
    reader = BagReader(bag, unfinished=True)
    found = times(reader)
    assert len(found) > 0.7 * N_DAMAGE and found[-1] == pytest.approx((N_DAMAGE - 1) / 100)
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
    assert len(warned) == 1 and 0.5 * N_DAMAGE < len(run) < N_DAMAGE
    notes = analyze(bag).notes
    assert any("messages missing" in line for line in notes)
    assert any("balances span the missing messages" in line for line in notes)
    set_up(FitOptions(bag, ["bodies.a.mass"]))
    assert "messages missing between t = " in capsys.readouterr().err


def test_recover_and_replay_say_it(bag, tmp_path, capsys):
    chunks = chunks_of(file_of(bag))
    change(file_of(bag), chunks[1].chunk_start_offset + chunks[1].chunk_length // 2)
    recover(bag, tmp_path / "saved")
    reported = capsys.readouterr()
    assert "the bag was complete" not in reported.out
    assert re.search(r"^warning: .*bag_0.mcap: damaged at byte \d+: .* between t = ", reported.err)
    again = recover_bag(tmp_path / "saved", tmp_path / "again")
    assert again.complete and again.damage == ()
    assert len(times(BagReader(tmp_path / "saved"))) == len(times(BagReader(bag)))
    pytest.importorskip("rerun", reason="rerun-sdk is not installed")
    replay(bag, save=tmp_path / "r.rrd")
    assert "messages missing between t = " in capsys.readouterr().err


def test_a_broken_index_is_reported_and_not_used(bag, samples):
    """Nothing is lost then, and the bag is read without it."""
    data = file_of(bag).read_bytes()
    change(file_of(bag), len(data) - 200)
    reader = BagReader(bag)
    assert len(times(reader)) == N_DAMAGE
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
        assert len(times(BagReader(bag))) == N_DAMAGE
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
    reported = 0
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
            reported += 1
            continue
        t = np.concatenate([[], *(block.t for block in blocks)])
        k = np.rint(t * 100).astype(int)
        for name in names if blocks else ():
            values = np.concatenate([getattr(block, name) for block in blocks])
            np.testing.assert_allclose(values, getattr(expected, name)[k], atol=1e-13)
        assert len(k) == 300 or reader.damage, at
        reported += bool(reader.damage)
    assert reported > 30


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
def test_a_broken_summary_is_reported_and_left_out(record, old):
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
