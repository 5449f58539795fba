"""Samples on their way from a simulation to whoever asked for them, looked at by all watches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

from rb_sim.finding import tell
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.watch_list import WatchList

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock
    from rb_sim.finding import Finding, GlobalError


class Watched:
    """Iterates over blocks of samples and keeps what the watches find in them.

    simulation: whose samples they are; its effort is asked for as they come. blocks: of samples in
    time. From a reset, or a state that was set, on the watches begin anew, for it is another run.
    """

    def __init__(self, simulation: Any, blocks: Iterable[SampleBlock]) -> None:
        self._simulation, self._blocks = simulation, blocks
        self._watches = self._new()
        self._found: list[Finding] = []
        self._before: tuple[Finding, ...] = ()
        """of runs before the last reset."""

    def __iter__(self) -> Iterator[SampleBlock]:
        try:
            for block in self._blocks:
                if any(given.state for given in block.inputs):
                    self._end()
                    self._watches = self._new()
                else:
                    self._watches.add(block, partial(effort_of, self._simulation))
                yield block
        finally:
            self._end()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What has passed its bound, by time; whole once the blocks have come to their end."""
        return tuple(self._found)

    def check(self, error: GlobalError) -> None:
        """Add what the second run shows."""
        self._watches.check(error, self._simulation)
        self._found = [*self._before, *self._watches.findings]

    def warn(self, stacklevel: int = 2) -> None:
        """Give a Python warning for each finding, at the caller of the function that calls this."""
        tell((), self._found, stacklevel + 1)

    def _new(self) -> WatchList:
        of = self._simulation
        return WatchList(of.scene, of.layout, of.compiled)

    def _end(self) -> None:
        self._watches.finish()
        self._before = tuple(self._found)
        self._found += self._watches.findings
