"""The open chunk of a bag as it would be if it ended now, so that a killed process loses little.

Where chunks ended by the clock, equal runs would give different files. So a chunk ends by its size
alone, and what waits in the open one stands at the end of the file as a draft, which any reader of
unfinished files takes for a chunk; the next chunk is written over it.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, Message, Schema

PERIOD = 0.5
"""[s] of wall time that a message waits for the next draft."""


class Draft:
    """Schemas, channels and the messages of the open chunk. clock: gives wall time [s]."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._heads: list[Schema | Channel] = []
        self._messages: list[tuple[int, int, int, bytes]] = []
        self._since: float | None = None

    def head(self, record: Schema | Channel) -> None:
        """What readers need to know before the first message."""
        self._heads.append(record)

    def add(self, channel: int, stamp: int, sequence: int, data: bytes) -> None:
        """A message that is in the open chunk. stamp: [ns]."""
        self._messages.append((channel, stamp, sequence, data))
        if self._since is None:
            self._since = self._clock()

    def clear(self) -> None:
        """The chunk has ended: its messages are in the file."""
        self._messages.clear()
        self._since = None

    @property
    def due(self) -> bool:
        """True if a message has waited for PERIOD."""
        return self._since is not None and self._clock() - self._since >= PERIOD

    def chunk(self) -> bytes:
        """The record of the chunk, not compressed; what is in it waits no longer."""
        self._since = None
        content = RecordBuilder()
        for head in self._heads:
            head.write(content)
        for channel, stamp, sequence, data in self._messages:
            Message(
                channel_id=channel, log_time=stamp, data=data, publish_time=stamp, sequence=sequence
            ).write(content)
        data = content.end()
        stamps = [stamp for _, stamp, _, _ in self._messages]
        record = RecordBuilder()
        Chunk(
            compression="",
            data=data,
            message_start_time=min(stamps, default=0),
            message_end_time=max(stamps, default=0),
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        ).write(record)
        return record.end()
