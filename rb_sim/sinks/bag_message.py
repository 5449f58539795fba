"""Messages as records of an MCAP file: one, or those of many samples without Python for each."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode

if TYPE_CHECKING:
    from numpy.typing import NDArray

MESSAGE = struct.Struct("<BQHIQQ")
"""Opcode, length, channel, sequence, log time, publish time; the data follow."""
HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""The same for numpy."""
OPCODE = int(Opcode.MESSAGE)
OWN = MESSAGE.size - 9
"""Bytes of a message's content before its data."""


class Rows(NamedTuple):
    """Messages of many samples, those of one in a row."""

    data: NDArray[np.uint8]
    """shape (n, size)."""
    bounds: Sequence[tuple[int, int]]
    """where in a row each message begins and ends."""

    def records(self, channels: Sequence[int], times: NDArray[Any], sequence: int) -> Rows:
        """The messages as records of the file. times: [ns], shape (n,); numbers count up."""
        n = len(times)
        sizes = [end - start for start, end in self.bounds]
        ends = np.cumsum([MESSAGE.size + size for size in sizes]).tolist()
        bounds = [*zip([0, *ends[:-1]], ends, strict=True)]
        heads = np.empty((n, len(channels)), HEAD)
        heads["opcode"], heads["length"], heads["channel"] = OPCODE, np.add(sizes, OWN), channels
        heads["sequence"] = (sequence + np.arange(n))[:, None] & 0xFFFFFFFF
        heads["log_time"] = heads["publish_time"] = times[:, None]
        front = heads.view(np.uint8).reshape(n, len(channels), MESSAGE.size)
        out = np.empty((n, ends[-1]), np.uint8)
        for j, ((start, end), (a, b)) in enumerate(zip(bounds, self.bounds, strict=True)):
            out[:, start : start + MESSAGE.size] = front[:, j]
            out[:, start + MESSAGE.size : end] = self.data[:, a:b]
        return Rows(out, bounds)
