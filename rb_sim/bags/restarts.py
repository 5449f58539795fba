"""Where a run of ours begins anew: no motion leads from the sample before to the one after."""

from __future__ import annotations

from rb_sim.engine.samples import Input


def restarts(inputs: tuple[Input, ...]) -> list[tuple[int, Input]]:
    """The last reset or state that was set before each sample that has one before it."""
    return list({given.index: given for given in inputs if not given.body or given.state}.items())
