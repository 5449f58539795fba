"""A logger that may fail without stopping the simulation: full disk, vanished folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.errors import RbSimError

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene
    from rb_sim.sinks.sink import Sink


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

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Errors here are the user's to mend before the start: they are not caught."""
        self._sink.open(scene, layout)

    def write(self, block: SampleBlock) -> None:
        """Pass on, or count."""
        if self.failed:
            self.dropped += len(block)
            return
        try:
            self._sink.write(block)
        except (OSError, RbSimError) as error:
            self.dropped += len(block)
            self._fail(str(error))

    def check(self) -> None:
        """Notice a file that was removed while it is open: writing to it fails silently."""
        if not self.failed and not self.path.exists():
            self._fail("it was removed")

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Finish the log; what was written so far is to be readable."""
        if self._closed:
            return
        self._closed = True
        try:
            self._sink.close(summary)
        except (OSError, RbSimError) as error:
            if not self.failed:
                self._fail(str(error))

    def _fail(self, reason: str) -> None:
        self.failed = True
        reason = reason.splitlines()[0] if reason else "unknown error"
        self._complain(f"logging to {self.path} stopped, the simulation goes on: {reason}")
