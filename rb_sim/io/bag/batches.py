# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages of a bag by the chunk, as arrays: many at a time, memory bounded by a chunk's size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from rb_sim.io.bag.checked_records import (
    CUT_OFF,
    NO_CHANNEL,
    NO_RECORD,
    OTHER_COUNT,
    OTHER_NAME,
    WRONG_TIMES,
    Damage,
    Frame,
    Frames,
    Missing,
)
from rb_sim.io.bag.records import (
    FRAME,
    Unchecked,
    count_entries,
    index_entries,
    name_of,
    parse_record,
)

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


# The messages of an MCAP file, batch by batch.


_MESSAGE = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
_LOOSE = 1 << 18
"""Bytes of messages outside of chunks that make one batch."""
_TOGETHER = 1 << 21
"""Bytes of chunks that are read as one batch; a larger chunk is a batch of its own."""
_CHANNELS, _GROWTH = 512, 16
"""In a file with n times as many channels a batch is n times as large, with so many times at most:
what is done once for each channel of a batch is dear where it has one message in it."""


def _by_channel(of: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Each channel, and the indices of its messages in their order."""
    order = np.argsort(of, kind="stable")
    ordered = of[order]
    for at in np.split(order, np.flatnonzero(ordered[1:] != ordered[:-1]) + 1):
        yield int(of[at[0]]), at


LOOSE = Frame(0, Opcode.MESSAGE, b"")
"""Stands for the chunk of messages that are in none: it says nothing of them."""


def _as_said(times: np.ndarray, chunk: Frame) -> bool:
    """Whether messages may be all that their chunk, which has no checksum, says of them."""
    in_time = chunk.start <= int(times.min()) and int(times.max()) <= chunk.end
    return (in_time or chunk.end == 0) and len(times) >= count_entries(chunk.indices)


class BagScan(Frames):
    """Reads one MCAP file from front to back; iterate over `batches` once.

    header, schemas, channels, metadata, attachments: what was met so far. Afterwards `missing`.
    Raises SinkError for a file that is no MCAP or cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.header: Header | None = None
        index = self.index
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
        index = self.index
        start = self._first
        lost = None if self._counted is None else max(0, self._counted - self.messages)
        if index is not None:
            times = [c.message_start_time for c in index.chunks.values() if c.message_end_time]
            times += [] if start is None else [start]
            start = min(times) if times else None
        return Missing(self.path, self.damages, lost, start)

    @property
    def _counted(self) -> int | None:
        """Messages by the file's own count."""
        index = self.index
        return self.claimed if index is None else index.messages

    @property
    def _together(self) -> int:
        """Bytes of chunks that are read as one batch."""
        return _TOGETHER * max(1, min(_GROWTH, len(self.channels) // _CHANNELS))

    def batches(self) -> Iterator[Batch]:
        """The messages, by chunks; those outside of chunks in batches of their own."""
        loose = bytearray()
        chunks: list[Frame] = []
        for frame in self:
            if frame.opcode == Opcode.MESSAGE:
                yield from self._checked(chunks)
                loose += FRAME.pack(frame.opcode, len(frame.content)) + frame.content
            if loose and (frame.opcode == Opcode.CHUNK or len(loose) > _LOOSE):
                yield self._batch(bytes(loose), LOOSE)
                loose.clear()
            if frame.opcode == Opcode.CHUNK:
                if not frame.checked:
                    yield from self._checked(chunks)
                chunks.append(frame)
                if (
                    not frame.checked
                    or sum(len(chunk.content) for chunk in chunks) >= self._together
                ):
                    yield from self._checked(chunks)
            elif frame.opcode != Opcode.MESSAGE:
                self._keep(frame.opcode, frame.content, frame)
        yield from self._checked(chunks)
        if loose:
            yield self._batch(bytes(loose), LOOSE)
        if not self.damages and self._counted not in (None, self.messages):
            self.damages.append(Damage(self.size, self.size, OTHER_COUNT))

    def _checked(self, chunks: list[Frame]) -> Iterator[Batch]:
        """The messages of the chunks, which are forgotten; of each by itself if one is broken."""
        waiting = chunks.copy()
        chunks.clear()
        if not waiting:
            return
        data = b"".join(frame.content for frame in waiting)
        try:
            if waiting[-1].missing:
                raise ValueError("cut off")
            yield self._batch(data, None if waiting[0].checked else waiting[0])
        except ValueError:
            if len(waiting) > 1:
                for frame in waiting:
                    yield from self._checked([frame])
                return
            yield from self._salvaged(*waiting)

    def _salvaged(self, frame: Frame) -> Iterator[Batch]:
        """What is whole in a chunk with a broken record, the rest reported.

        Behind a wrong length nothing is certain in what was decompressed: what follows may be
        copies of what is broken; and where the checksum is right nothing broke after writing.
        """
        times = frame.start, frame.end
        if frame.checked or frame.compressed:
            self.damages.append(Damage(frame.offset, frame.offset, NO_RECORD, *times))
            return
        data, cut = frame.content, frame.missing > 0
        records = Unchecked(
            lambda at, size: data[at : at + size], len(data), set(self.channels), cut=cut
        ).indexed(index_entries(frame.indices))
        parts = list(records.stretches())
        if parts == [(0, len(data))] and not cut:  # then what it says of its messages is broken
            self.damages.append(Damage(frame.offset, frame.offset, WRONG_TIMES))
        else:
            records = records._replace(times=times if frame.end else None)
            parts = list(records.stretches())
        for gap in records._replace(end=len(data) + frame.missing).gaps(parts, times):
            at = frame.inside + gap.begin
            reason = CUT_OFF if gap.end > len(data) else NO_RECORD
            self.damages.append(Damage(at, at, reason, gap.after, gap.before))
        if parts:
            yield self._batch(b"".join(data[begin:end] for begin, end in parts), LOOSE)

    def _keep(self, opcode: int, content: bytes, frame: Frame | None = None) -> None:
        index = self.index
        at = -1 if frame is None else frame.offset  # -1: within a chunk
        try:
            if index is not None and index.kinds.get(at, opcode) != opcode:
                raise ValueError("differs from the index")
            record = parse_record(opcode, content)
        except Exception:
            if frame is None:
                raise ValueError("no record") from None
            self.damages.append(Damage(frame.offset, frame.offset, NO_RECORD))
            return
        match record:
            case Header():
                self.header = record
            case Schema():
                self.schemas[record.id] = record
            case Channel():
                self.channels[record.id] = record
            case Metadata():
                name = name_of(index, at, record.name)
                if frame is not None and name != record.name:
                    self.damages.append(Damage(frame.offset, frame.offset, OTHER_NAME))
                self.metadata.append(replace(record, name=name))
            case Attachment():
                self.attachments.append(record)

    def _batch(self, data: bytes, unchecked: Frame | None) -> Batch:
        """unchecked: the chunk of the messages; None where its checksum is right.

        Raises ValueError for what are no records.
        """
        start, size = self._places(data, strict=unchecked is not None)
        if not len(start):
            return {}
        if size.min() < _MESSAGE.itemsize:
            raise ValueError("a message without a head")
        buffer = np.frombuffer(data, np.uint8)
        heads = rows_at(buffer, start, _MESSAGE.itemsize).reshape(-1).view(_MESSAGE)
        log_time = heads["log"].astype(np.int64)
        sequence = heads["sequence"].astype(np.int64)
        if unchecked is not None and not _as_said(heads["log"], unchecked):
            raise ValueError("differs from the head of its chunk")
        start, size = start + _MESSAGE.itemsize, size - _MESSAGE.itemsize
        self._first = int(log_time.min() if self._first is None else min(self._first, log_time[0]))
        batch: Batch = {}
        for channel, at in _by_channel(heads["channel"]):
            if channel not in self.channels:
                self._note_unknown(log_time[at])
                continue
            self.messages += len(at)
            self.unchecked += 0 if unchecked is None else len(at)
            self.bytes += int(size[at].sum())
            batch[channel] = Messages(log_time[at], sequence[at], buffer, start[at], size[at])
        return batch

    def _note_unknown(self, times: np.ndarray) -> None:
        first, last = int(times.min()), int(times.max())
        damages = self.damages
        if damages and damages[-1].reason == NO_CHANNEL:
            before = damages.pop()
            first, last = min(first, before.after or first), max(last, before.before or last)
        damages.append(Damage(0, 0, NO_CHANNEL, first, last))

    def _places(self, data: bytes, strict: bool) -> tuple[np.ndarray, np.ndarray]:
        """Where each message begins and how long it is; keeps what else there is.

        strict: no other records than a chunk may hold; zeros would pass for empty ones.
        """
        parts: list[tuple[Any, Any]] = []
        starts: list[int] = []
        sizes: list[int] = []
        at, end, unpack = 0, len(data), FRAME.unpack_from
        while at < end:
            if len(starts) >= PATTERN:
                parts.append((starts, sizes))
                at, *alike = repeated(data, at, sizes[-2 * LONGEST :])
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
            elif strict and opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
                raise ValueError("no record of a chunk")
            else:
                self._keep(opcode, data[at : at + length])
            at += length
        parts.append((starts, sizes))
        start, size = (np.concatenate(column) for column in zip(*parts, strict=True))
        return start.astype(np.int64, copy=False), size.astype(np.int64, copy=False)
