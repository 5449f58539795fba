"""Pairs of bodies that move by so little relative to each other that where they are leaves it few
digits, however far they go together.

An error is held to tolerance * max(1, |y|), or where the pair is followed (engine.relative_motions)
to its own motion; but a place far from the origin rounds to

    eps |p|,

which no tolerance makes less. Looked at are the distances that change at the start by more than
rounding makes of them; of others a change would be nothing but error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.engine.relative_motions import Pair, parting
from rb_sim.engine.small_motions import rate_of
from rb_sim.engine.systems.many_bodies import MultiBody
from rb_sim.finding import Finding
from rb_sim.sinks.frames import norms
from rb_sim.watches.little import FEW, bound_of

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock
    from rb_sim.scene.compiled import Compiled
    from rb_sim.watches.bounds import Effort

ROUNDINGS = 16.0 * float(np.finfo(float).eps)
"""Of where a body is: what rounding makes of a distance in some hundred steps."""


def pairs_that_part(compiled: Compiled | None) -> tuple[Pair, ...]:
    """A body and its parent of the scene whose distance changes at the start; none of bodies in
    contact, which have no law but between events."""
    if compiled is None or compiled.contact_laws or not isinstance(compiled.system, MultiBody):
        return ()
    laws: Any = compiled.laws
    inputs = np.array([*laws.inputs.values(compiled.system, 0.0), 0.0])
    y = np.array(compiled.y, dtype=float)
    return parting(rate_of(laws, inputs), y, compiled.system)


class LittleBetween:
    """How far the distances of pairs have changed in the samples so far."""

    def __init__(self, compiled: Compiled | None) -> None:
        self._compiled = compiled
        self._pairs: Array | None = None
        self._low = self._high = self._far = np.zeros(0)
        self.watching = True
        """whether one of them has changed by little so far."""

    def add(self, block: SampleBlock, effort: Effort) -> None:
        """The next samples that are looked at."""
        if not self.watching or not effort.local:
            return
        if self._pairs is None:
            self._pairs = np.array(pairs_that_part(self._compiled), dtype=int).reshape(-1, 2)
            self._low, self._high, self._far = np.zeros((3, len(self._pairs)))
            self._low += np.inf
        bodies, parents = (block.position[:, ends] for ends in self._pairs.T)
        distances = norms(bodies - parents)
        self._low = np.minimum(self._low, distances.min(axis=0))
        self._high = np.maximum(self._high, distances.max(axis=0))
        self._far = np.maximum(self._far, norms(bodies).max(axis=0))
        kept = self._high - self._low < effort.local * np.maximum(1.0, self._far) / FEW
        self._pairs, self._low = self._pairs[kept], self._low[kept]
        self._high, self._far = self._high[kept], self._far[kept]
        self.watching = bool(len(self._pairs))

    def found(self, t: float, effort: Effort, bodies: tuple[str, ...]) -> Finding | None:
        """The pair whose distance has changed by little up to t, most of all for its errors."""
        if not self.watching or self._pairs is None:
            return None
        few = bound_of(effort)
        worst: tuple[float, str, str] | None = None
        sizes = zip(self._pairs.tolist(), self._high - self._low, self._far, strict=True)
        for (body, parent), way, far in sizes:
            rounded = ROUNDINGS * far
            followed = {bodies[body], bodies[parent]} <= effort.held
            allowed = 0.0 if followed else effort.local * max(1.0, far)
            figure = float(max(rounded, allowed) / way) if way > 0.0 else 0.0
            if figure > few and way > rounded / 16.0 and (worst is None or figure > worst[0]):
                tight = f"try a tolerance below {few * effort.local / figure:.0e}"
                near = f"places {far:.3g} m from the origin round off; try one that goes along"
                names = f"{bodies[body]} beside {bodies[parent]}"
                worst = figure, names, tight if rounded <= few * way else near
        if worst is None:
            return None
        figure, names, advice = worst
        what = "error of a step, over all that the distance of two bodies changes,"
        return Finding("little motion", t, figure, few, what, names, advice)
