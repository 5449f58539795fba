"""Momentum against impulse over the stretches of a run that are looked at closely."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.sinks.frames import cross, norms, rotate
from rb_sim.watches.quadrature import CheckedQuadrature

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rb_sim.engine.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


class Impulses:
    """Change of [momentum, angular momentum about the world origin] less the impulse from outside.

    A stretch of samples that is left out parts the run: what its momentum does not account for is
    added up over the stretches before and after it.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._scene, self._layout = scene, layout
        self._isolated = not scene.effects and not scene.constraints
        """whether nothing acts from outside: no stretch is left out, then."""
        self.samples = 0
        """in the stretches that are balanced."""
        self.largest = np.zeros(2)
        """norms of momentum and angular momentum."""
        self._missed, self._given, self._doubt = np.zeros(6), np.zeros(6), np.zeros(6)
        self._first: Array | None = None
        self._last = np.zeros(6)
        self._impulse = CheckedQuadrature(6)

    def add(self, block: SampleBlock, breaks: Sequence[float] = ()) -> None:
        """The next samples. breaks: increasing, where commands change; a sample there is after."""
        if not self._isolated:
            self._impulse.add(block.t, external_wrench(block, self._scene, self._layout), breaks)
        for k, vectors in enumerate((block.momentum, block.angular_momentum)):
            self.largest[k] = max(self.largest[k], largest(vectors))
        if self._first is None:
            self._first = np.append(block.momentum[0], block.angular_momentum[0])
        self._last = np.append(block.momentum[-1], block.angular_momentum[-1])
        self.samples += len(block)

    def leave_out(self) -> None:
        """Samples follow that do not come to `add`."""
        if self._first is None or self._isolated:
            return
        self._missed, self._given, self._doubt = self.finish()
        self._first, self._impulse = None, CheckedQuadrature(6)

    def finish(self) -> tuple[Array, Array, Array]:
        """(change less impulse, impulse, how uncertain it is) of all stretches, each (6,)."""
        if self._first is None:
            return self._missed, self._given, self._doubt
        impulse, doubt = self._impulse.finish()
        missed = self._last - self._first - impulse
        return self._missed + missed, self._given + impulse, self._doubt + doubt


def largest(vectors: Array) -> float:
    """The largest norm."""
    return float(norms(vectors).max())


def external_wrench(block: SampleBlock, scene: Scene, layout: SampleLayout) -> Array:
    """Sum of the outer [force, torque about the world origin], world axes, shape (n, 6)."""
    total = np.zeros((len(block), 6))
    for k, name in enumerate(layout.reactions):
        if "/" in name or getattr(scene.constraints[name], "parent", None) is not None:
            continue  # part of a total, or an inner force
        put(total, block.reaction_force[:, k], block.reaction_torque[:, k], block.anchor[:, k])
    for effect in scene.effects.values():
        kind: str = effect.type  # type: ignore[attr-defined]
        if kind == "gravity":
            _put_gravity(total, effect, block, scene, layout)
        elif kind == "commanded_wrench":
            command = block.command[:, layout.commanded.index(effect.body)]  # type: ignore[attr-defined]
            origin = _point(block, scene, layout, effect.body, np.zeros(3))  # type: ignore[attr-defined]
            put(total, command[:, :3], command[:, 3:], origin)
        elif kind == "wrench":
            _put_wrench(total, effect, block, scene, layout)
    return total


def put(total: Array, force: Array, torque: Array, point: Array) -> None:
    """Add a force at `point` and a free torque, in place; each (n, 3) or (3,)."""
    total[:, :3] += force
    total[:, 3:] += torque + cross(point, force)


def _put_gravity(
    total: Array, effect: Any, block: SampleBlock, scene: Scene, layout: SampleLayout
) -> None:
    for body in effect.bodies or layout.bodies:
        force = scene.bodies[body].mass * np.array(effect.acceleration)
        total[:, :3] += force
        total[:, 3:] += cross(block.position[:, layout.bodies.index(body)], force)


def _put_wrench(
    total: Array, effect: Any, block: SampleBlock, scene: Scene, layout: SampleLayout
) -> None:
    point = _point(block, scene, layout, effect.body, np.array(effect.point_B))
    force, torque = (np.tile(v, (len(block), 1)) for v in (effect.force, effect.torque))
    if effect.frame == "body":
        q = block.orientation[:, layout.bodies.index(effect.body)]
        force, torque = rotate(q, force), rotate(q, torque)
    put(total, force, torque, point)


def _point(
    block: SampleBlock, scene: Scene, layout: SampleLayout, body: str, point_B: Array
) -> Array:
    """A point of the body, given from its origin in body axes, in the world, shape (n, 3)."""
    i = layout.bodies.index(body)
    arm = point_B - np.array(scene.bodies[body].center_of_mass)
    return block.position[:, i] + rotate(block.orientation[:, i], np.tile(arm, (len(block), 1)))
