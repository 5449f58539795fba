"""What can be broken in an MCAP file, and how a reader tells it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

NO_RECORD = "no record can be read there"
CUT_OFF = "the file is cut off"
BROKEN_INDEX = "its index is broken"
WRONG_TIMES = "its times or its index are not those of its messages"
OTHER_COUNT = "its own count of messages is another one"
ONE_LENGTH = "one of its two lengths is broken, and the other was read"
OTHER_NAME = "its name is not as written, and was taken from the index"
NO_CHANNEL = "messages whose topic stood in a broken part"


class Damage(NamedTuple):
    """A part of a file that cannot be read.

    offset, end: [bytes]; reason: one of the texts above or of `bag_chunks`.
    after, before: log times between which messages are missing [ns]; None: not known.
    """

    offset: int
    end: int
    reason: str
    after: int | None = None
    before: int | None = None


class Missing(NamedTuple):
    """What a reader could not read of a bag."""

    path: Path
    damages: list[Damage]
    messages: int | None
    """that are missing; None: the file does not tell."""
    start: int | None
    """log time of the first message that was read [ns]."""

    @property
    def within(self) -> bool:
        """Whether something is missing between messages that were read."""
        return any(d.after is not None and d.before is not None for d in self.damages)

    def lines(self) -> list[str]:
        """One line for each damaged part; times in seconds since the first message."""
        lost = "" if not self.messages else f"; {self.messages} messages are missing in all"
        texts = [f"{self.path}: {self._line(damage)}" for damage in self.damages]
        return [text + (lost if k == len(texts) - 1 else "") for k, text in enumerate(texts)]

    def _line(self, damage: Damage) -> str:
        if damage.reason == BROKEN_INDEX:
            return f"damaged: {damage.reason}, and is not used; the messages are read without it"
        if damage.reason == OTHER_COUNT:
            return f"damaged: {damage.reason}, and no checksum tells which is right"
        where = f"damaged at byte {damage.offset}: {damage.reason}"
        if damage.reason == NO_CHANNEL:
            where = damage.reason
        if damage.after is None and damage.before is None:
            return f"{where}; no message is missing there that the file knows of"
        return f"{where}; missing is what lies {self._between(damage)}"

    def _between(self, damage: Damage) -> str:
        if damage.before is None:
            return f"after t = {self._seconds(damage.after)} s of the bag"
        if damage.after is None:
            return f"before t = {self._seconds(damage.before)} s of the bag"
        first, last = self._seconds(damage.after), self._seconds(damage.before)
        return f"between t = {first} s and t = {last} s of the bag"

    def _seconds(self, time: int | None) -> str:
        first = time if self.start is None else self.start  # nothing was read: all from its begin
        return f"{((time or 0) - (first or 0)) * 1e-9:.9g}"
