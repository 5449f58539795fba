"""The conditions on which a function branches while it runs on symbols."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rb_sim.graph.symbols import Condition


class Path:
    """One way through a function that branches on symbols: what its conditions were taken to be."""

    def __init__(self, given: list[tuple[Condition, bool]]) -> None:
        self.decisions = list(given)
        """in the order in which they were asked, each condition once."""
        self._known = {condition.number: value for condition, value in given}

    def taken(self, condition: Condition) -> bool:
        """Whether the condition holds on this way; True where it has not been asked yet."""
        if condition.number not in self._known:
            self._known[condition.number] = True
            self.decisions.append((condition, True))
        return self._known[condition.number]
