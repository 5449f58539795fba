"""The messages among the bytes of a bag, as arrays."""

from __future__ import annotations

from importlib import import_module
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode

from rb_sim.io.bag.index import FRAME

PATTERN = 64
"""Messages read one by one before those that follow are taken to repeat their lengths."""
ZSTD = b"\x28\xb5\x2f\xfd"
"""How what zstd has compressed begins (RFC 8878); a message of CDR begins with a zero."""
LARGEST = 1 << 27
"""Bytes of a message that is decompressed; one that claims more is damage."""
LONGEST = 32
"""Messages in a pattern, at most."""


class Messages(NamedTuple):
    """Messages of one channel, in file order; n of them."""

    log_time: np.ndarray
    """[ns], shape (n,), int64."""
    sequence: np.ndarray
    """shape (n,), int64."""
    buffer: np.ndarray
    """uint8: the bytes among which the messages are."""
    start: np.ndarray
    """of each message in the buffer, shape (n,)."""
    size: np.ndarray
    """[bytes], shape (n,)."""

    def data(self, k: int) -> bytes:
        """The bytes of message k."""
        return self.buffer[self.start[k] : self.start[k] + self.size[k]].tobytes()

    def rows(self, size: int) -> np.ndarray:
        """The bytes of all messages, shape (n, size), if every one is that long; ValueError."""
        wrong = np.flatnonzero(self.size != size)
        if len(wrong):
            raise ValueError(f"{self.size[wrong[0]]} bytes instead of {size}")
        return rows_at(self.buffer, self.start, size)

    def take(self, which: np.ndarray) -> Messages:
        """Those that `which` picks."""
        return Messages(
            self.log_time[which], self.sequence[which], self.buffer, self.start[which],
            self.size[which],
        )  # fmt: skip


def rows_at(buffer: np.ndarray, start: np.ndarray, size: int) -> np.ndarray:
    """The `size` bytes from each start on, shape (n, size); a copy."""
    room = len(buffer) - size + 1
    if room <= 0 or not len(start):
        return np.empty((len(start), size), np.uint8)
    whole = np.ndarray((room,), np.dtype((np.void, size)), buffer, strides=(1,))  # copied at once
    return whole[start].view(np.uint8).reshape(len(start), size)


def unpacked(messages: Messages) -> Messages:
    """The messages as they were before rosbag2 compressed them one by one, where it did; what
    cannot be decompressed stays as it is."""
    if not len(messages.start) or messages.data(0)[: len(ZSTD)] != ZSTD:
        return messages
    zstandard = import_module("zstandard")
    decompress = zstandard.ZstdDecompressor().decompress
    parts = []
    for k in range(len(messages.start)):
        data = messages.data(k)
        try:
            small = zstandard.frame_content_size(data) <= LARGEST
            parts.append(decompress(data, max_output_size=LARGEST) if small else data)
        except zstandard.ZstdError:
            parts.append(data)
    size = np.array([len(part) for part in parts])
    buffer = np.frombuffer(b"".join(parts), np.uint8)
    return messages._replace(buffer=buffer, start=np.cumsum(size) - size, size=size)


Batch = dict[int, Messages]
"""By channel id."""


def repeated(data: bytes, at: int, tail: list[int]) -> tuple[int, np.ndarray, np.ndarray]:
    """Starts and sizes of the messages from `at` on that repeat the lengths of those before,
    `tail`, and where they end: most bags hold the same few topics again and again."""
    period = next((p for p in range(1, len(tail) // 2 + 1) if tail[-p:] == tail[-2 * p : -p]), None)
    if period is None:
        return at, np.empty(0, np.int64), np.empty(0, np.int64)
    lengths = np.array(tail[-period:])
    heads = np.concatenate([[0], np.cumsum(lengths + FRAME.size)])
    count = (len(data) - at) // int(heads[-1])
    if not count:
        return at, np.empty(0, np.int64), np.empty(0, np.int64)
    alike = np.ones(count, bool)
    for head, length in zip(heads[:-1].tolist(), lengths.tolist(), strict=True):
        opcode, size = (
            np.ndarray(count, kind, data, at + head + offset, (int(heads[-1]),))
            for kind, offset in (("u1", 0), ("<u8", 1))
        )
        alike &= (opcode == Opcode.MESSAGE) & (size == length)
    count = count if alike.all() else int(np.argmin(alike))
    first = at + int(heads[-1]) * np.arange(count)[:, None] + heads[:-1] + FRAME.size
    return at + count * int(heads[-1]), first.ravel(), np.tile(lengths, count)
