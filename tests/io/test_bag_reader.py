# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What was recorded comes back; anything else gets one clear line."""

from __future__ import annotations

import mcap.writer
import numpy as np
import pytest

from rb_sim.base.errors import SinkError
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.io.bag.batches import BagScan
from rb_sim.io.bag.file import BagFile
from rb_sim.io.bag.folder import absent, holds_bag, unlisted
from rb_sim.io.bag.reader import BagReader
from rb_sim.mechanics.samples import ARRAYS, concatenate


def test_round_trip(record, samples, layout):
    """An offset centre of mass and the body-frame spin are restored to round-off."""
    reader = BagReader(record(n=200))
    blocks = list(reader.blocks(size=90))
    assert [len(block) for block in blocks] == [90, 90, 20]
    found, expected = concatenate(blocks, layout), samples(200)
    for field in ARRAYS:
        a, b = getattr(found, field), getattr(expected, field)
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-14, err_msg=field)
    for exact in ("t", "orientation", "reaction_force", "anchor", "command", "residual", "power"):
        np.testing.assert_array_equal(getattr(found, exact), getattr(expected, exact))


def test_a_quaternion_that_is_not_quite_unit_does_no_harm(tmp_path, scene, layout, samples):
    """Integration leaves |q| - 1 of some 1e-13; the velocities come back to round-off even so."""
    block = samples(50)
    block.orientation[:] *= 1.0 + 1e-9
    sink = BagSink(tmp_path / "bag")
    sink.open(scene, layout)
    sink.write(block)
    sink.close()
    (found,) = BagReader(tmp_path / "bag").blocks()
    for name in ("position", "linear_velocity", "angular_velocity", "orientation"):
        np.testing.assert_allclose(getattr(found, name), getattr(block, name), rtol=0, atol=1e-15)


@pytest.mark.parametrize("topics", [1, 3, 32])
@pytest.mark.parametrize("messages", [64, 65, 66, 95, 96, 161])
def test_every_message_is_read_wherever_the_last_sample_ends(topics, messages, tmp_path):
    """Lengths repeat from sample to sample, and the file may end within one."""
    bag = BagFile(tmp_path / "bag", "test")
    channels = [bag.add_channel(f"/{i}", "a/msg/B", b"string data", "") for i in range(topics)]
    for k in range(messages):
        bag.add_message(channels[k % topics], k, k, bytes(1 + k % topics))
    bag.finish()
    scan = BagScan(bag.path)
    found = [(k, len(m.data(i))) for batch in scan.batches() for m in batch.values()
             for i, k in enumerate(m.log_time.tolist())]  # fmt: skip
    assert sorted(found) == [(k, 1 + k % topics) for k in range(messages)]
    assert not scan.missing.damages


def test_scene_and_layout(record, scene, layout):
    reader = BagReader(record(summary={"steps": 7}))
    assert reader.layout == layout
    assert (reader.scene.name, reader.scene.text) == ("workshop", scene.text)
    assert reader.scene.description == "a ball that rolls, a door on two bearings"
    assert reader.scene.simulation.method == "rk4"
    assert reader.summary == {"steps": 7}
    for name, body in scene.bodies.items():
        found = reader.scene.bodies[name]
        assert found.mass == body.mass
        np.testing.assert_array_equal(found.inertia, body.inertia)
        np.testing.assert_array_equal(found.center_of_mass, body.center_of_mass)
        assert found.shape.type == body.shape.type
    assert found.shape.size == (0.6, 0.04, 1.0) and found.shape.center_B == (0.3, 0.0, 0.5)


def test_lone_file_and_namespace(record, tmp_path):
    bag = record(namespace="/lab/sim")
    moved = (bag / "bag_0.mcap").rename(tmp_path / "renamed.mcap")
    reader = BagReader(moved)
    assert reader.namespace == "/lab/sim" and reader.summary is None
    assert sum(len(block) for block in reader.blocks()) == 200


def one_line(path) -> str:
    with pytest.raises(SinkError) as caught:
        BagReader(path)
    (line,) = str(caught.value).splitlines()
    return line.removeprefix(f"{path}")


NO_MCAP = ": not an MCAP file; a bag is a folder, an .mcap or a .db3 file"


def test_what_is_no_bag_of_rb_sim(tmp_path, record):
    assert one_line(tmp_path / "none").startswith(": does not exist; must be a bag or the folder")
    assert one_line(tmp_path) == ": not a bag: no .mcap or .db3 file in it"
    (tmp_path / "text.mcap").write_text("hello")
    assert one_line(tmp_path / "text.mcap") == NO_MCAP
    (tmp_path / "empty.mcap").write_text("")
    assert one_line(tmp_path / "empty.mcap") == NO_MCAP
    assert one_line(tmp_path).startswith(": not one bag: 2 files without metadata.yaml")
    bag = record("whole/bag")
    data = (bag / "bag_0.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    expected = f": unfinished; first run: rb_sim recover {tmp_path / 'cut.mcap'}"
    assert one_line(tmp_path / "cut.mcap") == expected


def test_the_folder_of_a_run_stands_for_its_bag(tmp_path, record):
    bag = record("out/bag")
    assert BagReader(tmp_path / "out").paths == BagReader(bag).paths
    assert holds_bag(tmp_path / "out") and not holds_bag(tmp_path)
    (bag / "bag_1.mcap").touch()
    assert f"{bag / 'bag_1.mcap'} is empty" in unlisted(tmp_path / "out")
    (bag / "bag_0.mcap").unlink()
    (line,) = absent(tmp_path / "out")
    assert line == f"{tmp_path / 'out'}: its metadata.yaml names bag_0.mcap, which is not there"


def test_foreign_bag(tmp_path):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file)
        writer.start(profile="ros2", library="somebody")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
        channel = writer.register_channel("/x", "cdr", schema)
        writer.add_message(channel, 0, b"\0\1\0\0" + bytes(8), 0)
        writer.finish()
    assert one_line(path) == ": not recorded by rb_sim"


def test_format_of_another_version(record, monkeypatch):
    monkeypatch.setattr("rb_sim.io.bag.bag_sink.FORMAT", "99")
    bag = record()
    monkeypatch.undo()
    assert "format 99; this version of rb_sim reads format 1" in one_line(bag)
