"""The laws of a motion together with its derivatives by parameters: the variational equations.

With s = dy/dk for a number k of the scene, ds/dt = (df/dy) s + (df/dp) dp/dk.  Every law is
differentiated along s exactly, the way back to the manifold too, so that a method of fixed steps
gives the derivative of the very numbers that it gives (Hairer, Norsett & Wanner I, section I.14).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from rb_sim.engine.inputs import Inputs
from rb_sim.engine.laws import ReducedLaws
from rb_sim.engine.multibody_laws import MultiBodyLaws
from rb_sim.engine.places import Place
from rb_sim.graph.symbols import graph_of
from rb_sim.graph.tangent import tangent

Weighted = Sequence[tuple[float, Any]]
"""Systems with the weights that make of their numbers a derivative."""


def with_tangents(outputs: list[Any], n: int, given: int, count: int) -> list[Any]:
    """The outputs of a law and their derivatives along `count` directions.

    y: n coordinates, then n for each direction; p likewise, with `given` inputs. A law of a single
    number (a gap, a domain) stays as it is.
    """
    graph = graph_of(outputs)
    if len(outputs) == 1 or graph is None:
        return outputs
    extended = list(outputs)
    for k in range(1, count + 1):
        y, p = graph.vector("y", n), graph.vector("p", given)
        direction = dict(zip(y, graph.vector("y", n, k * n), strict=True))
        direction |= dict(zip(p, graph.vector("p", given, k * given), strict=True))
        extended += tangent(outputs, direction)
    return extended


class _Reduced(ReducedLaws):
    """The laws of one body with their derivatives."""

    given = directions = 0

    def traced(self, kernel: Callable[..., Sequence[Any]]) -> list[Any]:
        outputs = super().traced(kernel)
        return with_tangents(outputs, self.n, self.given, self.directions)


class _MultiBody(MultiBodyLaws):
    """The laws of N bodies with their derivatives."""

    given = directions = 0

    @cached_property
    def back(self) -> None:
        """None: its coordinates would not lie beside their derivatives, since it gives a number
        more."""

    def outputs(self, kernel: Callable[..., list[Any]]) -> list[Any]:
        return with_tangents(super().outputs(kernel), self.n, self.given, self.directions)


class TangentInputs:
    """The inputs of the laws and their derivatives.

    directions: for each number the systems beside the one that moves, with weights.
    """

    def __init__(self, inputs: Inputs, directions: Sequence[Weighted]) -> None:
        self._inputs, self._directions = inputs, directions

    def values(self, system: Any, t: float, onwards: bool = True) -> list[float]:
        """The inputs for the steps from t on, or for the instant t alone; then their derivatives.

        What is commanded from outside does not depend on the numbers of the scene.
        """
        found = self._inputs.values(system, t, onwards)
        for beside in self._directions:
            members = [(w, self._inputs.values(other, t, onwards)) for w, other in beside]
            found += [
                sum(w * values[i] for w, values in members) for i in range(len(members[0][1]))
            ]
        return found


class TangentLaws:
    """What loops call of a motion with its derivatives along some directions.

    Its coordinates are y and dy/dk for each direction, its samples likewise.
    """

    def __init__(
        self,
        laws: ReducedLaws | MultiBodyLaws,
        varied: Sequence[Place],
        directions: Sequence[Weighted],
    ) -> None:
        own: _Reduced | _MultiBody
        if isinstance(laws, MultiBodyLaws):
            own = _MultiBody(laws.system, laws.width, laws.redundant, varied, laws.dependent)
        else:
            own = _Reduced(laws.system, laws.n, laws.width, varied)
        own.directions = len(directions)
        own.given = len(own.inputs.values(own.system, 0.0))
        self._own = own
        copies = 1 + len(directions)
        self.n, self.width = copies * own.n, copies * own.width
        self.velocities = copies * own.velocities
        self.inputs = TangentInputs(own.inputs, directions)

    def __getattr__(self, name: str) -> Any:
        """rate, settle, gap, position, velocity, inside, sample of the laws below."""
        return getattr(self._own, name)

    def whole(self, step: Any, estimated: bool = True) -> None:
        """No step is one law: it would be long."""
        return None
