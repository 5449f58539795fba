# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rows of the kernel as samples: what lies in which column, and blocks one after the other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rb_sim.mechanics.samples import (
    ContactEvent,
    Input,
    SampleLayout,
    SampleRow,
    block_of_rows,
    concatenate,
    row_width,
)

PLAIN = SampleLayout(("a", "b"), ("pin", "pin/A", "rod"), ("a", "a", "b"), ("b",))


def row(t: float, *events: Any, inputs: tuple[Input, ...] = ()) -> SampleRow:
    width = row_width(PLAIN)
    return SampleRow(t, np.arange(width) + t, np.full((1, 6), t), tuple(events), inputs)


def test_rows_become_a_block_with_their_events_and_inputs() -> None:
    """Inputs count the samples of their block."""
    hit = [ContactEvent(t, "floor", "impact") for t in (0.2, 0.7, 0.8)]
    push = [Input(9, t, "b") for t in (0.1, 0.6, 0.65)]
    rows = [row(0.5, hit[0], inputs=(push[0],)), row(1.0, hit[1], hit[2], inputs=tuple(push[1:]))]
    block = block_of_rows(rows, PLAIN)
    assert block.t.tolist() == [0.5, 1.0] and block.events == tuple(hit)
    assert [(given.index, given.t) for given in block.inputs] == [(0, 0.1), (1, 0.6), (1, 0.65)]
    assert (block.command[1] == 1.0).all() and block.position[1, 0, 0] == 1.0
    bare = block_of_rows([row(0.5), row(1.0)], PLAIN)
    assert bare.events == bare.inputs == ()
    one = row(0.5, hit[0]).block(PLAIN)
    assert len(one) == 1 and one.events == (hit[0],)


def test_blocks_one_after_the_other() -> None:
    parts = [block_of_rows([row(0.0), row(0.5)], PLAIN), block_of_rows([row(1.0)], PLAIN)]
    parts.append(block_of_rows([row(1.5), row(2.0)], PLAIN))
    hit, push = ContactEvent(0.2, "floor", "impact"), Input(1, 0.4, "b")
    parts = [replace(part, events=(hit,), inputs=(push,)) for part in parts]
    whole = concatenate(parts, PLAIN)
    assert whole.t.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0] and len(whole.events) == 3
    assert [given.index for given in whole.inputs] == [1, 3, 4]
    assert whole.position.shape == (5, 2, 3)
    assert len(concatenate([], PLAIN)) == 0
