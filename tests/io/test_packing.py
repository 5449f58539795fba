# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages from one buffer are those that each topic's layout gives field by field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rb_sim.io.messages.packing import FIELDS
from rb_sim.io.messages.topics import TopicTable
from rb_sim.mechanics.samples import (
    ARRAYS,
    SampleLayout,
    SampleRow,
    block_of_rows,
    centers_of_mass,
    empty_block,
    origins,
    row_width,
)
from rb_sim.scene.load import load_scene

NAMES = tuple(f"heap/{k}" for k in range(1, 301))
LAYOUT = SampleLayout(
    bodies=("top", "nut"),
    reactions=("pin", *NAMES),
    reaction_bodies=("top",) + ("nut",) * 300,
    commanded=("nut",),
    contacts=NAMES,
)
SCENE = {
    "bodies": {
        "top": {"mass": 1.0, "inertia": [1, 1, 1], "center_of_mass": [0.1, 0.2, 0.3]},
        "nut": {"mass": 2.0, "inertia": [1, 2, 3]},
    }
}


@pytest.mark.parametrize("n", [1, 7])
@pytest.mark.parametrize("skip", [(), ("/tf", "power")])
def test_packed_at_once_or_field_by_field(n: int, skip: tuple[str, ...]) -> None:
    """300 contacts: more than an octet counts."""
    scene, chance = load_scene(SCENE), np.random.default_rng(5)
    empty = empty_block(n, LAYOUT)
    block = replace(
        empty,
        **{name: chance.normal(size=getattr(empty, name).shape) for name in ARRAYS},
    )
    block = replace(
        block,
        t=np.array([0.0, 0.1, 0.3, 2.0, 1e5, 2e9, 2.1e9])[7 - n :],
        contact_state=chance.integers(0, 3, size=block.contact_state.shape).astype(float),
    )
    table = TopicTable(scene, LAYOUT, skip)
    motion = origins(block, centers_of_mass(scene.bodies, LAYOUT.bodies))
    fields = (motion.position, block.orientation, *motion[1:], block.energy)
    fields += tuple(getattr(block, name) for name in FIELDS)
    source = np.hstack([np.tile([0.0, 1.0], (n, 1)), *(field.reshape(n, -1) for field in fields)])
    for k, instant in enumerate(table.messages(block)):
        assert instant.stamp == round(block.t[k] * 1e9)
        states = iter(block.contact_state[k].astype(int).tolist())
        for topic, data in zip(table.topics, instant.messages, strict=True):
            octet = topic.name.endswith("/state")
            numbers = [next(states)] if octet else source[k, list(topic.columns)].tolist()
            assert data == topic.codec.pack(instant.stamp, numbers), topic.name


def test_no_samples_are_no_messages() -> None:
    table = TopicTable(load_scene(SCENE), LAYOUT)
    assert list(table.messages(empty_block(0, LAYOUT))) == []


def test_rows_of_the_kernel_give_the_bytes_of_their_blocks() -> None:
    """Centres of mass beside the origin, quaternions a little off unit length, signed zeros."""
    scene, chance = load_scene(SCENE), np.random.default_rng(6)
    table, samples = TopicTable(scene, LAYOUT), []
    for t in (0.0, 0.3, 2e9):
        row = chance.normal(size=row_width(LAYOUT))
        row[chance.integers(0, 26, size=5)] = (0.0, -0.0, 1.0, -1.0, 0.5)
        row[-len(LAYOUT.contacts) :] = chance.integers(0, 3, size=len(LAYOUT.contacts))
        sample = SampleRow(t, row, chance.normal(size=(1, 6)))
        expected = list(table.messages(sample.block(LAYOUT)))
        assert table.messages_of_rows([sample]) == expected
        samples.append(sample)
    assert table.messages_of_rows(samples) == list(table.messages(block_of_rows(samples, LAYOUT)))


def test_a_row_without_an_offset_of_the_centre_of_mass_or_contacts() -> None:
    layout = SampleLayout(("nut",), ("pin",), ("nut",), ())
    scene, chance = (
        load_scene({"bodies": {"nut": SCENE["bodies"]["nut"]}}),
        np.random.default_rng(7),
    )
    table = TopicTable(scene, layout)
    sample = SampleRow(1.25, chance.normal(size=row_width(layout)), np.zeros((0, 6)))
    expected = list(table.messages(sample.block(layout)))
    assert table.messages_of_rows([sample]) == expected
