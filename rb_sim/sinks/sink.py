"""The sink: where samples go. Three calls; every logger, topic set and recorder is one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


class Sink(Protocol):
    """Receives the samples of one run in time order."""

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Called once before the first sample."""
        ...

    def write(self, block: SampleBlock) -> None:
        """Called with every block of samples, in time order."""
        ...

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Called once more after errors and signals too; idempotent.

        What was written so far must be readable afterwards.
        """
        ...
