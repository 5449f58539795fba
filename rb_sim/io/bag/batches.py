# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages of an MCAP file as arrays, in batches of chunks; memory bounded by the chunk size."""

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
"""Messages read one by one before repetition of their lengths is assumed."""
ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of zstd data (RFC 8878); a CDR message starts with a zero byte."""
LARGEST = 1 << 27
"""Maximum size of a decompressed message [bytes]; a larger claim means damage."""
LONGEST = 32
"""Maximum number of messages in a repeated pattern."""


class Messages(NamedTuple):
    """n messages of one channel, in file order."""

    log_time: np.ndarray
    """[ns], shape (n,), int64."""
    sequence: np.ndarray
    """shape (n,), int64."""
    buffer: np.ndarray
    """uint8: bytes that contain the messages."""
    start: np.ndarray
    """offset of each message in the buffer, shape (n,)."""
    size: np.ndarray
    """[bytes], shape (n,)."""

    def data(self, k: int) -> bytes:
        """The bytes of message k."""
        return self.buffer[self.start[k] : self.start[k] + self.size[k]].tobytes()

    def rows(self, size: int) -> np.ndarray:
        """The bytes of all messages, shape (n, size). Raises ValueError for another length."""
        wrong = np.flatnonzero(self.size != size)
        if len(wrong):
            raise ValueError(f"{self.size[wrong[0]]} bytes instead of {size}")
        return rows_at(self.buffer, self.start, size)

    def take(self, which: np.ndarray) -> Messages:
        """The messages with these indices."""
        return Messages(
            self.log_time[which], self.sequence[which], self.buffer, self.start[which],
            self.size[which],
        )  # fmt: skip


def rows_at(buffer: np.ndarray, start: np.ndarray, size: int) -> np.ndarray:
    """The `size` bytes from each start, shape (n, size), copied."""
    room = len(buffer) - size + 1
    if room <= 0 or not len(start):
        return np.empty((len(start), size), np.uint8)
    whole = np.ndarray((room,), np.dtype((np.void, size)), buffer, strides=(1,))  # copied at once
    return whole[start].view(np.uint8).reshape(len(start), size)


def unpacked(messages: Messages) -> Messages:
    """The messages, decompressed if rosbag2 compressed them individually; those that cannot be
    decompressed stay as they are."""
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
    buffer, start, size = together(parts)
    return messages._replace(buffer=buffer, start=start, size=size)


def together(parts: list[bytes]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Buffer, starts and sizes of `Messages` with these bytes."""
    size = np.array([len(part) for part in parts], dtype=np.int64)
    return np.frombuffer(b"".join(parts), np.uint8), np.cumsum(size) - size, size


Batch = dict[int, Messages]
"""Messages by channel id."""


def repeated(data: bytes, at: int, tail: list[int]) -> tuple[int, np.ndarray, np.ndarray]:
    """End, starts and sizes of the messages from `at` on that repeat the periodic lengths `tail` of
    those before: most bags cycle through the same few topics."""
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


# Scan of an MCAP file, batch by batch.


_MESSAGE = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log", "<u8"), ("publish", "<u8")])
_LOOSE = 1 << 18
"""Bytes of messages outside of chunks per batch."""
_TOGETHER = 1 << 21
"""Bytes of chunks per batch; a larger chunk is a batch of its own."""
_CHANNELS, _GROWTH = 512, 16
"""In a file with n times _CHANNELS channels, batches are n times as large (at most _GROWTH times),
to limit the overhead per channel and batch."""


def by_channel(of: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Each channel, and the indices of its messages in order."""
    order = np.argsort(of, kind="stable")
    ordered = of[order]
    for at in np.split(order, np.flatnonzero(ordered[1:] != ordered[:-1]) + 1):
        yield int(of[at[0]]), at


LOOSE = Frame(0, Opcode.MESSAGE, b"")
"""Placeholder chunk of messages outside of chunks; it has no times to check."""


def _within_declared_times(times: np.ndarray, chunk: Frame) -> bool:
    """Whether messages agree with the times and index of their chunk without checksum."""
    in_time = chunk.start <= int(times.min()) and int(times.max()) <= chunk.end
    return (in_time or chunk.end == 0) and len(times) >= count_entries(chunk.indices)


class BagScan(Frames):
    """Reads one MCAP file from front to back; iterate over `batches` once.

    header, schemas, channels, metadata, attachments: found so far. `missing` is complete
    afterwards. Raises SinkError if the file is not MCAP or cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.header: Header | None = None
        index = self.index
        # channels are defined within chunks; if such a chunk is broken, the index still has them
        self.schemas: dict[int, Schema] = {} if index is None else dict(index.schemas)
        self.channels: dict[int, Channel] = {} if index is None else dict(index.channels)
        self.metadata: list[Metadata] = []
        self.attachments: list[Attachment] = []
        self.messages = 0
        self.unchecked = 0
        """messages without a checksum: in chunks without one, or outside of chunks."""
        self.bytes = 0
        """of message data."""
        self._first: int | None = None

    @property
    def missing(self) -> Missing:
        """Unreadable parts of the file; complete after the last batch."""
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
        """Number of messages according to the file."""
        index = self.index
        return self.claimed if index is None else index.messages

    @property
    def _together(self) -> int:
        """Bytes of chunks per batch."""
        return _TOGETHER * max(1, min(_GROWTH, len(self.channels) // _CHANNELS))

    def batches(self) -> Iterator[Batch]:
        """Yield the messages, by chunks; those outside of chunks in separate batches."""
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
        """Yield the messages of these chunks and clear the list; singly if one is broken."""
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
        """Yield the intact messages of a chunk with a broken record, and report the rest.

        Nothing is salvaged from compressed chunks (behind a wrong length, decompressed bytes may be
        copies of broken ones) or if the checksum is right (then the file was written so).
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
        if parts == [(0, len(data))] and not cut:  # intact messages: wrong times or index
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
        """The messages in these records.

        unchecked: the chunk of the messages; None if its checksum is right. Raises ValueError if
        the bytes are not records.
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
        if unchecked is not None and not _within_declared_times(heads["log"], unchecked):
            raise ValueError("differs from the head of its chunk")
        start, size = start + _MESSAGE.itemsize, size - _MESSAGE.itemsize
        self._first = int(log_time.min() if self._first is None else min(self._first, log_time[0]))
        batch: Batch = {}
        for channel, at in by_channel(heads["channel"]):
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
        """Start and size of each message; stores the other records.

        strict: allow only the records of a chunk; zero bytes would otherwise pass as empty records.
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
            if opcode == 5:  # Opcode.MESSAGE as a literal: this loop runs over all messages
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
