# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim info`: what a bag says of itself, against what was written."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from rb_sim import Trajectory
from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.bags.info import Rates, info
from rb_sim.bags.tracks import tracks_of_bag
from rb_sim.base.errors import SinkError
from rb_sim.cli.verbs.info import info as verb
from rb_sim.cli.verbs.info import lines
from rb_sim.cli.verbs.replay import recover
from tests.bags.scenes import PUSHED, record_node, record_run


def test_a_run(tmp_path, capsys):
    bag = record_run(PUSHED, tmp_path / "bag")
    found = info(bag)
    run = found["run"]
    assert run["bodies"] == ["box"]
    assert run["effects"] == {"weight": "gravity", "drive": "commanded_wrench"}
    assert run["simulation"]["method"] == "rk4" and run["simulation"]["step"] == 5e-3
    assert {"rb_sim", "numpy", "llvmlite", "python"} <= set(run["versions"])
    assert found["duration"] == pytest.approx(1.0, abs=1e-9)
    pose = found["topics"]["/rb_sim/box/pose"]
    assert (pose["count"], pose["gaps"]) == (51, 0)
    assert pose["rate"] == pytest.approx(50.0, rel=1e-6)
    assert found["health"]["whole"] and found["health"]["chunks_without_checksum"] == 0
    assert verb(bag) == 0
    text = capsys.readouterr().out
    for part in ("rk4, step 0.005 s", "weight (gravity)", "whole; ", "finished"):
        assert part in text


def test_a_node(tmp_path, capsys):
    pytest.importorskip("rclpy")
    bag = record_node(tmp_path / "bag")
    found = info(bag)
    assert found["resets"] == [pytest.approx(0.82)]
    assert found["commands"] == {"/sim/box": 3}
    assert found["run"]["settings"] == {"by": "node", "wrench_timeout": 0.0}
    assert found["run"]["commands_refused"] == {"not finite": 2}
    assert found["run"]["samples_dropped"] == 7
    assert verb(bag) == 0
    assert "7 samples: the queue of the logs was full" in capsys.readouterr().out


def test_a_damaged_bag(tmp_path, capsys):
    bag = record_run(PUSHED, tmp_path / "bag")
    file = bag / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    assert verb(bag) == 1
    assert "messages missing" in capsys.readouterr().err


@pytest.mark.parametrize("options", [{"enable_crcs": False}, {"use_chunking": False}])
def test_messages_that_no_checksum_covers_are_reported(tmp_path, capsys, options):
    """Written by the mcap library without checksums, or without chunks that would carry them."""
    path = tmp_path / "bare.mcap"
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/x", "cdr", schema)
        for k in range(7):
            writer.add_message(channel, k, bytes([0, 1, 0, 0]) + bytes(8), k)
        writer.finish()
    assert info(path)["health"]["messages_without_checksum"] == 7
    assert verb(path) == 0
    assert "no damage found, but no checksum covers any message" in capsys.readouterr().out
    recover(path, tmp_path / "saved")
    assert "7 messages, the bag was complete; no checksum covers any" in capsys.readouterr().out
    assert info(tmp_path / "saved")["health"]["messages_without_checksum"] == 0


def test_rates_in_pieces():
    """Gaps, jitter and steps back of a known stream, whatever the pieces."""
    t = np.arange(10_000) * 0.01
    t[5000:] += 0.5
    t = np.insert(t, 8000, t[7000])
    rng = np.random.default_rng(3)
    for size in (1, 7, 5000, 20_000):
        rates = Rates()
        for k in range(0, len(t), size):
            rates.add(t[k : k + size])
        found = rates.as_dict()
        assert found["count"] == 10_001
        assert found["rate"] == pytest.approx(100.0)
        assert found["backwards"] == 1
        assert found["gaps"] == 2  # the one put in, and the way forth again after the step back
        assert found["first_gaps"][0]["after"] == pytest.approx(49.99)
        assert found["first_gaps"][0]["seconds"] == pytest.approx(0.51)
    noisy = Rates()
    noisy.add(np.arange(20_000) * 0.01 + rng.normal(0, 1e-4, 20_000))
    assert noisy.as_dict()["jitter"] == pytest.approx(1e-4 * np.sqrt(2), rel=0.03)


def test_jitter_and_longest_gap_of_nothing():
    assert Rates().as_dict()["rate"] is None


def test_the_rate_of_times_of_a_calendar():
    """One interval of them is told to a quarter of a microsecond only, all together well."""
    rates = Rates()
    rates.add(1.7e9 + np.arange(1000) * 0.01)
    assert rates.as_dict()["rate"] == pytest.approx(100.0, rel=1e-7)


def test_names_are_whole_where_the_table_goes_to_a_file(tmp_path, capsys):
    """And what happens now and then has no rate."""
    pytest.importorskip("rclpy")
    bag = record_node(tmp_path / "bag")
    found = info(bag)
    assert verb(bag) == 0
    rows = {words[0]: words[1:] for words in map(str.split, capsys.readouterr().out.splitlines())}
    assert found["topics"].keys() <= rows.keys()
    assert rows["/sim/resets"] == ["Clock", "1"]


def test_files_in_any_order_span_all_of_their_times(tmp_path):
    """metadata.yaml of somebody else names the later file first: 3 s in all, not less than none."""
    for name, begin in (("a_0.mcap", 2.0), ("a_1.mcap", 0.0)):
        with (tmp_path / name).open("wb") as file:
            writer = Writer(file)
            writer.start(profile="ros2", library="somebody")
            schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
            channel = writer.register_channel("/x", "cdr", schema)
            for t in (begin, begin + 1.0):
                stamp = round((1.7e9 + t) * 1e9)
                writer.add_message(channel, stamp, bytes(12), stamp)
            writer.finish()
    about = "rosbag2_bagfile_information:\n  relative_file_paths: [a_0.mcap, a_1.mcap]\n"
    (tmp_path / "metadata.yaml").write_text(about)
    assert info(tmp_path)["duration"] == pytest.approx(3.0)


def test_a_topic_in_two_channels_has_one_rate(tmp_path):
    """Two publishers in turns: 100 messages a second, none of which goes back."""
    path = tmp_path / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="somebody")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channels = [writer.register_channel("/x", "cdr", schema) for _ in range(2)]
        for k in range(50):
            writer.add_message(channels[k % 2], k * 10_000_000, bytes(12), k * 10_000_000)
        writer.finish()
    (topic,) = info(path)["topics"].values()
    assert topic["count"] == 50 and topic["bytes"] == 600
    assert topic["rate"] == pytest.approx(100.0)
    assert topic["backwards"] == topic["gaps"] == 0


def test_a_file_that_metadata_leaves_out_is_reported(tmp_path, capsys):
    """Copied in by hand, or left by another bag: every reader of the folder says so."""
    bag = tmp_path / "bag"
    record_run(PUSHED, bag)
    assert info(bag)["notes"] == []
    shutil.copy(bag / "bag_0.mcap", bag / "bag_1.mcap")
    line = f"{bag}: its metadata.yaml does not name bag_1.mcap, which is not read"
    assert info(bag)["notes"] == [line]
    assert verb(bag) == 0 and f"warning: {line}\n" in capsys.readouterr().err
    assert (
        line in analyze(bag).notes
        and line in analyze(bag, topics=frozenset({"/rb_sim/box/pose"})).notes
    )
    assert line in tracks_of_bag(bag).notes
    recover(bag)
    assert f"warning: {line}\n" in capsys.readouterr().err
    with pytest.warns(UserWarning, match="does not name bag_1.mcap"):
        Trajectory.from_bag(bag)
    shutil.copy(bag / "bag_0.mcap", bag / "other.mcap")
    assert info(bag)["notes"] == [line.replace("bag_1.mcap", "bag_1.mcap and 1 more")]
    (bag / "metadata.yaml").unlink()
    with pytest.raises(SinkError, match="3 files without metadata.yaml .* name one of them, or"):
        info(bag)


def cut(folder: Path) -> Path:
    """A log that was closed before its run ended, as where the disk is full."""
    from rb_sim import Simulation, load_scene
    from rb_sim.io.bag.bag_sink import BagSink

    simulation = Simulation(load_scene(PUSHED))
    sink = BagSink(folder, run={"by": "node"})
    sink.open(simulation.scene, simulation.layout)
    sink.write(simulation.sample().block)
    sink.close(None)
    return folder


def test_a_log_that_was_cut_is_not_whole(tmp_path):
    bag = cut(tmp_path / "bag")
    health = info(bag)["health"]
    assert health["finished"] and not health["run_ended"] and not health["whole"]
    assert "the run did not end" in dict(lines(info(bag)))["health"]
