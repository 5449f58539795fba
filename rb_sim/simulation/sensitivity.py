# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A simulation that carries the derivatives of its motion with respect to numbers of the scene.

They are exact along the motion (variational equations). The initial state and the constants of the
laws depend on the numbers by a short calculation specific to each scene; its derivative is taken by
central differences of order six, with an error below 1e-11.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.compiler.graph.derivative import tangent
from rb_sim.compiler.graph.symbols import graph_of
from rb_sim.mechanics.compiled import Compiled, family_of
from rb_sim.mechanics.inputs import Family, Inputs, Place
from rb_sim.mechanics.laws import ReducedLaws
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.samples import Array, SampleBlock, block_of, row_width
from rb_sim.motion.traced import TracedMotion
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.schema import Scene
from rb_sim.simulation.simulation import Simulation
from rb_sim.simulation.state_override import Placement

# The laws of a motion with its derivatives by parameters: the variational equations.
#
# With s = dy/dk for a number k of the scene, ds/dt = (df/dy) s + (df/dp) dp/dk. Every law is
# differentiated exactly along s, including the projection onto the manifold, so that a method of
# fixed steps gives the exact derivative of its own results (Hairer, Norsett & Wanner I, section
# I.14).


Weighted = Sequence[tuple[float, Any]]
"""(weight, system) pairs whose weighted numbers sum up to a derivative."""


def with_tangents(outputs: list[Any], n: int, given: int, count: int) -> list[Any]:
    """The outputs of a law and their derivatives along `count` directions.

    y: n coordinates, then n for each direction; p likewise, with `given` inputs. A law of a single
    number (a gap, a domain) stays unchanged.
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
    """The laws of one body, with their derivatives."""

    given = directions = 0

    def traced(self, kernel: Callable[..., Sequence[Any]]) -> list[Any]:
        outputs = super().traced(kernel)
        return with_tangents(outputs, self.n, self.given, self.directions)


class _MultiBody(MultiBodyLaws):
    """The laws of N bodies, with their derivatives."""

    given = directions = 0

    @cached_property
    def back(self) -> None:
        """None: this law returns one more number, which would separate coordinates and
        derivatives."""

    def outputs(self, kernel: Callable[..., list[Any]]) -> list[Any]:
        return with_tangents(super().outputs(kernel), self.n, self.given, self.directions)


class TangentInputs:
    """The inputs of the laws and their derivatives.

    directions: for each number of the scene the neighbouring systems, with weights.
    """

    def __init__(self, inputs: Inputs, directions: Sequence[Weighted]) -> None:
        self._inputs, self._directions = inputs, directions

    def kept(self, system: Any) -> list[int]:
        """Indices of inputs that are carried over from step to step, without derivatives."""
        return self._inputs.kept(system)

    def values(self, system: Any, t: float, onwards: bool = True) -> list[float]:
        """The inputs for steps from t on (`onwards`), or for the instant t alone; then their
        derivatives.

        Commands do not depend on the numbers of the scene.
        """
        found = self._inputs.values(system, t, onwards)
        for beside in self._directions:
            members = [(w, self._inputs.values(other, t, onwards)) for w, other in beside]
            found += [
                sum(w * values[i] for w, values in members) for i in range(len(members[0][1]))
            ]
        return found


def with_directions(
    laws: ReducedLaws | MultiBodyLaws, varied: Sequence[Place], directions: int
) -> _Reduced | _MultiBody:
    """The laws with their derivatives along as many directions."""
    own: _Reduced | _MultiBody
    if isinstance(laws, MultiBodyLaws):
        own = _MultiBody(laws.system, laws.width, laws.redundant, varied, laws.dependent)
    else:
        own = _Reduced(laws.system, laws.n, laws.width, varied)
    own.directions = directions
    own.given = len(own.inputs.values(own.system, 0.0))
    return own


class TangentLaws:
    """The laws of a motion with its derivatives along some directions, as loops call them.

    Its coordinates are y and dy/dk for each direction, its samples likewise.
    """

    def __init__(self, own: _Reduced | _MultiBody, directions: Sequence[Weighted]) -> None:
        self._own = own
        copies = 1 + len(directions)
        self.n, self.width = copies * own.n, copies * own.width
        self.velocities, self.carried = copies * own.velocities, copies * own.carried
        self.inputs = TangentInputs(own.inputs, directions)

    def __getattr__(self, name: str) -> Any:
        """rate, project, gap, position, velocity, inside, sample of the underlying laws."""
        return getattr(self._own, name)

    def whole(self, step: Any, estimated: bool = True) -> None:
        """None: as one law a step would be too long."""
        return None


STEP = 1e-2
"""Step of the differences, relative to the scales of the numbers."""

SIXTH = {-3: -1 / 60, -2: 3 / 20, -1: -3 / 4, 1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
"""Weights of a first derivative over a step of 1: of order six, and of order four."""
FOURTH = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}

SMOOTH = 1e-5
"""Difference between both orders, relative to the largest derivative, above which a dependence is
not smooth."""

CARRIED = ("dopri853", "rk4", "euler")
"""Methods that can carry derivatives; dopri853 replaces others."""
TOLERANCE = 1e-10
"""Largest tolerance of dopri853 if it replaces another method."""


class NotSmoothError(RbSimError):
    """The motion has no derivatives that can be carried; the text gives the reason."""


class TangentSimulation(Simulation):
    """A simulation of scene_at(x) with the derivatives of its samples by the numbers x.

    scene_at: scenes that differ only in numbers. scales: of each number; scenes within 3 percent of
    it must be valid. like: one of the same scenes and numbers, whose laws need not be traced again.

    Raises NotSmoothError without derivatives: contacts, instants of the scene that depend on the
    numbers, a start that does not depend on them smoothly, laws without a derivative.
    """

    _is_trial = True

    def __init__(
        self,
        scene_at: Callable[[Array], Scene],
        x: Array,
        scales: Sequence[float],
        like: TangentSimulation | None = None,
    ) -> None:
        x, self.scales = np.array(x, dtype=float), np.abs(np.array(scales, dtype=float))
        scene = carried(scene_at(x))
        compiled = compile_scene(scene)
        self._beside = [_beside(scene_at, x, k, STEP * self.scales[k]) for k in range(len(x))]
        members = [compiled, *(c for by_offset in self._beside for c in by_offset.values())]
        if like is not None and _holds(like.family, members):
            self.family, self._laws = like.family, like._laws
        else:
            self.family = family = _family(members)
            self._laws = with_directions(family.laws, family.places, len(x))
        super().__init__(scene, announce=None, family=self.family)
        self._rows: list[Array] = []
        self._carry(compiled)

    def _carry(self, compiled: Compiled) -> None:
        """Replace the motion by the motion with derivatives."""
        directions, starts = [], [np.array(compiled.y, dtype=float)]
        for k, by_offset in enumerate(self._beside):
            h = STEP * self.scales[k]
            directions.append([(SIXTH[j] / h, c.system) for j, c in by_offset.items()])
            starts.append(_derivative({j: np.array(c.y, float) for j, c in by_offset.items()}, h))
            inputs = {
                j: np.array(self.family.laws.inputs.values(c.system, 0.0))
                for j, c in by_offset.items()
            }
            _derivative(inputs, h)  # checks that it is smooth
        y = np.concatenate(starts)
        extended = replace(compiled, y=tuple(y.tolist()) if compiled.reduced else y)
        laws = TangentLaws(self._laws, directions)
        extended.__dict__["laws"] = laws  # cached_property looks there
        try:
            motion = TracedMotion(extended, self.method)
            motion.width = laws.width
            motion.warm()
        except TypeError as error:
            raise NotSmoothError(f"sensitivities: {error}") from None
        self.compiled = extended
        self._motion = self._first = motion  # a reset returns to it

    def set_state(self, bodies: Mapping[str, Placement], *, project: bool = False) -> None:
        """Raises NotSmoothError: a motion from a state that was set has no derivatives."""
        raise NotSmoothError("sensitivities: a state was set during the run")

    def _block(self, t: Array, out: Array) -> SampleBlock:
        self._rows.append(out.copy())
        return super()._block(t, out[:, : row_width(self.layout)])

    def take_derivatives(self, count: int | None = None) -> list[SampleBlock]:
        """Derivatives of the samples since the last call with respect to each number, per its unit.

        count: of the first samples only.
        """
        rows, width = np.concatenate(self._rows)[:count], row_width(self.layout)
        self._rows = []
        command = np.zeros((len(rows), len(self.layout.commanded), 6))
        return [
            block_of(
                np.zeros(len(rows)), rows[:, k * width : (k + 1) * width], self.layout, command
            )
            for k in range(1, len(self.scales) + 1)
        ]


def carried(scene: Scene) -> Scene:
    """The scene with a method that can carry derivatives."""
    options = scene.simulation
    if options.method in CARRIED:
        return scene
    tolerance = min(TOLERANCE, options.tolerance or TOLERANCE)
    return scene.with_options(method="dopri853", tolerance=tolerance, step=None)


def _beside(scene_at: Callable[[Array], Scene], x: Array, k: int, h: float) -> dict[int, Compiled]:
    """The compiled scenes on both sides of x along number k, by their distance in steps of h."""
    found = {}
    for j in SIXTH:
        moved = x.copy()
        moved[k] += j * h
        try:
            scene = scene_at(moved)
            found[j] = compile_scene(carried(scene))
        except SceneError as error:
            raise NotSmoothError(
                f"sensitivities: a neighbouring scene is invalid: {error}"
            ) from None
        settings = changed_settings(scene_at(x), scene)
        if settings:
            raise NotSmoothError(f"sensitivities: {settings} depends on the numbers")
    return found


def changed_settings(one: Scene, other: Scene) -> str:
    """The first key of `simulation` that differs between the scenes; "" if none does.

    Such keys determine the sample times, on which the motion has no derivative.
    """
    a, b = one.simulation.model_dump(), other.simulation.model_dump()
    return next((f"simulation.{key}" for key in a if a[key] != b[key]), "")


def _at_the_same_instants(members: list[Compiled]) -> bool:
    return all(member.breakpoints == members[0].breakpoints for member in members)


def _holds(family: Family, members: list[Compiled]) -> bool:
    """Whether the scenes are of this family."""
    return _at_the_same_instants(members) and all(family.has(m.system) for m in members)


def _family(members: list[Compiled]) -> Family:
    """The family of the scenes. Raises NotSmoothError if they are not of one kind."""
    first = members[0]
    if not _at_the_same_instants(members):
        raise NotSmoothError("sensitivities: instants of the scene depend on the numbers")
    family = family_of(members)
    if family is None or first.laws is None:
        raise NotSmoothError("sensitivities: the scene has contacts")
    if not _holds(family, members):
        raise NotSmoothError("sensitivities: the kind of the scene depends on the numbers")
    return family


def _derivative(values: dict[int, Array], h: float) -> Array:
    """The derivative from values at distances j h. Raises NotSmoothError if it is not smooth."""
    sixth = np.sum([SIXTH[j] * values[j] for j in SIXTH], axis=0) / h
    fourth = np.sum([FOURTH[j] * values[j] for j in FOURTH], axis=0) / h
    floor = 1e-14 * max(np.abs(values[1]).max(initial=0.0), 1e-300) / h
    if np.abs(sixth - fourth).max(initial=0.0) > SMOOTH * np.abs(sixth).max(initial=0.0) + floor:
        raise NotSmoothError("sensitivities: the start does not depend smoothly on the numbers")
    return sixth
