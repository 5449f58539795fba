# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A bag in several files: what is in each, in metadata.yaml, and read back as one."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from rb_sim.base.errors import RbSimError, SinkError
from rb_sim.cli.verbs.run import RunOptions, splitting
from rb_sim.io.bag.folder import recover_bag
from rb_sim.io.bag.reader import BagReader
from rb_sim.mechanics.samples import concatenate


def poses(bag) -> list[tuple[int, bytes]]:
    """Time and bytes of the ball's poses, as rosbags reads them."""
    with AnyReader([bag]) as reader:
        wanted = [c for c in reader.connections if c.topic == "/rb_sim/ball/pose"]
        return [(time, bytes(data)) for _, time, data in reader.messages(wanted)]


@pytest.mark.parametrize("split", [{"split_duration": 0.5}, {"split_size": 40_000}])
def test_parts_hold_together_what_one_file_would(record, layout, split):
    whole = record("whole", n=200, chunk_size=8000)
    parts = record("parts", n=200, chunk_size=8000, **split)
    info = yaml.safe_load((parts / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    names = [f"parts_{k}.mcap" for k in range(len(info["files"]))]
    assert len(names) > 2
    assert info["relative_file_paths"] == names == [file["path"] for file in info["files"]]
    assert sorted(path.name for path in parts.glob("*.mcap")) == sorted(names)
    assert sum(file["message_count"] for file in info["files"]) == info["message_count"]
    one = yaml.safe_load((whole / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    again = len(names) - 1  # each part has what is latched, so that it can be drawn on its own
    assert info["message_count"] == one["message_count"] + 3 * again
    assert (info["duration"], info["starting_time"]) == (one["duration"], one["starting_time"])
    counts = {
        t["topic_metadata"]["name"]: t["message_count"] for t in one["topics_with_message_count"]
    }
    for topic in ("/rb_sim/description", "/robot_description", "/rb_sim/markers"):
        counts[topic] += again
    assert counts == {
        t["topic_metadata"]["name"]: t["message_count"] for t in info["topics_with_message_count"]
    }
    assert poses(parts) == poses(whole)
    a, b = (concatenate(list(BagReader(bag).blocks()), layout) for bag in (whole, parts))
    np.testing.assert_array_equal(b.t, a.t)
    np.testing.assert_array_equal(b.position, a.position)


def test_split_by_time_ends_where_it_says_and_a_part_is_read_on_its_own(record):
    bag = record(n=200, split_duration=0.5)
    info = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert [file["duration"]["nanoseconds"] for file in info["files"]] == [490_000_000] * 4
    (block,) = BagReader(bag / "bag_2.mcap").blocks()
    np.testing.assert_allclose(block.t, 1.0 + 0.01 * np.arange(50), atol=1e-9)


def test_files_of_an_older_bag_do_not_stay(record):
    """Else an unfinished bag of one file would seem to go on with them."""
    record(n=200, split_duration=0.5)
    bag = record(n=20)
    assert [path.name for path in bag.glob("*.mcap")] == ["bag_0.mcap"]


def test_recover_reads_what_is_left_of_a_bag_without_one_of_its_files(record):
    """The middle one is gone: the poses of the others, and a line."""
    bag = record(n=200, split_duration=0.5)
    all_poses = poses(bag)
    (bag / "bag_1.mcap").unlink()
    line = f"{bag}: its metadata.yaml names bag_1.mcap, which is not there"
    assert BagReader(bag).unlisted == [line]
    result = recover_bag(bag)
    assert not result.complete and result.damage == (line,)
    assert poses(result.directory) == all_poses[:50] + all_poses[100:]


def test_an_empty_file_behind_the_last_one_is_no_part_of_the_bag(record):
    """As a process leaves it that is killed when it begins another file."""
    bag = record(n=200, split_duration=0.5)
    all_poses = poses(bag)
    (bag / "metadata.yaml").unlink()
    (bag / "bag_4.mcap").touch()
    assert BagReader(bag).unlisted == [f"{bag / 'bag_4.mcap'} is empty"]
    assert poses(recover_bag(bag).directory) == all_poses


def test_refusals():
    with pytest.raises(RbSimError, match="^--split-size: got 1; must be at least 100000 bytes$"):
        splitting(RunOptions("top", split_size=1))
    with pytest.raises(RbSimError, match="^--split-duration: got nan; must be > 0 s$"):
        splitting(RunOptions("top", split_duration=float("nan")))


def test_a_recovered_bag_says_once_what_each_part_says(record, tmp_path):
    """Else a topic had a channel for each part, and readers warned of records of one name."""
    whole = record("whole", n=200)
    parts = record("parts", n=200, split_duration=0.5)
    recovered = recover_bag(parts, tmp_path / "recovered")
    path = recovered.directory / "recovered_0.mcap"
    with (whole / "whole_0.mcap").open("rb") as one, path.open("rb") as other:
        a, b = make_reader(one), make_reader(other)
        summaries = [s for r in (a, b) if (s := r.get_summary()) is not None]
        topics = [sorted(c.topic for c in s.channels.values()) for s in summaries]
        records = [sorted(m.name for m in r.iter_metadata()) for r in (a, b)]
        attached = [[(x.name, x.data) for x in r.iter_attachments()] for r in (a, b)]
    assert topics[1] == topics[0]
    assert records[1] == records[0]
    assert attached[1] == attached[0]
    assert poses(recovered.directory) == poses(whole)


def changed(bag, change):
    """Rewrite the names in metadata.yaml."""
    path = bag / "metadata.yaml"
    document = yaml.safe_load(path.read_text())
    info = document["rosbag2_bagfile_information"]
    info["relative_file_paths"] = change(info["relative_file_paths"])
    path.write_text(yaml.safe_dump(document))


def times(bag) -> np.ndarray:
    return np.concatenate([block.t for block in BagReader(bag).blocks()])


@pytest.mark.parametrize(
    "named",
    [
        lambda name: f"bag\\{name}",  # as on Windows
        lambda name: f"bag/{name}",  # as rosbag2 wrote them before Foxy
        lambda name: f"elsewhere/run7/{name}",  # as the folder was called when it was recorded
        lambda name: f"data/{name}",  # a folder of their own
        None,  # in another order
    ],
)
def test_files_are_found_however_metadata_names_them(record, named):
    bag = record(n=200, split_duration=0.5)
    whole = times(bag)
    changed(bag, lambda names: [*map(named, names)] if named else names[::-1])
    if named and named("") == "data/":
        (bag / "data").mkdir()
        for path in bag.glob("*.mcap"):
            path.rename(bag / "data" / path.name)
    np.testing.assert_array_equal(times(bag), whole)
    assert BagReader(bag).unlisted == []


def test_files_whose_names_are_no_series_are_read_in_the_order_of_their_times(record):
    """As `ros2 bag reindex` lists what somebody has renamed."""
    bag = record(n=200, split_duration=0.5)
    whole = times(bag)
    names = dict(
        zip([f"bag_{k}.mcap" for k in range(4)], ("wed", "tue", "mon", "sun"), strict=True)
    )
    for old, new in names.items():
        (bag / old).rename(bag / f"{new}.mcap")
    changed(bag, lambda listed: sorted(f"{names[old]}.mcap" for old in listed))
    np.testing.assert_array_equal(times(bag), whole)


def test_files_without_metadata_are_one_bag_if_their_names_are_a_series(record):
    bag = record(n=200, split_duration=0.5)
    whole = times(bag)
    (bag / "metadata.yaml").unlink()
    np.testing.assert_array_equal(times(bag), whole)
    for number in range(4):  # as rosbag2 names them since 2026
        began = f"2026_01_31-23_59_{58 - number:02}"  # its clock was set back
        (bag / f"bag_{number}.mcap").rename(bag / f"{number}_bag_{began}.mcap")
    np.testing.assert_array_equal(times(bag), whole)
    next(bag.glob("1_*")).rename(bag / "other.mcap")
    with pytest.raises(
        SinkError, match="not one bag: .* as .* name one of them, or call .* NAME_0.mcap"
    ):
        BagReader(bag)
