# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags in SQLite storage are read as those in MCAP are: by rosbags, and what of them is broken."""

from __future__ import annotations

import shutil
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest
import zstandard
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.bags.info import info
from rb_sim.bags.tracks import tracks_of_bag
from rb_sim.base.errors import MissingExtraError, SinkError
from rb_sim.io.bag.folder import recover_bag, scan_of
from tests.bags.analysis import foreign

T, P, Q = foreign.swing()
POSE = "geometry_msgs/msg/PoseStamped"
MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3


def write(
    folder: Path, plugin: StoragePlugin = SQLITE, mode: CompressionMode | None = None,
    times: slice = slice(None), make=foreign.pose_stamped,
) -> Path:  # fmt: skip
    """The swing as somebody records it on /body."""
    motion = zip(T[times], P[times], Q[times], strict=True)
    return foreign.record(folder, ((x[0], "/body", *make(*x)) for x in motion), plugin, mode)


@pytest.mark.parametrize("make", [foreign.pose_stamped, foreign.odometry, foreign.tf])
def test_every_reader_finds_in_both_storages_the_same(tmp_path, make):
    other, bag = write(tmp_path / "m", MCAP, make=make), write(tmp_path / "s", make=make)
    for path in (bag, bag / "s.db3"):
        one, two = info(path), info(other)
        for key in ("duration", "messages", "topics", "run"):
            assert one[key] == two[key]
        assert one["health"]["whole"] and one["health"]["messages_without_checksum"] == len(T)
        a, b = tracks_of_bag(path), tracks_of_bag(other)
        assert list(a.bodies) == list(b.bodies) and a.notes == b.notes
        for name, track in a.bodies.items():
            assert np.array_equal(track.position, b.bodies[name].position)
        assert analyze(path).as_dict() | {"bag": ""} == analyze(other).as_dict() | {"bag": ""}


def test_recover_makes_an_mcap_bag_of_it(tmp_path):
    made = recover_bag(write(tmp_path / "s"))
    assert made.messages == len(T) and made.complete and made.unchecked == len(T)
    (file,) = made.directory.glob("*.mcap")
    assert np.array_equal(tracks_of_bag(file).bodies["/body"].position, P)


def test_without_rosbags_one_line_says_what_to_install(tmp_path, monkeypatch):
    bag = write(tmp_path / "s")
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    line = (
        f"{bag / 's.db3'}: a bag in SQLite storage needs the package 'rosbags': "
        "install it with pip install 'rb_sim[analysis]'"
    )
    for read in (info, tracks_of_bag, analyze, recover_bag):
        with pytest.raises(MissingExtraError) as caught:
            read(bag)
        assert str(caught.value) == line


def test_files_of_one_bag_come_in_the_order_of_their_numbers(tmp_path):
    (tmp_path / "bag").mkdir()
    for name, times in (("drive_10", slice(200, None)), ("drive_9", slice(200))):
        write(tmp_path / name, times=times)
        shutil.move(tmp_path / name / f"{name}.db3", tmp_path / "bag")
    track = tracks_of_bag(tmp_path / "bag").bodies["/body"]
    assert np.array_equal(track.position, P)


def test_the_same_bag_in_both_storages_is_not_read_as_one(tmp_path):
    write(tmp_path / "s")
    shutil.move(write(tmp_path / "m", MCAP) / "m.mcap", tmp_path / "s" / "s.mcap")
    info_lines = info(tmp_path / "s")["notes"]
    assert info_lines == [
        f"{tmp_path / 's'}: its metadata.yaml does not name s.mcap, which is not read"
    ]
    (tmp_path / "s" / "metadata.yaml").unlink()
    with pytest.raises(
        SinkError, match="not one bag: 2 files without .* name one of them, or call .* NAME_0"
    ):
        info(tmp_path / "s")


@pytest.mark.parametrize("columns", [4, 5])
def test_tables_of_older_releases(tmp_path, columns):
    """Foxy's and Humble's have no message definitions; the first no QoS either."""
    new = sqlite3.connect(write(tmp_path / "s") / "s.db3")
    path = tmp_path / "old.db3"
    old = sqlite3.connect(path)
    text = ["name TEXT", "type TEXT", "serialization_format TEXT", "offered_qos_profiles TEXT"]
    old.execute(f"CREATE TABLE topics(id INTEGER PRIMARY KEY, {', '.join(text[: columns - 1])})")
    old.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data BLOB)")
    old.execute("INSERT INTO topics VALUES (7, '/body', ?, 'cdr'{})".format(", ''" * (columns - 4)),
                (POSE,))  # fmt: skip
    rows = new.execute("SELECT id, 7, timestamp, data FROM messages").fetchall()
    old.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
    old.commit()
    assert np.array_equal(tracks_of_bag(path).bodies["/body"].position, P)


def test_a_journal_beside_it_is_reported(tmp_path):
    bag = write(tmp_path / "s")
    (bag / "s.db3-wal").write_bytes(b"x")
    found = info(bag)["health"]
    assert not found["whole"]
    assert found["damage"] == [
        f"{bag / 's.db3'}: its recorder was killed; messages in its journal (-wal) are "
        "not read; messages missing after t = 3.99000013 s of the bag"
    ]


def long_name(t, p, q):
    """A message of more than a page, whose end is on pages that only its reader looks at."""
    kind, message = foreign.pose_stamped(t, p, q)
    message.header.frame_id = "map" + "_" * 20_000
    return kind, message


def test_what_lies_before_a_broken_page_is_read_and_the_rest_reported(tmp_path):
    path = write(tmp_path / "s", make=long_name) / "s.db3"
    (page,) = sqlite3.connect(path).execute("PRAGMA page_size").fetchone()
    data = bytearray(path.read_bytes())
    numbers = data.index(np.array([P[200, 0], P[200, 1]]).tobytes())
    at = data.rindex(b"map_", 0, numbers) // page * page + page  # the second page of the message
    data[at : at + page] = b"\xff" * page
    path.write_bytes(data)
    scan = scan_of(path)
    read = [messages.log_time for batch in scan.batches() for messages in batch.values()]
    assert 190 < sum(map(len, read)) == scan.messages <= 200
    (line,) = scan.missing.lines()
    assert "damaged: the database cannot be read any further; messages missing after" in line
    assert line.endswith(f"; {len(T) - scan.messages} messages are missing in all")


def test_a_broken_table_is_refused_with_the_command_that_mends_it(tmp_path):
    path = write(tmp_path / "s") / "s.db3"
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 8192] = bytes(8192)
    path.write_bytes(data)
    with pytest.raises(
        SinkError, match=r"damaged; to save its undamaged part: sqlite3 \S+ .recover \|"
    ):
        info(path)


def test_what_is_no_database_is_refused_in_one_line(tmp_path):
    path = tmp_path / "x.db3"
    for content in (b"", b"hello", bytes(4096)):
        path.write_bytes(content)
        with pytest.raises(SinkError, match=r"x\.db3: not an SQLite file of rosbag2: [^\n]+$"):
            info(path)


def test_messages_compressed_one_by_one_are_read(tmp_path):
    for plugin in (SQLITE, MCAP):
        bag = write(tmp_path / plugin.name, plugin, CompressionMode.MESSAGE)
        assert np.array_equal(tracks_of_bag(bag).bodies["/body"].position, P)


def test_a_broken_message_among_compressed_ones_is_left_out(tmp_path):
    path = write(tmp_path / "s", mode=CompressionMode.MESSAGE) / "s.db3"
    database = sqlite3.connect(path)
    (data,) = database.execute("SELECT data FROM messages WHERE id = 5").fetchone()
    database.execute("UPDATE messages SET data = ? WHERE id = 5", (data[:-8],))
    database.commit()
    found = tracks_of_bag(path)
    assert len(found.bodies["/body"].t) == len(T) - 1
    (note,) = found.notes
    assert note.startswith("/body: 1 message skipped: its encoding 28b5 is not CDR")


@pytest.mark.parametrize("plugin", [SQLITE, MCAP])
def test_files_compressed_as_a_whole_are_read_once_unpacked_as_the_line_says(tmp_path, plugin):
    bag = write(tmp_path / "x", plugin, CompressionMode.FILE)
    (packed,) = bag.glob("*.zstd")
    line = rf"{packed.name} was compressed as a whole by rosbag2; unpack it first: zstd -d "
    for path in (bag, packed):
        with pytest.raises(SinkError, match=line):
            info(path)
    with packed.open("rb") as source, packed.with_suffix("").open("wb") as target:
        zstandard.ZstdDecompressor().copy_stream(source, target)
    assert np.array_equal(tracks_of_bag(bag).bodies["/body"].position, P)
