"""The inputs p of a traced law: everything of a system that changes between steps, as one vector.

Commands, the present segment of tabulated wrenches, what a system keeps of its start.
"""

from __future__ import annotations

from typing import Any

from rb_sim.catalogue.types import CHANGING, Placed
from rb_sim.graph.symbols import Graph


def _rows(system: Any) -> list[Any]:
    return [effect.row if isinstance(effect, Placed) else effect for effect in system.effects]


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
    return changed(system)._replace(effects=effects)
