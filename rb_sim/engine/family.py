"""Systems that differ only in numbers share their laws: the numbers that differ become inputs.

A law has the constants of its scene folded in, which is right for one scene and wrong for ten
thousand that differ in a mass.  A family is told of a few of them, finds which numbers differ, and
makes laws that take those as inputs; everything else stays folded in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from rb_sim.engine.inputs import on_inputs
from rb_sim.engine.places import (
    FREE,
    Place,
    cleared,
    fits,
    number_at,
    numbers,
    skeleton,
    with_numbers,
)
from rb_sim.graph.symbols import Graph


class Family:
    """The laws that all systems of one kind share.

    systems: a few that differ in every number that any of them may differ in. make: gives the laws
    of a system whose numbers at the given places are inputs.
    """

    def __init__(
        self, systems: Sequence[Any], make: Callable[[Any, tuple[Place, ...]], Any]
    ) -> None:
        first, *others = [cleared(system) for system in systems]
        shape = skeleton(first)
        alike = [system for system in others if skeleton(system) == shape]
        folded_in = dict(constants(first))
        self.places: tuple[Place, ...] = tuple(
            place
            for place, value in folded_in.items()
            if any(number_at(system, place) != value for system in alike)
        )
        given = {place for place, _ in numbers(first)} - folded_in.keys()
        self._pattern = with_numbers(first, dict.fromkeys((*given, *self.places), FREE))
        self.laws: Any = make(first, self.places)

    def has(self, system: Any) -> bool:
        """True for a system whose motion the shared laws describe."""
        return fits(cleared(system), self._pattern)


def constants(system: Any) -> Iterator[tuple[Place, float]]:
    """The floats of a system that a law folds in: those that are no inputs already."""
    return numbers(on_inputs(system, Graph()))
