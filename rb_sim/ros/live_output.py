"""A log beside a running node: gets samples in batches.

A batch costs a log little more than one sample does. What waits is written at the latest
FLUSH_PERIOD after the batch before, and at the end.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.cli.outputs import Output, Say
from rb_sim.engine.samples import concatenate

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene
    from rb_sim.sinks.sink import Sink

BATCH = 256
"""Samples."""
FLUSH_PERIOD = 0.2
"""[s] of wall time."""


class LiveOutput(Output):
    """An Output that may be written sample by sample; `flush` while nothing is written."""

    def __init__(self, sink: Sink, path: Path, say: Say) -> None:
        super().__init__(sink, path, say)
        self._waiting: list[SampleBlock] = []
        self._flushed = time.monotonic()

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Errors here are for the user to mend before the start: they are not caught."""
        self._layout = layout
        super().open(scene, layout)

    def write(self, block: SampleBlock) -> None:
        """Keep for the next batch."""
        self._waiting.append(block)
        if len(self._waiting) >= BATCH or time.monotonic() - self._flushed >= FLUSH_PERIOD:
            self.flush()

    def flush(self) -> None:
        """Write what waits."""
        self._flushed = time.monotonic()
        if self._waiting:
            batch = concatenate(self._waiting, self._layout)
            self._waiting = []
            super().write(batch)

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Finish the file; what was written so far is to be readable."""
        self.flush()
        super().close(summary)
