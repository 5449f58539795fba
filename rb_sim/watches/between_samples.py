"""What a motion does between two samples: some taken closer, on the way ahead.

Of an oscillation sampled once a period all samples are alike: it seems to exchange no energy, so
that a rounding of its balance is all there is, and to move by nothing but the errors of a step.
Nothing among them tells that; so where a watch is about to speak of one of these, the motion is
followed for some intervals by another one beside it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock
    from rb_sim.watches.bounds import Effort

INTERVALS = 6
"""Between samples, that are looked at."""

CLOSER = 64
"""Samples in place of one."""


def closer_samples(block: SampleBlock, effort: Effort) -> SampleBlock | None:
    """Samples CLOSER times as close as those of the block, from its end on; None where there are
    none to be had.  effort: of the run, which stands at the end of the block."""
    if effort.ahead is None or len(block) < 2:
        return None
    interval = float(block.t[-1] - block.t[0]) / (len(block) - 1)
    return effort.ahead(INTERVALS * interval, INTERVALS * CLOSER)
