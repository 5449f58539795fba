"""The energy that a run exchanges, with which the error of its balance is compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock

ROUNDING = 1e-13
"""Energy, relative to that of the loads, up to which a body counts as at rest; more is motion."""

AT_REST = 1e-9
"""Share of a scene's lengths by which places of bodies at rest may be in doubt."""


class Exchanged:
    """Scale of the energies: what the scene started with or has exchanged by right.

    The kinetic energy at the start, the fall of the potential from there, and the work of what has
    none. What an error makes, a spring that gains without end, is in none of the three.
    """

    def __init__(self, given: float = 0.0) -> None:
        """given: kinetic energy of the velocities that the scene gives, before constraints take
        theirs [J]; what is left of them then may be rounding."""
        self._given = ROUNDING**2 * given
        self._kinetic = self._fall = self._works = self._contacts = self._noise = 0.0
        self._loads = 0.0
        """weights and reactions times lengths, at the start [J]."""
        self._potential: float | None = None
        self._struck = 0.0
        """contact work before the first sample."""
        self._signed = 0.0
        """the works with their signs."""

    def add(self, block: SampleBlock) -> None:
        if self._potential is None:
            self._potential = float(block.potential_energy[0])
            self._kinetic = float(block.kinetic_energy[0])
            self._struck = float(block.contact_work[0])
            self._noise = self._roundings(block)
        self._fall = max(self._fall, self._potential - float(block.potential_energy.min()))
        self._contacts = max(self._contacts, float(np.abs(block.contact_work).max()))

    def saw(self, block: SampleBlock) -> None:
        """How far the potential falls in samples beside those of the run."""
        if self._potential is not None:
            self._fall = max(self._fall, self._potential - float(block.potential_energy.min()))

    def glance(self, block: SampleBlock) -> float:
        """The next samples by the last of them; its energy less that of the start and the work."""
        kinetic, potential = float(block.kinetic_energy[-1]), float(block.potential_energy[-1])
        if self._potential is None:
            self.add(block)
        assert self._potential is not None
        struck = float(block.contact_work[-1])
        self._fall = max(self._fall, self._potential - potential)
        self._contacts = max(self._contacts, abs(struck))
        given = self._kinetic + self._potential + self._signed + struck - self._struck
        return kinetic + potential - given

    def work(self, size: float, signed: float) -> None:
        """The size of the work of forces without potential so far, and the work itself, about."""
        self._works, self._signed = size, signed

    def _roundings(self, block: SampleBlock) -> float:
        """Energy that the loads at the start make of a rounding of the places where they act."""
        force = float(np.linalg.norm(block.reaction_force[0], axis=1).sum())
        reach = float(np.abs(block.position[0]).max())
        self._loads = abs(float(block.potential_energy[0])) + force * reach
        return self._given + ROUNDING * self._loads

    @property
    def rounding(self) -> float:
        """Energy that cannot be told from round-off [J]."""
        return self._noise

    @property
    def at_rest(self) -> float:
        """Energy that is no error: loads times a billionth of the lengths at which they act, by
        which solvers and tolerances may leave in doubt where a body at rest is [J]."""
        return AT_REST * self._loads

    @property
    def scale(self) -> float:
        """[J]; 0 where nothing but rounding has moved."""
        found = self._kinetic + self._fall + self._works + self._contacts
        return found if found > self._noise else 0.0


def farthest(points: Array) -> float:
    """The largest coordinate."""
    return float(max(points.max(), -points.min()))
