"""What a sink is, and how its samples follow each other through resets and restarts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from rb_sim.base.errors import SinkError
from rb_sim.mechanics.samples import ARRAYS, Input, SampleBlock

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleLayout
    from rb_sim.scene.schema import Scene


# The sink: where samples go. Three calls; every logger, topic set and recorder is one.


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


def check_ending(path: Path | None, ending: str) -> None:
    """Refuse a file name with another ending. Raises SinkError."""
    if path is not None and path.suffix != ending:
        raise SinkError(f"{path}: the name must end in {ending}")


# A time that never goes back, for logs of a simulation that may be reset.


class Timeline:
    """Simulated time that goes on from where it was when the simulation was set back."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._offset = 0.0

    @property
    def offset(self) -> float:
        """What is added to times by now [s]."""
        return self._offset

    def follow(self, t: Array) -> Array:
        """The times `t` [s] of the next samples, shifted so that they never decrease."""
        if not len(t):
            return t
        steps = np.diff(t, prepend=t[0] if self._last is None else self._last)
        offsets = self._offset + np.cumsum(np.maximum(0.0, -steps))
        self._last, self._offset = float(t[-1]), float(offsets[-1])
        return t + offsets


# Where a run of ours begins anew: no motion leads from the sample before to the one after.


def restarts(inputs: tuple[Input, ...]) -> list[tuple[int, Input]]:
    """The last reset or state that was set before each sample that has one before it."""
    return list({given.index: given for given in inputs if not given.body or given.state}.items())


def stretches(block: SampleBlock) -> Iterator[tuple[SampleBlock, Input | None]]:
    """The parts of a block, each with the reset or state that was set before it, if any was."""
    done, before, left = 0, None, block
    for index, given in restarts(block.inputs):
        if index > done:
            part, left = split_at(left, index - done)
            yield part, before
            done = index
        before = given
    yield left, before


def split_at(block: SampleBlock, size: int) -> tuple[SampleBlock, SampleBlock]:
    """The first `size` > 0 samples, and the rest; events go with the sample they come before."""
    first, rest = _slice(block, slice(None, size)), _slice(block, slice(size, None))
    end = first.t[-1] if len(rest) else np.inf
    before = tuple(event for event in block.events if event.t <= end)
    now = tuple(given for given in block.inputs if given.index < size)
    later = tuple(g._replace(index=g.index - size) for g in block.inputs[len(now) :])
    return (
        replace(first, events=before, inputs=now),
        replace(rest, events=block.events[len(before) :], inputs=later),
    )


def _slice(block: SampleBlock, which: slice) -> SampleBlock:
    arrays = {name: getattr(block, name)[which] for name in ARRAYS}
    return replace(block, **arrays, events=(), inputs=())
