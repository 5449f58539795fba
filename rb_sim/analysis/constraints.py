"""How far a motion is from the constraints of a scene, recomputed from its poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rb_sim.analysis.laws import Found, SceneLaws
from rb_sim.engine.samples import Array


@dataclass
class _Worst:
    """The largest value so far, and when."""

    value: float = 0.0
    at: float | None = None

    def follow(self, t: Array, values: Array) -> None:
        k = int(np.nanargmax(values)) if np.isfinite(values).any() else -1
        if k >= 0 and (self.at is None or values[k] > self.value):
            self.value, self.at = float(values[k]), float(t[k])

    def as_dict(self) -> dict[str, Any]:
        return {"largest": self.value, "at": self.at}


TOUCHES = 1e-9
"""Of the scene's length: a gap that is none, or an overlap."""


class ConstraintFigures:
    """Follows the errors of all constraints of `laws`."""

    def __init__(self, laws: SceneLaws) -> None:
        self._laws = laws
        names = dict.fromkeys(line.constraint for line in laws.lines)
        self._position = {name: _Worst() for name in names if self._of(name, True)}
        self._velocity = {name: _Worst() for name in names}
        self._overlap = {name: _Worst() for name in laws.points}
        self._relative = 0.0

    def _of(self, name: str, holonomic: bool = False) -> list[int]:
        """The lines of a constraint; those that are holonomic."""
        lines = enumerate(self._laws.lines)
        return [k for k, x in lines if x.constraint == name and (x.holonomic or not holonomic)]

    def add(self, t: Array, found: Found) -> None:
        """The next instants."""
        if not len(t):
            return
        for name, worst in self._position.items():
            worst.follow(t, np.abs(found.gap[:, self._of(name, True)]).max(axis=1))
        for name, worst in self._velocity.items():
            worst.follow(t, np.abs(found.slip[:, self._of(name)]).max(axis=1))
        for k, worst in enumerate(self._overlap.values()):
            worst.follow(t, found.overlap[:, k])
        arms = np.array([line.arm for line in self._laws.lines])
        gap = np.abs(found.gap * arms).max(initial=0.0) / self._laws.length
        slip = np.abs(found.slip * arms).max(initial=0.0) / self._laws.speed
        depth = found.overlap.max(initial=0.0) / self._laws.length
        self._relative = float(np.nanmax([self._relative, gap, slip, depth]))

    def as_dict(self) -> dict[str, Any] | None:
        """Largest errors by constraint and their times; None where the scene has none.

        position [m or rad] and velocity [m/s or rad/s] of joints; overlap [m] of contacts, negative
        where they never touched, and whether they did; relative: the largest of all, of the scene's
        length and speed, angles and spins at the end of an arm of that length.
        """
        if not (self._velocity or self._overlap):
            return None
        return {
            "relative": self._relative,
            "position": {name: worst.as_dict() for name, worst in self._position.items()},
            "velocity": {name: worst.as_dict() for name, worst in self._velocity.items()},
            "overlap": {
                name: worst.as_dict() | {"touches": worst.value >= -TOUCHES * self._laws.length}
                for name, worst in self._overlap.items()
            },
        }
