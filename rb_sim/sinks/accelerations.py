"""BODY/accel: what BODY/twist changes by, as geometry_msgs/AccelStamped, where it is asked for.

    a_O = a_C - R (dw/dt x r_OC + w x (w x r_OC))

with a_C (world axes), w and dw/dt (body axes) of the samples; the message has a_O and R dw/dt in
world axes, as the twist has its numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.sinks import cdr
from rb_sim.sinks.cdr import stamp_of
from rb_sim.sinks.frames import centers_of_mass, cross, rotate
from rb_sim.sinks.message_types import ACCEL_STAMPED
from rb_sim.sinks.topic_names import WORLD

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

Accelerating = Callable[["SampleBlock"], Any]
"""Linear accelerations of C, world axes, and dw/dt, body axes, of shape (n, bodies, 3)."""

Asked = Callable[["Scene", "SampleLayout"], Accelerating]
"""Gives them for the blocks of a run; rb_sim.accelerations.accelerating is one."""


def accel_topic(body: str) -> str:
    """Topic of the accelerations of a body."""
    return f"{body}/accel"


class AccelTable:
    """The messages of all bodies. topics: (name, ROS type) of each; prefix: before the frame."""

    def __init__(self, scene: Scene, layout: SampleLayout, asked: Asked, prefix: str = "") -> None:
        self._accelerations = asked(scene, layout)
        self._center_of_mass = centers_of_mass(scene.bodies, layout.bodies)
        self._codec = cdr.accel_stamped(prefix + WORLD)
        self.topics = [(accel_topic(body), ACCEL_STAMPED) for body in layout.bodies]

    def messages(self, block: SampleBlock) -> list[list[bytes]]:
        """Of each sample, in the order of the topics."""
        linear, angular = self._accelerations(block)
        spin, arm = block.angular_velocity, -self._center_of_mass
        own = cross(angular, arm) + cross(spin, cross(spin, arm))
        turned = rotate(block.orientation, own), rotate(block.orientation, angular)
        values = np.concatenate([linear + turned[0], turned[1]], axis=2)
        pack = self._codec.pack
        return [
            [pack(stamp_of(t), numbers) for numbers in row]
            for t, row in zip(block.t.tolist(), values.tolist(), strict=True)
        ]
