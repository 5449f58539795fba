"""Bodies that move by so little that the tolerance, which has a unit, leaves them few digits.

An error is held to tolerance * max(1, |y|) where nothing says how far the body goes (commands, laws
of the time, contacts); see engine.small_motions for where something does. What is put on the floor
by numbers of ten digits settles by an ulp of those, which nobody asks for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.finding import Finding
from rb_sim.sinks.frames import norms

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock
    from rb_sim.scene.schema import Scene
    from rb_sim.watches.bounds import Effort

FEW = 1e-3
"""Error of a step over the whole motion of a body above which the motion has two digits or fewer:
what is lost in a run is up to ten times as much."""

ASKED = 3.0
"""Times the tolerance up to which the same is what was asked for: of a motion of a third of a metre
or more a tolerance of 1e-3 leaves three digits by its own words."""

AT_REST, SETTLED = 1e-12, 1e-9
"""Motion [m, rad], or of where the body is, below which it is that of rounding, and of bodies in
contact that have come to rest that of settling."""

STANDS = 1e-2
"""Share of its whole motion that a body which has settled still makes in the later half of the last
samples: what swings makes all of it again, or goes on."""

BESIDE = 1e-2
"""Share of the larger of a body's way and turn below which the other, as of a body that turns about
its own centre, may be nothing but error."""


def bound_of(effort: Effort) -> float:
    """Error of a step over the whole motion above which it is told."""
    return max(FEW, ASKED * effort.local)


class Little:
    """How far each body of a scene has moved and turned in the samples so far."""

    def __init__(self, scene: Scene) -> None:
        specs: list[Any] = [s for s in scene.constraints.values() if s.type == "contact"]
        self._settling = {name for s in specs for name in (s.body, s.parent)}
        self._low: Array | None = None
        self._high: Array | None = None
        self._late: Array | None = None
        """of each body its motion in the later half of the last samples [m, rad], (n,)."""
        self.watching = True
        """whether one of the bodies has moved by little so far."""

    def add(self, block: SampleBlock, effort: Effort) -> None:
        """The next samples that are looked at."""
        if not self.watching or not effort.local:
            return
        poses = np.concatenate((block.position, 2.0 * block.orientation), axis=2)
        low, high = poses.min(axis=0), poses.max(axis=0)
        if self._low is not None and self._high is not None:
            low, high = np.minimum(low, self._low), np.maximum(high, self._high)
        self._low, self._high = low, high
        self._late = np.ptp(poses[len(poses) // 2 :], axis=0).max(axis=1)
        self.watching = bool((self._moved() * FEW < effort.local).any())

    def _moved(self) -> Array:
        """Of each body its way and twice that of its quaternion [m, rad], (n, 2)."""
        assert self._low is not None and self._high is not None
        span = self._high - self._low
        return np.stack((norms(span[:, :3]), norms(span[:, 3:])), axis=1)

    def _at_rest(self, body: str, stands: bool) -> float:
        return SETTLED if stands and body in self._settling else AT_REST

    def found(self, t: float, effort: Effort, bodies: tuple[str, ...]) -> Finding | None:
        """The body that has moved by little up to t, most of all for its tolerance."""
        if not self.watching or self._high is None or not effort.local:
            return None
        assert self._late is not None
        few = bound_of(effort)
        sizes = np.maximum(1.0, norms(self._high[:, :3]))
        both = self._moved()
        largest = both.max(axis=1)
        beside = largest[:, None]
        moved = np.where(both < BESIDE * beside, beside, both).min(axis=1)
        stands = self._late < STANDS * largest
        little = [
            (float(effort.local * size / way), name)
            for name, way, most, size, rest in zip(
                bodies, moved, largest, sizes, stands, strict=True
            )
            if self._at_rest(name, rest) * size < most
            and AT_REST * size < way < effort.local * size / few
            and name not in effort.held
        ]
        if not little:
            return None
        figure, name = max(little)
        what = "error that the tolerance allows a step, over the whole motion of a body,"
        advice = f"try a tolerance below {few * effort.local / figure:.0e}"
        return Finding("little motion", t, figure, few, what, name, advice)
