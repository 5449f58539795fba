"""Where whole records lie among bytes that no checksum covers, when a length in them is broken.

A record is taken for whole if its opcode, its length and, of a message, its log time can be right,
and what follows it is a record too. Reading goes on only where it is certain that records begin: at
a known channel's message, or at a channel or schema that fills its length, from which records
follow to the very end, or RUN of them without a break. That bytes within a message look so by
chance takes as many lengths that fit, of 64 bits each.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from io import BytesIO
from struct import Struct
from typing import Any, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from rb_sim.io.bag.records import FRAME, WholeStream

RUN = 4
"""Records in a row that are no chance."""
MESSAGE_HEAD = Struct("<HIQQ")
"""Channel, sequence, log time and publish time [ns]: the beginning of a message's content."""
_WINDOW = 1 << 20
_RECORD_HEAD = re.compile(rb"[\x03-\x05](?=.{5}\x00\x00\x00)", re.DOTALL)
"""A schema, channel or message of less than 2^40 bytes."""
_LONGEST_DEFINITION = 1 << 24
_PARSED: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}


class Gap(NamedTuple):
    """Bytes in which no whole record was found, and the log times around them [ns]."""

    begin: int
    end: int
    after: int
    before: int


class Unchecked(NamedTuple):
    """Records one after the other, of which lengths may be broken.

    read: bytes from (offset, size), fewer at the end. end: where the last one ends [bytes].
    channels: ids that are known; those that are met come in. times: log times of the messages,
    first and last [ns]; None: not known. closes: whether something else than these records begins
    there. starts: where messages begin that an index names, increasing. cut: the rest is cut off.
    """

    read: Callable[[int, int], bytes]
    end: int
    channels: set[int]
    times: tuple[int, int] | None = None
    closes: Callable[[int], bool] = lambda at: False
    starts: Sequence[int] = ()
    cut: bool = False

    def indexed(self, entries: Iterable[tuple[int, int, int]]) -> Unchecked:
        """With the starts that `entries` of an index (channel, log time, offset) name rightly."""
        return self._replace(
            starts=sorted(at for channel, time, at in entries if self._stands(at, channel, time))
        )

    def next_of(self, at: int) -> int | None:
        """The end of the record at `at`; None if none can be there."""
        opcode, length, content = self._head(at)
        end = at + FRAME.size + length
        if end > self.end or bisect_left(self.starts, end) > bisect_right(self.starts, at):
            return None
        if opcode == Opcode.MESSAGE:
            return end if length >= MESSAGE_HEAD.size and self._in_time(content) else None
        if opcode not in _PARSED or length > _LONGEST_DEFINITION:
            return None
        content = self.read(at + FRAME.size, length)
        return end if _fills(_PARSED[opcode], content) else None

    def resume(self, at: int) -> int | None:
        """The first offset from `at` on where records certainly begin; None if nowhere."""
        while at < self.end:
            window = self.read(at, min(_WINDOW + FRAME.size, self.end - at))
            for match in _RECORD_HEAD.finditer(window):
                if match.start() < _WINDOW and self._begins(at + match.start()):
                    return at + match.start()
            at += _WINDOW
        return None

    def is_record(self, at: int, resumed: int | None) -> bool:
        """True if a record begins at `at`, though it cannot be read as one.

        Its own length leads to where reading goes on, or only its length cannot be right.
        """
        opcode, length, content = self._head(at)
        if at + FRAME.size + length == (self.end if resumed is None else resumed):
            return True
        if self.cut and self.end - at < FRAME.size + MESSAGE_HEAD.size:
            return True
        return opcode == Opcode.MESSAGE and self._is_known(content) and self._in_time(content)

    def stretches(self, at: int = 0) -> Iterator[tuple[int, int]]:
        """Begin and end of whole records from `at` on, between which something is broken.

        A message of which the length may be the broken one is in none of them.
        """
        begin, last = at, None
        while at < self.end:
            after = self.next_of(at)
            if after is not None:
                self._learn(at)
                last, at = at, after
                continue
            resumed = self.resume(at + 1 if last is None else last + 1)
            behind = resumed is None or resumed > at
            whole = at if last is None or (behind and self.is_record(at, resumed)) else last
            if whole > begin:
                yield begin, whole
            if resumed is None:
                return
            begin, last, at = resumed, None, resumed
        if at > begin:
            yield begin, at

    def time_of(self, at: int) -> int | None:
        """Log time of the message at `at` [ns]; None if it is none."""
        opcode, _, content = self._head(at)
        return MESSAGE_HEAD.unpack_from(content)[2] if opcode == Opcode.MESSAGE else None

    def gaps(self, parts: list[tuple[int, int]], times: tuple[int, int]) -> Iterator[Gap]:
        """What is missing between the stretches `parts` of bytes that begin at 0.

        times: first and last log time where the stretches do not tell more [ns].
        """
        edges = [0, *(edge for part in parts for edge in part), self.end]
        inside = [self._times_in(*part) for part in parts]
        known = [time for part in inside for time in part]
        ordered = known == sorted(known)
        for k in range(0, len(edges), 2):
            begin, end = edges[k : k + 2]
            if begin == end:
                continue
            before = [time for part in inside[: k // 2] for time in part] if ordered else []
            later = [time for part in inside[k // 2 :] for time in part] if ordered else []
            yield Gap(begin, end, (before or times[:1])[-1], (later or times[1:])[0])

    def _times_in(self, at: int, end: int) -> list[int]:
        found = []
        while at < end:
            time = self.time_of(at)
            if time is not None:
                found.append(time)
            at = self.next_of(at) or end
        return found

    def _head(self, at: int) -> tuple[int, int, bytes]:
        head = self.read(at, FRAME.size + MESSAGE_HEAD.size)
        opcode, length = FRAME.unpack_from(head) if len(head) >= FRAME.size else (0, 0)
        return opcode, length, head[FRAME.size :]

    def _learn(self, at: int) -> None:
        opcode, _, content = self._head(at)
        if opcode == Opcode.CHANNEL:
            self.channels.add(int.from_bytes(content[:2], "little"))

    def _stands(self, at: int, channel: int, time: int) -> bool:
        opcode, _, content = self._head(at)
        if opcode != Opcode.MESSAGE or len(content) < MESSAGE_HEAD.size:
            return False
        found, _, at_time, _ = MESSAGE_HEAD.unpack_from(content)
        return (found, at_time) == (channel, time)

    def _is_known(self, content: bytes) -> bool:
        return (
            len(content) >= MESSAGE_HEAD.size
            and MESSAGE_HEAD.unpack_from(content)[0] in self.channels
        )

    def _in_time(self, content: bytes) -> bool:
        if len(content) < MESSAGE_HEAD.size:
            return False
        first, last = self.times or (0, 1 << 64)
        return first <= MESSAGE_HEAD.unpack_from(content)[2] <= last

    def _begins(self, at: int) -> bool:
        opcode, _, content = self._head(at)
        if opcode == Opcode.MESSAGE and not self._is_known(content):
            return False
        for count in range(RUN):
            if at == self.end or self.closes(at):
                return count > 0
            after = self.next_of(at)
            if after is None:
                return False
            at = after
        return True


def _fills(kind: Any, content: bytes) -> bool:
    """True if a record of that kind is made of all of these bytes."""
    stream = WholeStream(BytesIO(content))
    try:
        kind.read(stream)
    except Exception:  # whatever a decoder makes of bytes that are something else
        return False
    return stream.count == len(content)
