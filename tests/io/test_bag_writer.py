# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The file is that of the package mcap, byte for byte."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from rb_sim.io.bag.writer import McapWriter, Rows

CHUNK = 5_000


class Sink(BytesIO):
    """A file in memory."""


def story(seed: int) -> list[tuple]:
    """What is written, in order; times go back now and then, channels come late."""
    rng = np.random.default_rng(seed)
    reported: list[tuple] = [
        ("metadata", "m", {"a": "b"}),
        ("attachment", 3, "f", "text/plain", b"x"),
    ]
    channels = 0
    for k in range(int(rng.integers(0, 300))):
        if channels < 5 and (channels == 0 or rng.random() < 0.02):
            channels += 1
            reported.append(("channel", f"/topic/{channels}", bytes(int(rng.integers(0, 9_000)))))
        if rng.random() < 0.01:
            reported.append(("metadata", "again", {"k": str(k)}))
        some = rng.permutation(channels)[: rng.integers(1, channels + 1)]
        data = [rng.bytes(int(rng.choice([0, 8, 56, 700, 2 * CHUNK]))) for _ in some]
        time = int(1e9 + 1e7 * k - 3e7 * (rng.random() < 0.1))
        reported.append(("messages", [int(c) + 1 for c in some], time, k, data))
    return reported


def written(sink: Sink, writer: Any, reported: list[tuple], message: Any, attachment: Any) -> bytes:
    """The file of a story; message, attachment: how this writer is told of these."""
    writer.start("ros2", "test")
    for kind, *given in reported:
        if kind == "channel":
            topic, text = given
            schema = writer.register_schema(topic, "ros2msg", text)
            writer.register_channel(topic, "cdr", schema, {"qos": topic})
        elif kind == "messages":
            channels, time, sequence, data = given
            for channel, one in zip(channels, data, strict=True):
                message(channel, time, sequence, one)
        elif kind == "metadata":
            writer.add_metadata(*given)
        else:
            attachment(*given)
    writer.finish()
    return sink.getvalue()


def ours(reported: list[tuple]) -> bytes:
    sink = Sink()
    writer = McapWriter(sink, CHUNK)
    return written(sink, writer, reported, writer.add_message, writer.add_attachment)


def theirs(reported: list[tuple]) -> bytes:
    sink = Sink()
    writer = Writer(sink, chunk_size=CHUNK, compression=CompressionType.ZSTD)

    def message(channel: int, time: int, sequence: int, data: bytes) -> None:
        writer.add_message(channel, time, data, time, sequence)

    def attachment(time: int, *given: Any) -> None:
        writer.add_attachment(time, time, *given)

    return written(sink, writer, reported, message, attachment)


def rows_of(seed: int) -> tuple[list[int], list[tuple[np.ndarray, int, Rows]]]:
    """Sizes of the messages of a sample; blocks of samples: times, number of the first, bytes.

    Between the messages are bytes that are none, as alignment leaves them.
    """
    rng = np.random.default_rng(seed)
    sizes = [int(n) for n in rng.choice([8, 12, 56, 333, 2 * CHUNK], rng.integers(1, 7))]
    bounds, at = [], 0
    for size in sizes:
        at += int(rng.integers(0, 8))
        bounds.append((at, at + size))
        at += size
    blocks, time, number = [], 10**9, 0xFFFFFFF0 * (seed % 2)
    for count in rng.integers(1, 200, 5):
        times = time + np.cumsum(rng.integers(0, 2_000_000, count))
        blocks.append(
            (times, number, Rows(rng.integers(0, 256, (count, at + 3), np.uint8), bounds))
        )
        time, number = int(times[-1]), number + int(count)
    return sizes, blocks


@pytest.mark.parametrize("seed", range(6))
def test_many_samples_at_once_are_the_same_bytes(seed: int) -> None:
    """As one message after the other; and the writer counts them alike."""
    sizes, blocks = rows_of(seed)
    files = []
    for together in (True, False):
        sink = Sink()
        writer = McapWriter(sink, CHUNK)
        writer.start("ros2", "test")
        schema = writer.register_schema("t", "ros2msg", b"")
        channels = [writer.register_channel(str(k), "cdr", schema, {}) for k in range(len(sizes))]
        for times, number, rows in blocks:
            if together:
                writer.add_rows(channels, times, number, rows)
                continue
            for k, (time, row) in enumerate(zip(times, rows.data, strict=True)):
                for channel, (a, b) in zip(channels, rows.bounds, strict=True):
                    writer.add_message(channel, int(time), number + k, row[a:b].tobytes())
        waiting = writer.waiting
        writer.finish()
        files.append((sink.getvalue(), waiting, writer.counts, writer.span))
    assert files[0] == files[1]


@pytest.mark.parametrize("seed", range(6))
def test_the_same_bytes_as_the_package(seed: int) -> None:
    reported = story(seed)
    assert ours(reported) == theirs(reported)


def test_a_file_without_messages() -> None:
    assert ours([]) == theirs([])
    reported = [("channel", "/a", b"text")]
    assert ours(reported) == theirs(reported)
