"""joint_states: position and velocity of each joint, by the name of its constraint.

Of a `fixed_axis` angle [rad] and rate [rad/s], of a `translation` along a line displacement [m] and
speed [m/s] along the guide's direction; the displacement is zero in the first sample.

The angle is that of the body against its parent, right-handed about axis_B; it is zero in the first
sample, too, and goes on beyond a full turn. How many turns lie between two samples is told by the
mean of their rates: it may be wrong only where that is off by half a turn, as after an impact.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.names import ros_name
from rb_sim.io.messages import cdr
from rb_sim.numerics.rotations import conjugate, product, rotate

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

TURN = 2.0 * np.pi


class JointTable:
    """The messages of the joints of a scene, sample after sample. names: in their order; units: of
    their positions."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        joints: dict[str, Any] = {
            n: c for n, c in scene.constraints.items() if c.type == "fixed_axis" or slides(c)
        }
        self.names = list(joints)
        self._slides = np.array([slides(c) for c in joints.values()], dtype=bool)
        self.units = ["m" if sliding else "rad" for sliding in self._slides]
        axes = [c for c in joints.values() if not slides(c)]
        self._axis_B = np.array([c.axis_B for c in axes]).reshape(-1, 3)
        index = {name: i for i, name in enumerate(layout.bodies)}
        self._body = [index[c.body] for c in axes]
        self._parent = [-1 if c.parent is None else index[c.parent] for c in axes]
        guided = [c for c in joints.values() if slides(c)]
        self._slider = [index[c.body] for c in guided]
        self._direction = np.array([c.guide.direction for c in guided]).reshape(-1, 3)
        self._codec = cdr.joint_state("", [ros_name(name) for name in self.names], efforts=False)
        self._last: tuple[float, Array, Array, Array] | None = None
        """of the last sample: time [s], and of each axis its angle from the first sample within a
        turn [rad], the full turns beside it, its rate [rad/s]."""
        self._start = np.zeros((len(guided), 3))
        """of each guided body its centre of mass in the first sample, world axes [m]."""

    def rows(self, block: SampleBlock) -> Any:
        """The messages of the next samples as bytes, shape (n, length)."""
        stamps = np.rint(block.t * cdr.NANO).astype(np.int64)
        return self._codec.pack_rows(stamps, self.values(block))

    def messages(self, block: SampleBlock) -> list[bytes]:
        """The messages of the next samples."""
        return [row.tobytes() for row in self.rows(block)]

    def values(self, block: SampleBlock) -> Array:
        """Positions, then velocities of the next samples, shape (n, 2 J)."""
        n = len(block)
        restarts = {given.index for given in block.inputs if not given.body}
        placed = sorted({given.index for given in block.inputs if given.state})
        relative, rate = self._relative(block)
        position, velocity = np.empty((2, n, len(self.names)))
        velocity[:, ~self._slides] = rate
        # a guided body does not turn: its centre of mass goes the way of each of its points
        place, speed = block.position[:, self._slider], block.linear_velocity[:, self._slider]
        velocity[:, self._slides] = np.sum(speed * self._direction, axis=-1)
        borders = sorted({0, n} | {k for k in restarts if k < n})
        for first, end in zip(borders, borders[1:], strict=False):
            part = slice(first, end)
            jumps = [k - first for k in placed if first <= k < end]
            restart = first in restarts or self._last is None
            if restart:
                self._start = place[first]
            way = np.sum((place[part] - self._start) * self._direction, axis=-1)
            angle = self._go_on(block.t[part], relative[part], rate[part], jumps, restart)
            position[part, self._slides], position[part, ~self._slides] = way, angle
        return np.hstack([position, velocity])

    def _relative(self, block: SampleBlock) -> tuple[Array, Array]:
        """Orientations of the bodies in their parents' axes (n, J, 4), and rates (n, J)."""
        orientation, spin = block.orientation, block.angular_velocity
        own = orientation[:, self._body]
        parent = _of_parents(orientation, self._parent, (0.0, 0.0, 0.0, 1.0))
        relative = product(conjugate(parent), own)
        carried = rotate(parent, _of_parents(spin, self._parent, (0.0, 0.0, 0.0)))
        along = np.sum(carried * rotate(own, self._axis_B), axis=-1)
        return relative, np.sum(spin[:, self._body] * self._axis_B, axis=-1) - along

    def _go_on(
        self, t: Array, relative: Array, rate: Array, jumps: list[int], restart: bool
    ) -> Array:
        """The angles of samples that follow the last one; jumps: where a state was set."""
        if restart or self._last is None:
            none = np.zeros(len(self._body))
            self._initial, self._last = relative[0], (t[0], none, none, rate[0])
        t_last, turn_last, turns_last, rate_last = self._last
        # the turn from the first pose in the axes of the body: about axis_B alone
        x, y, z, w = np.moveaxis(product(conjugate(self._initial), relative), -1, 0)
        along = x * self._axis_B[:, 0] + y * self._axis_B[:, 1] + z * self._axis_B[:, 2]
        turn = 2.0 * np.arctan2(along, w)
        mean = 0.5 * (np.vstack([rate_last, rate[:-1]]) + rate)
        way = np.diff(t, prepend=t_last)[:, None] * mean
        way[jumps] = 0.0
        more = np.round((np.vstack([turn_last, turn[:-1]]) + way - turn) / TURN)
        turns = turns_last + np.cumsum(more, axis=0)
        self._last = t[-1], turn[-1], turns[-1], rate[-1]
        return turn + TURN * turns


def slides(constraint: Any) -> bool:
    """Whether the constraint is a prismatic joint: a `translation` along a line."""
    guide = constraint.guide if constraint.type == "translation" else None
    return guide is not None and guide.type == "line"


def _of_parents(of_bodies: Array, parents: list[int], of_world: tuple[float, ...]) -> Array:
    """What is of bodies, shape (n, N, k), for each parent; -1: the world."""
    values = of_bodies[:, parents]
    values[:, [i < 0 for i in parents]] = of_world
    return values
