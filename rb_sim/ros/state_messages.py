"""The state of a sample as the messages of rb_sim_interfaces, for the answers of services.

The numbers are read from the messages that the topics have, so the two agree to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from rb_sim.sinks.topics import TopicTable, reaction_topic

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleLayout, SampleRow
    from rb_sim.scene.schema import Scene

ANCHOR = slice(6, 9)
"""Of the nine numbers that a row has of each reaction."""


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

        self._layout = layout
        self._table = TopicTable(scene, layout)
        self._table.warm(layout)
        self._at = {topic.name: i for i, topic in enumerate(self._table.topics)}
        self._bodies: list[Any] = [msg.BodyState(body=name) for name in layout.bodies]
        of_each = zip(layout.reactions, layout.reaction_bodies, strict=True)
        self._reactions: list[Any] = [
            msg.Reaction(constraint=name, body=body) for name, body in of_each
        ]

    def of(self, row: SampleRow) -> Told:
        """The messages of a sample."""
        layout = self._layout
        self._messages = self._table.messages_of_rows([row])[0].messages
        for name, state in zip(layout.bodies, self._bodies, strict=True):
            pose, twist = self._numbers(f"{name}/pose"), self._numbers(f"{name}/twist")
            set_fields(state.pose.position, pose[:3])
            set_fields(state.pose.orientation, pose[3:])
            set_fields(state.twist.linear, twist[:3])
            set_fields(state.twist.angular, twist[3:])
        at = 13 * len(layout.bodies)
        for name, one in zip(layout.reactions, self._reactions, strict=True):
            wrench = self._numbers(reaction_topic(name))
            set_fields(one.anchor, row.row[at : at + 9][ANCHOR].tolist())
            set_fields(one.wrench.force, wrench[:3])
            set_fields(one.wrench.torque, wrench[3:])
            at += 9
        energy, residual = self._numbers("energy"), self._numbers("residual")
        return Told(self._bodies, self._reactions, *energy, *residual)

    def _numbers(self, topic: str) -> list[float]:
        """The numbers of the topic's message."""
        i = self._at[topic]
        return self._table.topics[i].codec.unpack(self._messages[i])


def set_fields(of: Any, values: Sequence[float]) -> None:
    """Values of x, y, z (and w), plain floats, into a message's fields."""
    for name, value in zip("xyzw", values, strict=False):
        setattr(of, name, value)
