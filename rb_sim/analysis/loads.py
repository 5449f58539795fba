"""The wrenches that a bag of ours tells for each body, as one about its centre of mass."""

from __future__ import annotations

import numpy as np

from rb_sim.engine.samples import SampleBlock, SampleLayout
from rb_sim.scene.schema import Scene
from rb_sim.sinks.frames import centers_of_mass, rotate

TOLD = ("gravity", "commanded_wrench")
"""Effects whose force follows from the samples."""


class Loads:
    """Adds up reactions (on the body and, opposite, on its parent), commands and uniform gravity.

    notes: effects whose wrench is not among the samples; what a motion takes differs by it.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._layout = layout
        self._offsets = centers_of_mass(scene.bodies, layout.bodies)
        self._weights = np.zeros((len(layout.bodies), 3))
        untold = []
        for name, effect in scene.effects.items():
            kind = effect.type  # type: ignore[attr-defined]
            if kind == "gravity":
                for body in effect.bodies or layout.bodies:  # type: ignore[attr-defined]
                    g = np.array(effect.acceleration)  # type: ignore[attr-defined]
                    self._weights[layout.bodies.index(body)] += scene.bodies[body].mass * g
            elif kind not in TOLD:
                untold.append(f"{name} ({kind})")
        self._parents = [self._parent(scene, name) for name in layout.reactions]
        # a bearing's share is in the total of its constraint, which has an entry of its own
        self._counted = ["/" not in name for name in layout.reactions]
        text = "the samples do not tell the wrench of " + ", ".join(untold)
        self.notes = [f"{text}: the recorded total is without it"] if untold else []

    def _parent(self, scene: Scene, reaction: str) -> int | None:
        spec = scene.constraints.get(reaction.partition("/")[0])
        parent = getattr(spec, "parent", None)
        return None if parent is None else self._layout.bodies.index(parent)

    def totals(self, block: SampleBlock) -> np.ndarray:
        """Force and torque about C, world axes, shape (n, N, 6)."""
        n, bodies = len(block), self._layout.bodies
        total = np.zeros((n, len(bodies), 6))
        total[:, :, :3] = self._weights
        for k, body in enumerate(self._layout.reaction_bodies):
            if not self._counted[k]:
                continue
            force, torque = block.reaction_force[:, k], block.reaction_torque[:, k]
            for i, sign in ((bodies.index(body), 1.0), (self._parents[k], -1.0)):
                if i is not None:
                    arm = block.anchor[:, k] - block.position[:, i]
                    total[:, i, :3] += sign * force
                    total[:, i, 3:] += sign * (torque + np.cross(arm, force))
        for m, body in enumerate(self._layout.commanded):
            i = bodies.index(body)
            arm = -rotate(block.orientation[:, i], self._offsets[i])
            force, torque = block.command[:, m, :3], block.command[:, m, 3:]
            total[:, i, :3] += force
            total[:, i, 3:] += torque + np.cross(arm, force)
        return total
