"""Samples to topics: the messages of the one topic table, as the bytes that the bag records too."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

from rb_sim.sinks.topics import CLOCK, TF, Topic, TopicTable

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


class TopicSink:
    """Publishes each sample once. depth: messages kept for a slow subscriber (/clock: 1)."""

    def __init__(self, node: Node, depth: int) -> None:
        self._node = node
        self._depth = depth
        self._publishers: list[Publisher] = []

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the publishers."""
        self._table = TopicTable(scene, layout, skip=_unavailable())
        self._publishers = [self._publisher(topic) for topic in self._table.topics]

    def write(self, block: SampleBlock) -> None:
        """Publish every sample of the block."""
        for _, messages in self._table.messages(block):
            for publisher, data in zip(self._publishers, messages, strict=True):
                publisher.publish(data)

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Remove the publishers."""
        for publisher in self._publishers:
            self._node.destroy_publisher(publisher)
        self._publishers = []

    def _publisher(self, topic: Topic) -> Publisher:
        name = topic.name if topic.name.startswith("/") else f"~/{topic.name}"
        depth = 1 if topic.name == CLOCK else self._depth
        qos = QoSProfile(
            history=QoSHistoryPolicy.KEEP_LAST,
            depth=depth,
            reliability=QoSReliabilityPolicy.RELIABLE,
        )
        return self._node.create_publisher(_message_class(topic.ros_type), name, qos)


def _message_class(ros_type: str) -> type:
    package, kind, name = ros_type.split("/")
    return getattr(import_module(f"{package}.{kind}"), name)


def _unavailable() -> tuple[str, ...]:
    """/tf where tf2_msgs is not installed (it is with ROS, but not on PyPI)."""
    try:
        import_module("tf2_msgs.msg")
    except ImportError:
        return (TF,)
    return ()
