"""The state of a sample as the messages of rb_sim_interfaces, for the answers of services.

The numbers are packed as those of the topics are, so the two agree to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.sinks.cdr import Layout
from rb_sim.sinks.frames import Origins, centers_of_mass
from rb_sim.sinks.packing import Packer
from rb_sim.sinks.topics import Topic

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock, SampleLayout, SampleRow
    from rb_sim.scene.schema import Scene


class Told(NamedTuple):
    """What an answer says of a sample."""

    bodies: list[Any]
    """BodyState of each."""
    reactions: list[Any]
    """Reaction of each."""
    energy: float
    """kinetic plus potential [J]."""
    residual: float
    """worst violation of a constraint, relative."""


class StateMessages:
    """Makes the messages of one scene's samples; numbers come as plain floats, all at once.

    The messages are the same objects each time, with other numbers: an answer is sent before the
    next one is made.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        from rb_sim_interfaces import msg  # type: ignore[import-not-found]

        self._bodies: list[Any] = [msg.BodyState(body=name) for name in layout.bodies]
        of_each = zip(layout.reactions, layout.reaction_bodies, strict=True)
        self._reactions: list[Any] = [
            msg.Reaction(constraint=name, body=body) for name, body in of_each
        ]
        self._places = [
            *(place for state in self._bodies for place in _of_state(state)),
            *(place for one in self._reactions for place in _of_reaction(one)),
        ]
        """for each vector, in the order of the numbers: where it goes, and whether it has a w."""
        size = sum(3 + turns for _, turns in self._places) + 2
        numbers = Topic("", "", Layout().doubles(size).codec(), _numbers)
        self._codec = numbers.codec
        self._packer = Packer([numbers], layout, centers_of_mass(scene.bodies, layout.bodies))

    def of(self, row: SampleRow) -> Told:
        """The messages of a sample."""
        packed = self._packer.pack_rows(row.row[None], row.command[None], [0])[0][0]
        values = iter(self._codec.unpack(packed))
        for place, turns in self._places:
            place.x, place.y, place.z = next(values), next(values), next(values)
            if turns:
                place.w = next(values)
        return Told(self._bodies, self._reactions, next(values), next(values))


def _of_state(state: Any) -> tuple[tuple[Any, bool], ...]:
    pose, twist = state.pose, state.twist
    linear, angular = (twist.linear, False), (twist.angular, False)
    return (pose.position, False), (pose.orientation, True), linear, angular


def _of_reaction(one: Any) -> tuple[tuple[Any, bool], ...]:
    return (one.anchor, False), (one.wrench.force, False), (one.wrench.torque, False)


def _numbers(block: SampleBlock, motion: Origins) -> Array:
    """All numbers of an answer, shape (n, size), in the order of its vectors."""
    moving = (motion.position, block.orientation, motion.linear_velocity, motion.angular_velocity)
    acting = (block.anchor, block.reaction_force, block.reaction_torque)
    parts = [np.concatenate(one, axis=2) for one in (moving, acting)]
    told = np.stack([block.energy, block.residual], axis=1)
    return np.concatenate([*(one.reshape(len(block), -1) for one in parts), told], axis=1)


def set_vector(of: Any, values: Sequence[float]) -> None:
    """Three plain floats into a message's x, y and z."""
    of.x, of.y, of.z = values
