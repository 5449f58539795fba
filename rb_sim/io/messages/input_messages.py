"""What came from outside as messages of a bag, and back: commands, resets, states that were set.

Each is recorded before the sample that it acts on first, so that the run can be done again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rb_sim.io.messages import cdr
from rb_sim.io.messages import cdr as types
from rb_sim.io.messages.cdr import stamp_of
from rb_sim.io.messages.topic_names import (
    RESETS,
    STATE_COMMAND,
    WORLD,
    body_frame,
    body_topic,
    command_topic,
)
from rb_sim.mechanics.samples import Input

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import SampleLayout

STATE = (
    *("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx_body", "wy_body", "wz_body"),
    *("bodies_together", "project"),
)


class InputTable:
    """Messages of commands, resets and states that were set.

    topics: (name, ROS type) of each.
    """

    def __init__(self, layout: SampleLayout) -> None:
        self._bodies = layout.commanded
        self._world = cdr.wrench_stamped(WORLD)
        self._own = {body: cdr.wrench_stamped(body_frame(body)) for body in layout.commanded}
        self._reset = cdr.clock()
        self._placed, self._state = layout.bodies, _state_codec()
        commands = [(command_topic(body), types.WRENCH_STAMPED) for body in layout.commanded]
        states = [(body_topic(body, STATE_COMMAND), types.JOINT_STATE) for body in layout.bodies]
        self.topics = (*commands, (RESETS, types.CLOCK), *states)

    def message(self, given: Input) -> tuple[int, bytes]:
        """Index of the topic, and the message."""
        stamp = stamp_of(given.t)
        if not given.body:
            return len(self._bodies), self._reset.pack(stamp, ())
        if given.state:
            values = (*given.state, float(given.together), float(given.project))
            index = len(self._bodies) + 1 + self._placed.index(given.body)
            return index, self._state.pack(stamp, values)
        codec = self._world if given.frame == "world" else self._own[given.body]
        return self._bodies.index(given.body), codec.pack(stamp, (*given.force, *given.torque))

    def read(self, topic: int, data: bytes, index: int) -> Input:
        """The input of a message. index: of its sample. Raises ValueError for another message."""
        if topic == len(self._bodies):
            return Input(index, _stamp(self._reset, data) / cdr.NANO, "")
        if topic > len(self._bodies):
            values = self._state.unpack(data)
            body, t = self._placed[topic - len(self._bodies) - 1], _stamp(self._state, data)
            state, together, project = tuple(values[:13]), int(values[13]), bool(values[14])
            return Input(index, t / cdr.NANO, body, state=state, together=together, project=project)
        body = self._bodies[topic]
        for frame, codec in (("world", self._world), ("body", self._own[body])):
            if codec.frames(data):
                values = tuple(codec.unpack(data))
                t = _stamp(codec, data) / cdr.NANO
                return Input(index, t, body, frame, values[:3], values[3:])  # type: ignore[arg-type]
        raise ValueError(f"a command for {body} in the axes of another frame")


def _state_codec() -> cdr.Codec:
    """sensor_msgs/JointState with named numbers: what Input.state, together and project hold."""
    layout = cdr.Layout().stamp().text(WORLD).count(len(STATE))
    for name in STATE:
        layout.text(name)
    return layout.count(len(STATE)).doubles(len(STATE)).count(0).count(0).codec()


def _stamp(codec: cdr.Codec, data: bytes) -> int:
    return int(codec.unpack_stamps(np.frombuffer(data, np.uint8)[None])[0])
