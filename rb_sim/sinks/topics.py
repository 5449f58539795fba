"""The one table of topics: what the node publishes and the bag records. SI units.

| topic                  | type          | numbers                           | frame_id          |
|------------------------|---------------|-----------------------------------|-------------------|
| BODY/pose              | PoseStamped   | of the body frame (its origin O)  | world             |
| BODY/twist             | TwistStamped  | velocity of O, angular velocity   | world             |
| BODY/wrench_applied    | WrenchStamped | commanded wrench as applied       | BODY/origin       |
| reactions/CONSTRAINT   | WrenchStamped | BY the constraint ON the body     | CONSTRAINT/anchor |
| energy                 | Float64       | kinetic plus potential [J]        |                   |
| energy/kinetic         | Float64       | [J]                               |                   |
| energy/potential       | Float64       | [J]                               |                   |
| power                  | Float64       | of what has no potential [W]      |                   |
| residual               | Float64       | worst violation of a constraint   |                   |
| /tf                    | TFMessage     | BODY and the frames of wrenches   | world             |
| /clock                 | Clock         | simulated time                    |                   |

Names without a leading slash are under the node's name (NAMESPACE unless it was renamed). A wrench
acts at the origin of the frame that its frame_id names, and its numbers are in that frame's axes.
`BODY/origin` and `CONSTRAINT/anchor` have the axes of the world; the first moves with the body's
origin, the second with the point of the constraint. Bearings are CONSTRAINT/A and CONSTRAINT/B.
The slash keeps these frames apart from any body's, whose names have none.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.errors import SinkError
from rb_sim.sinks import cdr
from rb_sim.sinks import message_types as types
from rb_sim.sinks.frames import Origins, centers_of_mass, origins

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

NAMESPACE = "/rb_sim"
WORLD = "world"
TF = "/tf"
CLOCK = "/clock"

_NO_ROTATION = (0.0, 0.0, 0.0, 1.0)

Values = Callable[["SampleBlock", Origins], "Array"]


class Topic(NamedTuple):
    """One topic.

    name: relative to the node's name, or absolute with a leading slash.
    values: numbers of the messages, shape (n, codec.size), from a block and its body origins.
    """

    name: str
    ros_type: str
    codec: cdr.Codec
    values: Values

    def full_name(self, namespace: str = NAMESPACE) -> str:
        """Absolute name for a node called `namespace`."""
        return self.name if self.name.startswith("/") else f"{namespace}/{self.name}"


def origin_frame(body: str) -> str:
    """Frame with world axes at the origin of `body`."""
    return f"{body}/origin"


def anchor_frame(reaction: str) -> str:
    """Frame with world axes at the anchor of `reaction`."""
    return f"{reaction}/anchor"


class TopicTable:
    """The topics of a scene, and the messages of a block.

    skip: names of topics to leave out, as in Topic.name.
    Raises SinkError where two topics would have one name.
    """

    def __init__(self, scene: Scene, layout: SampleLayout, skip: Collection[str] = ()) -> None:
        self._center_of_mass = centers_of_mass(scene.bodies, layout.bodies)
        entries = [*_body_topics(layout), *_reaction_topics(layout), *_scalar_topics()]
        entries += [_tf_topic(layout), Topic(CLOCK, types.CLOCK, cdr.clock(), _nothing)]
        _check_names(entries)
        self.topics = tuple(topic for topic in entries if topic.name not in skip)

    def messages(self, block: SampleBlock) -> Iterator[tuple[int, list[bytes]]]:
        """For each sample its stamp [ns] and its messages, in the order of `topics`."""
        motion = origins(block, self._center_of_mass)
        columns = [topic.values(block, motion).tolist() for topic in self.topics]
        packers = [topic.codec.pack for topic in self.topics]
        stamps = np.rint(block.t * cdr.NANO).astype(np.int64).tolist()
        for k, stamp in enumerate(stamps):
            yield (
                stamp,
                [pack(stamp, rows[k]) for pack, rows in zip(packers, columns, strict=True)],
            )


def _check_names(entries: list[Topic]) -> None:
    seen: set[str] = set()
    for topic in entries:
        name = topic.full_name()
        if name in seen:
            raise SinkError(f"topic {name}: two sources have it; rename the body or the constraint")
        seen.add(name)


def _body_topics(layout: SampleLayout) -> Iterator[Topic]:
    pose, twist = cdr.pose_stamped(WORLD), cdr.twist_stamped(WORLD)
    for i, name in enumerate(layout.bodies):
        yield Topic(f"{name}/pose", types.POSE_STAMPED, pose, _pose(i))
        yield Topic(f"{name}/twist", types.TWIST_STAMPED, twist, _twist(i))
    for i, name in enumerate(layout.commanded):
        codec = cdr.wrench_stamped(origin_frame(name))
        yield Topic(f"{name}/wrench_applied", types.WRENCH_STAMPED, codec, _command(i))


def _reaction_topics(layout: SampleLayout) -> Iterator[Topic]:
    for i, name in enumerate(layout.reactions):
        codec = cdr.wrench_stamped(anchor_frame(name))
        yield Topic(f"reactions/{name}", types.WRENCH_STAMPED, codec, _reaction(i))


def _scalar_topics() -> Iterator[Topic]:
    for name, field in (
        ("energy", "energy"),
        ("energy/kinetic", "kinetic_energy"),
        ("energy/potential", "potential_energy"),
        ("power", "power"),
        ("residual", "residual"),
    ):
        yield Topic(name, types.FLOAT64, cdr.float64(), _scalar(field))


def _tf_topic(layout: SampleLayout) -> Topic:
    children = [
        *layout.bodies,
        *(anchor_frame(name) for name in layout.reactions),
        *(origin_frame(name) for name in layout.commanded),
    ]
    codec = cdr.tf_message([(WORLD, child) for child in children])
    return Topic(TF, types.TF_MESSAGE, codec, _transforms(layout))


def _pose(i: int) -> Values:
    return lambda block, motion: np.hstack([motion.position[:, i], block.orientation[:, i]])


def _twist(i: int) -> Values:
    return lambda _, motion: np.hstack(
        [motion.linear_velocity[:, i], motion.angular_velocity[:, i]]
    )


def _command(i: int) -> Values:
    return lambda block, _: block.command[:, i]


def _reaction(i: int) -> Values:
    return lambda block, _: np.hstack([block.reaction_force[:, i], block.reaction_torque[:, i]])


def _scalar(field: str) -> Values:
    return lambda block, _: getattr(block, field)[:, None]


def _nothing(block: SampleBlock, _: Origins) -> Array:
    return np.empty((len(block), 0))


def _transforms(layout: SampleLayout) -> Values:
    commanded = [layout.bodies.index(name) for name in layout.commanded]

    def values(block: SampleBlock, motion: Origins) -> Array:
        moving = np.concatenate([motion.position, block.orientation], axis=2)
        points = np.concatenate([block.anchor, motion.position[:, commanded]], axis=1)
        turns = np.broadcast_to(_NO_ROTATION, (*points.shape[:2], 4))
        fixed = np.concatenate([points, turns], axis=2)
        return np.concatenate([moving, fixed], axis=1).reshape(len(block), -1)

    return values
