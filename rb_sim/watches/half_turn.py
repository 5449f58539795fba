"""Whether a torsion spring has passed half a turn, where its torque jumps to the other sign.

Its angle is taken in (-pi, pi] (see catalogue/effects/torsion.py), which no balance shows: with a
rest angle of zero the energy is the same on both sides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rb_sim.catalogue.effects.torsion import TorsionSpring

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from rb_sim.engine.samples import SampleBlock, SampleLayout
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

    def first(self, block: SampleBlock) -> tuple[str, float, float] | None:
        """(spring, time [s], angle without a jump [rad]) where the samples show the first one.

        What turns on between two samples by more than RESOLVED is only taken for a turn if the
        kinetic energy would do to wind the spring so far; else it may be an oscillation.
        """
        found: list[tuple[str, float, float]] = []
        for name, effect, b, a, before in self._springs:
            t, angle, rate = block.t, *_twist(effect, block, b, a, before)
            energy = np.array(block.kinetic_energy)
            if name in self._last:
                last = self._last[name]
                t, angle, rate = (
                    np.append(x, y) for x, y in zip(last, (t, angle, rate), strict=True)
                )
                energy = np.append(energy[:1], energy)
            self._last[name] = float(t[-1]), float(angle[-1]), float(rate[-1])
            way = 0.5 * np.diff(t) * (rate[1:] + rate[:-1])
            reached = angle[:-1] + way
            wound = 0.5 * effect.stiffness * (np.pi - abs(effect.rest_angle)) ** 2
            stored = 0.5 * effect.stiffness * (angle - effect.rest_angle) ** 2
            able = (np.abs(way) <= RESOLVED) | ((energy + stored)[:-1] >= wound)
            jumped = np.flatnonzero(able & (np.abs(reached - angle[1:]) > np.pi))
            if len(jumped):
                found.append((name, float(t[jumped[0] + 1]), float(abs(reached[jumped[0]]))))
        return min(found, key=lambda jump: jump[1], default=None)


def _relative(
    scene: Scene, layout: SampleLayout, effect: TorsionSpring
) -> tuple[int, int | None, Rotation]:
    """(number of the body, of its parent or None, turn from parent to body at the start)."""
    from scipy.spatial.transform import Rotation  # slow to import, and few scenes need it

    body, parent = effect.body, effect.parent
    turn = Rotation.from_quat(np.array(scene.bodies[body].orientation, dtype=float))
    if parent is None:
        return layout.bodies.index(body), None, turn
    other = Rotation.from_quat(np.array(scene.bodies[parent].orientation, dtype=float))
    return layout.bodies.index(body), layout.bodies.index(parent), other.inv() * turn


def _twist(
    effect: TorsionSpring, block: SampleBlock, b: int, a: int | None, before: Rotation
) -> tuple[np.ndarray, np.ndarray]:
    """(angle in (-pi, pi] [rad], its rate about the axis [rad/s]) at every sample."""
    from scipy.spatial.transform import Rotation

    axis = np.array(effect.axis_B, dtype=float)
    turn, spin = Rotation.from_quat(block.orientation[:, b]), block.angular_velocity[:, b]
    if a is not None:
        other = Rotation.from_quat(block.orientation[:, a])
        spin = spin - turn.inv().apply(other.apply(block.angular_velocity[:, a]))
        turn = other.inv() * turn
    q = (before.inv() * turn).as_quat()
    angle = 2.0 * np.arctan2(q[:, :3] @ axis, q[:, 3])
    return np.arctan2(np.sin(angle), np.cos(angle)), spin @ axis
