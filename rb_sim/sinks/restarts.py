"""Where a run of ours begins anew: no motion leads from the sample before to the one after."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rb_sim.engine.samples import ARRAYS, Input, SampleBlock


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
