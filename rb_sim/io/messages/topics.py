# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The table of topics that the node publishes and the bag records. SI units.

| topic                  | type          | values                            | frame_id          |
|------------------------|---------------|-----------------------------------|-------------------|
| BODY/pose              | PoseStamped   | of the body frame (its origin O)  | world             |
| BODY/twist             | TwistStamped  | velocity of O, angular velocity   | world             |
| BODY/accel             | AccelStamped  | rate of BODY/twist; on request    | world             |
| BODY/wrench_applied    | WrenchStamped | commanded wrench as applied       | BODY/origin       |
| reactions/CONSTRAINT   | WrenchStamped | BY the constraint ON the body     | CONSTRAINT/anchor |
| energy                 | Float64       | kinetic plus potential [J]        |                   |
| energy/kinetic         | Float64       | [J]                               |                   |
| energy/potential       | Float64       | [J]                               |                   |
| power                  | Float64       | of non-conservative forces [W]    |                   |
| residual               | Float64       | largest constraint violation, relative |              |
| contacts/CONTACT/state | UInt8         | 0 open, 1 slip, 2 stick or roll   |                   |
| contact_work           | Float64       | of all contacts since the start [J] |                 |
| contact_events         | DiagnosticArray | one event each, see below       |                   |
| BODY/wrench_command    | WrenchStamped | command as received; only in bags | world or BODY     |
| BODY/state_command     | JointState    | state that was set; only in bags  | world             |
| resets                 | Clock         | reset to the start; only in bags  |                   |
| joint_states           | JointState    | of each fixed_axis, linear guide  |                   |
| BODY/odometry          | Odometry      | pose, twist in body axes; on request | world          |
| description            | String        | scene as JSON; latched            |                   |
| state                  | String        | of the node: paused, running, error; latched |        |
| markers                | MarkerArray   | shapes of the bodies; latched     | BODY              |
| robot_description      | String        | URDF; latched, in the node's namespace |              |
| /tf                    | TFMessage     | BODY and the frames of wrenches   | world             |
| /clock                 | Clock         | simulated time                    |                   |

Names without a leading slash are relative to the node's name (NAMESPACE unless renamed). A wrench
acts at the origin of its frame_id, and its components are in that frame's axes. `BODY/origin` and
`CONSTRAINT/anchor` have world axes; the first moves with the body's origin, the second with the
constraint's anchor point. Bearings are CONSTRAINT/A and CONSTRAINT/B. The slash distinguishes these
frames from those of bodies, whose names contain none.

Topics of contacts exist only if the scene has contacts. Several points of one contact are
CONTACT/1, CONTACT/2 ... in frames and CONTACT/point_1 ... in topics, since no part of a topic name
may start with a digit. An event has its own instant as stamp, the contact as `name`, the kind as
`message`, and the values `t` [s] and `impulse_x`, `_y`, `_z` BY the contact ON the body [N s], in
full precision. It is sent before the first sample that is not earlier.

A bag has `joint_states` if the scene has joints, the node if parameter `joint_states` is set;
angles are continuous from sample to sample (`robot_description.py`). Latched topics are sent once,
with the first sample, and have durability transient_local also in a bag, for viewers that start
later. `robot_description` is in the namespace of the node, not under its name, where viewers expect
it. In a bag `description` also contains the record `rb_sim` (`bag/bag_sink.py`), since converters
of bags keep only messages.

A bag also records the inputs, each before the first sample that it affects: commands in the axes in
which they were received (zero when wrench_timeout ended one), resets, and states that were set.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base import __version__
from rb_sim.base.errors import SinkError
from rb_sim.io.messages import cdr
from rb_sim.io.messages.cdr import stamp_of
from rb_sim.io.messages.packing import NO_ROTATION, Packer, Topic, columns_of, stamps_of
from rb_sim.io.messages.robot_description import marker_array, urdf
from rb_sim.io.messages.topic_names import (
    CLOCK,
    CONTACT_EVENTS,
    CONTACT_WORK,
    DESCRIPTION,
    MARKERS,
    RESETS,
    ROBOT_DESCRIPTION,
    STATE_COMMAND,
    TF,
    WORLD,
    anchor_frame,
    body_frame,
    body_topic,
    command_topic,
    origin_frame,
    reaction_topic,
    state_topic,
)
from rb_sim.mechanics.samples import Input, SampleRow, centers_of_mass, origins, row_width
from rb_sim.numerics.rotations import conjugate, cross, rotate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rb_sim.mechanics.samples import ContactEvent, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# Conversion between contact events and messages, without loss of precision.


_IMPULSE = ("impulse_x", "impulse_y", "impulse_z")


def event_message(event: ContactEvent) -> bytes:
    """The DiagnosticArray message of a contact event."""
    impulse = zip(_IMPULSE, event.impulse, strict=True)
    values = {"t": repr(event.t), **{key: repr(value) for key, value in impulse}}
    return cdr.diagnostic(stamp_of(event.t), event.contact, event.kind, values)


def events_before(block: SampleBlock, stamps: NDArray[Any]) -> dict[int, list[ContactEvent]]:
    """Events that come before each sample, by its index; the last sample takes also those that are
    announced for just after it. stamps: of the samples [ns]."""
    found: dict[int, list[ContactEvent]] = {}
    k = 0
    for event in block.events:
        while k < len(stamps) - 1 and stamp_of(event.t) > stamps[k]:
            k += 1
        found.setdefault(k, []).append(event)
    return found


def read_event(data: bytes) -> tuple[float, str, str, tuple[float, ...]]:
    """t [s], contact, kind, impulse [N s] of an event message. Raises ValueError for others."""
    _, contact, kind, values = cdr.read_diagnostic(data)
    try:
        numbers = [float(values[key]) for key in ("t", *_IMPULSE)]
    except KeyError as missing:
        raise ValueError(f"an event without {missing}") from None
    return numbers[0], contact, kind, tuple(numbers[1:])


class SampleMessages(NamedTuple):
    """Messages to send at one sample."""

    stamp: int
    """of the sample [ns]."""
    messages: list[bytes]
    """in the order of TopicTable.topics."""
    events: list[bytes]
    """messages of the event topic before this sample, in order."""


class TopicTable:
    """The topics of a scene, and the messages of its samples.

    skip: topics to omit, by Topic.name. prefix: prepended to every frame name. event_topic: (name,
    ROS type) of the events, None without contacts. Raises SinkError if two topics have the same
    name.
    """

    def __init__(
        self, scene: Scene, layout: SampleLayout, skip: Collection[str] = (), prefix: str = ""
    ) -> None:
        self._center_of_mass = centers_of_mass(scene.bodies, layout.bodies)
        of = columns_of(layout)
        entries = [*_body_topics(layout, prefix, of), *_reaction_topics(layout, prefix, of)]
        entries += _scalar_topics(of)
        entries += _contact_topics(layout, of)
        entries += [_tf_topic(layout, prefix, of), Topic(CLOCK, cdr.CLOCK, cdr.codec(cdr.CLOCK))]
        events = Topic(CONTACT_EVENTS, cdr.DIAGNOSTIC_ARRAY, cdr.codec(cdr.CLOCK))
        self.event_topic = (events.name, events.ros_type) if layout.contacts else None
        inputs = [Topic(*topic, cdr.codec(cdr.CLOCK)) for topic in InputTable(layout).topics]
        _check_names([*entries, *inputs, *([events] if layout.contacts else [])])
        self.topics = tuple(topic for topic in entries if topic.name not in skip)
        self._packer = Packer(self.topics, layout, self._center_of_mass)

    def warm(self, layout: SampleLayout) -> None:
        """Compile what `messages_of_rows` calls, so that no sample is delayed by it."""
        row, command = np.zeros(row_width(layout)), np.zeros((len(layout.commanded), 6))
        self.messages_of_rows([SampleRow(0.0, row, command)])

    def messages(self, block: SampleBlock) -> Iterator[SampleMessages]:
        """Messages of each sample, and of the events before it."""
        stamps = stamps_of(block)
        rows, events = self._packer.pack(block, stamps), events_before(block, stamps)
        for k, stamp in enumerate(stamps.tolist()):
            yield SampleMessages(stamp, rows[k], list(map(event_message, events.get(k, ()))))

    def packed(self, block: SampleBlock) -> tuple[Any, Any, list[tuple[int, int]]]:
        """Stamps [ns], shape (n,); message bytes, shape (n, size); and start and end of each
        topic's message in a row of them."""
        stamps = stamps_of(block)
        return stamps, self._packer.fill(block, stamps), self._packer.bounds

    def messages_of_rows(self, rows: Sequence[SampleRow]) -> list[SampleMessages]:
        """Messages of each sample, given as a row: the same bytes as `messages`, faster."""
        stamps = [stamp_of(one.t) for one in rows]
        numbers, commands = (np.array([one[i] for one in rows]) for i in (1, 2))
        packed = self._packer.pack_rows(numbers, commands, stamps)
        event_messages = ([event_message(event) for event in one.events] for one in rows)
        return list(map(SampleMessages, stamps, packed, event_messages))


def _check_names(entries: list[Topic]) -> None:
    seen: set[str] = set()
    for topic in entries:
        name = topic.full_name()
        if name in seen:
            raise SinkError(f"topic {name}: two sources have it; rename the body or the constraint")
        seen.add(name)


def _body_topics(layout: SampleLayout, prefix: str, of: Any) -> Iterator[Topic]:
    pose, twist = (
        cdr.codec(kind, prefix + WORLD) for kind in (cdr.POSE_STAMPED, cdr.TWIST_STAMPED)
    )
    for i, name in enumerate(layout.bodies):
        columns = [*of.position[i], *of.orientation[i]]
        yield Topic(body_topic(name, "pose"), cdr.POSE_STAMPED, pose, columns)
        columns = [*of.velocity[i], *of.spin[i]]
        yield Topic(body_topic(name, "twist"), cdr.TWIST_STAMPED, twist, columns)
    for i, name in enumerate(layout.commanded):
        codec, topic = cdr.codec(cdr.WRENCH_STAMPED, prefix + origin_frame(name)), "wrench_applied"
        yield Topic(body_topic(name, topic), cdr.WRENCH_STAMPED, codec, of.command[i])


def _reaction_topics(layout: SampleLayout, prefix: str, of: Any) -> Iterator[Topic]:
    for i, name in enumerate(layout.reactions):
        codec = cdr.codec(cdr.WRENCH_STAMPED, prefix + anchor_frame(name))
        columns = [*of.reaction_force[i], *of.reaction_torque[i]]
        yield Topic(reaction_topic(name), cdr.WRENCH_STAMPED, codec, columns)


def _scalar_topics(of: Any) -> Iterator[Topic]:
    for name, columns in (
        ("energy", of.energy),
        ("energy/kinetic", of.kinetic_energy),
        ("energy/potential", of.potential_energy),
        ("power", of.power),
        ("residual", of.residual),
    ):
        yield Topic(name, cdr.FLOAT64, cdr.codec(cdr.FLOAT64), columns)


def _contact_topics(layout: SampleLayout, of: Any) -> Iterator[Topic]:
    for name in layout.contacts:
        yield Topic(state_topic(name), cdr.UINT8, cdr.codec(cdr.UINT8))
    if layout.contacts:
        yield Topic(CONTACT_WORK, cdr.FLOAT64, cdr.codec(cdr.FLOAT64), of.contact_work)


def _tf_topic(layout: SampleLayout, prefix: str, of: Any) -> Topic:
    children = [
        *(body_frame(name) for name in layout.bodies),
        *(anchor_frame(name) for name in layout.reactions),
        *(origin_frame(name) for name in layout.commanded),
    ]
    frames = [name for child in children for name in (prefix + WORLD, prefix + child)]
    codec = cdr.codec(cdr.TF_MESSAGE, *frames, lengths=[len(children)])
    points = [*of.anchor, *(of.position[layout.bodies.index(name)] for name in layout.commanded)]
    columns = [*np.hstack([of.position, of.orientation]).ravel()]
    columns += [column for point in points for column in (*point, *NO_ROTATION)]
    return Topic(TF, cdr.TF_MESSAGE, codec, columns)


# BODY/accel: time derivative of BODY/twist as geometry_msgs/AccelStamped, on request.
#
#     a_O = a_C - R (dw/dt x r_OC + w x (w x r_OC))
#
# with a_C (world axes), w and dw/dt (body axes) of the samples; the message contains a_O and
# R dw/dt in world axes, like the twist.


Accelerating = Callable[["SampleBlock"], Any]
"""Function of a block: linear accelerations of C, world axes [m/s^2], and dw/dt, body axes
[rad/s^2], of shape (n, bodies, 3)."""

Asked = Callable[["Scene", "SampleLayout"], Accelerating]
"""Makes an `Accelerating` for a run, e.g. rb_sim.simulation.record.accelerating."""


class AccelTable:
    """BODY/accel messages of all bodies. prefix: prepended to the frame name."""

    latched = False

    def __init__(self, scene: Scene, layout: SampleLayout, asked: Asked, prefix: str = "") -> None:
        self._accelerations = asked(scene, layout)
        self._center_of_mass = centers_of_mass(scene.bodies, layout.bodies)
        self._codec = cdr.codec(cdr.ACCEL_STAMPED, prefix + WORLD)
        self.topics = [(body_topic(body, "accel"), cdr.ACCEL_STAMPED) for body in layout.bodies]

    def rows(self, block: SampleBlock) -> list[Any]:
        """As in MessageTable."""
        linear, angular = self._accelerations(block)
        spin, arm = block.angular_velocity, -self._center_of_mass
        own = cross(angular, arm) + cross(spin, cross(spin, arm))
        turned = rotate(block.orientation, own), rotate(block.orientation, angular)
        values = np.concatenate([linear + turned[0], turned[1]], axis=2)
        stamps = stamps_of(block)
        return [self._codec.pack_rows(stamps, values[:, i]) for i in range(len(self.topics))]


class OdometryTable:
    """BODY/odometry messages: pose in the world, twist of the body's origin in body axes.

    prefix: as in AccelTable.
    """

    latched = False

    def __init__(self, scene: Scene, layout: SampleLayout, prefix: str = "") -> None:
        self._center_of_mass = centers_of_mass(scene.bodies, layout.bodies)
        names = layout.bodies
        frames = [(prefix + WORLD, prefix + body_frame(name)) for name in names]
        self._codecs = [cdr.codec(cdr.ODOMETRY, *pair) for pair in frames]
        self.topics = [(body_topic(name, "odometry"), cdr.ODOMETRY) for name in names]

    def rows(self, block: SampleBlock) -> list[Any]:
        """As in MessageTable."""
        motion = origins(block, self._center_of_mass)
        velocity_B = rotate(conjugate(block.orientation), motion.linear_velocity)
        none = np.zeros((*block.position.shape[:2], cdr.COVARIANCE_6X6))
        pose = (motion.position, block.orientation, none)
        values = np.concatenate([*pose, velocity_B, block.angular_velocity, none], axis=2)
        stamps = stamps_of(block)
        return [codec.pack_rows(stamps, values[:, i]) for i, codec in enumerate(self._codecs)]


# Latched messages: sent once, and delivered to late subscribers.


class Latched(NamedTuple):
    """A message that is sent once."""

    topic: str
    """absolute topic name."""
    ros_type: str
    data: bytes


def latched_messages(
    scene: Scene,
    layout: SampleLayout,
    initial: SampleBlock,
    namespace: str,
    record: Mapping[str, str],
) -> list[Latched]:
    """The latched messages of a scene.

    initial: its first sample; namespace: name of the node; record: metadata record of the bag."""
    beside = namespace.rpartition("/")[0]
    document, text = urdf(scene, layout, initial), description(scene, record)
    return [
        Latched(f"{namespace}/{DESCRIPTION}", cdr.STRING, cdr.string(text)),
        Latched(f"{beside}/{ROBOT_DESCRIPTION}", cdr.STRING, cdr.string(document)),
        Latched(f"{namespace}/{MARKERS}", cdr.MARKER_ARRAY, marker_array(scene)),
    ]


def description(scene: Scene, record: Mapping[str, str] | None = None) -> str:
    """Description of the scene as JSON. record: of a bag, read back by `record_in`."""
    document = {
        "rb_sim": __version__,
        "scene": scene.name,
        "description": scene.description,
        "bodies": {name: {"mass": body.mass} for name, body in scene.bodies.items()},
        "constraints": {name: spec.type for name, spec in scene.constraints.items()},
        "effects": {name: spec.type for name, spec in scene.effects.items()},
        "rate": scene.simulation.rate,
        "method": scene.simulation.method,
    }
    return json.dumps(document | ({} if record is None else {_RECORD: dict(record)}))


_RECORD = "record"


def record_in(data: bytes) -> dict[str, str] | None:
    """The metadata record in a message of the topic `description`; None if it contains none."""
    try:
        found = json.loads(cdr.read_string(data))[_RECORD]
    except (ValueError, KeyError, TypeError):
        return None
    texts = isinstance(found, dict) and all(isinstance(value, str) for value in found.values())
    return found if texts else None


# Inputs of a run (commands, resets, set states) as messages of a bag, and back.
#
# Each is recorded before the first sample that it affects, so that the run can be repeated.


STATE = (
    *("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx_body", "wy_body", "wz_body"),
    *("bodies_together", "project"),
)
"""Names of the numbers in a message of a state that was set: Input.state, together, project."""


class InputTable:
    """Messages of commands, resets and set states. topics: (name, ROS type) of each."""

    def __init__(self, layout: SampleLayout) -> None:
        self._bodies = layout.commanded
        self._world = cdr.codec(cdr.WRENCH_STAMPED, WORLD)
        self._own = {
            body: cdr.codec(cdr.WRENCH_STAMPED, body_frame(body)) for body in layout.commanded
        }
        self._reset, self._placed = cdr.codec(cdr.CLOCK), layout.bodies
        numbers = [len(STATE)] * 2  # of names and positions; no velocities, no efforts
        self._state = cdr.codec(cdr.JOINT_STATE, WORLD, *STATE, lengths=[*numbers, 0, 0])
        commands = [(command_topic(body), cdr.WRENCH_STAMPED) for body in layout.commanded]
        states = [(body_topic(body, STATE_COMMAND), cdr.JOINT_STATE) for body in layout.bodies]
        self.topics = (*commands, (RESETS, cdr.CLOCK), *states)

    def message(self, given: Input) -> tuple[int, bytes]:
        """Index of the topic, and the message of an input."""
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
        """The input in a message. index: of its sample. Raises ValueError for other messages."""
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


def _stamp(codec: cdr.Codec, data: bytes) -> int:
    return int(codec.unpack_stamps(np.frombuffer(data, np.uint8)[None])[0])
