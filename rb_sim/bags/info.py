# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contents of a bag: its run, its topics with their rates, and damage.

Rates, gaps and clock jumps of message times are computed in bounded memory.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.base.errors import SceneError, SinkError
from rb_sim.base.names import MOST_NAMED
from rb_sim.io.bag.bag_sink import RECORD, SUMMARY_RECORD, checksum, summary_in
from rb_sim.io.bag.batches import Messages
from rb_sim.io.bag.folder import Scan, bag_paths, scan_of, unlisted
from rb_sim.io.bag.reader import described_in
from rb_sim.io.messages.topic_names import RESETS
from rb_sim.mechanics.samples import Array
from rb_sim.scene import yaml_reader

# Readings at increasing times.


def forward(t: Array) -> NDArray[np.bool_]:
    """Mask of the times later than all before them (False e.g. after a reset)."""
    return np.concatenate([[True], t[1:] > np.maximum.accumulate(t)[:-1]]) if len(t) else t > 0


def joined(times: Iterable[Array], rows: Iterable[Array]) -> tuple[Array, Array]:
    """Concatenated times and rows, without the readings whose time goes back."""
    t = np.concatenate(list(times))
    kept = forward(t)
    return t[kept], np.concatenate(list(rows))[kept]


def linear(t: Array, times: Array, rows: Array, outside: float | None = None) -> Array:
    """Rows (m, k) interpolated at times t; outside: value beyond the ends, None: the nearest."""
    columns = [np.interp(t, times, column, left=outside, right=outside) for column in rows.T]
    return np.stack(columns, axis=1)


def held(t: Array, times: Array, rows: Array) -> Array:
    """Rows (m, k), each of which holds until the next, at times t; zero before the first."""
    before = np.zeros_like(rows, shape=(1, rows.shape[1]))
    return np.concatenate([before, rows])[np.searchsorted(times, t, side="right")]


# Rates and gaps of a stream of times.


FIRST = 4096
"""Number of intervals whose median is the period by which gaps are judged."""
LOST = 1.5
"""An interval longer than this many periods means a lost message."""
GAP = 2.5
"""An interval longer than this many periods is a gap: several messages are missing."""
LONG = 10.0
"""An interval longer than this many periods is not interpolated."""
KEPT = 20
"""Maximum number of gaps listed individually."""


def after_gaps(t: Array, most: float = LONG) -> NDArray[np.intp]:
    """Indices of the times that follow an interval of more than `most` periods, or a step back."""
    steps = np.diff(t)
    ahead = steps[steps > 0]
    period = np.median(ahead) if len(ahead) else 0.0
    return 1 + np.flatnonzero((steps <= 0) | (steps > most * period))


def between(cuts: Iterable[int], n: int) -> list[slice]:
    """Slices of n samples that begin at the cuts."""
    edges = sorted({0, *cuts, n})
    return [slice(a, b) for a, b in pairwise(edges)]


class Rates:
    """Count, rate, jitter and gaps of times [s] that arrive in pieces."""

    def __init__(self) -> None:
        self.count = 0
        self.first = self.last = np.nan
        self.longest = 0.0
        self.backwards = 0
        """number of times earlier than the one before."""
        self.gaps: list[tuple[float, float]] = []
        self.gap_count = 0
        self.lost = 0
        """number of single missing messages."""
        self._sum = self._squares = 0.0
        self._regular = 0
        self._waiting: list[tuple[np.ndarray, np.ndarray]] = []
        self._waiting_count = 0
        self._period: float | None = None

    def add(self, t: np.ndarray) -> None:
        """Append times [s], in the order of the stream."""
        if not len(t):
            return
        steps = np.diff(t, prepend=self.last) if self.count else np.diff(t)
        starts = t[-len(steps) :] - steps if len(steps) else t[:0]
        if not self.count:
            self.first = float(t[0])
        self.count += len(t)
        self.last = float(t[-1])
        self.backwards += int((steps < 0).sum())
        if self._period is not None:
            self._judge(starts, steps)
            return
        self._waiting.append((starts, steps))
        self._waiting_count += len(steps)
        if self._waiting_count >= FIRST:
            self._begin()

    def _begin(self) -> None:
        steps = np.concatenate([s for _, s in self._waiting]) if self._waiting else np.empty(0)
        forward = steps[steps > 0]
        self._period = float(np.median(forward)) if len(forward) else 0.0
        waiting, self._waiting = self._waiting, []
        for starts, part in waiting:
            self._judge(starts, part)

    def _judge(self, starts: np.ndarray, steps: np.ndarray) -> None:
        period = self._period or 0.0
        self.longest = max(self.longest, float(steps.max(initial=0.0)))
        far = steps > GAP * period
        self.gap_count += int(far.sum())
        room = KEPT - len(self.gaps)
        self.gaps += list(zip(starts[far].tolist(), steps[far].tolist(), strict=True))[:room]
        single = (steps > LOST * period) & ~far
        self.lost += int(single.sum())
        near = steps[(steps > 0) & ~far & ~single] - period
        self._regular += len(near)
        self._sum += float(near.sum())
        self._squares += float(near @ near)

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers; times in seconds, rates in Hz."""
        if self._period is None:
            self._begin()
        period = self._period or 0.0
        mean = self._sum / self._regular if self._regular else 0.0
        spread = self._squares / self._regular - mean**2 if self._regular else 0.0
        return {
            "count": self.count,
            "first": None if np.isnan(self.first) else self.first,
            "last": None if np.isnan(self.last) else self.last,
            "rate": 1.0 / (period + mean) if period > 0 else None,
            "jitter": float(np.sqrt(max(0.0, spread))),
            "longest_gap": self.longest,
            "gaps": self.gap_count,
            "lost": self.lost,
            "first_gaps": [{"after": start, "seconds": step} for start, step in self.gaps],
            "backwards": self.backwards,
        }


# A monotonic time for readings whose stamps go back: a clock that was set, a looped bag.


APART = 1000.0
"""Gap between the stretches before and after a jump on the growing time [s]; sources may reach the
jump at instants that differ by less."""


class _Jump(NamedTuple):
    """A step back in the time of all sources."""

    source: str
    """the source that showed it first."""
    old: float
    new: float
    """last stamp before and first stamp after the jump [s]."""
    offset: float
    """growing time minus stamp after the jump [s]."""
    border: float
    """growing time [s] beyond which a reading is after the jump."""


class GrowingTime:
    """Maps the stamps of several sources to one time that never decreases.

    The n-th jump back of each source is taken as the same jump. APART makes every jump a gap.
    """

    def __init__(self) -> None:
        self._jumps: list[_Jump] = []
        self._count: dict[str, int] = {}
        self._latest: dict[str, float] = {}

    def jump(self, source: str, old: float, new: float) -> None:
        """Register that the stamps of a source go back from `old` to `new` [s]."""
        count = self._count[source] = self._count.get(source, 0) + 1
        if count > len(self._jumps):
            before = self._offset(count - 1)
            offset = before + old - new + APART
            self._jumps.append(_Jump(source, old, new, offset, old + before + 0.5 * APART))

    def of(self, source: str, t: Array) -> Array:
        """Growing time of stamps of a source, all after its last jump."""
        return t + self._offset(self._count.get(source, 0))

    def found(self, source: str, t: Array, late: float) -> Array:
        """Like `of`, but detects the jumps: steps back by more than `late` [s]."""
        parts, latest = [], self._latest.get(source, -np.inf)
        while len(t):
            highest = np.maximum.accumulate(np.append(latest, t))
            jump = int(np.argmax(np.append(highest[:-1] - t > late, True)))
            parts.append(self.of(source, t[:jump]))
            latest, t = float(highest[jump]), t[jump:]
            if len(t):
                self.jump(source, latest, float(t[0]))
                latest = float(t[0])
        self._latest[source] = latest
        return np.concatenate(parts) if parts else t

    def stamps(self, t: Array) -> Array:
        """Stamps that correspond to growing times t."""
        count = np.searchsorted([jump.border for jump in self._jumps], t, side="right")
        return t - np.array([0.0, *(jump.offset for jump in self._jumps)])[count]

    def notes(self) -> list[str]:
        """A line for each of the first few jumps."""
        lines = [
            f"{jump.source}: time goes back from {jump.old:.6g} s to {jump.new:.6g} s: the balance "
            "starts again there"
            for jump in self._jumps[:MOST_NAMED]
        ]
        more = len(self._jumps) - len(lines)
        return [*lines, f"and so {more} times more"] if more else lines

    def _offset(self, count: int) -> float:
        return self._jumps[count - 1].offset if count else 0.0


NANO = 1e-9
MOST_RESETS = 1000
"""Maximum number of resets whose times are kept."""


def info(bag: Path) -> dict[str, Any]:
    """Contents of any bag, as plain data; reads the whole bag.

    Raises SinkError if it is not a bag.
    """
    paths = bag_paths(Path(bag))
    found = _Info()
    scans = [found.read(path) for path in paths]
    damage = [line for scan in scans for line in scan.missing.lines()]
    metadata = {record.name: record.metadata for scan in scans for record in scan.metadata}
    headers = [scan.header for scan in scans if scan.header is not None]
    recorded = metadata.get(RECORD)
    converted = None if recorded else described_in(paths[0])
    try:
        summary = summary_in(metadata.get(SUMMARY_RECORD))
    except ValueError as error:
        summary = None
        damage.append(str(error))
    topics = {
        name: {"type": topic.type, "bytes": topic.bytes, **topic.rates.as_dict()}
        for name, topic in sorted(found.topics.items())
    }
    recorded = recorded or converted
    run = None if recorded is None else run_of(recorded, summary, damage)
    # converters keep only messages, and thus no summary
    ended = run is None or run["summarised"] or converted is not None
    finished = all(scan.complete for scan in scans)
    return {
        "path": str(paths[0]),
        "files": len(paths),
        "size": sum(path.stat().st_size for path in paths),
        "library": headers[-1].library if headers else "",
        "profile": headers[-1].profile if headers else "",
        "duration": max(0.0, found.last - found.first),
        "messages": sum(int(topic["count"]) for topic in topics.values()),
        "run": run,
        "resets": found.resets,
        "commands": _commands(topics),
        "topics": topics,
        "health": {
            "finished": finished,
            "run_ended": ended,
            "damage": damage,
            "chunks": sum(scan.chunks for scan in scans),
            "chunks_without_checksum": sum(scan.unchecked_chunks for scan in scans),
            "messages_without_checksum": sum(scan.unchecked for scan in scans),
            "whole": finished and ended and not damage,
        },
        "notes": unlisted(Path(bag)),
    }


def _commands(topics: dict[str, Any]) -> dict[str, int]:
    ending = "/wrench_command"
    found = {name: t["count"] for name, t in topics.items() if name.endswith(ending)}
    return {name.removesuffix(ending): count for name, count in found.items()}


@dataclass
class _Topic:
    """Messages of a topic."""

    type: str = "unknown"
    bytes: int = 0
    rates: Rates = field(default_factory=Rates)


class _Info:
    """Collects the messages while the files are read."""

    def __init__(self) -> None:
        self.topics: dict[str, _Topic] = {}
        self.resets: list[float] = []
        self.start: int | None = None
        self.first, self.last = np.inf, -np.inf
        """least and largest log time, relative to `start` [s]: files may come in any order."""

    def read(self, path: Path) -> Scan:
        """Read a file; the scan tells the rest of it."""
        scan = scan_of(path)
        for batch in scan.batches():
            topics: dict[str, list[Messages]] = {}
            for number, messages in batch.items():
                topics.setdefault(scan.channels[number].topic, []).append(messages)
            for topic, parts in topics.items():
                self._add(scan, topic, parts)
        for channel in scan.channels.values():
            topic = self.topics.setdefault(channel.topic, _Topic())
            schema = scan.schemas.get(channel.schema_id)
            if schema is not None and topic.type == "unknown":
                topic.type = schema.name
        return scan

    def _add(self, scan: Scan, topic: str, parts: list[Messages]) -> None:
        """Add the messages of a topic, which may have several channels, in file order."""
        if self.start is None:
            self.start = scan.missing.start or 0
        times = np.concatenate([messages.log_time for messages in parts])
        if len(parts) > 1:
            times = times[np.argsort(np.concatenate([messages.start for messages in parts]))]
        t = (times - self.start) * NANO
        self.first = min(self.first, float(t.min(initial=np.inf)))
        self.last = max(self.last, float(t.max(initial=-np.inf)))
        found = self.topics.setdefault(topic, _Topic())
        found.rates.add(t)
        found.bytes += sum(int(messages.size.sum()) for messages in parts)
        if topic.endswith(f"/{RESETS}") and len(self.resets) < MOST_RESETS:
            self.resets += np.round(t, 9).tolist()[:MOST_RESETS]


def run_of(record: dict[str, str], summary: Any, damage: list[str]) -> dict[str, Any] | None:
    """Metadata record and summary of an rb_sim bag as plain data; None if it is damaged."""
    if record.get("sha256", checksum(record)) != checksum(record):
        damage.append("the record of the simulation is damaged (wrong checksum)")
        return None
    options = json.loads(record["simulation"])
    summary = summary or {}
    return {
        "scene": record["name"],
        "description": record["description"],
        **parts_of(record["scene"], record["name"]),
        "simulation": options,
        "choice": summary.get("choice"),
        "settings": json.loads(record.get("run", "{}")),
        "versions": json.loads(record.get("versions", "{}")),
        "host": json.loads(record.get("host", "{}")),
        "commands_refused": summary.get("commands_refused", {}),
        "samples_dropped": summary.get("samples_dropped", 0),
        "outcome": summary.get("outcome") or summary.get("stopped_by"),
        "summarised": bool(summary),
    }


def parts_of(scene: str, name: str) -> dict[str, Any]:
    """Types of the bodies, constraints and effects in the text of a scene, by name.

    Raises SinkError if the text cannot be parsed."""
    try:
        data = yaml_reader.parse(scene, name)
    except SceneError as error:
        raise SinkError(f"{name}: the scene in the bag cannot be read: {error}") from None
    kinds = {
        section: {
            key: str(value.get("type", "")) if isinstance(value, dict) else ""
            for key, value in (data.get(section) or {}).items()
        }
        for section in ("constraints", "effects")
    }
    return {"bodies": list(data.get("bodies") or {}), **kinds}
