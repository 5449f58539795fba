"""~/BODY/accel (geometry_msgs/AccelStamped): published where parameter `accelerations` asks."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rb_sim.accelerations import accelerating
from rb_sim.errors import RbSimError
from rb_sim.ros.offers import offer
from rb_sim.sinks.accelerations import AccelTable

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.ros.parameters import Settings
    from rb_sim.scene.schema import Scene


class Accel:
    """Publishes the accelerations of every body."""

    def __init__(self, node: Node, settings: Settings) -> None:
        self._node, self._settings = node, settings
        self._publishers: list[Publisher] = []

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the publishers. RbSimError: the method has no accelerations."""
        if scene.simulation.method == "time_stepping":
            raise RbSimError(
                "parameter accelerations: method time_stepping has none; must be another method"
            )
        self._table = AccelTable(scene, layout, accelerating, self._settings.frame_prefix)
        kind = import_module("geometry_msgs.msg").AccelStamped
        for name, _ in self._table.topics:
            publisher = offer(self._node, kind, f"~/{name}", self._settings.publish_depth)
            self._publishers.append(publisher)

    def write(self, block: SampleBlock) -> None:
        """Publish every sample of the block."""
        for messages in self._table.messages(block):
            for publisher, data in zip(self._publishers, messages, strict=True):
                publisher.publish(data)

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Remove the publishers."""
        for publisher in self._publishers:
            self._node.destroy_publisher(publisher)
        self._publishers = []
