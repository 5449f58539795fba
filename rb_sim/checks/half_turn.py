"""Whether a torsion spring has passed half a turn, where its torque jumps to the other sign.

Its angle is taken in (-pi, pi] (see catalogue/effects/torsion.py), which no balance shows: with a
rest angle of zero the energy is the same on both sides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rb_sim.catalogue.effects.torsion import TorsionSpring
from rb_sim.numerics.rotations import conjugate, product, rotate
from rb_sim.numerics.vectors import quaternion_product

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

RESOLVED = 1.0
"""Angle between two samples [rad] up to which they tell the way that the spring has gone."""


class HalfTurns:
    """Follows the twist of each torsion spring from sample to sample."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._springs = [
            (name, effect, *(_relative(scene, layout, effect)))
            for name, effect in scene.effects.items()
            if isinstance(effect, TorsionSpring) and effect.stiffness > 0.0
        ]
        self._last: dict[str, tuple[float, float, float]] = {}
        self._ways = [halves_of(effect, a, before) for _, effect, _, a, before in self._springs]
        self._ends: list[tuple[float, float]] = []
        self._seen: SampleBlock | None = None

    @property
    def springs(self) -> int:
        """How many there are."""
        return len(self._springs)

    def _may_hold(self, block: SampleBlock) -> bool:
        """Whether a spring passes half a turn in the block or on the way to it, as it seems: the
        cosine of half its angle changes sign, of quaternions whose signs follow each other."""
        found, ends = False, self._ends
        self._ends = []
        for i, (_, _, b, a, _) in enumerate(self._springs):
            q, parent = block.orientation[:, b], None if a is None else block.orientation[:, a]
            cos, sin = halves(self._ways[i], q, parent)
            self._ends.append((float(cos[-1]), float(sin[-1])))
            if ends:
                cos, sin = np.append(ends[i][0], cos), np.append(ends[i][1], sin)
            signs = cos[1:] * cos[:-1]
            found |= bool((signs * (signs + sin[1:] * sin[:-1]) <= 0.0).any())
        return found

    def _note(self, block: SampleBlock) -> None:
        """Take the block's last sample for the one before the next."""
        for name, effect, b, a, before in self._springs:
            angle, rate = _twist(effect, block, b, a, before, slice(-1, None))
            self._last[name] = float(block.t[-1]), float(angle[0]), float(rate[0])

    def first(self, block: SampleBlock) -> tuple[str, float, float] | None:
        """(spring, time [s], angle without a jump [rad]) where the samples show the first one.

        What turns on between two samples by more than RESOLVED is only taken for a turn if the
        kinetic energy would do to wind the spring so far; else it may be an oscillation.
        """
        if not self._springs:
            return None
        before, self._seen = self._seen, block
        if not self._may_hold(block) or not all(map(has_attitudes, (block, before or block))):
            return None
        if before is not None:
            self._note(before)
        found: list[tuple[str, float, float]] = []
        for name, effect, b, a, start in self._springs:
            t, angle, rate = block.t, *_twist(effect, block, b, a, start)
            energy = np.array(block.kinetic_energy)
            if name in self._last:
                last = self._last[name]
                t, angle, rate = (
                    np.append(x, y) for x, y in zip(last, (t, angle, rate), strict=True)
                )
                energy = np.append(energy[:1], energy)
            way = 0.5 * np.diff(t) * (rate[1:] + rate[:-1])
            reached = angle[:-1] + way
            wound = 0.5 * effect.stiffness * (np.pi - abs(effect.rest_angle)) ** 2
            stored = 0.5 * effect.stiffness * (angle - effect.rest_angle) ** 2
            able = (np.abs(way) <= RESOLVED) | ((energy + stored)[:-1] >= wound)
            turns = np.rint((reached - angle[1:]) / (2.0 * np.pi))
            jumped = np.flatnonzero(able & (turns != 0.0))
            if len(jumped):
                i = jumped[0]
                went = angle[i + 1] + 2.0 * np.pi * turns[i]
                found.append((name, float(t[i + 1]), float(abs(went))))
        return min(found, key=lambda jump: jump[1], default=None)


def has_attitudes(block: SampleBlock) -> bool:
    """Whether all quaternions are about of length 1; where a run blows up they are not, which the
    residual tells."""
    square = np.einsum("nbi,nbi->nb", block.orientation, block.orientation)
    return bool((np.abs(square - 1.0) < 0.5).all())


def _relative(
    scene: Scene, layout: SampleLayout, effect: TorsionSpring
) -> tuple[int, int | None, np.ndarray]:
    """(number of the body, of its parent or None, turn from parent to body at the start)."""
    body, parent = effect.body, effect.parent
    turn = np.array(scene.bodies[body].orientation, dtype=float)
    if parent is None:
        return layout.bodies.index(body), None, turn
    other = np.array(scene.bodies[parent].orientation, dtype=float)
    return layout.bodies.index(body), layout.bodies.index(parent), product(conjugate(other), turn)


def halves_of(effect: TorsionSpring, a: int | None, before: np.ndarray) -> np.ndarray:
    """(cos, sin) of half the angle as numbers times the body's quaternion, or times products of
    the parent's elements with the body's; shape (2, 4) or (2, 4, 4)."""
    axis = np.array(effect.axis_B, dtype=float)
    first, back = conjugate(before), np.diag([-1.0, -1.0, -1.0, 1.0])
    units = np.eye(4)
    if a is None:
        products = np.array([quaternion_product(first, q) for q in units])
        return np.stack([products[:, 3], products[:, :3] @ axis])
    pairs = [(back @ p, q) for p in units for q in units]
    turned = [quaternion_product(first, quaternion_product(p, q)) for p, q in pairs]
    products = np.array(turned).reshape(4, 4, 4)
    return np.stack([products[..., 3], products[..., :3] @ axis])


def halves(ways: np.ndarray, q: np.ndarray, parent: np.ndarray | None) -> np.ndarray:
    """(cos, sin) of half the angle at every sample, shape (2, n)."""
    if parent is None:
        return ways @ q.T
    return np.stack([np.einsum("ni,ij,nj->n", parent, way, q) for way in ways])


def _twist(
    effect: TorsionSpring,
    block: SampleBlock,
    b: int,
    a: int | None,
    before: np.ndarray,
    at: slice = slice(None),
) -> tuple[np.ndarray, np.ndarray]:
    """(angle in (-pi, pi] [rad], its rate about the axis [rad/s]) at every sample, or at some."""
    axis = np.array(effect.axis_B, dtype=float)
    turn, spin = block.orientation[at, b], block.angular_velocity[at, b]
    if a is not None:
        other = block.orientation[at, a]
        spin = spin - rotate(conjugate(turn), rotate(other, block.angular_velocity[at, a]))
        turn = product(conjugate(other), turn)
    q = product(conjugate(before), turn)
    angle = 2.0 * np.arctan2(q[:, :3] @ axis, q[:, 3])
    return np.arctan2(np.sin(angle), np.cos(angle)), spin @ axis
