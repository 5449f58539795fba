"""Whether constraints come to depend on each other on the way: a dead point, or the end of a way.

Let s be the root of the least pivot of A = G M^-1 G^T relative to its diagonal element, over the
lines that were independent at the start.  Where the lines lose rank s passes through zero as |x|
does, so that around a dead point the samples of s make a V whose two lowest add up to one step of
its sides.  What comes after one, the laws of motion do not decide.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.engine.manifold import lines_left
from rb_sim.errors import RbSimError
from rb_sim.graph.machine import evaluate_rows
from rb_sim.scene.compile import compile_motion
from rb_sim.scene.initial import part_of
from rb_sim.scene.place import InitialPlace

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

MOST_LINES = 120
"""Lines up to which a scene is watched: the law that tells s is traced as a whole."""
VANISHED = 1e-5
"""s at or below which the lines depend on each other at the sample itself."""
OPEN = 1.3
"""Two lowest samples of a V over one step of its sides; above, s has a minimum beside zero."""


class DeadPoint(NamedTuple):
    """Where lines came to depend on each other."""

    t: float
    least: float
    """s at the sample next to it."""
    constraint: str


class Conditioning:
    """Follows s over the samples of a run; `found` is the first dead point, if there was one."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self.found: DeadPoint | None = None
        self._layout, self._scene = layout, scene
        self._owners: list[str] = []
        self._t, self._s, self._line = np.zeros(0), np.zeros(0), np.zeros(0, int)
        looped = not layout.contacts and has_loops(scene)
        self._law = self._made(scene) if looped else None

    def _made(self, scene: Scene) -> object:
        """The law of the shares of the pivots; None where it cannot be made, or for many lines."""
        options = scene.simulation.model_copy(update={"project_initial": True})
        try:
            projected = scene.model_copy(update={"simulation": options})
            compiled = compile_motion(projected, "maximal")
        except RbSimError:
            return None
        system = compiled.system
        if not 0 < compiled.rows <= MOST_LINES or compiled.laws is None:
            return None
        place = InitialPlace(scene)
        owners = [n for n, spec in scene.constraints.items() for _ in spec.parts(place)]  # type: ignore[attr-defined]
        self._lines, law = lines_left(system, compiled.y)
        self._owners = [owners[part_of(system, k)] for k in self._lines]
        self._inputs = np.array([*compiled.laws.inputs.values(system, 0.0), 0.0])
        return law

    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        if self._law is None or self.found is not None or not len(block):
            return
        columns = (
            block.position, block.orientation, block.linear_velocity, block.angular_velocity,
        )  # fmt: skip
        y = np.ascontiguousarray(np.concatenate(columns, axis=2).reshape(len(block), -1))
        shares = np.zeros((len(block), len(self._lines)))
        evaluate_rows(self._law, block.t, y, self._inputs, shares)  # type: ignore[arg-type]
        shares[~np.isfinite(shares)] = 1.0  # told as what it is, elsewhere
        self._t = np.append(self._t[-3:], block.t)
        self._s = np.append(self._s[-3:], np.sqrt(np.maximum(shares.min(axis=1), 0.0)))
        self._line = np.append(self._line[-3:], shares.argmin(axis=1))
        self._look()

    def _look(self) -> None:
        s = self._s
        gone = np.flatnonzero(s <= VANISHED)
        if len(gone):
            self._say(float(self._t[gone[0]]), int(gone[0]))
            return
        for k in range(1, len(s) - 2):
            a, b, c, d = s[k - 1 : k + 3]
            if b < a and c < d and b + c <= OPEN * max(a - b, d - c):
                t = self._t[k] + (self._t[k + 1] - self._t[k]) * b / (b + c)
                self._say(float(t), k if b <= c else k + 1)
                return

    def _say(self, t: float, k: int) -> None:
        self.found = DeadPoint(t, float(self._s[k]), self._owners[int(self._line[k])])


def has_loops(scene: Scene) -> bool:
    """True unless the joints hang together as trees, whose lines cannot lose rank."""
    group: dict[str | None, str | None] = {}

    def root(name: str | None) -> str | None:
        while group.setdefault(name, name) != name:
            name = group[name]
        return name

    for spec in scene.constraints.values():
        first, second = root(spec.body), root(getattr(spec, "parent", None))  # type: ignore[attr-defined]
        if first == second:
            return True
        group[first] = second
    return False
