"""The inputs p of a traced law: everything of a system that changes between steps, as one vector.

Commands, the present segment of tabulated wrenches, what a system keeps of its start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rb_sim.catalogue.types import CHANGING, Placed
from rb_sim.engine.places import Place, number_at, with_numbers
from rb_sim.graph.symbols import Graph


def _rows(system: Any) -> list[Any]:
    rows = [effect.row if isinstance(effect, Placed) else effect for effect in system.effects]
    return [*rows, *getattr(system, "spins", ())]


def input_values(system: Any, t: float, onwards: bool = True) -> list[float]:
    """The inputs for the steps from t on, or for the instant t alone."""
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
    """How the laws of one system take what is not constant in them.

    varied: places in the system whose numbers are inputs as well (see rb_sim.engine.family).
    chosen: the choice of lines that the motion starts with (see rb_sim.engine.systems.choice), the
    last of the inputs; whoever steps makes it anew on the way.
    """

    def __init__(self, varied: Sequence[Place] = (), chosen: Sequence[float] = ()) -> None:
        self.varied, self.chosen = tuple(varied), list(chosen)

    def values(self, system: Any, t: float, onwards: bool = True) -> list[float]:
        """The inputs for the steps from t on, or for the instant t alone."""
        own = input_values(system, t, onwards)
        return own + [number_at(system, place) for place in self.varied] + self.chosen

    def symbolic(self, system: Any, graph: Graph) -> Any:
        """The system with symbols for its inputs, in the order of `values`."""
        on_symbols = on_inputs(system, graph)
        first = len(input_values(system, 0.0))
        symbols = graph.vector("p", len(self.varied), first)
        places = dict(zip(self.varied, symbols, strict=True))
        return with_numbers(on_symbols, places) if places else on_symbols
