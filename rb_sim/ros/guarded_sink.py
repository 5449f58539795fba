"""A logger beside a running simulation: gets samples in batches, and may fail without stopping it.

A batch costs a log little more than one sample does. What waits for it is written at the latest
after FLUSH_PERIOD, and at the end.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.engine.samples import concatenate
from rb_sim.errors import RbSimError

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene
    from rb_sim.sinks.sink import Sink

BATCH = 256
"""Samples."""
FLUSH_PERIOD = 0.2
"""[s] of wall time."""


class GuardedSink:
    """Passes samples on until the first failure; then says so once and counts what is lost."""

    def __init__(self, sink: Sink, path: Path, complain: Callable[[str], None]) -> None:
        self.path = path
        self.dropped = 0
        """samples that are not in the log."""
        self.failed = False
        self._sink = sink
        self._complain = complain
        self._closed = False
        self._waiting: list[SampleBlock] = []
        self._flushed = time.monotonic()

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Errors here are the user's to mend before the start: they are not caught."""
        self._layout = layout
        self._sink.open(scene, layout)
        self._there = self.path.exists()  # a picture comes only with the end

    def write(self, block: SampleBlock) -> None:
        """Keep for the next batch, or count."""
        if self.failed:
            self.dropped += len(block)
            return
        self._waiting.append(block)
        late = time.monotonic() - self._flushed >= FLUSH_PERIOD
        if late or len(self._waiting) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Write what waits."""
        self._flushed = time.monotonic()
        if not self._waiting or self.failed:
            return
        batch = concatenate(self._waiting, self._layout)
        self._waiting = []
        try:
            self._sink.write(batch)
        except (OSError, RbSimError) as error:
            self.dropped += len(batch)
            self._fail(str(error))

    def check(self) -> None:
        """Write what waits; notice a file that was removed, where writing to it fails silently."""
        self.flush()
        if self._there and not self.failed and not self.path.exists():
            self._fail("it was removed")

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Finish the log; what was written so far is to be readable."""
        if self._closed:
            return
        self._closed = True
        self.flush()
        try:
            self._sink.close(summary)
        except (OSError, RbSimError) as error:
            if not self.failed:
                self._fail(str(error))

    def _fail(self, reason: str) -> None:
        self.failed = True
        reason = reason.splitlines()[0] if reason else "unknown error"
        self._complain(f"logging to {self.path} stopped, the simulation goes on: {reason}")
