"""Messages of a bag by the chunk, as arrays: many at a time, memory bounded by a chunk's size."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from rb_sim.sinks.bag_frames import NO_CHANNEL, NO_RECORD, Damage, Frame, Frames
from rb_sim.sinks.bag_records import Missing, parse_record

_HEAD = struct.Struct("<BQ")
_MESSAGE = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
_LOOSE = 1 << 18
"""Bytes of messages outside of chunks that make one batch."""
_TOGETHER = 1 << 21
"""Bytes of chunks that are read as one batch; a larger chunk is a batch of its own."""
_PATTERN = 64
"""Messages read one by one before those that follow are taken to repeat their lengths."""
_LONGEST = 32
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
        return _rows(self.buffer, self.start, size)

    def take(self, which: np.ndarray) -> Messages:
        """Those that `which` picks."""
        return Messages(
            self.log_time[which], self.sequence[which], self.buffer, self.start[which],
            self.size[which],
        )  # fmt: skip


def _rows(buffer: np.ndarray, start: np.ndarray, size: int) -> np.ndarray:
    """The `size` bytes from each start on, shape (n, size); a copy."""
    room = len(buffer) - size + 1
    if room <= 0 or not len(start):
        return np.empty((len(start), size), np.uint8)
    whole = np.ndarray((room,), np.dtype((np.void, size)), buffer, strides=(1,))  # copied at once
    return whole[start].view(np.uint8).reshape(len(start), size)


Batch = dict[int, Messages]
"""By channel id."""


class BagScan:
    """Reads one MCAP file from front to back; iterate over `batches` once.

    header, schemas, channels, metadata, attachments: what was met so far. Afterwards `missing`.
    Raises SinkError for a file that is no MCAP or cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.frames = Frames(path)
        self.header: Header | None = None
        index = self.frames.index
        # a file names its channels within its chunks; where such a chunk is broken, its index helps
        self.schemas: dict[int, Schema] = {} if index is None else dict(index.schemas)
        self.channels: dict[int, Channel] = {} if index is None else dict(index.channels)
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self.messages = 0
        self.unchecked = 0
        """messages that no checksum covers: of chunks without one, or outside of chunks."""
        self.bytes = 0
        """of message data."""
        self._first: int | None = None

    @property
    def missing(self) -> Missing:
        """What could not be read; complete after the last batch."""
        index = self.frames.index
        lost = None
        start = self._first
        if index is not None:
            lost = None if index.messages is None else max(0, index.messages - self.messages)
            times = [c.message_start_time for c in index.chunks.values() if c.message_end_time]
            times += [] if start is None else [start]
            start = min(times) if times else None
        return Missing(self.path, self.frames.damages, lost, start)

    def batches(self) -> Iterator[Batch]:
        """The messages, by chunks; those outside of chunks in batches of their own."""
        loose = bytearray()
        chunks: list[Frame] = []
        for frame in self.frames:
            if frame.opcode == Opcode.MESSAGE:
                yield from self._checked(chunks)
                loose += _HEAD.pack(frame.opcode, len(frame.content)) + frame.content
            if loose and (frame.opcode == Opcode.CHUNK or len(loose) > _LOOSE):
                yield self._batch(bytes(loose), checked=False)
                loose.clear()
            if frame.opcode == Opcode.CHUNK:
                if chunks and chunks[0].checked != frame.checked:
                    yield from self._checked(chunks)
                chunks.append(frame)
                if sum(len(chunk.content) for chunk in chunks) >= _TOGETHER:
                    yield from self._checked(chunks)
            elif frame.opcode != Opcode.MESSAGE:
                self._keep(frame.opcode, frame.content, frame)
        yield from self._checked(chunks)
        if loose:
            yield self._batch(bytes(loose), checked=False)

    def _checked(self, chunks: list[Frame]) -> Iterator[Batch]:
        """The messages of the chunks, which are forgotten; of each by itself if one is broken."""
        waiting = chunks.copy()
        chunks.clear()
        if not waiting:
            return
        try:
            yield self._batch(b"".join(frame.content for frame in waiting), waiting[0].checked)
        except ValueError:
            if len(waiting) > 1:
                for frame in waiting:
                    yield from self._checked([frame])
                return
            (frame,) = waiting
            self.frames.damages.append(
                Damage(frame.offset, frame.offset, NO_RECORD, frame.start, frame.end)
            )

    def _keep(self, opcode: int, content: bytes, frame: Frame | None = None) -> None:
        try:
            record = parse_record(opcode, content)
        except Exception:
            if frame is None:
                raise ValueError("no record") from None
            self.frames.damages.append(Damage(frame.offset, frame.offset, NO_RECORD))
            return
        match record:
            case Header():
                self.header = record
            case Schema():
                self.schemas[record.id] = record
            case Channel():
                self.channels[record.id] = record
            case Metadata():
                self.metadata.append(record)
            case Attachment():
                self.attachments.append(record)

    def _batch(self, data: bytes, checked: bool) -> Batch:
        start, size = self._walk(data)
        if not len(start):
            return {}
        if size.min() < _MESSAGE.itemsize:
            raise ValueError("a message without a head")
        buffer = np.frombuffer(data, np.uint8)
        heads = _rows(buffer, start, _MESSAGE.itemsize).reshape(-1).view(_MESSAGE)
        log_time = heads["log"].astype(np.int64)
        sequence = heads["sequence"].astype(np.int64)
        start, size = start + _MESSAGE.itemsize, size - _MESSAGE.itemsize
        self._first = int(log_time.min() if self._first is None else min(self._first, log_time[0]))
        batch: Batch = {}
        of = heads["channel"].copy()
        for channel in np.flatnonzero(np.bincount(of)).tolist():
            at = np.flatnonzero(of == channel)
            if channel not in self.channels:
                self._note_unknown(log_time[at])
                continue
            self.messages += len(at)
            self.unchecked += 0 if checked else len(at)
            self.bytes += int(size[at].sum())
            batch[channel] = Messages(log_time[at], sequence[at], buffer, start[at], size[at])
        return batch

    def _note_unknown(self, times: np.ndarray) -> None:
        first, last = int(times.min()), int(times.max())
        damages = self.frames.damages
        if damages and damages[-1].reason == NO_CHANNEL:
            before = damages.pop()
            first, last = min(first, before.after or first), max(last, before.before or last)
        damages.append(Damage(0, 0, NO_CHANNEL, first, last))

    def _walk(self, data: bytes) -> tuple[np.ndarray, np.ndarray]:
        """Where each message begins and how long it is; keeps what else there is."""
        parts: list[tuple[Any, Any]] = []
        starts: list[int] = []
        sizes: list[int] = []
        at, end, unpack = 0, len(data), _HEAD.unpack_from
        while at < end:
            if len(starts) >= _PATTERN:
                parts.append((starts, sizes))
                at, *alike = _repeated(data, at, sizes[-2 * _LONGEST :])
                parts.append((alike[0], alike[1]))
                starts, sizes = [], []
                if at >= end:
                    break
            if at + 9 > end:
                raise ValueError("no record")
            opcode, length = unpack(data, at)
            at += 9
            if length > end - at:
                raise ValueError("no record")
            if opcode == 5:  # Opcode.MESSAGE; the loop over all messages is worth the literal
                starts.append(at)
                sizes.append(length)
            else:
                self._keep(opcode, data[at : at + length])
            at += length
        parts.append((starts, sizes))
        start, size = (np.concatenate(column) for column in zip(*parts, strict=True))
        return start.astype(np.int64, copy=False), size.astype(np.int64, copy=False)


def _repeated(data: bytes, at: int, tail: list[int]) -> tuple[int, np.ndarray, np.ndarray]:
    """Starts and sizes of the messages from `at` on that repeat the lengths of those before,
    `tail`, and where they end: most bags hold the same few topics again and again."""
    period = next((p for p in range(1, len(tail) // 2 + 1) if tail[-p:] == tail[-2 * p : -p]), None)
    if period is None:
        return at, np.empty(0, np.int64), np.empty(0, np.int64)
    lengths = np.array(tail[-period:])
    heads = np.concatenate([[0], np.cumsum(lengths + _HEAD.size)])
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
    first = at + int(heads[-1]) * np.arange(count)[:, None] + heads[:-1] + _HEAD.size
    return at + count * int(heads[-1]), first.ravel(), np.tile(lengths, count)
