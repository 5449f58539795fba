# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A recorded run once more: the same bits, commands in body axes and resets included."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from tests.bags.scenes import PLAN, PUSHED, record_node, record_run


def payloads(bag: Path) -> dict[str, str]:
    """SHA-256 of the payloads of each topic, by the mcap library."""
    digests: dict[str, hashlib._Hash] = {}
    with (bag / f"{bag.name}_0.mcap").open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            digests.setdefault(channel.topic, hashlib.sha256()).update(message.data)
    return {topic: digest.hexdigest() for topic, digest in digests.items()}


def again(bag: Path, folder: Path, changes: tuple[str, ...] = ()):
    from rb_sim.bags.resim import identity, resimulate
    from rb_sim.io.bag.reader import BagReader, scene_as_run

    reader = BagReader(bag, unfinished=True)
    resimulate(reader, scene_as_run(reader, changes), folder)
    return identity(reader, BagReader(folder)), reader.damage


@pytest.fixture(scope="module")
def node_bag(tmp_path_factory) -> Path:
    pytest.importorskip("rclpy")
    return record_node(tmp_path_factory.mktemp("node") / "bag")


def test_a_node_with_body_commands_and_a_reset(node_bag, tmp_path):
    found, _ = again(node_bag, tmp_path / "again")
    assert found.same and found.samples == found.identical == 61
    assert found.sha256[0] == found.sha256[1]
    first, second = payloads(node_bag), payloads(tmp_path / "again")
    # it holds the text of the scene, which is here as it was run
    assert first.pop("/sim/description") != second.pop("/sim/description")
    assert first == second


def test_the_bag_carries_commands_as_they_came(node_bag):
    """By the mcap library and the type's own layout: frame, instant and components."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([node_bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        rows = [
            (c.topic, reader.deserialize(data, c.msgtype))
            for c, _, data in reader.messages()
            if c.topic in ("/sim/box/wrench_command", "/sim/resets")
        ]
    commands = [m for topic, m in rows if topic.endswith("wrench_command")]
    assert [m.header.frame_id for m in commands] == ["box", "world", "box"]
    stamps = [m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in commands]
    np.testing.assert_allclose(stamps, [k / 50 for k in PLAN], atol=1e-9)
    (first, *_), (force, torque, _) = commands, PLAN[3][0]
    w = first.wrench
    assert (w.force.x, w.force.y, w.force.z) == force
    assert (w.torque.x, w.torque.y, w.torque.z) == torque
    (reset,) = [m for topic, m in rows if topic == "/sim/resets"]
    assert reset.clock.nanosec == 820_000_000


def test_a_run_with_options(tmp_path):
    bag = record_run(PUSHED, tmp_path / "bag")
    found, _ = again(bag, tmp_path / "again")
    assert found.same and found.samples == 51
    options = {"method": "dopri853", "tolerance": 1e-9, "duration": 0.33}
    other = _record_with(tmp_path / "other", options)
    found, _ = again(other, tmp_path / "other_again")
    assert found.same and found.samples == 18


def _record_with(folder: Path, options: dict) -> Path:
    return record_run(PUSHED, folder, **options)


def test_a_difference_is_reported_with_its_size(node_bag, tmp_path):
    """g changed by 1 %: the fall parts from the first sample on, by 0.01 g t^2 / 2."""
    found, _ = again(node_bag, tmp_path / "x", ("effects.weight.acceleration=[0, 0, -9.9081]",))
    assert not found.same and found.first is not None
    assert found.first.number in (0, 1)
    fall = 0.01 * 9.81 / 2 * 0.8**2
    assert found.largest["box/pose"] == pytest.approx(fall, rel=0.1)


def test_a_damaged_bag_is_compared_where_it_is_whole(node_bag, tmp_path):
    bag = tmp_path / "bag"
    shutil.copytree(node_bag, bag)
    file = bag / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    file.write_bytes(data[: len(data) * 2 // 3])
    found, damage = again(bag, tmp_path / "again")
    assert found.identical == found.samples > 20 and damage


def test_scene_as_run(tmp_path):
    """The attachment is a scene that any run can take: with the options of the run."""
    bag = _record_with(tmp_path / "bag", {"method": "dopri853", "duration": 0.2})
    with (bag / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file)
        texts = {a.name: a.data.decode() for a in reader.iter_attachments()}
        (record,) = [m.metadata for m in reader.iter_metadata() if m.name == "rb_sim"]
    from rb_sim import load_scene

    scene = load_scene(texts["scene_as_run.yaml"])
    assert (scene.simulation.method, scene.simulation.duration) == ("dopri853", 0.2)
    assert scene.bodies["box"].mass == 2.0
    assert json.loads(record["versions"])["numpy"] == np.__version__
    assert json.loads(record["host"])["cpu"]


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ("effects.wight.acceleration=1", "there is no 'wight'; must be weight or drive"),
        ("bodies.box.spin[2]=1", r"no 'spin'; .* or set the whole vector: spin=\[\.\.\.\]"),
        ("mass=2", "must be KEY=VALUE with a path as KEY"),
        ("bodies.box.mass", "must be KEY=VALUE"),
        ("bodies.box.mass.x=2", "there is no 'x'; must be omitted: there is a single value"),
    ],
)
def test_a_change_that_will_not_do(change, line):
    from rb_sim.base.errors import RbSimError
    from rb_sim.scene import yaml_reader
    from rb_sim.scene.values import with_value

    with pytest.raises(RbSimError, match=line):
        with_value(yaml_reader.parse(PUSHED, "pushed"), change)


def lacking(folder: Path) -> Path:
    """A node's bag without samples 5 to 7, which found the queue of the logs full."""
    from rb_sim import Simulation, load_scene
    from rb_sim.io.bag.bag_sink import BagSink

    simulation = Simulation(load_scene(PUSHED))
    sink = BagSink(folder, run={"by": "node"}, namespace="/sim")
    sink.open(simulation.scene, simulation.layout)
    for k in range(12):
        simulation.advance(k / simulation.scene.simulation.rate - simulation.time)
        if k not in (5, 6, 7):
            sink.write(simulation.sample().block)
    sink.close({"samples_dropped": 3})
    return folder


def test_a_bag_that_lacks_samples_says_so(tmp_path):
    """It said that the run differs "by 0"."""
    from rb_sim.base.errors import SinkError

    bag = lacking(tmp_path / "bag")
    with pytest.raises(SinkError, match=r"3 samples are lacking, .* before t = 0.16 s"):
        again(bag, tmp_path / "again")
