"""By how much the power of commands jumps at the instants at which they change.

A command acts from a sample on, and that sample still shows the one before: between two samples the
power at the beginning is P(t_k) + (f' - f) v_O + (tau' - tau) w, with the new command f', tau'.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.sinks.frames import centers_of_mass, origins, rotate

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


class _Shown(NamedTuple):
    """What samples show of the bodies that take commands: shape (n, M, ...), world axes."""

    command: Array
    orientation: Array
    motion: Array
    """velocity of the origin and angular velocity, six numbers."""


class CommandJumps:
    """Takes the blocks of a run one behind the other."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._center_of_mass = centers_of_mass(scene.bodies, layout.bodies)
        self._commanded = layout.commanded
        self._bodies = [layout.bodies.index(name) for name in layout.commanded]
        self._last: _Shown | None = None

    def __call__(self, block: SampleBlock) -> Array:
        """For each sample, the jump at the beginning of the time that it ends [W], shape (n,)."""
        jumps = np.zeros(len(block))
        if not self._commanded or not len(block):
            return jumps
        shown = self._shown(block)
        before = shown if self._last is None else _behind(self._last, shown)
        given = {(one.index, one.body): one for one in block.inputs if one.body and not one.state}
        for (k, body), one in given.items():
            row, m = k - (self._last is None), self._commanded.index(body)
            if row < 0:  # it came before the first sample
                continue
            wrench = np.array([one.force, one.torque])
            if one.frame == "body":
                wrench = rotate(before.orientation[row, m], wrench)
            jumps[k] += (wrench.ravel() - before.command[row, m]) @ before.motion[row, m]
        self._last = _Shown(*(part[-1:] for part in shown))
        return jumps

    def _shown(self, block: SampleBlock) -> _Shown:
        motion = origins(block, self._center_of_mass)
        speeds = np.concatenate([motion.linear_velocity, motion.angular_velocity], axis=2)
        return _Shown(block.command, block.orientation[:, self._bodies], speeds[:, self._bodies])


def _behind(last: _Shown, shown: _Shown) -> _Shown:
    return _Shown(*(np.concatenate(parts) for parts in zip(last, shown, strict=True)))
