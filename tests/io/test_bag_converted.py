# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A bag that was converted to the other storage and back still has its scene and all samples."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rb_sim.bags.info import info
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.io.bag.reader import BagReader, ForeignBagError, scene_as_run
from rb_sim.io.messages.topics import record_in
from rb_sim.mechanics.samples import (
    ARRAYS,
    ContactEvent,
    Input,
    SampleLayout,
    concatenate,
    empty_block,
)
from rb_sim.scene.load import as_run_text, load_scene

convert = pytest.importorskip("rosbags.convert", reason="rosbags is not installed").convert


def converted(bag: Path, storage: str, without: tuple[str, ...] = ()) -> Path:
    """What `rosbags-convert` makes of it. without: topics that it is to leave out."""
    made = bag.with_name(f"{bag.name}_{storage}")
    every = {"include_topics": (), "exclude_msgtypes": (), "include_msgtypes": ()}
    kept = {"default_typestore": None, "typestore": None, "compress": None, "compress_mode": "file"}
    convert(
        [bag], made, dst_storage=storage, dst_version=9, exclude_topics=without, **every, **kept
    )
    return made


@pytest.fixture
def bag(tmp_path, scene, layout, samples) -> Path:
    """With commands, two at one sample, a reset, which sets the time back, and a state."""
    sink = BagSink(tmp_path / "bag", odometry=True)
    sink.open(scene, layout)
    one, two = (1.0, 2.0, 3.0), (0.0, 0.0, 0.5)
    given = (
        Input(3, 0.03, "ball", "world", one, two),
        Input(3, 0.03, "ball", "world", two, one),
        Input(40, 0.4, "ball", "body", one, one),
    )
    sink.write(replace(samples(64), inputs=given))
    sink.write(replace(samples(64), inputs=(Input(0, 0.0, ""), Input(0, 0.0, "ball"))))
    sink.note_state("paused")
    sink.write(samples(300, start=0.64))
    sink.close()
    return sink.directory


def same(a: BagReader, b: BagReader) -> None:
    x, y = (concatenate(reader.blocks(), reader.layout) for reader in (a, b))
    assert all(np.array_equal(getattr(x, name), getattr(y, name)) for name in ARRAYS)
    assert (x.events, x.inputs) == (y.events, y.inputs) and len(x) == len(y)


def test_to_sqlite_and_back_a_bag_keeps_scene_samples_and_inputs(bag):
    there = converted(bag, "sqlite3")
    back = converted(there, "mcap")
    whole = BagReader(bag)
    assert len(concatenate(whole.blocks(), whole.layout).inputs) == 5
    for path in (there, back):
        reader = BagReader(path)
        same(whole, reader)
        assert reader.record == whole.record and reader.scene.text == whole.scene.text
        assert as_run_text(scene_as_run(reader)) == as_run_text(scene_as_run(whole))
        found = info(path)
        assert found["run"]["scene"] == "workshop" and found["health"]["run_ended"]
        assert found["topics"]["/rb_sim/state"]["count"] == 1


def test_events_of_contacts_stay_before_their_samples(tmp_path):
    scene = load_scene({
        "bodies": {"ball": {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}},
        "constraints": {
            "floor": {"type": "contact", "body": "ball", "surface": {"type": "plane"}}
        },
    })  # fmt: skip
    layout = SampleLayout(("ball",), ("floor",), ("ball",), (), ("floor",))
    block = replace(
        empty_block(20, layout),
        t=np.arange(20) / 10.0,
        events=(
            ContactEvent(0.5, "floor", "impact", (0.0, 0.0, 1.0)),
            ContactEvent(0.55, "floor", "opens", (0.0, 0.0, 0.0)),
            ContactEvent(0.55, "floor", "impact", (0.0, 0.0, 2.0)),
        ),
    )
    block.orientation[..., 3] = 1.0
    sink = BagSink(tmp_path / "bag")
    sink.open(scene, layout)
    sink.write(block)
    sink.close()
    same(BagReader(tmp_path / "bag"), BagReader(converted(tmp_path / "bag", "sqlite3")))


def test_a_bag_without_the_description_is_of_somebody_else(bag):
    with pytest.raises(ForeignBagError):
        BagReader(converted(bag, "sqlite3", without=("/rb_sim/description",)))


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0\5\0\0\0{}..\0", b"\0\1\0\0\3\0\0\0{}\0"])
def test_a_description_of_somebody_else_has_no_record(data):
    assert record_in(data) is None
