# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Inputs of a traced law: the numbers of a system that change between steps or between runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rb_sim.catalogue.spec import CHANGING, Placed
from rb_sim.compiler.graph.symbols import Graph

# Places of numbers in a system: enumeration, access and replacement.


Place = tuple[int, ...]
"""Place of a number in a system: one index per level of nested tuples; the last may be into an
array."""


CLEARED: dict[type, Callable[[Any], Any]] = {}
"""Function of each system class with a workspace that returns the system with a zero workspace."""


def cleared(system: Any) -> Any:
    """The system with a zero workspace."""
    clear = CLEARED.get(type(system))
    return system if clear is None else clear(system)


def numbers(x: Any, place: Place = ()) -> Iterator[tuple[Place, float]]:
    """Every float in a system with its place."""
    if isinstance(x, float):
        yield place, float(x)
    elif isinstance(x, tuple):
        for i, entry in enumerate(x):
            yield from numbers(entry, (*place, i))
    elif isinstance(x, np.ndarray) and x.dtype.kind == "f":
        for i, entry in enumerate(x.ravel().tolist()):
            yield (*place, i), entry


def skeleton(x: Any) -> Any:
    """A system without its floats: classes, lengths, indices, shapes."""
    if isinstance(x, float):
        return float
    if isinstance(x, tuple):
        return type(x), tuple(skeleton(entry) for entry in x)
    if isinstance(x, np.ndarray):
        return x.shape, None if x.dtype.kind == "f" else x.tobytes()
    return x


def with_numbers(x: Any, values: Mapping[Place, Any]) -> Any:
    """The system with these values at their places; float arrays become arrays of objects."""
    if () in values:
        return values[()]
    heads = {place[0] for place in values}
    if isinstance(x, np.ndarray):
        table = x.astype(object)
        for (i,), value in values.items():
            table.flat[i] = value
        return table
    entries = list(x)
    for i in heads:
        below = {place[1:]: value for place, value in values.items() if place[0] == i}
        entries[i] = with_numbers(x[i], below)
    return x._make(entries) if hasattr(x, "_make") else tuple(entries)


FREE = object()
"""Wildcard for any number in a pattern."""


def fits(x: Any, pattern: Any) -> bool:
    """Whether a system equals the pattern, with any number at places marked FREE."""
    if pattern is FREE:
        return isinstance(x, float)
    if isinstance(pattern, tuple):
        if type(x) is not type(pattern) or len(x) != len(pattern):
            return False
        return all(fits(one, other) for one, other in zip(x, pattern, strict=True))
    if isinstance(pattern, np.ndarray):
        if not isinstance(x, np.ndarray) or x.shape != pattern.shape:
            return False
        if pattern.dtype == object:
            return all(map(fits, x.ravel().tolist(), pattern.ravel().tolist()))
        return x.dtype == pattern.dtype and bool((x == pattern).all())
    return isinstance(x, float) is isinstance(pattern, float) and bool(x == pattern)


def number_at(x: Any, place: Place) -> float:
    """The number at a place of a system."""
    for i in place:
        x = x.flat[i] if isinstance(x, np.ndarray) else x[i]
    return float(x)


# The inputs p of a traced law: all quantities of a system that change between steps, as one vector:
# commands, the current segment of tabulated wrenches, constants that depend on the initial state.


def _rows(system: Any) -> list[Any]:
    rows = [effect.row if isinstance(effect, Placed) else effect for effect in system.effects]
    return [*rows, *getattr(system, "spins", ())]


def _with_ends(system: Any) -> Iterator[tuple[Any, int, int]]:
    """(row or system, body, parent) of everything with inputs, in the order of the inputs."""
    for effect in system.effects:
        placed = effect if isinstance(effect, Placed) else Placed(effect, 0, -1)
        if type(placed.row) in CHANGING:
            yield placed.row, placed.body, placed.parent
    for x in (*getattr(system, "spins", ()), system):
        if type(x) in CHANGING:
            yield x, -1, -1


States = Callable[[int], Any]
"""Function: index of a body -> its state; -1 -> state of the world."""


def kept_inputs(system: Any) -> list[int]:
    """Indices of the inputs that are carried over from step to step."""
    found: list[int] = []
    at = 0
    for x, *_ in _with_ends(system):
        kind = CHANGING[type(x)]
        found += range(at, at + kind.count) if kind.next is not None else ()
        at += kind.count
    return found


def next_inputs(system: Any, inputs: Sequence[Any], state: States) -> list[Any]:
    """Inputs of the step that follows one with these inputs and ended in the states `state`."""
    found: list[Any] = []
    for x, body, parent in _with_ends(system):
        kind, at = CHANGING[type(x)], len(found)
        own = tuple(inputs[at : at + kind.count])
        if kind.next is not None:
            own = kind.next(kind.symbolic(x, own), state(body), state(parent))
        found += own
    return found


def with_kept(system: Any, values: Sequence[float]) -> Any:
    """The system with these values of the carried-over inputs, in their order."""
    left = iter(values)

    def taken(row: Any) -> Any:
        kind = CHANGING.get(type(row))
        if kind is None or kind.next is None:
            return row
        return kind.symbolic(row, tuple(next(left) for _ in range(kind.count)))

    effects = tuple(
        effect._replace(row=taken(effect.row)) if isinstance(effect, Placed) else taken(effect)
        for effect in system.effects
    )
    return system._replace(effects=effects)


def input_values(system: Any, t: float, onwards: bool = True) -> list[float]:
    """The inputs for steps from t on (`onwards`), or for the instant t alone."""
    changing = [x for x in (*_rows(system), system) if type(x) in CHANGING]
    return [value for x in changing for value in CHANGING[type(x)].values(x, t, onwards)]


def on_inputs(system: Any, graph: Graph) -> Any:
    """The system with symbols for its inputs, in the order of `input_values`."""
    at = 0

    def changed(x: Any) -> Any:
        nonlocal at
        kind = CHANGING.get(type(x))
        if kind is None:
            return x
        symbols = graph.vector("p", kind.count, at)
        at += kind.count
        return kind.symbolic(x, symbols)

    effects = tuple(
        effect._replace(row=changed(effect.row)) if isinstance(effect, Placed) else changed(effect)
        for effect in system.effects
    )
    if hasattr(system, "spins"):
        system = system._replace(spins=tuple(changed(spin) for spin in system.spins))
    return changed(system)._replace(effects=effects)


class Inputs:
    """Inputs of the laws of one system.

    varied: places in the system whose numbers are inputs as well (see rb_sim.mechanics.inputs).
    chosen: initial choice of rows (see rb_sim.mechanics.systems.elimination), the last inputs; it
    is made anew during the motion.
    """

    def __init__(self, varied: Sequence[Place] = (), chosen: Sequence[float] = ()) -> None:
        self.varied, self.chosen = tuple(varied), list(chosen)

    def values(self, system: Any, t: float, onwards: bool = True) -> list[float]:
        """The inputs for steps from t on (`onwards`), or for the instant t alone."""
        own = input_values(system, t, onwards)
        return own + [number_at(system, place) for place in self.varied] + self.chosen

    def kept(self, system: Any) -> list[int]:
        """Indices in `values` of inputs that are carried over from step to step, without
        `chosen`."""
        return kept_inputs(system)

    def next(self, system: Any, graph: Graph, state: States) -> list[Any]:
        """Symbols of the inputs of the next step, without `chosen`, after a step that ended in
        `state`."""
        count = len(input_values(system, 0.0))
        symbols = graph.vector("p", count + len(self.varied))
        return [*next_inputs(system, symbols, state), *symbols[count:]]

    def symbolic(self, system: Any, graph: Graph) -> Any:
        """The system with symbols for its inputs, in the order of `values`."""
        on_symbols = on_inputs(system, graph)
        first = len(input_values(system, 0.0))
        symbols = graph.vector("p", len(self.varied), first)
        places = dict(zip(self.varied, symbols, strict=True))
        return with_numbers(on_symbols, places) if places else on_symbols


# Systems that differ only in numbers share their laws: the differing numbers become inputs.
#
# A law contains the constants of its scene, which suits one scene but not ten thousand that differ
# in a mass. A family gets a few of them, finds the numbers that differ, and makes laws with these
# as inputs; all others stay constants.


class Family:
    """Laws shared by systems that differ only in numbers.

    systems: examples that differ in every number in which any member may differ. make: function
    that returns the laws of a system with the numbers at the given places as inputs.
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
        """Whether the shared laws hold for this system."""
        return fits(cleared(system), self._pattern)


def constants(system: Any) -> Iterator[tuple[Place, float]]:
    """The floats of a system that a law takes as constants: those that are not inputs."""
    return numbers(on_inputs(system, Graph()))
