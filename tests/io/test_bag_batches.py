# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How much of a bag is read at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.writer import Writer

from rb_sim.io.bag import batches as bag_batches
from rb_sim.io.bag.batches import BagScan

CHANNELS, EACH = 8, 40


def bag(path: Path) -> Path:
    """Messages of all channels in turns, in small chunks."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=300)
        writer.start(profile="ros2", library="somebody")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channels = [writer.register_channel(f"/x{k}", "cdr", schema) for k in range(CHANNELS)]
        for n in range(EACH):
            for k, channel in enumerate(channels):
                stamp = n * 1000 + k
                writer.add_message(channel, stamp, bytes(12), stamp, n)
        writer.finish()
    return path


def test_batches_grow_with_the_channels(tmp_path, monkeypatch):
    """What is done once for each channel of a batch costs as much for one message as for many."""
    path = bag(tmp_path / "x.mcap")
    monkeypatch.setattr(bag_batches, "_TOGETHER", 600)
    few = list(BagScan(path).batches())
    monkeypatch.setattr(bag_batches, "_CHANNELS", 2)
    many = list(BagScan(path).batches())
    assert len(few) > 3 * len(many) > 3
    for batches in (few, many):
        for channel in range(1, CHANNELS + 1):
            parts = [batch[channel].log_time for batch in batches if channel in batch]
            expected = np.arange(EACH) * 1000 + channel - 1
            np.testing.assert_array_equal(np.concatenate(parts), expected)
