"""Are two bags of one scene the same, byte for byte? Where they part first, and by how much."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from rb_sim.errors import SinkError
from rb_sim.sinks.bag_reader import BagReader
from rb_sim.sinks.bag_rows import Rows
from rb_sim.sinks.cdr import NANO


class FirstDifference(NamedTuple):
    """The first sample that is not the same."""

    number: int
    t: float
    """[s]."""
    topic: str
    size: float
    """largest difference of a number in that message; 0.0 where only bytes differ."""


class Identity(NamedTuple):
    """How far the payloads of two bags agree."""

    samples: int
    """that are in both."""
    only_in: tuple[int, int]
    """samples that only one of them has."""
    identical: int
    sha256: tuple[str, str]
    """of the payloads of those samples, topic by topic."""
    first: FirstDifference | None
    largest: dict[str, float]
    """difference of a number over the whole run, by topic, where there is any."""

    @property
    def same(self) -> bool:
        """True if every sample of the one is in the other, bit for bit."""
        return self.sha256[0] == self.sha256[1] and self.only_in == (0, 0)

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        first = None if self.first is None else self.first._asdict()
        return self._asdict() | {"first": first, "same": self.same}


def identity(a: BagReader, b: BagReader) -> Identity:
    """Compare two bags with the same topics, sample by sample. Raises SinkError for other ones."""
    if a.layout != b.layout:
        raise SinkError(f"{b.path}: its bodies, reactions or contacts are not those of {a.path}")
    codecs = {topic.name: topic.codec for topic in a.topics}
    clock = a.topics[-1]
    digests = {name: (hashlib.sha256(), hashlib.sha256()) for name in codecs}
    largest: dict[str, float] = {}
    first: FirstDifference | None = None
    samples = identical = 0
    counts = [0, 0]
    for number, one, other in _aligned(a.rows(), b.rows(), counts):
        samples += len(number)
        differs = np.zeros(len(number), bool)
        for name, codec in codecs.items():
            for digest, data in zip(digests[name], (one[name], other[name]), strict=True):
                digest.update(data.tobytes())
            wrong = (one[name] != other[name]).any(axis=1)
            if wrong.any():
                size = np.abs(codec.unpack_rows(one[name]) - codec.unpack_rows(other[name]))
                k = int(np.argmax(wrong))
                if first is None or number[k] < first.number:
                    t = clock.codec.unpack_stamps(one[clock.name][k : k + 1])[0] / NANO
                    first = FirstDifference(
                        int(number[k]), float(t), name, float(size[k].max(initial=0))
                    )
                largest[name] = max(largest.get(name, 0.0), float(size.max(initial=0.0)))
            differs |= wrong
        identical += int((~differs).sum())
    sums = [hashlib.sha256(), hashlib.sha256()]
    for pair in digests.values():
        for total, digest in zip(sums, pair, strict=True):
            total.update(digest.digest())
    rest = (counts[0] - samples, counts[1] - samples)
    return Identity(
        samples, rest, identical, (sums[0].hexdigest(), sums[1].hexdigest()), first, largest
    )


Part = tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]


def _aligned(a: Iterator[Rows], b: Iterator[Rows], counts: list[int]) -> Iterator[Part]:
    """The samples with equal numbers: (numbers, data of a, data of b). counts: of each side."""
    waiting: Rows | None = None
    for one in a:
        counts[0] += len(one.number)
        while waiting is None or waiting.number[-1] < one.number[-1]:
            more = next(b, None)
            if more is None:
                break
            counts[1] += len(more.number)
            waiting = more if waiting is None else _joined(waiting, more)
        if waiting is None:
            continue
        number, i, j = np.intersect1d(one.number, waiting.number, return_indices=True)
        yield (
            number,
            {name: data[i] for name, data in one.data.items()},
            {name: data[j] for name, data in waiting.data.items()},
        )
        later = waiting.number > one.number[-1]
        waiting = _those(waiting, later) if later.any() else None
    counts[1] += sum(len(more.number) for more in b)


def _joined(a: Rows, b: Rows) -> Rows:
    data = {name: np.concatenate([a.data[name], b.data[name]]) for name in a.data}
    return Rows(np.concatenate([a.number, b.number]), data, [], [])


def _those(rows: Rows, which: np.ndarray) -> Rows:
    return Rows(rows.number[which], {k: v[which] for k, v in rows.data.items()}, [], [])
