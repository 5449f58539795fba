# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The laws of a system, traced: what loops call by address.

The kernels of the systems run once on symbols; where they only give back what they got (nothing
to settle, no domain to leave), there is no law to call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from rb_sim.graph.derivative import PlainColumns, compile_columns, jacobian
from rb_sim.graph.functions import where
from rb_sim.graph.machine import Law, PlainLaw, compile_law
from rb_sim.graph.symbols import Graph, Symbol, operations
from rb_sim.graph.table_program import PlainProgram
from rb_sim.graph.taylor_code import SeriesLaws
from rb_sim.mechanics.inputs import Inputs, Place
from rb_sim.mechanics.system import CONFIGURATION, EVENT_DRIVEN, inside, rate, sample, settle
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.mechanics.systems.translation import GuidedLaws, ways
from rb_sim.mechanics.taylor_variables import Variables, variables_of
from rb_sim.numerics.kernels import Step

CompiledLaws = Law | PlainLaw | PlainColumns | PlainProgram


def reference(law: CompiledLaws | None) -> Any:
    """A loop calls this: the address, or the Python function; 0 where there is no law."""
    if law is None:
        return 0
    return law.address if isinstance(law, Law) else law


def domain_law(within: Any) -> CompiledLaws | None:
    """One number, 0 once `within` is false; None where it never is."""
    return None if within is True else compile_law([where(within, 1.0, 0.0)])


BY_ENTRIES = 400
"""Operations of dy/dt up to which its Jacobian is one law; of longer ones, whose code would be many
times as long, it is found by columns."""

WHOLE = 4600
"""Operations up to which a whole step is one law: it saves the calls and the loops between."""


class ReducedLaws(GuidedLaws):
    """The laws of one body in reduced coordinates.

    system: with its constants. n: coordinates. width: numbers of a sample. varied: places of
    constants that are inputs.
    """

    def __init__(self, system: Any, n: int, width: int, varied: Sequence[Place] = ()) -> None:
        self.system, self.n, self.width = system, n, width
        self.inputs = Inputs(varied)
        self._whole: dict[tuple[Step, bool], CompiledLaws | None] = {}

    @property
    def velocities(self) -> list[float]:
        """1 for each coordinate that is a velocity, else 0."""
        first = CONFIGURATION[type(self.system)]
        return [0.0 if i < first else 1.0 for i in range(self.n)]

    def traced(self, kernel: Callable[..., Sequence[Any]]) -> list[Any]:
        """The outputs of kernel(system, t, y) on symbols of a new graph."""
        graph = Graph()
        system = self.inputs.symbolic(self.system, graph)
        return list(kernel(system, graph.input("t"), graph.vector("y", self.n)))

    @cached_property
    def rate(self) -> CompiledLaws | None:
        """dy/dt."""
        return compile_law(self.traced(rate))

    @cached_property
    def jacobian(self) -> CompiledLaws:
        """d(dy/dt)/dy by rows, n n numbers."""
        if self._rate_operations > BY_ENTRIES:
            return compile_columns(self.traced(rate), self.n)
        return compile_law(self.traced(lambda system, t, y: dense(list(rate(system, t, y)), y)))

    @cached_property
    def series(self) -> SeriesLaws:
        """The Taylor series of y, or of the variables."""
        own = self.variables
        return SeriesLaws(self.traced(rate) if own is None else own.rates)

    @cached_property
    def variables(self) -> VariableLaws | None:
        """Variables that have a cheaper series than y, as those of every system of a family."""
        known = None if self.inputs.varied else variables_of(self.system)
        return None if known is None else VariableLaws(self, known)

    @cached_property
    def settle(self) -> CompiledLaws | None:
        """y brought back to where it belongs."""
        outputs = self.traced(settle)
        if all(is_coordinate(x, i) for i, x in enumerate(outputs)):
            return None
        return compile_law(outputs)

    def whole(self, step: Step, estimated: bool = True) -> CompiledLaws | None:
        """A step of this method as one law; None where it would be long.

        y is a row of `integrate.loop`: coordinates and carry; the last input is the step's length.
        estimated: the error is wanted; fixed steps go without, which is a third of dopri853.
        """
        key = step, estimated
        if key not in self._whole:
            self._whole[key] = self._whole_step(step, estimated)
        return self._whole[key]

    def _whole_step(self, step: Step, estimated: bool) -> CompiledLaws | None:
        if step.traced is None or self._rate_operations * step.stages > WHOLE:
            return None
        graph = Graph()
        system, n = self.inputs.symbolic(self.system, graph), self.n
        t, y, carry = graph.input("t"), graph.vector("y", n), graph.vector("y", n, n)
        h = graph.input("p", len(self.inputs.values(self.system, 0.0)))
        dy, error = step.traced(lambda t, y: rate(system, t, y), t, y, h, self.velocities)
        change = [a + b for a, b in zip(dy, carry, strict=True)]
        moved = tuple(a + b for a, b in zip(y, change, strict=True))
        rest = [c - (b - a) for a, b, c in zip(y, moved, change, strict=True)]
        settled = settle(system, t + h, moved)
        outputs = [*settled, *rest, sum(settled[1:], settled[0])]
        outputs += [error] if estimated else []
        return compile_law(outputs) if operations(outputs) <= WHOLE else None

    @cached_property
    def _rate_operations(self) -> int:
        return operations(self.traced(rate))

    @cached_property
    def inside(self) -> CompiledLaws | None:
        """One number, 0 once the state has left the system's domain."""
        (output,) = self.traced(lambda system, t, y: [inside(system, y)])
        return domain_law(output)

    @cached_property
    def carried(self) -> int:
        """How many of the inputs, the last but that of the step's length, `choice` gives."""
        return len(self.inputs.values(self.system, 0.0)) if self.inputs.kept(self.system) else 0

    @cached_property
    def choice(self) -> CompiledLaws | None:
        """The inputs of the next step, where laws keep something from step to step."""
        if not self.carried:
            return None

        def kernel(system: Any, t: Any, y: Any) -> list[Any]:
            out: list[Any] = [0.0] * self.width
            sample(system, t, y, out)  # which begins with the state of the body
            return self.inputs.next(self.system, y[0].graph, lambda body: state_of(out, body))

        return compile_law(self.traced(kernel))

    @cached_property
    def along(self) -> CompiledLaws | None:
        """The parameter of each spline and its rate."""
        return (
            compile_law(self.traced(lambda system, t, y: ways(system, y))) if self.splines else None
        )

    @cached_property
    def sample(self) -> CompiledLaws | None:
        """Everything that is reported at one instant."""

        def outputs(system: Any, t: Any, y: Any) -> list[Any]:
            out: list[Any] = [0.0] * self.width
            sample(system, t, y, out)
            return out

        return compile_law(self.traced(outputs))


class VariableLaws:
    """The laws of variables z in which the series is cheaper: z at the start, dz/dt, and the change
    of y from y, z and the change of z."""

    def __init__(self, laws: ReducedLaws, known: Variables) -> None:
        graph, n, m = Graph(), laws.n, known.count
        system = laws.inputs.symbolic(laws.system, graph)
        y, z, dz = (graph.vector("y", *at) for at in ((n, 0), (m, n), (m, n + m)))
        self.rates = list(known.rates(system, graph.vector("y", m)))
        self.rate = compile_law(self.rates)
        self.begin = compile_law(list(known.begin(system, y)))
        self.end = compile_law(list(known.change(system, y, z, dz)))


def dense(outputs: Sequence[Any], y: Sequence[Any]) -> list[Any]:
    """The Jacobian of the outputs by y, row by row."""
    sparse = jacobian(outputs, y)
    full: list[Any] = [0.0] * (len(outputs) * len(y))
    for i, j, value in zip(sparse.rows, sparse.columns, sparse.values, strict=True):
        full[i * len(y) + j] = value
    return full


def is_coordinate(x: Any, i: int) -> bool:
    """Whether x is the symbol of coordinate i, unchanged."""
    return isinstance(x, Symbol) and x.op == "y" and x.operands[0] == i


def traceable(system: Any) -> bool:
    """False for what events cut into pieces, which has laws of its own (contact.system.laws)."""
    return type(system) not in EVENT_DRIVEN
