# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What is in a bag: the run that it is of, its topics, and whether it is whole."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.bags.message_rates import Rates
from rb_sim.base.errors import SceneError, SinkError
from rb_sim.io.bag.batches import Messages
from rb_sim.io.bag.folder import Scan, bag_paths, scan_of, unlisted
from rb_sim.io.bag.reader import described_in
from rb_sim.io.bag.sink import RECORD, SUMMARY_RECORD, checksum, summary_in
from rb_sim.io.messages.topic_names import RESETS
from rb_sim.scene import yaml_reader

NANO = 1e-9
MOST_RESETS = 1000
"""Resets whose times are kept."""


def info(bag: Path) -> dict[str, Any]:
    """Read all of a bag, ours or anybody's, and say what is in it; plain data.

    Raises SinkError for what is no bag.
    """
    return _Info(bag_paths(Path(bag))).read() | {"notes": unlisted(Path(bag))}


class _Info:
    """What is gathered while the files are read."""

    def __init__(self, paths: list[Path]) -> None:
        self.paths = paths
        self.rates: dict[str, Rates] = {}
        self.types: dict[str, str] = {}
        self.bytes: Counter[str] = Counter()
        self.resets: list[float] = []
        self.damage: list[str] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self.chunks = self.unchecked = self.unchecked_messages = 0
        self.whole = True
        self.library = self.profile = ""
        self.start: int | None = None
        self.first, self.last = np.inf, -np.inf
        """least and largest log time, from `start` [s]: files of others may come in any order."""

    def read(self) -> dict[str, Any]:
        for path in self.paths:
            self._read_file(path)
        recorded = self.metadata.get(RECORD)
        converted = None if recorded else described_in(self.paths[0])
        try:
            summary = summary_in(self.metadata.get(SUMMARY_RECORD))
        except ValueError as error:
            summary = None
            self.damage.append(str(error))
        topics = {
            name: {
                "type": self.types[name],
                "bytes": self.bytes[name],
                **self.rates[name].as_dict(),
            }
            for name in sorted(self.types)
        }
        recorded = recorded or converted
        run = None if recorded is None else run_of(recorded, summary, self.damage)
        # what converts a bag keeps its messages, and with them no summary
        ended = run is None or run["summarised"] or converted is not None
        return {
            "path": str(self.paths[0]),
            "files": len(self.paths),
            "size": sum(path.stat().st_size for path in self.paths),
            "library": self.library,
            "profile": self.profile,
            "duration": max(0.0, self.last - self.first),
            "messages": sum(topic["count"] for topic in topics.values()),
            "run": run,
            "resets": self.resets,
            "commands": self._commands(topics),
            "topics": topics,
            "health": {
                "finished": self.whole,
                "run_ended": ended,
                "damage": self.damage,
                "chunks": self.chunks,
                "chunks_without_checksum": self.unchecked,
                "messages_without_checksum": self.unchecked_messages,
                "whole": self.whole and ended and not self.damage,
            },
        }

    def _read_file(self, path: Path) -> None:
        scan = scan_of(path)
        for batch in scan.batches():
            topics: dict[str, list[Messages]] = {}
            for number, messages in batch.items():
                topics.setdefault(scan.channels[number].topic, []).append(messages)
            for topic, parts in topics.items():
                self._add(scan, topic, parts)
        for channel in scan.channels.values():
            schema = scan.schemas.get(channel.schema_id)
            self.types.setdefault(channel.topic, schema.name if schema else "unknown")
            self.rates.setdefault(channel.topic, Rates())
        self.damage += scan.missing.lines()
        self.metadata |= {record.name: record.metadata for record in scan.metadata}
        self.chunks += scan.chunks
        self.unchecked += scan.unchecked_chunks
        self.unchecked_messages += scan.unchecked
        self.whole &= scan.complete
        if scan.header is not None:
            self.library, self.profile = scan.header.library, scan.header.profile

    def _add(self, scan: Scan, topic: str, parts: list[Messages]) -> None:
        """The messages of a topic, which may lie in several channels, in the order of the file."""
        if self.start is None:
            self.start = scan.missing.start or 0
        times = np.concatenate([messages.log_time for messages in parts])
        if len(parts) > 1:
            times = times[np.argsort(np.concatenate([messages.start for messages in parts]))]
        t = (times - self.start) * NANO
        self.first = min(self.first, float(t.min(initial=np.inf)))
        self.last = max(self.last, float(t.max(initial=-np.inf)))
        self.rates.setdefault(topic, Rates()).add(t)
        self.bytes[topic] += sum(int(messages.size.sum()) for messages in parts)
        if topic.endswith(f"/{RESETS}") and len(self.resets) < MOST_RESETS:
            self.resets += np.round(t, 9).tolist()[:MOST_RESETS]

    def _commands(self, topics: dict[str, Any]) -> dict[str, int]:
        ending = "/wrench_command"
        found = {name: t["count"] for name, t in topics.items() if name.endswith(ending)}
        return {name.removesuffix(ending): count for name, count in found.items()}


def run_of(record: dict[str, str], summary: Any, damage: list[str]) -> dict[str, Any] | None:
    """What the record of a bag of rb_sim says, and its summary; None if it is damaged."""
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
    """Kinds of the bodies, constraints and effects in the text of a scene, by their names."""
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
